"""Benchmarks: cases are measured once, in processes of their own, and kept."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from deploy.bench.cases import Case, measure_all


def square(x: int, log: str) -> dict[str, Any]:
    with Path(log).open("a") as file:
        file.write(f"{x} {os.getpid()}\n")
    if x < 0:
        raise ValueError("no negative numbers")
    return {"square": x * x}


def test_cases_are_measured_once_and_kept(tmp_path: Path) -> None:
    log = tmp_path / "log"
    cases = [Case(f"squares/{x}", square, {"x": x, "log": str(log)}, alone=x == 3) for x in (1, 2, 3)]
    outcome = measure_all(cases, tmp_path / "kept", jobs=2, quiet=True)
    assert outcome.figures == {f"squares/{x}": {"square": x * x} for x in (1, 2, 3)} and not outcome.failed
    lines = [line.split() for line in log.read_text().splitlines()]
    assert lines[-1][0] == "3"  # alone is after the others
    assert str(os.getpid()) not in {pid for _, pid in lines}

    (tmp_path / "kept/squares/2.json").write_text('{"key": "half wri')
    again = measure_all(cases, tmp_path / "kept", jobs=1, quiet=True)
    assert again == outcome
    assert [line.split()[0] for line in log.read_text().splitlines()[3:]] == ["2"]


def test_other_arguments_are_another_measurement(tmp_path: Path) -> None:
    log = str(tmp_path / "log")
    measure_all([Case("one", square, {"x": 1, "log": log})], tmp_path, jobs=1, quiet=True)
    outcome = measure_all([Case("one", square, {"x": 5, "log": log})], tmp_path, jobs=1, quiet=True)
    assert outcome.figures == {"one": {"square": 25}}
    assert json.loads((tmp_path / "one.json").read_text())["figures"] == {"square": 25}


def test_a_case_that_raises_is_told_and_measured_again(tmp_path: Path) -> None:
    log = str(tmp_path / "log")
    cases = [Case(str(x), square, {"x": x, "log": log}) for x in (-1, 1)]
    for _ in range(2):
        outcome = measure_all(cases, tmp_path, jobs=1, quiet=True)
        assert outcome.figures == {"1": {"square": 1}}
        assert outcome.failed == {"-1": "ValueError: no negative numbers"}
    assert [line.split()[0] for line in Path(log).read_text().splitlines()] == ["-1", "1", "-1"]


def test_two_cases_of_one_name_are_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="same"):
        measure_all([Case("same", square), Case("same", square)], tmp_path, quiet=True)
