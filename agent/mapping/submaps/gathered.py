"""Walls that scans show, merged one scan after the other (ours)."""

import numpy as np

from agent.mapping.submaps.merging import merge
from agent.mapping.submaps.segments import SEGMENT
from protocol.arrays import Records

ROOM = 64  # records by which the array grows, at least
NONE = np.zeros(0, SEGMENT)


class Gathered:
    """Segments in one frame, in an array with room for more."""

    def __init__(self, walls: Records = NONE) -> None:
        """walls: (n,) of SEGMENT to begin with."""
        self._records, self._count = np.concatenate((walls, np.zeros(ROOM, SEGMENT))), len(walls)

    @property
    def walls(self) -> Records:
        """(n,) of SEGMENT; the next scan changes them."""
        return self._records[: self._count]

    def add(self, seen: Records) -> None:
        """Merge the segments (k,) of a scan in."""
        if self._count + len(seen) > len(self._records):
            more = max(ROOM, len(self._records), len(seen))
            self._records = np.concatenate((self._records, np.zeros(more, SEGMENT)))
        self._count = merge(self._records, self._count, seen)
