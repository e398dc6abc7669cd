"""What is made of a run directory: report, bandwidth measurement, and its end where a world was killed."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Exit, Option, Typer

from deploy.commands.options import Pairs, RunDirectory
from protocol.command import say, tell
from protocol.status import Status
from protocol.text import printable

if TYPE_CHECKING:
    from deploy.bandwidth.representations import Measurement

commands = Typer()


@commands.command(epilog="Example: wireswarm finish runs/maze-15-0")
def finish(run: RunDirectory) -> None:
    """Bring a run whose world was killed to its end: summary, maps, books and report."""
    from deploy.finish import finish

    if finish(run):
        raise Exit(write_results(run))
    print(f"{printable(str(run))} is finished already")


@commands.command(epilog="Example: wireswarm report runs/maze-15-0 --pairs")
def report(run: RunDirectory, pairs: Pairs = False) -> None:
    """Write the report of a run directory anew, and print its summary; of mapped logs the page has it."""
    from deploy import manifest
    from deploy.report import write_report
    from deploy.terminal.live import print_summary
    from protocol.files import UnwritableError

    made = None
    try:
        made = write_report(run)
    except UnwritableError as error:
        say(str(error))
    if not manifest.is_of_logs(run):
        print_summary(run, pairs)
    if made is None:
        raise Exit(Status.FAILURE)
    tell(printable(str(made)))


@commands.command(epilog="Example: wireswarm bandwidth runs/maze-15-0 runs/office-0")
def bandwidth(
    runs: Annotated[list[Path], Argument(help="Run directories.", metavar="DIR...")],
    as_json: Annotated[bool, Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Measure what finished runs sent, and what their maps would have cost in other forms."""
    from deploy.bandwidth.tables import document, print_tables
    from protocol.errors import InputError
    from protocol.files import UnwritableError

    documents, status = [], Status.OK
    for run in runs:
        try:
            measurement = _measured(run)
            documents.append(document(run, measurement))
            if not as_json:
                print_tables(documents[-1])
            _keep(run, measurement)
        except (InputError, UnwritableError) as error:  # the others do not wait for it
            say(str(error))
            status = max(status, Status.USAGE if isinstance(error, InputError) else Status.FAILURE)
    if as_json and documents:
        print(json.dumps(documents, indent=1))
    raise Exit(status)


def write_results(run: Path, pairs: bool = False, status: Status = Status.OK) -> Status:
    """Write report and bandwidth measurement of a run, as far as can be, and print its summary.

    Returns the status of the run, or FAILURE for one that ended well and whose results could not all be written.
    """
    from deploy import manifest
    from deploy.report import write_report
    from deploy.terminal.live import print_summary
    from protocol.errors import InputError
    from protocol.files import UnwritableError

    made = {}
    makers: dict[str, Callable[[Path], object]] = {"report": write_report}
    if manifest.ended(run) is not None and (run / "bandwidth.json").exists():
        makers["bandwidth measurement"] = measure_bandwidth
    for what, make in makers.items():
        try:
            made[what] = make(run)
        except UnwritableError as error:
            say(str(error))
        except InputError as error:
            say(f"no {what}: {error}")
        except Exception as error:  # the run itself is written and must not be lost with its picture
            say(f"no {what}: stopped by a mistake in its program: {type(error).__name__}: {error}")
    print_summary(run, pairs)
    tell(printable(str(made.get("report", run))))
    return Status.FAILURE if status == Status.OK and len(made) < len(makers) else status


def leave(run: Path, made: list[Path]) -> None:
    """End at once, also in the midst of drawing: libraries drop what is raised, and a run that ended needs no more.

    made: the folders that were made for it, which go where nothing was run.
    """
    from deploy import manifest
    from deploy.launch import forks
    from protocol.errors import InputError
    from protocol.files import remove_empty, remove_parts

    why = f"interrupted before the report was written; `wireswarm report {shlex.quote(str(run))}` writes it"
    try:
        remove_parts(run)
        manifest.interrupt(run, why)
    except (OSError, InputError):  # nothing was run yet
        remove_empty(made)
    else:
        say(why)
    forks.leave(Status.INTERRUPTED)


def measure_bandwidth(run: Path) -> None:
    """Add what other forms of the maps would have cost to bandwidth.json, and draw it."""
    _keep(run, _measured(run))


def _measured(run: Path) -> Measurement:
    from deploy.bandwidth.pool import processes
    from deploy.bandwidth.representations import measure

    with processes() as pool:
        return measure(run, pool=pool)


def _keep(run: Path, measurement: Measurement) -> None:
    from deploy.bandwidth.plots import draw
    from deploy.bandwidth.representations import write

    write(run, measurement)
    draw(run, measurement)
