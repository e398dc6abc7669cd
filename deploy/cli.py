"""The command `wireswarm`. What a command needs beyond the base install is imported when it runs."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

from deploy.status import ENDINGS, Status

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # small arrays: threads would only wait for each other

EXTRAS = {"pymunk": "world", "matplotlib": "deploy", "psutil": "deploy", "rich": "deploy"}
"""Which extra brings a package that the base install may lack."""

app = typer.Typer(
    help="Small robots map a building together as wireframes: trust, but verify.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
bench = typer.Typer(help="Repeatable measurements, as tables and JSON.", no_args_is_help=True)
app.add_typer(bench, name="bench")

World = Annotated[str | None, typer.Option(help="A bundled world's name or a world file.", show_default="maze-15")]
Robots = Annotated[int | None, typer.Option(help="How many robots.", show_default="3")]
Seed = Annotated[int | None, typer.Option(help="All that is random is drawn from it.", show_default="0")]
Out = Annotated[Path | None, typer.Option(help="Run directory.", show_default="runs/WORLD-SEED, with -2, -3, ...")]
Range = Annotated[float | None, typer.Option("--range", help="Radio range in metres.", show_default="4.0")]
Until = Annotated[
    str | None,
    typer.Option(help="`complete` or simulated seconds.", metavar="complete|SECONDS", show_default="complete"),
]
MaxTime = Annotated[float | None, typer.Option(help="Simulated seconds at most.", show_default="7200")]
RealTime = Annotated[
    float | None,
    typer.Option(help="Simulated seconds per second of the clock; without, as fast as the machine goes."),
]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="YAML file with settings.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", help="One setting, such as starts=random.", metavar="KEY=VALUE")
]
Quick = Annotated[bool, typer.Option("--quick", help="Small, for tests.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress.")]
Jobs = Annotated[int | None, typer.Option(help="Cases at a time.", show_default="one a core", min=1)]
Results = Annotated[Path, typer.Option(help="Where figures are kept, so that nothing is measured twice.")]


@app.callback(invoke_without_command=True)
def wireswarm(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    """Small robots map a building together as wireframes: trust, but verify."""
    if show_version:
        print(f"wireswarm {version('wireswarm')}")
        raise typer.Exit


@app.command()
def run(
    world: World = None,
    robots: Robots = None,
    seed: Seed = None,
    out: Out = None,
    range_m: Range = None,
    until: Until = None,
    max_time: MaxTime = None,
    real_time: RealTime = None,
    config: ConfigFile = None,
    set_: Set = None,
    quiet: Quiet = False,
) -> None:
    """Run a world and its robots, one process each, and write the run directory."""
    from deploy.config import load
    from deploy.launcher import launch, run_directory
    from deploy.live import Display, print_summary
    from deploy.report import write_report

    flags = _flags(world, robots, seed, range_m, until, max_time, real_time)
    settings = load(config, flags, set_ or ())
    _check_world(settings.world)
    directory = run_directory(out, settings.world, settings.seed)
    with Display(settings.world, quiet) as display:
        result = launch(settings, directory, command_line=sys.argv, show=display.show)
    for error in result.errors:
        _say(error)
    if result.status == Status.USAGE:  # nothing was run
        raise typer.Exit(result.status)
    page: Path | None = None
    try:
        page = write_report(directory)
    except Exception as error:  # the run itself is written and must not be lost with its picture
        _say(f"no report: {type(error).__name__}: {error}")
    print_summary(directory)
    print(page or directory)
    raise typer.Exit(result.status)


@app.command("world")
def world_(
    world: World = None,
    robots: Robots = None,
    seed: Seed = None,
    out: Out = None,
    range_m: Range = None,
    until: Until = None,
    max_time: MaxTime = None,
    real_time: RealTime = None,
    listen: Annotated[str | None, typer.Option(help="Endpoint.", show_default="a free port of 127.0.0.1")] = None,
    config: ConfigFile = None,
    set_: Set = None,
) -> None:
    """Run a world alone, for robots that join it from other terminals, containers or hosts."""
    from deploy.config import load
    from deploy.launcher import run_directory
    from world.server import Inbox, serve

    flags = _flags(world, robots, seed, range_m, until, max_time, real_time) | {"server.listen": listen}
    settings = load(config, flags, set_ or ())
    _check_world(settings.world)
    directory = run_directory(out, settings.world, settings.seed)
    inbox = Inbox()
    _stop_on_signals(inbox.stop)
    ended = serve(
        settings,
        settings.server,
        directory,
        inbox=inbox,
        listening=lambda endpoint: print(f"listening on {endpoint}", flush=True),
    )
    print(f"ended: {ended}; {directory}")
    raise typer.Exit(ENDINGS.get(ended, Status.INTERRUPTED))


@bench.command()
def lidar(quick: Quick = False) -> None:
    """Rays a second in the bundled worlds."""
    from deploy.bench.lidar import measure
    from deploy.bench.table import print_rows

    print_rows("lidar", measure(quick))


@bench.command()
def lockstep(quick: Quick = False) -> None:
    """Ticks a second over Zenoh with robots that do not think."""
    from deploy.bench.lockstep import measure
    from deploy.bench.table import print_rows

    print_rows("lockstep", measure(quick))


@bench.command("filter")
def filter_(quick: Quick = False, jobs: Jobs = None, results: Results = Path("results")) -> None:
    """Whole runs, faults, ambiguous walls, storage, cost and number of particles of the filter; takes hours."""
    from deploy.bench.filter import measure

    if not measure(quick, results, jobs):
        raise typer.Exit(Status.FAILURE)


@bench.command()
def exploration(quick: Quick = False, jobs: Jobs = None, results: Results = Path("results")) -> None:
    """Whole runs of one robot and of teams, mazes, default states, a bound of tours, a dense grid; takes hours."""
    from deploy.bench.exploration import measure

    if not measure(quick, results, jobs):
        raise typer.Exit(Status.FAILURE)


@app.command()
def agent(
    id_: Annotated[str, typer.Option("--id", help="Name of the robot, such as r1.")],
    connect: Annotated[str, typer.Option(help="Endpoint of the world, such as tcp/127.0.0.1:7447.")],
    reconnect: Annotated[
        float | None, typer.Option(help="Seconds to wait for a world that is gone.", show_default="2")
    ] = None,
    config: ConfigFile = None,
    set_: Set = None,
) -> None:
    """Run one robot."""
    from agent.process import Inbox, run_agent
    from deploy.config import load

    settings = load(config, {"reconnect_s": reconnect}, set_ or ())
    inbox = Inbox()
    _stop_on_signals(inbox.stop)
    ended = run_agent(
        id_,
        connect,
        settings.agent,
        reconnect_s=settings.reconnect_s,
        join_timeout_s=settings.join_timeout_s,
        inbox=inbox,
    )
    print(f"{id_}: {ended}")
    raise typer.Exit(ENDINGS.get(ended, Status.FAILURE))


def _flags(
    world: str | None,
    robots: int | None,
    seed: int | None,
    range_m: float | None,
    until: str | None,
    max_time: float | None,
    real_time: float | None,
) -> dict[str, Any]:
    """Flags by the keys of the configuration."""
    return {
        "world": world,
        "robots": robots,
        "seed": seed,
        "radio.range_m": range_m,
        "until": until,
        "max_time_s": max_time,
        "server.real_time": real_time,
    }


def _check_world(world: str) -> None:
    """Raise WorldFileError before anything is made for a world that cannot be loaded."""
    from world.worldfile import load

    load(world)


def _stop_on_signals(stop: Callable[[], None]) -> None:
    """End at the next tick on Ctrl-C or SIGTERM; at once on a second."""

    def handler(number: int, frame: object) -> None:
        stop()
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def _say(sentence: str) -> None:
    print(f"wireswarm: {sentence}", file=sys.stderr)


@contextmanager
def _one_sentence() -> Iterator[None]:
    """Turn what a user can act on into one sentence and an exit status."""
    from deploy.config import ConfigError
    from protocol.errors import LinkError, ProtocolError, RefusedError
    from world.worldfile import WorldFileError

    try:
        yield
    except ModuleNotFoundError as error:
        extra = EXTRAS.get((error.name or "").split(".")[0])
        if extra is None:
            raise
        _say(f"this command needs {error.name}: install it with `pip install 'wireswarm[{extra}]'`")
        sys.exit(Status.USAGE)
    except (ConfigError, WorldFileError, RefusedError) as error:
        _say(str(error))
        sys.exit(Status.USAGE)
    except (LinkError, ProtocolError, OSError) as error:
        _say(str(error))
        sys.exit(Status.FAILURE)
    except KeyboardInterrupt:
        sys.exit(Status.INTERRUPTED)


def main() -> None:
    """Entry point of `wireswarm`."""
    with _one_sentence():
        app()
