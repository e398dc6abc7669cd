"""Merging by tiles makes the map that a look at all walls would make."""

import numpy as np
import pytest

from agent.mapping.submaps.merging import MERGE_M, _apart, _fuse, merge
from agent.mapping.submaps.segments import SEGMENT
from protocol.arrays import Records
from tests.agent.mapping.submaps.test_tiles import scattered


def merged_by_a_look_at_all(walls: Records, count: int, new: Records) -> int:
    for segment in new:
        apart = [_apart(wall, segment) for wall in walls[:count]]
        best = int(np.argmin(apart)) if apart else -1
        if apart and apart[best] < MERGE_M:
            _fuse(walls[best], segment)
        elif count < len(walls):
            walls[count] = segment
            count += 1
    return count


@pytest.mark.parametrize(("count", "size", "room"), [(0, 1.0, 5), (150, 8.0, 400), (150, 8.0, 160), (150, 300.0, 400)])
def test_each_segment_is_merged_as_by_a_look_at_all(count: int, size: float, room: int) -> None:
    rng = np.random.default_rng(count)
    known, new = scattered(count, size, rng), scattered(200, size, rng)
    new = np.concatenate((new, known))
    new["x"] += rng.normal(0, 0.05, len(new))
    turn = rng.normal(0, 0.05, len(new))
    new["ux"], new["uy"] = new["ux"] - turn * new["uy"], new["uy"] + turn * new["ux"]
    for records in (known, new):
        norm = np.hypot(records["ux"], records["uy"])
        records["ux"] /= norm
        records["uy"] /= norm
        records["hits"] = records["high"] - records["low"]
        records["xx"], records["yy"] = records["hits"] * records["ux"] ** 2, records["hits"] * records["uy"] ** 2
        records["xy"] = records["hits"] * records["ux"] * records["uy"]
    one, other = (np.concatenate((known, np.zeros(room - count, SEGMENT))) for _ in range(2))
    found = merge(one, count, new)
    assert found == merged_by_a_look_at_all(other, count, new)
    assert one.tobytes() == other.tobytes()
