"""Files of others: recorded logs, worlds in, maps and runs out."""

from __future__ import annotations

import gc
import math
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option, Typer

from deploy.commands import results
from deploy.commands.options import ConfigFile, Quiet
from protocol.command import say, tell
from protocol.status import Status
from protocol.text import printable

commands = Typer()


@commands.command("map", epilog="Example: wireswarm map intel.log.gz --out runs/intel")
def map_(
    logs: Annotated[
        list[Path],
        Argument(
            help="CARMEN text (.gz or not), bags of ROS 1 or 2 (.bag, .mcap, .db3, a folder), runs.", metavar="LOG..."
        ),
    ],
    out: Annotated[Path, Option(help="Run directory.", show_default=False)],
    field_of_view_deg: Annotated[
        float | None,
        Option("--field-of-view", help="Degrees, where a log does not tell.", show_default="180", min=1, max=360),
    ] = None,
    range_max_m: Annotated[
        float | None,
        Option(
            "--range-max", help="Metres from which on nothing came back.", show_default="by the log", min=0.05, max=100
        ),
    ] = None,
    scan_topic: Annotated[
        str | None, Option("--scan-topic", help="Of a bag's LaserScan.", show_default="that with most messages")
    ] = None,
    odometry_topic: Annotated[
        str | None, Option("--odometry-topic", help="Of a bag's Odometry.", show_default="likewise; without any, tf")
    ] = None,
    mount: Annotated[
        tuple[float, float, float] | None,
        Option(help="Where the lidar is on the robot of a bag's Odometry: m, m, degrees.", show_default="by tf"),
    ] = None,
    revolution_s: Annotated[
        float | None,
        Option(
            "--revolution",
            help="Seconds that the lidar turns for a scan, where a log does not tell it right; 0 for one moment.",
            show_default="by its scans",
            min=0,
            max=100,
        ),
    ] = None,
    upside_down: Annotated[
        bool | None, Option("--upside-down", help="The lidar of a bag is, though no tf tells so.", show_default=False)
    ] = None,
    reference: Annotated[
        list[Path] | None,
        Option(help="The lidar's true poses by number of scan, TUM; one a log. They gate the radio and nothing else."),
    ] = None,
    split: Annotated[int, Option(help="Cut each log into so many robots, which drive at once.", min=1, max=100)] = 1,
    range_m: Annotated[
        float, Option("--range", help="Radio range in metres, where references say who is where.", min=0.01, max=10**9)
    ] = 4.0,
    config: ConfigFile = None,
    set_: Annotated[
        list[str] | None,
        Option("--set", help="One setting of the minds, such as agent.filter.particles=3.", metavar="KEY=VALUE"),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Map recorded lidar logs, each by a mind of its own that is not asked to drive. Several are a team."""
    from agent.warmup import rehearse_carried
    from deploy.launch.interrupts import on_interrupt
    from deploy.launch.launcher import run_directory
    from deploy.recorded.lidar_log import Given
    from deploy.recorded.mapping import LogsConfig, map_logs
    from deploy.recorded.reading import read_logs
    from deploy.recorded.team import cut, refer
    from deploy.recorded.words import print_mapped
    from deploy.report import write_report
    from protocol.configuration import load
    from protocol.errors import InputError
    from protocol.settings import MAX_NUMBER

    settings = load(LogsConfig, config, None, set_ or (), shared=True)
    if mount is not None and not all(abs(number) <= MAX_NUMBER for number in mount):  # NaN is not
        raise InputError(f"--mount: three numbers of at most {MAX_NUMBER:g} are wanted")
    on_robot = None if mount is None else (mount[0], mount[1], math.radians(mount[2]))
    of_bags = (scan_topic, odometry_topic, on_robot, revolution_s, upside_down)
    team = read_logs(logs, Given(field_of_view_deg, range_max_m, *of_bags))
    refer(team, reference or [])
    rehearse_carried()
    gc.freeze()  # what is loaded lives on: looking it through for garbage took 60 ms of a scan
    with run_directory(out, "", 0) as (directory, made), on_interrupt(partial(_leave, directory, made)):
        summary = map_logs(cut(team, split), settings.agent, directory, range_m=range_m, quiet=quiet)
        print_mapped(directory, summary)
        tell(printable(str(write_report(directory))))


def _leave(out: Path, made: list[Path]) -> None:
    """End at once; where no map is written yet, nothing stays, of the folders that were `made` neither."""
    from deploy import manifest
    from deploy.launch import forks
    from protocol.files import remove_empty, remove_parts

    with suppress(OSError):
        remove_parts(out)
        if any(file.name != manifest.FILE for file in out.iterdir()):
            results.leave(out, made)
        manifest.withdraw(out)
        remove_empty(made)
    say(f"interrupted before a map was written to {out}")
    forks.leave(Status.INTERRUPTED)


@commands.command("import", epilog="Example: wireswarm import home.world --out home.yaml --close 2")
def import_(
    file: Annotated[
        Path, Argument(help="A map_server YAML, SDF, picture, HouseExpo JSON, GeoJSON, DXF, or SVG or map of ours.")
    ],
    out: Annotated[
        Path, Option(help="World file to write; a picture goes beside it.", metavar="WORLD.yaml", show_default=False)
    ],
    width_m: Annotated[
        float | None,
        Option(
            "--width", help="Metres that a picture without a YAML, or a DXF without a unit, is wide.", min=0.1, max=1000
        ),
    ] = None,
    height_m: Annotated[
        float, Option("--height", help="Metres above the ground at which SDF is cut: the lidar's.", min=-100, max=100)
    ] = 0.182,
    models: Annotated[
        list[Path] | None, Option(help="Folder in which SDF's model://NAME is looked for.", metavar="DIR")
    ] = None,
    close_m: Annotated[
        float, Option("--close", help="Close openings of the outer walls up to so many metres wide.", min=0, max=20)
    ] = 0.0,
    boundary: Annotated[bool, Option("--boundary", help="Put a wall around a picture, as Stage does.")] = False,
    as_is: Annotated[bool, Option("--as-is", help="Leave outlines of pictures and HouseExpo as they are.")] = False,
    robots: Annotated[int, Option(help="How many robots must have room to start.", min=1, max=500)] = 3,
) -> None:
    """Make a world file from a file of another program."""
    from deploy.exchange.worlds import Options, import_world

    options = Options(width_m, height_m, tuple(models or ()), close_m, boundary, not as_is, robots)
    for line in import_world(file, out, options):
        print(printable(line))


@commands.command(epilog="Example: wireswarm export runs/maze-15-0 --to geojson --frame world")
def export(
    path: Annotated[Path, Argument(help="A run directory, or a map file of it.", metavar="DIR|MAP")],
    to: Annotated[
        Literal["map_server", "geojson", "dxf", "svg", "carmen", "video", "mcap"],
        Option(help="The form; carmen needs a run with --set scans=true."),
    ],
    frame: Annotated[
        Literal["own", "world"] | None, Option(help="Frame of a map: its robot's, or the world's.", show_default="own")
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the files.", show_default="FORM in DIR, or beside MAP")] = None,
) -> None:
    """Write maps for other programs, a run's scans as CARMEN logs, or a run as a moving picture or for Foxglove."""
    from deploy.exchange import FORMS
    from deploy.exchange.maps import export_maps
    from protocol.errors import InputError

    folder = out or (path if path.is_dir() else path.parent) / to
    if to in ("carmen", "video", "mcap"):
        if frame is not None:
            raise InputError("--frame: it is for maps, leave it out")
        made = _exported_run(path, to, folder)
    else:
        made = export_maps(path, folder, frame or "own", FORMS[to])
    for file in made:
        print(printable(str(file)))


def _exported_run(run: Path, to: str, folder: Path) -> list[Path]:
    if to == "carmen":
        from deploy.recorded.written import write_carmen

        return write_carmen(run, folder)
    if to == "video":
        from deploy.exchange.video import write_video

        return write_video(run, folder)
    from deploy.exchange.mcap import write_mcap

    return write_mcap(run, folder)
