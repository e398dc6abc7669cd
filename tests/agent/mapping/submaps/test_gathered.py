"""Walls of scans, gathered: each once, however many there are."""

import numpy as np

from agent.mapping.submaps.gathered import ROOM, Gathered
from agent.mapping.submaps.segments import SEGMENT
from protocol.arrays import Records


def rows(count: int) -> Records:
    """Segments of 1 m along x, one beside the other, 1 m apart."""
    out = np.zeros(count, SEGMENT)
    out["y"], out["ux"], out["low"], out["high"] = np.arange(count), 1.0, -0.5, 0.5
    out["hits"], out["xx"], out["seen"] = 1.0, 1 / 12, 1.0
    return out


def test_more_walls_than_there_is_room_for_are_kept() -> None:
    gathered, many = Gathered(rows(3)), rows(3 * ROOM)
    gathered.add(many)
    assert np.array_equal(np.sort(gathered.walls["y"]), many["y"])


def test_a_wall_that_is_seen_again_stands_once() -> None:
    gathered, again = Gathered(), rows(5)
    gathered.add(rows(5))
    again["y"] += 0.02
    gathered.add(again)
    assert len(gathered.walls) == 5 and (gathered.walls["seen"] == 2.0).all()
    assert np.allclose(np.sort(gathered.walls["y"]), np.arange(5) + 0.01)
