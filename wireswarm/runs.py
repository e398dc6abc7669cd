"""Runs for notebooks: robots in this process, or a run directory that is already there."""

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from agent.shell.mind import minds_of
from deploy import config, inprocess
from deploy.report.rundir import Run, read_run
from world.episode import Episode
from world.worldfile import bundled


def run(
    world: str | Path = "maze-15",
    robots: int = 3,
    seed: int = 0,
    *,
    until: float | str = "complete",
    settings: Mapping[str, Any] | None = None,
    file: str | Path | None = None,
    out: str | Path | None = None,
    progress: Callable[[Episode], None] | None = None,
) -> Run:
    """Robots explore a world in this process, and the run is returned as load() would read it.

    It gives the same maps, paths and events as `wireswarm run` with the same settings, byte for byte.

    world:    a bundled world's name (see worlds()) or a world file.
    until:    "complete", or simulated seconds.
    settings: further settings by dotted key, such as {"radio.range_m": 6}; `wireswarm config` lists them.
    file:     a YAML file of settings; the arguments here win over it.
    out:      run directory to write; without one, nothing stays on the disk.
    progress: called after every tick with the episode: its `tick`, its `robots`.

    Raises protocol.configuration.ConfigError, world.worldfile.WorldFileError and FileExistsError.
    """
    given = {"world": str(world), "robots": robots, "seed": seed, "until": until}
    loaded = config.load(None if file is None else Path(file), {**(settings or {}), **given})
    with TemporaryDirectory(prefix="wireswarm-") as temporary:
        directory = Path(temporary, "run") if out is None else Path(out)
        if directory.exists() and any(directory.iterdir()):
            raise FileExistsError(f"{directory}: something is there already")
        inprocess.run(loaded, loaded.agent, directory, progress, minds_of(loaded.mind))
        return read_run(directory)


load, worlds = read_run, bundled
