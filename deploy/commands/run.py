"""`wireswarm run`: a world and its robots, one process each."""

from __future__ import annotations

import shlex
import shutil
import sys
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Context, Exit, Option, Typer

from deploy.commands.options import (
    ConfigFile,
    Ideal,
    MaxTime,
    Out,
    Pairs,
    Quiet,
    Range,
    RealTime,
    Robots,
    Seed,
    Set,
    Until,
    World,
    say_doubts,
    settings_of,
)
from deploy.commands.results import leave, write_results
from protocol.command import say
from protocol.status import Status

if TYPE_CHECKING:
    from deploy.config import RunConfig
    from deploy.ros2 import Ros2Robots

commands = Typer()


@commands.command(epilog="Example: wireswarm run --world office --robots 4 --seed 7 --until 300")
def run(
    context: Context,
    world: World = None,
    robots: Robots = None,
    seed: Seed = None,
    out: Out = None,
    range_m: Range = None,
    until: Until = None,
    max_time_s: MaxTime = None,
    real_time: RealTime = None,
    restart: Annotated[
        bool | None, Option("--restart", help="Start a process that dies again: it goes on from its checkpoint.")
    ] = None,
    mind: Annotated[
        list[str] | None,
        Option("--mind", help="A mind in place of ours, of all robots or of one.", metavar="[ID=]package:Class"),
    ] = None,
    ideal: Ideal = False,
    as_ros2: Annotated[
        bool, Option("--ros2", help="Robots of ROS 2 in place of minds: /r1/scan, odom, tf and cmd_vel, by the clock.")
    ] = False,
    config: ConfigFile = None,
    set_: Set = None,
    view: Annotated[bool, Option("--view", help="Show the run in the browser while it goes on.")] = False,
    pairs: Pairs = False,
    quiet: Quiet = False,
) -> None:
    """Run a world and its robots, one process each, and write the run directory."""
    from deploy.launch import forks

    forks.begin()
    if view:
        import rerun_cli  # noqa: F401  (tells before the run that the extra is missing)
    from deploy.launch.interrupts import on_interrupt
    from deploy.launch.launcher import launch, run_directory
    from deploy.terminal.live import Display, print_summary
    from deploy.view.beside import beside
    from protocol.errors import InputError

    if as_ros2 and mind:
        raise InputError("--ros2: it goes without --mind, as what drives the robots is on ROS 2")
    settings, bodies = settings_of(context), None
    if as_ros2:
        settings, bodies = _of_ros2(settings)
    say_doubts(settings.spec)
    with (
        run_directory(out, settings.world, settings.seed) as (directory, made),
        on_interrupt(partial(leave, directory, made)),
        beside(directory) if view else nullcontext(),
    ):
        with Display(settings.world, str(settings.radio), quiet) as display:
            result = launch(settings, directory, show=display.show, make_mind=bodies)
        for error in result.errors:
            say(error)
        if result.status == Status.USAGE:  # nothing was run
            raise Exit(result.status)
        if result.status == Status.INTERRUPTED:
            say(f"interrupted; `wireswarm report {shlex.quote(str(directory))}` draws what there is")
            print_summary(directory, pairs)
            raise Exit(result.status)
        status = write_results(directory, pairs, result.status)
        if not (quiet or view):
            say(f"`{_as_called()} view {shlex.quote(str(directory))}` shows it as a moving picture")
        raise Exit(status)


def _as_called() -> str:
    """How the user calls `wireswarm` here."""
    if shutil.which("wireswarm"):
        return "wireswarm"
    return "python -m wireswarm" if Path(sys.argv[0]).name == "__main__.py" else shlex.quote(sys.argv[0])


def _of_ros2(settings: RunConfig) -> tuple[RunConfig, Ros2Robots]:
    """The settings of a run by the clock, and what takes the place of minds. Raises ConfigError, LinkError."""
    from deploy.ros2 import JOIN_S, Ros2Robots
    from protocol.configuration import ConfigError
    from protocol.session import open_ros2_client

    if settings.server.real_time not in (None, 1.0):  # stamps would run away from the clock of whoever drives
        raise ConfigError(
            f"server.real_time={settings.server.real_time:g}: robots of ROS 2 have stamps and speeds by the clock, "
            "so --ros2 takes 1 only"
        )
    with open_ros2_client(settings.ros2.router, JOIN_S):
        pass  # each robot opens its own; without a router nothing is begun
    server = settings.server.model_copy(update={"real_time": 1.0})
    return settings.model_copy(update={"server": server}), Ros2Robots(settings.ros2)
