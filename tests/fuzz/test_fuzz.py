"""Each fuzz target takes its seeds, what once broke it, and some mutants of them."""

import random

import pytest

from tests.fuzz.runner import mutant
from tests.fuzz.targets import BROKE, TARGETS


@pytest.mark.parametrize("name", TARGETS)
def test_any_bytes_are_taken_or_refused_by_the_error_that_is_due(name: str) -> None:
    target, rng = TARGETS[name], random.Random(7)
    seeds = target.seeds()
    for data in (b"", *seeds, *BROKE.get(name, ())):
        target.fuzz(data)
    for _ in range(30 if name in ("runs", "reports", "measurements", "conversations", "hearing", "minds") else 200):
        target.fuzz(mutant(rng, seeds))
