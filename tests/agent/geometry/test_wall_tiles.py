"""Walls by tiles: the same answers as of a look at all walls."""

import numpy as np
import pytest

from agent.geometry.clearance import distances_to_walls, keeps_clear
from agent.geometry.wall_tiles import all_in_view, barred_by, keep_off, wall_tiles
from tests.sight import all_seen

CLEARANCE_M = 0.18


@pytest.mark.parametrize("upright", [True, False])
def test_ways_and_views_are_barred_as_by_all_walls(upright: bool) -> None:
    rng = np.random.default_rng(int(upright))
    starts, ends = rng.uniform(-10.0, 10.0, (2, 60, 2))
    if upright:  # walls, ways and views along the sides of tiles
        starts, ends = np.round(starts), np.round(ends)
        ends[np.arange(60), rng.integers(0, 2, 60)] = starts[np.arange(60), rng.integers(0, 2, 60)]
    walls = np.ascontiguousarray(np.hstack((starts, starts + 0.2 * (ends - starts))))
    tiles, ways = wall_tiles(walls), rng.uniform(-12.0, 12.0, (400, 4))
    ways[:200, 2:] = ways[:200, :2] + rng.uniform(-2.0, 2.0, (200, 2))  # most of the others are barred
    if upright:
        ways = np.round(ways)
    for a, b, c, d in ways.tolist():
        bar = barred_by(a, b, c, d, tiles, CLEARANCE_M, -1)
        assert (bar < 0) == keeps_clear(a, b, c, d, walls, CLEARANCE_M)
        assert bar < 0 or not keeps_clear(a, b, c, d, walls[bar : bar + 1], CLEARANCE_M)
        assert (barred_by(a, b, c, d, tiles, CLEARANCE_M, 7) < 0) == (bar < 0)
    eyes, targets = np.ascontiguousarray(ways[:, :2]), np.ascontiguousarray(ways[:, 2:])
    seen = all_in_view(eyes, targets, tiles)
    assert (seen == all_seen(eyes, targets, walls)).all() and seen.any() and not seen.all()
    assert (keep_off(eyes, tiles, CLEARANCE_M) == (distances_to_walls(eyes, walls) >= CLEARANCE_M)).all()


def test_without_walls_nothing_is_barred() -> None:
    tiles = wall_tiles(np.zeros((0, 4)))
    assert barred_by(0.0, 0.0, 5.0, 5.0, tiles, CLEARANCE_M, -1) < 0
    assert keep_off(np.zeros((1, 2)), tiles, CLEARANCE_M).all()
