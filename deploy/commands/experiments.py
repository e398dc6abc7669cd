"""Many runs, what they say, and the published measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Context, Exit, Option, Typer

from deploy.commands.options import Ideal, Jobs, Quick, Quiet, Results
from protocol.status import Status
from protocol.text import printable

commands = Typer()
bench = Typer(
    help="Repeatable measurements, as tables and JSON; status 4 where a bar is not met (--quick: not judged).",
    no_args_is_help=True,
    epilog="Example: wireswarm bench lidar --quick",
)

Measures = Annotated[
    list[str] | None,
    Option("--measure", help="A column of the results, such as team.t_90.", show_default="the usual ones"),
]

BENCHMARKS = {
    "lidar": "Rays a second in the bundled worlds.",
    "lockstep": "Ticks a second over Zenoh with robots that do not think.",
    "crowd": "What a robot costs among 3 to 100; 30 and 100 as processes: speed, memory, false merges, bytes.",
    "filter": "Whole runs, faults, ambiguous walls, storage, cost and number of particles of the filter; takes hours.",
    "alignment": "Pairs of partial maps by three methods, and robots that merge; takes a day, mostly `exact`.",
    "exploration": "One robot and teams, mazes, default states, a bound of tours, a dense grid; takes 45 minutes.",
    "sensing": "One robot and teams with a lidar that turns and wheels that err, and exact ones; half an hour.",
    "radio": "Bytes of the codec and of whole runs, a bad radio and a perfect one, range and speed; takes 20 minutes.",
}


@commands.command(epilog="Example: wireswarm sweep sweep.yaml --out results/range")
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


@commands.command(epilog="Example: wireswarm table results/range --measure team.t_90 --against radio.range_m=4")
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
    try:
        if against is not None:
            sheets.append(tables.against(rows, against, wanted))
    finally:
        tables.show(sheets, out)


@commands.command(epilog="Example: wireswarm compare results/range:radio.range_m=8 results/range:radio.range_m=4")
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

    tables.show([tables.compare(first, second, measures or tables.MEASURES)], out)


@commands.command(epilog="Example: wireswarm study trust --results studies")
def study(
    name: Annotated[Literal["trust", "maps", "exploration", "radio"], Argument(help="Which tables.", metavar="NAME")],
    quick: Quick = False,
    results: Results = Path("studies"),
    jobs: Jobs = None,
) -> None:
    """Make a published experiment again: trust, maps, exploration or radio; takes as long as its benchmark."""
    from deploy.bench.study import study

    raise Exit(study(name, results, jobs, quick))


def _measure(
    context: Context,
    quick: Quick = False,
    ideal: Ideal = False,
    jobs: Jobs = None,
    results: Results = Path("results"),
    part: Annotated[
        str | None, Option(help="One part of it only, such as exact; a wrong name tells all.", show_default="all")
    ] = None,
) -> None:
    from deploy.bench.benchmark import Benchmark

    raise Exit(Benchmark(str(context.info_name), part=part).run(quick, results, jobs, ideal))


for _name, _words in BENCHMARKS.items():
    bench.command(_name, help=_words, epilog=f"Example: wireswarm bench {_name} --quick")(_measure)
commands.add_typer(bench, name="bench")
