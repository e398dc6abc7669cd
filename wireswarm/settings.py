"""Settings of a run from the arguments of a function."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deploy import config
from protocol.configuration import ConfigError


def settings_of(
    arguments: Mapping[str, object], settings: Mapping[str, Any] | None, file: str | Path | None = None
) -> config.RunConfig:
    """Configuration of one process from arguments named like a setting, None where not given, and further settings.

    Both win over the file, as flags and --set of the command line do. Raises ConfigError, also for a key in both, and
    for what only processes can heed.
    """
    further, given = dict(settings or {}), {key: value for key, value in arguments.items() if value is not None}
    for key in given:
        if key in further:
            raise ConfigError(f"{key}: given twice, as an argument and in settings")
    flags = {key: str(value) if isinstance(value, Path) else value for key, value in (further | given).items()}
    loaded = config.load(None if file is None else Path(file), flags)
    config.check_heeded(loaded, config.ONE_PROCESS, "a run in one process")
    return loaded
