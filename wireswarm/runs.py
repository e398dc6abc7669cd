"""Runs for notebooks: robots in this process, or a run directory that is already there."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from agent.shell.mind import minds_of
from deploy import inprocess
from deploy.report.rundir import Run, read_run
from protocol.temporary import temporary_folder
from wireswarm.settings import settings_of
from world.episode import Episode
from world.worldfile import bundled


def run(
    world: str | Path | None = None,
    robots: int | None = None,
    seed: int | None = None,
    *,
    until: float | str | None = None,
    settings: Mapping[str, Any] | None = None,
    file: str | Path | None = None,
    out: str | Path | None = None,
    progress: Callable[[Episode], None] | None = None,
) -> Run:
    """Robots explore a world in this process, and the run is returned as load() would read it.

    It gives the same maps, paths and events as `wireswarm run` with the same settings, byte for byte.

    world:    a bundled world's name (see worlds()) or a world file; maze-15 where nothing says it.
    robots:   how many; 3 where nothing says it.
    seed:     of all that is random; 0 where nothing says it.
    until:    "complete", which it is where nothing says it, or simulated seconds.
    settings: further settings by dotted key, such as {"radio.range_m": 6}; `wireswarm config` lists them.
    file:     a YAML file of settings; arguments and `settings` win over it.
    out:      run directory to write; without one, nothing stays on the disk.
    progress: called after every tick with the episode: its `tick`, its `robots`.

    Raises protocol.configuration.ConfigError, also for what is an argument and in `settings`;
    world.worldfile.WorldFileError and FileExistsError.
    """
    loaded = settings_of({"world": world, "robots": robots, "seed": seed, "until": until}, settings, file)
    with temporary_folder() as temporary:
        directory = temporary / "run" if out is None else Path(out)
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise FileExistsError(f"{directory}: something is there already")
        inprocess.run(loaded, loaded.agent, directory, progress, minds_of(loaded.mind))
        return read_run(directory)


load, worlds = read_run, bundled
