"""The command `wireswarm`. What a command needs beyond the base install is imported when it runs."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
from collections.abc import Callable
from contextlib import nullcontext, suppress
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Context, Exit, Option, Typer

from agent.shell.command import Certs, agent
from protocol import command
from protocol.command import say, stop_on_signals
from protocol.status import Status, of_run
from protocol.text import printable

if TYPE_CHECKING:
    from deploy.bandwidth.representations import Measurement
    from deploy.config import RunConfig
    from deploy.ros2 import Ros2Robots
    from protocol.messages import Progress
    from world.config import WorldConfig

EXTRAS = {
    "pymunk": "world",
    "ezdxf": "export",
    "defusedxml": "export",
    "foxglove": "export",
    "rosbags": "bags",
} | dict.fromkeys(("cryptography", "matplotlib", "PIL", "psutil", "rich"), "deploy")
EXTRAS |= dict.fromkeys(("dask", "distributed", "pyarrow"), "sweep")  # what brings a package
EXTRAS |= dict.fromkeys(("rerun", "rerun_cli"), "view")
SETTINGS_BELOW = ("radio.range_m", *(f"server.{name}" for name in ("real_time", "listen", "connect", "insecure")))
NEVER_KEPT = ("resume", "secrets", "certs")  # options of a world that no file of a run holds

app = Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: wireswarm run --world office --robots 4",
)
bench = Typer(
    help="Repeatable measurements, as tables and JSON; status 4 where a bar is not met.",
    no_args_is_help=True,
    epilog="Example: wireswarm bench lidar --quick",
)
app.add_typer(bench, name="bench")

World = Annotated[
    str | None,
    Option(help="A bundled world's name, generated-WIDTHxHEIGHT-SEED, or a world file.", show_default="maze-15"),
]
Robots = Annotated[int | None, Option(help="How many robots.", show_default="3")]
Seed = Annotated[int | None, Option(help="All that is random is drawn from it.", show_default="0")]
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
Set = Annotated[list[str] | None, Option("--set", help="One setting, such as starts=random.", metavar="KEY=VALUE")]
Quick = Annotated[bool, Option("--quick", help="Small, for tests.")]
Ideal = Annotated[bool, Option("--ideal", help="The paper's sensing: scans at one instant, exact odometry.")]
Pairs = Annotated[bool, Option("--pairs", help="Print who met whom, for more than six robots, too.")]
Quiet = Annotated[bool, Option("--quiet", help="No progress.")]
Jobs = Annotated[int | None, Option(help="Cases at a time.", show_default="one a core", min=1)]
Results = Annotated[Path, Option(help="Where figures are kept, so that nothing is measured twice.")]


@app.callback(invoke_without_command=True)
def wireswarm(
    show_version: Annotated[bool, Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    """Small robots map a building together as wireframes: trust, but verify."""
    if show_version:
        print(f"wireswarm {version('wireswarm')}")
        raise Exit


@app.command(epilog="Example: wireswarm run --world office --robots 4 --seed 7 --until 300")
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
    from deploy import forks

    forks.begin()
    if view:
        import rerun_cli  # noqa: F401  (tells before the run that the extra is missing)
    from agent.limits import doubts
    from deploy.interrupts import on_interrupt
    from deploy.launcher import launch, run_directory
    from deploy.live import Display, print_summary
    from deploy.view.beside import beside

    settings, bodies = _settings(context), None
    if as_ros2:
        settings, bodies = _of_ros2(settings)
    for doubt in doubts(settings.spec):
        say(f"a complete map is not to be expected: {doubt}")
    with (
        run_directory(out, settings.world, settings.seed) as directory,
        beside(directory) if view else nullcontext(),
        on_interrupt(partial(_leave, directory)),
    ):
        with Display(settings.world, str(settings.radio), quiet) as display:
            result = launch(settings, directory, show=display.show, make_mind=bodies)
        for error in result.errors:
            say(error)
        if result.status == Status.USAGE:  # nothing was run
            raise Exit(result.status)
        if result.status == Status.INTERRUPTED:
            say(f"interrupted; `wireswarm report {directory}` draws what there is")
            print_summary(directory, pairs)
            raise Exit(result.status)
        _draw(directory, pairs)
        if not (quiet or view):
            name = "wireswarm" if shutil.which("wireswarm") else sys.argv[0]
            say(f"`{name} view {directory}` shows it as a moving picture")
        raise Exit(result.status)


def _of_ros2(settings: RunConfig) -> tuple[RunConfig, Ros2Robots]:
    """The settings of a run by the clock, and what takes the place of minds."""
    from deploy.ros2 import JOIN_S, Ros2Robots
    from protocol.session import open_ros2_client

    with open_ros2_client(settings.ros2.router, JOIN_S):
        pass  # each robot opens its own; without a router nothing is begun
    real_time = settings.server.real_time or 1.0
    server = settings.server.model_copy(update={"real_time": real_time})
    return settings.model_copy(update={"server": server}), Ros2Robots(settings.ros2, real_time)


def _draw(run: Path, pairs: bool = False) -> None:
    """Write report and bandwidth measurement of a run, as far as can be, and print its summary."""
    from deploy.live import print_summary
    from deploy.report import write_report
    from protocol.files import UnwritableError

    made = {}
    makers: dict[str, Callable[[Path], object]] = {"report": write_report}
    if (run / "bandwidth.json").exists():  # else the run broke off
        makers["bandwidth measurement"] = _measure_bandwidth
    for what, make in makers.items():
        try:
            made[what] = make(run)
        except UnwritableError as error:
            say(str(error))
        except Exception as error:  # the run itself is written and must not be lost with its picture
            say(f"no {what}: {type(error).__name__}: {error}")
    print_summary(run, pairs)
    print(printable(str(made.get("report", run))), flush=True)


def _leave(run: Path) -> None:
    """End at once, also in the midst of drawing: libraries drop what is raised, and a run that ended needs no more."""
    from deploy import forks, manifest
    from protocol.errors import InputError
    from protocol.files import remove_parts

    why = f"interrupted before the report was written; `wireswarm report {run}` writes it"
    try:
        remove_parts(run)
        manifest.interrupt(run, why)
    except (OSError, InputError):  # nothing was run yet
        with suppress(OSError):
            run.rmdir()
    else:
        say(why)
    forks.kill()
    os._exit(Status.INTERRUPTED)


def _measure_bandwidth(run: Path) -> Measurement:
    """What other forms of the maps would have cost, added to bandwidth.json, and its plots."""
    from deploy.bandwidth.plots import draw
    from deploy.bandwidth.representations import measure, write

    measurement = measure(run)
    write(run, measurement)
    draw(run, measurement)
    return measurement


@app.command("world", epilog="Example: wireswarm world --robots 2 --listen tls/0.0.0.0:7447 --certs certs")
def world_(
    context: Context,
    world: World = None,
    robots: Robots = None,
    seed: Seed = None,
    out: Out = None,
    range_m: Range = None,
    until: Until = None,
    max_time_s: MaxTime = None,
    real_time: RealTime = None,
    listen: Annotated[str | None, Option(help="Endpoint.", show_default="a free port of 127.0.0.1")] = None,
    connect: Annotated[
        str | None, Option(help="A Zenoh router between world and robots.", show_default="the world is the router")
    ] = None,
    secrets: Annotated[
        Path | None, Option(help="File of secrets, without which nobody gets in; made where there is none.")
    ] = None,
    certs: Certs = None,
    insecure: Annotated[
        bool | None, Option("--insecure", help="Let anybody take part who reaches the address.")
    ] = None,
    resume: Annotated[
        Path | None,
        Option(help="Go on in the directory of a run whose world was killed, with its settings.", metavar="DIR"),
    ] = None,
    settle_s: Annotated[
        float | None,
        Option(
            "--settle",
            help="Begin with those of --robots that have come when no further one has for so many seconds.",
            show_default="wait for all",
            min=0.1,
        ),
    ] = None,
    config: ConfigFile = None,
    set_: Set = None,
) -> None:
    """Run a world alone, for robots that join it from other terminals, containers or hosts."""
    from deploy import manifest
    from deploy.interrupts import on_interrupt
    from deploy.launcher import run_directory
    from protocol import credentials
    from protocol.errors import InputError
    from world.inbox import WorldInbox
    from world.server import serve
    from world.worldfile import load

    settings = _settings(context) if resume is None else _resumed(context, resume)
    loaded = load(settings.world)
    stop_on_signals(inbox := WorldInbox())

    def listening(endpoint: str) -> None:
        place = "listening on" if settings.server.connect is None else "robots are awaited at"
        print(f"{place} {endpoint}\nradio: {settings.radio}", flush=True)

    def begin(settings: WorldConfig) -> None:
        begun = manifest.begun(settings, loaded)
        del begun["config"]["agent"]  # each robot has its own
        manifest.begin(directory, begun)

    standing: dict[str, str] = {}  # how each robot does

    def progress(progress: Progress) -> None:
        standing.update(progress.clock.status)

    goes_on, router = resume is not None, settings.server.connect is not None
    place = nullcontext(resume) if resume else run_directory(out, settings.world, settings.seed)
    with place as directory, credentials.of_all(settings.robot_ids, secrets, certs, world=router) as known:
        if not goes_on:
            begin(settings)
        try:
            ended = serve(
                settings,
                settings.server,
                directory,
                credentials=known,
                inbox=inbox,
                resume=goes_on,
                settle_s=settle_s,
                counted=begin,
                listening=listening,
                progress=progress,
            )
        except InputError:
            if not goes_on:
                manifest.withdraw(directory)
            raise
        except Exception as error:
            manifest.finish(directory, ended="failed", exit_status=Status.FAILURE, errors=[str(error)])
            raise
        status = of_run(ended, settings.until, standing.values())
        manifest.finish(directory, ended=ended, exit_status=status)
    print(f"ended: {ended}; {printable(str(directory))}", flush=True)
    if status != Status.INTERRUPTED:
        with on_interrupt(partial(_leave, directory)):
            _draw(directory)
    raise Exit(status)


def _resumed(context: Context, run: Path) -> RunConfig:
    """Configuration of a run that goes on; only where its world listens may be new."""
    from deploy.finish import left_by
    from protocol.configuration import ConfigError

    reach = {name: value for name in ("listen", "connect", "insecure") if (value := context.params[name])}
    given = [name for name, value in context.params.items() if value and name not in (*reach, *NEVER_KEPT)]
    if given:
        raise ConfigError(f"--resume {run}: it goes on with the settings of its beginning, leave out {given[0]}")
    config = left_by(run)
    server = config.server.model_copy(update=reach)
    return config.model_copy(update={"server": server})


@app.command(epilog="Example: wireswarm router --listen tls/0.0.0.0:7447 --certs certs")
def router(
    listen: Annotated[str | None, Option(help="Endpoint.", show_default="a free port of 127.0.0.1")] = None,
    secrets: Annotated[Path | None, Option(help="File of secrets, with a line of the world.")] = None,
    certs: Certs = None,
    insecure: Annotated[bool, Option("--insecure", help="Let anybody connect who reaches the address.")] = False,
    write: Annotated[
        Path | None, Option(help="Write the configuration for `zenohd --config FILE` instead.", metavar="FILE")
    ] = None,
) -> None:
    """Run a Zenoh router between a world and its robots, with their access control."""
    from deploy.router import route, write_config
    from protocol.errors import InputError
    from protocol.inbox import Inbox

    if write is not None:
        if listen is None:
            raise InputError("--write: name the endpoint, too, such as --listen tls/0.0.0.0:7447")
        write_config(write, listen, secrets, certs, insecure=insecure)
        return
    stop_on_signals(inbox := Inbox())
    route(listen, secrets, certs, inbox, insecure=insecure)


@app.command("certs", epilog="Example: wireswarm certs certs --robots 2 --host 192.168.1.7")
def certs_(
    folder: Annotated[Path, Argument(help="Folder of certificates.", metavar="DIR")],
    robots: Annotated[str | None, Option(help="How many robots, or their names.", metavar="N|r1,r2")] = None,
    host: Annotated[
        list[str] | None,
        Option(help="A further address or name by which the world, or the router before it, is reached."),
    ] = None,
    revoke: Annotated[str | None, Option(help="Whose certificate counts no longer.", metavar="NAME")] = None,
) -> None:
    """Make identities for a world, a viewer and robots, by which they know each other over TLS."""
    from deploy.certs import issue, names_of
    from deploy.certs import revoke as end
    from protocol.errors import InputError

    if revoke is not None:
        if robots or host:
            raise InputError("--revoke: it goes alone; make another identity afterwards")
        end(folder, revoke)
        print(f"{revoke} is revoked; copies of {folder / 'roster.json'} on other hosts must be replaced")
        return
    made = issue(folder, names_of(robots), host or [])
    print(
        f"made {', '.join(made)} in {folder}\nA robot's host needs ca.pem, and NAME.pem and NAME.key of its robot; the "
        "world's ca.pem, world.pem, world.key and roster.json. ca.key stays here: who has it can make identities."
    )


@app.command(epilog="Example: wireswarm finish runs/maze-15-0")
def finish(run: Annotated[Path, Argument(help="Run directory.", metavar="DIR")]) -> None:
    """Bring a run whose world was killed to its end: summary, maps, books and report."""
    from deploy.finish import finish

    if finish(run):
        _draw(run)
    else:
        print(f"{printable(str(run))} is finished already")


@app.command(epilog="Example: wireswarm report runs/maze-15-0 --pairs")
def report(run: Annotated[Path, Argument(help="Run directory.", metavar="DIR")], pairs: Pairs = False) -> None:
    """Write the report of a run directory anew, and print its summary."""
    from deploy.live import print_summary
    from deploy.report import write_report

    made = write_report(run)
    print_summary(run, pairs)
    print(printable(str(made)))


@app.command(epilog="Example: wireswarm bandwidth runs/maze-15-0 runs/office-0")
def bandwidth(
    runs: Annotated[list[Path], Argument(help="Run directories.", metavar="DIR...")],
    as_json: Annotated[bool, Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Measure what finished runs sent, and what their maps would have cost in other forms."""
    from deploy.bandwidth.books import read_books
    from deploy.bandwidth.tables import document, print_tables

    documents = []
    for run in runs:
        documents.append(document(run, read_books(run), _measure_bandwidth(run)))
        if not as_json:
            print_tables(documents[-1])
    if as_json:
        print(json.dumps(documents, indent=1))


@app.command("map", epilog="Example: wireswarm map intel.log.gz --out runs/intel")
def map_(
    context: Context,
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
        Option("--range-max", help="Metres from which on nothing came back.", show_default="80", min=0.05, max=100),
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
    reference: Annotated[
        list[Path] | None,
        Option(help="The lidar's true poses by number of scan, TUM; one a log. They gate the radio and nothing else."),
    ] = None,
    split: Annotated[int, Option(help="Cut each log into so many robots, which drive at once.", min=1, max=100)] = 1,
    range_m: Annotated[
        float, Option("--range", help="Radio range in metres, where references say who is where.", min=0.01)
    ] = 4.0,
    config: ConfigFile = None,
    set_: Set = None,
    quiet: Quiet = False,
) -> None:
    """Map recorded lidar logs, each by a mind of its own that is not asked to drive. Several are a team."""
    from deploy.launcher import run_directory
    from deploy.recorded.lidar_log import Given
    from deploy.recorded.mapping import map_logs
    from deploy.recorded.reading import read_logs
    from deploy.recorded.team import cut, refer
    from deploy.recorded.words import print_mapped
    from deploy.report import write_report

    settings = _settings(context)
    on_robot = None if mount is None else (mount[0], mount[1], math.radians(mount[2]))
    team = read_logs(logs, Given(field_of_view_deg, range_max_m, scan_topic, odometry_topic, on_robot))
    refer(team, reference or [])
    with run_directory(out, "", 0) as directory:
        summary = map_logs(cut(team, split), settings.agent, directory, range_m=range_m, quiet=quiet)
        print_mapped(directory, summary)
        print(printable(str(write_report(directory))), flush=True)


@app.command(epilog="Example: wireswarm export runs/maze-15-0 --to geojson --frame world")
def export(
    path: Annotated[Path, Argument(help="A run directory, or a map file of it.", metavar="DIR|MAP")],
    to: Annotated[
        Literal["map_server", "geojson", "dxf", "svg", "carmen", "video", "mcap"],
        Option(help="The form; carmen needs a run with --set scans=true."),
    ],
    frame: Annotated[
        Literal["own", "world"] | None, Option(help="Frame of a map: its robot's, or the world's.", show_default="own")
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the files.", show_default="PATH/FORM")] = None,
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


@app.command(epilog="Example: wireswarm view runs/maze-15-0")
def view(
    run: Annotated[
        Path | None, Argument(help="Run directory.", metavar="DIR", show_default="the newest in runs/")
    ] = None,
    connect: Annotated[str | None, Option(help="Endpoint of a world elsewhere, in place of DIR.")] = None,
    secrets: Annotated[Path | None, Option(help="File of secrets with the viewer's line.")] = None,
    certs: Certs = None,
    save: Annotated[
        Path | None, Option(help="Write a finished run for Rerun's own viewer instead.", metavar="FILE.rrd")
    ] = None,
    browser: Annotated[bool, Option(help="Open it in the browser; else the address is printed only.")] = True,
    beside: Annotated[
        bool, Option("--beside", help="Come before the run, and end with its command.", hidden=True)
    ] = False,
) -> None:
    """Show a run in the browser: world, robots, what each has mapped, whom it tries and trusts.

    A run that is under way is shown as it goes on, a finished one from its begin.
    """
    from deploy.view import command

    if connect is not None:
        command.view_elsewhere(connect, secrets, certs, browser)
    elif save is not None:
        command.save(command.newest() if run is None else run, save)
        print(printable(str(save)))
    else:
        command.view(command.newest() if run is None else run, browser, beside)


@app.command("import", epilog="Example: wireswarm import home.world --out home.yaml --close 2")
def import_(
    file: Annotated[
        Path, Argument(help="A map_server YAML, SDF, picture, HouseExpo JSON, GeoJSON, DXF, or map of ours.")
    ],
    out: Annotated[
        Path, Option(help="World file to write; a picture goes beside it.", metavar="WORLD.yaml", show_default=False)
    ],
    width_m: Annotated[
        float | None, Option("--width", help="Metres that a picture without a YAML is wide.", min=0.1, max=1000)
    ] = None,
    height_m: Annotated[
        float, Option("--height", help="Metres above the ground at which SDF is cut: the lidar's.")
    ] = 0.182,
    models: Annotated[
        list[Path] | None, Option(help="Folder in which SDF's model://NAME is looked for.", metavar="DIR")
    ] = None,
    close_m: Annotated[
        float, Option("--close", help="Close openings of the outer walls up to so many metres wide.", min=0, max=20)
    ] = 0.0,
    boundary: Annotated[bool, Option("--boundary", help="Put a wall around a picture, as Stage does.")] = False,
    as_is: Annotated[bool, Option("--as-is", help="Leave the outlines of pictures as their cells are.")] = False,
    robots: Annotated[int, Option(help="How many robots must have room to start.", min=1, max=500)] = 3,
) -> None:
    """Make a world file from a file of another program."""
    from deploy.exchange.worlds import Options, import_world

    options = Options(width_m, height_m, tuple(models or ()), close_m, boundary, not as_is, robots)
    for line in import_world(file, out, options):
        print(printable(line))


@app.command(epilog="Example: wireswarm worlds --json")
def worlds(as_json: Annotated[bool, Option("--json", help="Print the sizes as JSON.")] = False) -> None:
    """List the bundled worlds: sizes, walls, free area, and a small drawing."""
    from deploy.worlds import to_json, to_text

    print(to_json() if as_json else to_text())


@app.command("config", epilog="Example: wireswarm config --yaml")
def config_(
    as_yaml: Annotated[bool, Option("--yaml", help="Print a file for --config with all defaults.")] = False,
    as_json: Annotated[bool, Option("--json", help="Print JSON.")] = False,
) -> None:
    """List the settings: default, unit and reason."""
    from deploy.settings import to_json, to_text, to_yaml

    print(to_json() if as_json else to_yaml() if as_yaml else to_text())


@app.command(epilog="Example: wireswarm sweep sweep.yaml --out results/range")
def sweep(
    file: Annotated[Path, Argument(help="Worlds, settings and seeds to run.", metavar="FILE.yaml")],
    out: Annotated[Path, Option(help="Folder of the results; what is there is not run again.", show_default=False)],
    workers: Annotated[
        int | None, Option(help="Processes on this machine.", show_default="one a core", min=1, max=1000)
    ] = None,
    scheduler: Annotated[
        str | None, Option(help="A Dask cluster instead, such as tls://HOST:8786.", metavar="ADDRESS")
    ] = None,
    certs: Annotated[Path | None, Option(help="Folder of `wireswarm certs` for the cluster.", metavar="DIR")] = None,
    retry_failed: Annotated[bool, Option("--retry-failed", help="Run those again that failed.")] = False,
    quiet: Quiet = False,
) -> None:
    """Make many runs, each in one process, and keep the figures of each in a Parquet file."""
    from deploy.sweep.command import sweep

    options: dict[str, Any] = {"workers": workers, "scheduler": scheduler, "certs": certs}
    runs, failed, place = sweep(file, out, retry_failed=retry_failed, quiet=quiet, **options)
    print(f"{runs} runs, {failed} of them failed; {printable(str(place))}", flush=True)
    raise Exit(Status.INCOMPLETE if failed else Status.OK)


Measures = Annotated[
    list[str] | None,
    Option("--measure", help="A column of the results, such as team.t_90.", show_default="the usual ones"),
]


@app.command(epilog="Example: wireswarm table results/range --measure team.t_90 --against radio.range_m=4")
def table(
    folder: Annotated[Path, Argument(help="Folder of results.", metavar="DIR")],
    measures: Measures = None,
    against: Annotated[
        str | None, Option(help="Compare with the runs of this setting, seed by seed.", metavar="KEY=VALUE")
    ] = None,
    out: Annotated[Path | None, Option(help="Folder for the tables as CSV, LaTeX and plots.")] = None,
) -> None:
    """Print medians of a sweep's runs, with intervals that hold them with 95 %."""
    from deploy.sweep import tables

    rows, _ = tables.select(str(folder))
    wanted = measures or tables.MEASURES
    sheets = [tables.medians(rows, wanted)]
    if against is not None:
        sheets.append(tables.against(rows, against, wanted))
    tables.show(sheets, out)


@app.command(epilog="Example: wireswarm compare results/range:radio.range_m=8 results/range:radio.range_m=4")
def compare(
    first: Annotated[str, Argument(help="Folder of results, maybe only those with some settings.", metavar="A")],
    second: Annotated[str, Argument(help="The same, such as of another commit.", metavar="B")],
    measures: Measures = None,
    out: Annotated[Path | None, Option(help="Folder for the table as CSV, LaTeX and a plot.")] = None,
) -> None:
    """Compare runs of the same seeds, A less B, with the probability that A is better.

    A and B are DIR or DIR:KEY=VALUE,KEY=VALUE.
    """
    from deploy.sweep import tables

    mine, keys = tables.select(first)
    theirs, others = tables.select(second)
    besides = ["revision", *keys, *others]
    tables.show([tables.compared(mine, theirs, besides, measures or tables.MEASURES)], out)


BENCHMARKS = {
    "lidar": "Rays a second in the bundled worlds.",
    "lockstep": "Ticks a second over Zenoh with robots that do not think, and what a robot costs in a crowd.",
    "filter": "Whole runs, faults, ambiguous walls, storage, cost and number of particles of the filter; takes hours.",
    "alignment": "Pairs of partial maps by three methods, and robots that align, verify and merge; takes hours.",
    "exploration": "One robot and teams, mazes, default states, a bound of tours, a dense grid; takes hours.",
    "sensing": "One robot and teams with a lidar that turns and wheels that err, against exact ones; takes hours.",
    "radio": "Bytes of the codec and of whole runs, a bad radio against a perfect one, range and speed; takes an hour.",
}


def _measure(
    context: Context, quick: Quick = False, ideal: Ideal = False, jobs: Jobs = None, results: Results = Path("results")
) -> None:
    from deploy.bench.benchmark import Benchmark

    raise Exit(Benchmark(str(context.info_name)).run(quick, results, jobs, ideal))


@app.command(epilog="Example: wireswarm study trust --results studies")
def study(
    name: Annotated[Literal["trust", "maps", "exploration", "radio"], Argument(help="Which tables.", metavar="NAME")],
    results: Results = Path("studies"),
    jobs: Jobs = None,
) -> None:
    """Make a published experiment again: trust, maps, exploration or radio; hours, as its benchmark takes."""
    from deploy.bench.study import study

    raise Exit(study(name, results, jobs))


for _name, _words in BENCHMARKS.items():
    bench.command(_name, help=_words, epilog=f"Example: wireswarm bench {_name} --quick")(_measure)


app.command(epilog="Example: wireswarm agent --id r1 --connect tls/HOST:7447 --certs certs")(agent)


def _settings(context: Context) -> RunConfig:
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


def main() -> None:
    """Entry point of `wireswarm`."""
    try:
        command.run(app)
    except ModuleNotFoundError as error:
        package = (error.name or "").split(".")[0]
        extra = EXTRAS.get(package)
        if extra is None:
            raise
        say(f"this command needs {package}: install it with `pip install 'wireswarm[{extra}]'`")
        sys.exit(Status.USAGE)
