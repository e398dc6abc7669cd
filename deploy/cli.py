"""The command `wireswarm`. What a command needs beyond the base install is imported when it runs."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Abort, Argument, Context, Exit, Option, Typer

from deploy.status import ENDINGS, Status
from deploy.text import printable

if TYPE_CHECKING:
    from deploy.bandwidth.representations import Measurement
    from deploy.config import RunConfig
    from protocol.inbox import Inbox

for _library in ("OPENBLAS", "OMP", "MKL", "NUMBA"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")  # small arrays: threads would only wait for each other

EXTRAS = {"pymunk": "world"} | dict.fromkeys(("matplotlib", "PIL", "psutil", "rich"), "deploy")  # what brings a package
MAX_SENTENCE = 600  # characters of an error: longer ones quote what was given

app = Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)
bench = Typer(help="Repeatable measurements, as tables and JSON.", no_args_is_help=True)
app.add_typer(bench, name="bench")

World = Annotated[str | None, Option(help="A bundled world's name or a world file.", show_default="maze-15")]
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


@app.command()
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
    config: ConfigFile = None,
    set_: Set = None,
    quiet: Quiet = False,
) -> None:
    """Run a world and its robots, one process each, and write the run directory."""
    from deploy.interrupts import on_interrupt
    from deploy.launcher import launch, run_directory
    from deploy.live import Display, print_summary

    settings = _settings(context)
    with run_directory(out, settings.world, settings.seed) as directory:
        with Display(settings.world, str(settings.radio), quiet) as display:
            result = launch(settings, directory, show=display.show)
        for error in result.errors:
            _say(error)
        if result.status == Status.USAGE:  # nothing was run
            raise Exit(result.status)
        if result.status == Status.INTERRUPTED:
            _say(f"interrupted; `wireswarm report {directory}` draws what there is")
            print_summary(directory)
            raise Exit(result.status)
        with on_interrupt(partial(_leave_report, directory)):
            _draw(directory)
        raise Exit(result.status)


def _draw(run: Path) -> None:
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
            _say(str(error))
        except Exception as error:  # the run itself is written and must not be lost with its picture
            _say(f"no {what}: {type(error).__name__}: {error}")
    print_summary(run)
    print(printable(str(made.get("report", run))), flush=True)


def _leave_report(run: Path) -> None:
    """End at once, in the midst of drawing: a finished run needs nothing more, and libraries drop what is raised."""
    from deploy import manifest

    why = f"interrupted before the report was written; `wireswarm report {run}` writes it"
    with suppress(OSError):
        manifest.finish(run, exit_status=Status.INTERRUPTED, errors=[why])
    _say(why)
    os._exit(Status.INTERRUPTED)


def _measure_bandwidth(run: Path) -> Measurement:
    """What other forms of the maps would have cost, added to bandwidth.json, and its plots."""
    from deploy.bandwidth.plots import draw
    from deploy.bandwidth.representations import measure, write

    measurement = measure(run)
    write(run, measurement)
    draw(run, measurement)
    return measurement


@app.command("world")
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
    secrets: Annotated[
        Path | None, Option(help="File of secrets, without which nobody gets in; made where there is none.")
    ] = None,
    resume: Annotated[
        Path | None,
        Option(help="Go on in the directory of a run whose world was killed, with its settings.", metavar="DIR"),
    ] = None,
    config: ConfigFile = None,
    set_: Set = None,
) -> None:
    """Run a world alone, for robots that join it from other terminals, containers or hosts."""
    from deploy import manifest
    from deploy.launcher import run_directory
    from protocol.errors import InputError
    from world.inbox import WorldInbox
    from world.server import serve
    from world.worldfile import load

    settings = _settings(context) if resume is None else _resumed(context, resume)
    begun = manifest.begun(settings, load(settings.world))
    del begun["config"]["agent"]  # each robot has its own
    _stop_on_signals(inbox := WorldInbox())

    def listening(endpoint: str) -> None:
        print(f"listening on {endpoint}\nradio: {settings.radio}", flush=True)

    goes_on = resume is not None
    place = nullcontext(resume) if resume else run_directory(out, settings.world, settings.seed)
    with place as directory, _secrets(secrets, settings.robot_ids) as known:
        if not goes_on:
            manifest.begin(directory, begun)
        try:
            ended = serve(
                settings, settings.server, directory, secrets=known, inbox=inbox, resume=goes_on, listening=listening
            )
        except InputError:
            if not goes_on:
                manifest.withdraw(directory)
            raise
        except Exception as error:
            manifest.finish(directory, ended="failed", exit_status=Status.FAILURE, errors=[str(error)])
            raise
        status = ENDINGS.get(ended, Status.INTERRUPTED)
        manifest.finish(directory, ended=ended, exit_status=status)
    print(f"ended: {ended}; {printable(str(directory))}")
    raise Exit(status)


@contextmanager
def _secrets(file: Path | None, robots: list[str]) -> Iterator[dict[str, str] | None]:
    """The secrets of a file, which is made where there is none, and removed where the world cannot be run."""
    from protocol.access import VIEWER, new_secrets, read_secrets, write_secrets
    from protocol.errors import InputError

    if file is None:
        yield None
        return
    try:
        if new := not file.exists():
            write_secrets(file, new_secrets(robots))
    except OSError as error:
        raise InputError(f"--secrets: {error}") from None
    try:
        yield read_secrets(file, [*robots, VIEWER])
    except InputError:
        if new:
            file.unlink()
        raise


def _resumed(context: Context, run: Path) -> RunConfig:
    """Configuration of a run that goes on; only where its world listens may be new."""
    from deploy.config import ConfigError
    from deploy.finish import left_by

    given = [name for name, value in context.params.items() if value and name not in ("resume", "listen", "secrets")]
    if given:
        raise ConfigError(f"--resume {run}: it goes on with the settings of its beginning, leave out {given[0]}")
    config, listen = left_by(run), context.params["listen"]
    server = config.server.model_copy(update={"listen": listen} if listen else {})
    return config.model_copy(update={"server": server})


@app.command()
def finish(run: Annotated[Path, Argument(help="Run directory.", metavar="DIR")]) -> None:
    """Bring a run whose world was killed to its end: summary, maps, books and report."""
    from deploy.finish import finish

    if finish(run):
        _draw(run)
    else:
        print(f"{printable(str(run))} is finished already")


@app.command()
def report(run: Annotated[Path, Argument(help="Run directory.", metavar="DIR")]) -> None:
    """Write the report of a run directory anew."""
    from deploy.report import write_report

    print(printable(str(write_report(run))))


@app.command()
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


@app.command()
def worlds(as_json: Annotated[bool, Option("--json", help="Print the sizes as JSON.")] = False) -> None:
    """List the bundled worlds: sizes, walls, free area, and a small drawing."""
    from deploy.worlds import to_json, to_text

    print(to_json() if as_json else to_text())


@app.command("config")
def config_(
    as_yaml: Annotated[bool, Option("--yaml", help="Print a file for --config with all defaults.")] = False,
    as_json: Annotated[bool, Option("--json", help="Print JSON.")] = False,
) -> None:
    """List the settings: default, unit and reason."""
    from deploy.settings import to_json, to_text, to_yaml

    print(to_json() if as_json else to_yaml() if as_yaml else to_text())


BENCHMARKS = {
    "lidar": "Rays a second in the bundled worlds.",
    "lockstep": "Ticks a second over Zenoh with robots that do not think.",
    "filter": "Whole runs, faults, ambiguous walls, storage, cost and number of particles of the filter; takes hours.",
    "alignment": "Pairs of partial maps by three methods, and robots that align, verify and merge; takes hours.",
    "exploration": "One robot and teams, mazes, default states, a bound of tours, a dense grid; takes hours.",
    "radio": "Bytes of the codec and of whole runs, a bad radio against a perfect one, range and speed; takes an hour.",
}


def _measure(context: Context, quick: Quick = False, jobs: Jobs = None, results: Results = Path("results")) -> None:
    from deploy.bench.benchmark import Benchmark

    signal.signal(signal.SIGINT, signal.default_int_handler)  # raised, so that cases under way are ended
    if not Benchmark(str(context.info_name)).run(quick, results, jobs):
        raise Exit(Status.FAILURE)


for _name, _words in BENCHMARKS.items():
    bench.command(_name, help=_words)(_measure)


@app.command()
def agent(
    context: Context,
    connect: Annotated[str, Option(help="Endpoint of the world, such as tcp/127.0.0.1:7447.")],
    id_: Annotated[
        str | None,
        Option("--id", help="Name of the robot.", show_default="the first of --secrets that is not there yet"),
    ] = None,
    secrets: Annotated[Path | None, Option(help="File of secrets with this robot's line.")] = None,
    reconnect_s: Annotated[
        float | None, Option("--reconnect", help="Seconds to wait for a world that is gone.", show_default="60")
    ] = None,
    checkpoints: Annotated[
        Path | None, Option(help="Folder where the robot keeps its map, and goes on from when started again.")
    ] = None,
    config: ConfigFile = None,
    set_: Set = None,
) -> None:
    """Run one robot."""
    from agent.shell.process import AgentInbox, run_agent
    from protocol.access import read_secrets
    from protocol.errors import InputError
    from protocol.messages import ID

    settings = _settings(context)
    if id_ is None and secrets is None:
        raise InputError("--id: name the robot, such as r1, or give --secrets to take the first that is not there yet")
    if id_ is not None and not re.fullmatch(ID, id_):
        raise InputError(f"--id {id_}: a name has up to 16 small letters, digits, - and _, and begins with a letter")
    known = None if secrets is None else read_secrets(secrets, None if id_ is None else [id_])
    _stop_on_signals(inbox := AgentInbox())
    ended = run_agent(
        id_, connect, settings.agent, secrets=known, patience=settings, inbox=inbox, checkpoints=checkpoints
    )
    print(f"{id_ or 'robot'}: {ended}")
    raise Exit(ENDINGS.get(ended, Status.FAILURE))


def _settings(context: Context) -> RunConfig:
    """Configuration of a command from its flags (parameters named like a setting), --config and --set.

    Raises ConfigError, and WorldFileError before anything is made for a world that cannot be run.
    """
    from deploy.config import RunConfig, load
    from world.draws import starts_of
    from world.worldfile import load as load_world

    given, settings_below = context.params, ("radio.range_m", "server.real_time", "server.listen")
    flags = {
        key: given[name] for key in (*RunConfig.model_fields, *settings_below) if (name := key.split(".")[-1]) in given
    }
    settings = load(given["config"], flags, given["set_"] or ())
    if "world" in given:
        starts_of(settings, load_world(settings.world))
    return settings


def _stop_on_signals(inbox: Inbox) -> None:
    """End at the next tick on Ctrl-C or SIGTERM; at once on a second."""

    def handler(number: int, frame: object) -> None:
        inbox.stop()
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def _say(sentence: str) -> None:
    print(f"wireswarm: {printable(sentence):.{MAX_SENTENCE}}", file=sys.stderr)


def main() -> None:
    """Entry point of `wireswarm`: what a user can act on becomes one sentence and an exit status."""
    from protocol.errors import InputError, LinkError, ProtocolError, RefusedError

    try:
        sys.exit(app(standalone_mode=False))
    except ModuleNotFoundError as error:
        extra = EXTRAS.get((error.name or "").split(".")[0])
        if extra is None:
            raise
        _say(f"this command needs {error.name}: install it with `pip install 'wireswarm[{extra}]'`")
        sys.exit(Status.USAGE)
    except (InputError, RefusedError) as error:
        _say(str(error))
        sys.exit(Status.USAGE)
    except (LinkError, ProtocolError, OSError) as error:
        _say(str(error))
        sys.exit(Status.FAILURE)
    except (Abort, KeyboardInterrupt):
        sys.exit(Status.INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):  # Typer has Click's errors, but no public name for all of them
            raise
        _say(error.format_message() or "which command? `--help` lists them")
        sys.exit(Status.USAGE)
