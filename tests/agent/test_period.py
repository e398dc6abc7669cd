"""What is due every so many ticks is done, whichever ticks come."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.period import HELD_S, Period, WakingTime, in_ticks


@pytest.mark.parametrize(("ticks", "begin"), [(1, 0), (2, 7), (5, 3)])
def test_where_all_ticks_come_it_is_due_at_multiples(ticks: int, begin: int) -> None:
    period = Period(ticks)
    due = [tick for tick in range(begin, begin + 40) if period.take_due(tick)]
    assert due == [tick for tick in range(begin, begin + 40) if tick % ticks == 0]


@given(st.integers(1, 20), st.lists(st.integers(1, 50), min_size=1))
def test_where_ticks_are_left_out_it_is_due_once_for_each_period_that_passes(ticks: int, steps: list[int]) -> None:
    period, all_ticks = Period(ticks), [3]
    for step in steps:
        all_ticks.append(all_ticks[-1] + step)
    due = [period.take_due(tick) for tick in all_ticks]
    assert due[1:] == [b // ticks > a // ticks for a, b in pairwise(all_ticks)]


def test_of_a_fast_lidar_whose_odd_scans_come_alone_each_period_counts() -> None:
    """A driver that passes every second scan of one of 10 Hz: a robot with it never mapped, nor spoke."""
    period = Period(2)
    due = [period.take_due(tick) for tick in range(10_001, 10_101, 2)]
    assert all(due[1:])


def test_a_tick_that_comes_twice_is_due_once() -> None:
    period = Period(5)
    assert [period.take_due(tick) for tick in (4, 5, 5, 6)] == [False, True, False, False]


def test_no_time_is_shorter_than_a_tick() -> None:
    assert [in_ticks(1.0, rate_hz) for rate_hz in (0.1, 0.5, 1.0, 5.0, 20.0)] == [1, 1, 1, 5, 20]


def test_a_robot_that_was_held_was_not_awake() -> None:
    """Under a dead man's switch it gave goals up that it had not been let drive to."""
    awake, most = WakingTime(20.0), in_ticks(HELD_S, 20.0)
    assert [awake.at(tick) for tick in (7, 8, 10, 10 + most)] == [0, 1, 3, 3 + most]
    assert awake.at(100_000) == 3 + 2 * most
