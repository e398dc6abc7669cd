"""Options that several commands have, and the settings that they make."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Context, Option

from protocol.command import say

if TYPE_CHECKING:
    from deploy.config import RunConfig
    from protocol.messages import RobotSpec

SETTINGS_BELOW = ("radio.range_m", *(f"server.{name}" for name in ("real_time", "listen", "connect", "insecure")))

World = Annotated[
    str | None,
    Option(help="A bundled world's name, generated-WIDTHxHEIGHT-SEED, or a world file.", show_default="maze-15"),
]
Robots = Annotated[int | None, Option(help="How many robots.", show_default="3")]
Seed = Annotated[int | None, Option(help="All that is random is drawn from it.", show_default="0")]
RunDirectory = Annotated[Path, Argument(help="Run directory.", metavar="DIR")]
Out = Annotated[Path | None, Option(help="Run directory.", show_default="runs/WORLD-SEED, with -2, -3, ...")]
Range = Annotated[float | None, Option("--range", help="Radio range in metres.", show_default="4.0")]
Until = Annotated[
    str | None, Option(help="`complete` or simulated seconds.", metavar="complete|SECONDS", show_default="complete")
]
MaxTime = Annotated[float | None, Option("--max-time", help="Simulated seconds at most.", show_default="7200")]
RealTime = Annotated[
    float | None, Option(help="Simulated seconds per second of the clock; without, as fast as the machine goes.")
]
ConfigFile = Annotated[Path | None, Option("--config", help="YAML file with settings.")]
Listen = Annotated[
    str | None, Option(help="Endpoint to listen on, such as tcp/0.0.0.0:7447.", show_default="a free port of 127.0.0.1")
]
Set = Annotated[list[str] | None, Option("--set", help="One setting, such as starts=random.", metavar="KEY=VALUE")]
Quick = Annotated[bool, Option("--quick", help="Small, for tests.")]
Ideal = Annotated[bool, Option("--ideal", help="The paper's sensing: scans at one instant, exact odometry.")]
Pairs = Annotated[bool, Option("--pairs", help="Print who met whom, for more than six robots, too.")]
Quiet = Annotated[bool, Option("--quiet", help="No progress.")]
Jobs = Annotated[int | None, Option(help="Cases at a time.", show_default="one a core", min=1)]
Results = Annotated[Path, Option(help="Where figures are kept, so that nothing is measured twice.")]


def settings_of(context: Context) -> RunConfig:
    """Configuration of a command from its flags (parameters named like a setting), --config and --set.

    Raises ConfigError, and WorldFileError before anything is made for a world that cannot be run.
    """
    from deploy.config import RunConfig, load
    from deploy.sensing import IDEAL
    from world.draws import starts_of
    from world.worldfile import load as load_world

    given, keys = context.params, (*RunConfig.model_fields, *SETTINGS_BELOW)
    flags = {key: given[name] for key in keys if (name := key.split(".")[-1]) in given}
    if minds := flags.pop("mind", ()):
        flags["mind"] = {robot or "*": name for robot, _, name in (one.rpartition("=") for one in minds)}
    if given.get("ideal"):
        flags |= {f"spec.{part}.{key}": value for part, some in IDEAL.items() for key, value in some.items()}
    settings = load(given["config"], flags, given["set_"] or ())
    if "world" in given:
        sure = settings.model_copy(update={"robots": 1}) if given.get("settle_s") else settings  # else it may be fewer
        starts_of(sure, load_world(settings.world))
    return settings


def say_doubts(spec: RobotSpec) -> None:
    """Tell why a complete map is not to be expected of robots, before they drive."""
    from agent.limits import INCOMPLETE, doubts

    for doubt in doubts(spec):
        say(f"{INCOMPLETE}: {doubt}")
