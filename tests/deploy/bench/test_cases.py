"""Benchmarks: cases are measured once, by the engine of sweeps, and kept."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from deploy import revision
from deploy.bench import cases, layouts
from deploy.bench.cases import Case, kept, measure_all
from deploy.revision import ROOT, sources
from deploy.sweep.store import Store
from deploy.sweep.work import WorkerTask, work
from protocol.errors import InputError


def square(x: int, log: str) -> dict[str, Any]:
    with Path(log).open("a") as file:
        file.write(f"{x} {os.getpid()}\n")
    if x < 0:
        raise ValueError("no negative numbers")
    return {"square": x * x}


def folder_of_files() -> dict[str, Any]:
    return {"folder": str(layouts.KEEP)}


def logged(log: Path) -> list[str]:
    return [line.split()[0] for line in log.read_text().splitlines()]


@pytest.fixture
def without_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tasks are done here and now, which is quicker than to start workers."""

    def fill(store: Store, tasks: Sequence[WorkerTask], *_: Any, **__: Any) -> None:
        for task in tasks:
            if task.key not in store.kept() - store.failed():
                store.keep(work(task, sources()))

    monkeypatch.setattr(cases, "fill", fill)


def test_cases_are_measured_by_workers(tmp_path: Path) -> None:
    log = tmp_path / "log"
    squares = [Case(f"squares/{x}", square, {"x": x, "log": str(log)}) for x in (1, 2)]
    outcome = measure_all([*squares, Case("folder", folder_of_files)], tmp_path / "kept", jobs=1, quiet=True)
    assert outcome.figures.pop("folder") == folder_of_files()  # what was made beforehand is found there
    assert outcome.figures == {f"squares/{x}": {"square": x * x} for x in (1, 2)} and not outcome.failed
    assert str(os.getpid()) not in log.read_text()


@pytest.mark.usefixtures("without_dask")
def test_cases_are_measured_once_and_kept(tmp_path: Path) -> None:
    log = tmp_path / "log"
    squares = [Case(f"squares/{x}", square, {"x": x, "log": str(log)}, alone=x == 1) for x in (1, 2, 3)]
    outcome = measure_all(squares, tmp_path / "kept")
    assert list(outcome.figures) == ["squares/1", "squares/2", "squares/3"]
    assert logged(log) == ["2", "3", "1"]  # alone is after the others
    (tmp_path / "kept" / f"{squares[1].key}.parquet").unlink()
    assert measure_all(squares, tmp_path / "kept") == outcome
    assert logged(log)[3:] == ["2"]


@pytest.mark.usefixtures("without_dask")
def test_other_arguments_are_another_measurement(tmp_path: Path) -> None:
    for x in (1, 5):
        case = Case("one", square, {"x": x, "log": str(tmp_path / "log")})
        assert measure_all([case], tmp_path / "kept").figures == {"one": {"square": x * x}}


def test_the_file_of_a_layout_that_is_no_part_of_the_project_decides_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(layouts, "SHARED", tmp_path)
    named: list[dict[str, Any]] = [{"world": "shared"}, {"worlds": ["hall", "shared"]}, {"world": "hall"}, {}]

    def keys(text: str) -> list[str]:
        (tmp_path / "shared.yaml").write_text(text)
        return [Case("one", square, arguments).key for arguments in named]

    assert [one == other for one, other in zip(keys("a"), keys("b"), strict=True)] == [False, False, True, True]


@pytest.mark.usefixtures("without_dask")
def test_what_was_measured_is_read_without_measuring(tmp_path: Path) -> None:
    log = tmp_path / "log"
    squares = [Case(str(x), square, {"x": x, "log": str(log)}) for x in (-1, 1)]
    outcome = measure_all(squares, tmp_path / "kept")
    assert kept(squares, tmp_path / "kept") == outcome and len(outcome.failed) == 1
    assert logged(log) == ["-1", "1"]
    with pytest.raises(InputError, match="parquet"):
        kept([Case("2", square, {"x": 2, "log": str(log)})], tmp_path / "kept")


def test_a_change_of_what_a_measure_calls_is_another_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys held the measure's own file only, so figures of the code before stood in the tables."""
    from deploy.bench.filter.trials import measure_faults

    def key() -> str:
        revision.with_imports.cache_clear()
        return Case("trials", measure_faults).key

    before, read = key(), Path.read_bytes
    changed = ROOT / "deploy/bench/filter/faults.py"
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b"# after" * (path == changed))
    assert key() != before
    monkeypatch.undo()
    assert key() == before


@pytest.mark.usefixtures("without_dask")
def test_a_case_that_raises_is_told_and_measured_again(tmp_path: Path) -> None:
    log = tmp_path / "log"
    squares = [Case(str(x), square, {"x": x, "log": str(log)}) for x in (-1, 1)]
    for _ in range(2):
        outcome = measure_all(squares, tmp_path / "kept")
        assert outcome.figures == {"1": {"square": 1}}
        assert outcome.failed == {"-1": "ValueError: no negative numbers"}
    assert logged(log) == ["-1", "1", "-1"]


def test_two_cases_of_one_name_are_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="same"):
        measure_all([Case("same", square), Case("same", square)], tmp_path, quiet=True)
