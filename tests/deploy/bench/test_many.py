"""Many robots as processes, in small: a whole team, with its figures."""

import pytest

from deploy.bench.many import measure

pytestmark = pytest.mark.system


def test_figures_of_robots_as_processes_are_those_of_one_process() -> None:
    figures = measure(3, "8x8", 30.0)
    assert figures["ended"] == "time"
    assert figures["accepted"] > 0
    assert figures["false"] == 0
    assert figures["same"]
    assert 0.0 < figures["gib"] < 2.0
