"""Long benchmarks as cases: measured in parallel processes, kept one file each, and not measured twice.

A case is a function of plain arguments. Its figures are kept under a key of the sources that they depend on and of
the arguments, so that an interrupted benchmark goes on where it stopped, and a change of the code starts anew.
"""

import hashlib
import json
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from inspect import getsourcefile
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from deploy.revision import sources
from deploy.sensing import IDEAL_BENCHMARK
from protocol.files import write_whole

Figures = dict[str, Any]  # what a case measured: JSON values


@dataclass(frozen=True)
class Case:
    """One measurement."""

    name: str  # Path-like and unique in its benchmark, such as plain/maze-15/0; also where its figures are kept
    measure: Callable[..., Figures]  # a function at the top of a module: other processes must find it
    arguments: Mapping[str, Any] = field(default_factory=dict)  # JSON values
    alone: bool = False  # whether nothing may run beside it, because its figures are times
    ideal: bool = False  # whether runs have the paper's sensing, where the measure does not say otherwise
    ignores: str = ""  # how the paths of sources begin that its figures do not depend on; empty: they depend on all

    @property
    def key(self) -> str:
        """Hash of all that decides the figures: sources of the minds and the world, the measure's, arguments."""
        own = getsourcefile(self.measure)
        assert own is not None
        words = [sources(self.ignores), hashlib.sha256(Path(own).read_bytes()).hexdigest(), self.measure.__qualname__]
        words += ["ideal"] if self.ideal else []
        return hashlib.sha256(json.dumps([*words, self.arguments], sort_keys=True).encode()).hexdigest()[:16]


def each(
    name: str,
    measure: Callable[..., Figures],
    fixed: Mapping[str, Any] | None = None,
    alone: bool = False,
    **loops: Iterable[Any],
) -> list[Case]:
    """One case a combination of the loops' values, the first loop outermost; its name has them at {LOOP}.

    Arguments of `measure` are the values, and those that are `fixed`.
    """
    values = [dict(zip(loops, combination, strict=True)) for combination in product(*loops.values())]
    return [Case(name.format(**found), measure, {**(fixed or {}), **found}, alone) for found in values]


class Outcome(NamedTuple):
    """What became of all cases of a benchmark, by name."""

    figures: dict[str, Figures]
    failed: dict[str, str]  # why a case has no figures


def measure_all(cases: Sequence[Case], folder: Path, jobs: int | None = None, quiet: bool = False) -> Outcome:
    """Measure the cases that `folder` has no figures of, `jobs` at a time (None: one a core), and return all.

    Each is kept in folder/NAME.json as soon as it is there. A case that raises is told in `failed` and measured
    again next time. Raises ValueError where two cases share a name.
    """
    names = [case.name for case in cases]
    if len(set(names)) < len(names):
        raise ValueError(f"two cases are called {next(name for name in names if names.count(name) > 1)}")
    keys = {case.name: case.key for case in cases}  # of the sources as they are now, whatever happens to them later
    figures = {case.name: known for case in cases if (known := _kept(case, keys[case.name], folder)) is not None}
    failed: dict[str, str] = {}
    left = [case for case in cases if case.name not in figures]
    console = Console(stderr=True, quiet=quiet)
    if figures:
        console.print(f"{len(figures)} of {len(cases)} cases are in {folder}")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=quiet) as progress:
        bar = progress.add_task("measuring", total=len(cases), completed=len(figures))
        for alone, workers in ((False, jobs or os.cpu_count() or 1), (True, 1)):
            part = [case for case in left if case.alone == alone]
            for case, found, seconds in _measured(part, workers):
                if isinstance(found, str):
                    failed[case.name] = found
                    progress.console.print(f"{case.name}: {found}", style="red", markup=False, highlight=False)
                else:
                    figures[case.name] = found
                    _keep(case, keys[case.name], folder, found, seconds)
                    progress.console.print(f"{case.name}: {seconds:.1f} s", markup=False, highlight=False)
                progress.advance(bar)
    return Outcome({name: figures[name] for name in names if name in figures}, failed)


def _measured(cases: Sequence[Case], workers: int) -> Iterator[tuple[Case, Figures | str, float]]:
    """Figures of each case, or the sentence of its error, as they come."""
    if not cases:
        return
    context = multiprocessing.get_context("forkserver")  # no threads or random state of this process
    with ProcessPoolExecutor(min(workers, len(cases)), context, initializer=_become_worker) as pool:
        waiting: dict[Future[tuple[Figures, float]], Case] = {pool.submit(_measure, case): case for case in cases}
        try:
            for future in as_completed(waiting):
                if error := future.exception():
                    yield waiting[future], f"{type(error).__name__}: {error}", 0.0
                else:
                    yield waiting[future], *future.result()
        except BaseException:  # Ctrl-C: what is half done is not worth waiting for
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def _become_worker() -> None:
    """End with the process that started this one, even if it was killed."""

    def watch() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _measure(case: Case) -> tuple[Figures, float]:
    begin = time.perf_counter()
    IDEAL_BENCHMARK.set(case.ideal)
    figures: Figures = json.loads(json.dumps(case.measure(**case.arguments), allow_nan=False))  # as read back later
    return figures, time.perf_counter() - begin


def _kept(case: Case, key: str, folder: Path) -> Figures | None:
    """Figures of an earlier run under the same key."""
    try:
        kept = json.loads((folder / f"{case.name}.json").read_text(encoding="utf-8"))
        figures: Figures = kept["figures"]
        return figures if kept["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError):
        return None  # none yet, or of a former version


def _keep(case: Case, key: str, folder: Path, figures: Figures, seconds: float) -> None:
    path = folder / f"{case.name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {"case": case.name, "key": key, "arguments": dict(case.arguments), "seconds": round(seconds, 2)}
    document |= {"python": sys.version.split()[0], "figures": figures}
    write_whole(path, json.dumps(document, indent=1, allow_nan=False) + "\n")
