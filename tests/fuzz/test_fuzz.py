"""Each fuzz target takes its seeds, what once broke it, and some mutants of them."""

import multiprocessing as mp
import random
import re
import resource
import sys
from collections.abc import Callable
from contextlib import nullcontext
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.fuzz import runner
from tests.fuzz.runner import FIRST, GROWTH_MB, mutant, run_guided, run_random
from tests.fuzz.targets import BROKE, TARGETS

REPO = Path(__file__).parents[2]


@pytest.mark.parametrize("name", TARGETS)
def test_any_bytes_are_taken_or_refused_by_the_error_that_is_due(name: str) -> None:
    target, rng = TARGETS[name], random.Random(7)
    seeds = target.seeds()
    for data in (b"", *seeds, *BROKE.get(name, ())):
        target.fuzz(data)
    for _ in range(30 if name in ("runs", "reports", "measurements", "conversations", "hearing", "minds") else 200):
        target.fuzz(mutant(rng, seeds))


@pytest.mark.parametrize("guided", [True, False])
def test_memory_that_grows_is_a_failure(guided: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a MB with each input; runs guided by atheris never looked at it."""
    callbacks: list[Callable[[bytes], None]] = []

    def fuzz() -> None:
        for _ in range(FIRST + 2 * GROWTH_MB):
            callbacks[0](b"")

    atheris = SimpleNamespace(
        instrument_imports=lambda **_: nullcontext(), Setup=lambda _, one: callbacks.append(one), Fuzz=fuzz
    )
    grown = (SimpleNamespace(ru_maxrss=1024 * megabytes) for megabytes in count())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "atheris", atheris)
    monkeypatch.setattr(resource, "getrusage", lambda _: next(grown))
    monkeypatch.setattr(runner, "checked", lambda *_: (None, 0.0))
    tried = mp.Value("Q", 0)
    with pytest.raises(AssertionError, match=f"memory grew by {GROWTH_MB + 1} MB"):
        run_guided("secrets", 60, tried) if guided else run_random("secrets", 60, tried, 0)
    assert tried.value == FIRST + GROWTH_MB + 1


def test_what_numba_compiles_is_not_instrumented() -> None:
    """It cannot compile the counters of atheris: targets with a shared kernel ended at their first input."""
    compiled = [file for file in (REPO / "agent").rglob("*.py") if re.search(r"^@\w*kernel", file.read_text(), re.M)]
    assert len(compiled) > 50
    assert {".".join(file.relative_to(REPO).with_suffix("").parts) for file in compiled} <= set(runner._compiled())
