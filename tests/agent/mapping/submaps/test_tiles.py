"""Tiles find the wall that a look at all of them would find, and stay few however far apart walls stand."""

import numpy as np
import pytest

from agent.geometry.lines import ALIKE_COSINE
from agent.geometry.wall_tiles import MOST
from agent.mapping.submaps.matching import BEYOND_END_M, nearest_wall, tiles_of
from agent.mapping.submaps.segments import SEGMENT
from protocol.arrays import Records


def scattered(count: int, size: float, rng: np.random.Generator) -> Records:
    """Segments of 0.1 to 8 m anywhere in a square of that size, metres."""
    out, angle = np.zeros(count, SEGMENT), rng.uniform(0, 2 * np.pi, count)
    out["x"], out["y"] = rng.uniform(-0.5 * size, 0.5 * size, (2, count))
    out["ux"], out["uy"] = np.cos(angle), np.sin(angle)
    out["low"], out["high"] = -rng.uniform(0.05, 4.0, count), rng.uniform(0.05, 4.0, count)
    return out


def nearest_of_all(walls: Records, x: float, y: float, ux: float, uy: float, gate: float) -> int:
    dx, dy = x - walls["x"], y - walls["y"]
    off, t = np.abs(dy * walls["ux"] - dx * walls["uy"]), dx * walls["ux"] + dy * walls["uy"]
    beside = (walls["low"] - BEYOND_END_M <= t) & (t <= walls["high"] + BEYOND_END_M)
    off[~beside | (walls["ux"] * ux + walls["uy"] * uy < ALIKE_COSINE)] = gate
    return int(off.argmin()) if (off < gate).any() else -1


@pytest.mark.parametrize(("count", "size"), [(0, 1.0), (1, 1.0), (200, 20.0), (200, 300.0)])
def test_the_nearest_wall_is_that_of_a_look_at_all(count: int, size: float) -> None:
    rng = np.random.default_rng(count)
    walls = scattered(count, size, rng)
    tiles = tiles_of(walls)
    found = 0
    for gate in (0.6, 0.2):
        for _ in range(1000):
            (x, y), angle = rng.uniform(-0.7 * size, 0.7 * size, 2).tolist(), rng.uniform(0, 2 * np.pi)
            if count and rng.random() < 0.5:  # near to a wall, up to just beyond its end
                wall = walls[rng.integers(count)]
                t, off = rng.uniform(wall["low"] - 0.25, wall["high"] + 0.25), rng.uniform(-0.65, 0.65)
                x, y = wall["x"] + t * wall["ux"] - off * wall["uy"], wall["y"] + t * wall["uy"] + off * wall["ux"]
                angle = float(np.arctan2(wall["uy"], wall["ux"])) + rng.uniform(-0.4, 0.4)
            sample = (float(x), float(y), float(np.cos(angle)), float(np.sin(angle)))
            expected = nearest_of_all(walls, *sample, gate)
            assert nearest_wall(tiles, *sample, gate)[0] == expected
            found += expected >= 0
    assert found > 200 or not count


def test_walls_a_thousand_kilometres_apart_need_no_more_tiles() -> None:
    walls = scattered(50, 1e6, np.random.default_rng(0))
    tiles = tiles_of(walls)
    assert tiles.tiles.tiling.columns <= MOST + 1 and tiles.tiles.tiling.rows <= MOST + 1
    assert len(tiles.tiles.listed) < 2 * (MOST + 1) ** 2
