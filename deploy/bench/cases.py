"""Long benchmarks as cases: tasks of the engine of sweeps, measured in parallel, kept, and not measured twice.

A case is a function of plain arguments. Its figures are kept under a key of the sources that they depend on and of
the arguments, so that an interrupted benchmark goes on where it stopped, and a change of the code starts anew.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import getsourcefile
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from deploy.bench.layouts import content_of
from deploy.revision import revision, sources, with_imports
from deploy.sensing import IDEAL_BENCHMARK
from deploy.sweep.command import fill
from deploy.sweep.store import Store
from deploy.sweep.work import OK, Row, WorkerTask

Figures = dict[str, Any]  # what a case measured: JSON values


@dataclass(frozen=True)
class Case:
    """One measurement."""

    name: str  # Path-like and unique in its benchmark, such as plain/maze-15/0
    measure: Callable[..., Figures]  # a function at the top of a module: other processes must find it
    arguments: Mapping[str, Any] = field(default_factory=dict)  # JSON values
    alone: bool = False  # whether nothing may run beside it, because its figures are times
    ideal: bool = False  # whether runs have the paper's sensing, where the measure does not say otherwise
    ignores: str = ""  # how the paths of sources begin that its figures do not depend on; empty: they depend on all

    @property
    def key(self) -> str:
        """Hash of what decides the figures: the sources of all figures, the measure's own and what it imports of
        deploy/, its arguments, and the files of layouts that are no part of the project (`world` and `worlds`)."""
        own = getsourcefile(self.measure)
        assert own is not None
        words = [sources(self.ignores), with_imports(Path(own)), self.measure.__qualname__]
        words += ["ideal"] if self.ideal else []
        named = [self.arguments.get("world"), *self.arguments.get("worlds", ())]
        words += [content for name in named if isinstance(name, str) and (content := content_of(name))]
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

    A case that raises is told in `failed` and measured again next time. Raises ValueError where two cases share a name.
    """
    names = [case.name for case in cases]
    if len(set(names)) < len(names):
        raise ValueError(f"two cases are called {next(name for name in names if names.count(name) > 1)}")
    keys = {case.name: case.key for case in cases}  # of the sources as they are now, whatever happens to them later
    store = Store(folder, revision())
    for alone, workers in ((False, jobs), (True, 1)):
        tasks = [_task(case, keys[case.name]) for case in cases if case.alone == alone]
        fill(store, tasks, workers, retry_failed=True, quiet=quiet)
    return _outcome(store, keys)


def kept(cases: Sequence[Case], folder: Path) -> Outcome:
    """The same of cases that have all been measured, which many processes may ask for. Raises InputError."""
    return _outcome(Store(folder, revision()), {case.name: case.key for case in cases})


def _outcome(store: Store, keys: Mapping[str, str]) -> Outcome:
    rows = {name: store.row(key) for name, key in keys.items()}
    figures = {name: json.loads(row["figures"]) for name, row in rows.items() if row["status"] == OK}
    return Outcome(figures, {name: row["reason"] for name, row in rows.items() if row["status"] != OK})


def _task(case: Case, key: str) -> WorkerTask:
    settings = json.dumps({"case": case.name, **case.arguments}, sort_keys=True)
    return WorkerTask(key, {"settings": settings}, _measure, (case,))


def _measure(case: Case) -> Row:
    IDEAL_BENCHMARK.set(case.ideal)
    return {"figures": json.dumps(case.measure(**case.arguments), allow_nan=False)}
