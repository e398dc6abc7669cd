"""A map that was merged anew from submaps, and how each part of the torn one has moved (ours)."""

from typing import NamedTuple

import numpy as np

from protocol.arrays import Floats, Ints, Records
from protocol.geometry import Pose, apply, pose_of


class Settled(NamedTuple):
    """What a loop has settled. The frame stays the robot's own, but its map lies otherwise in it."""

    walls: Records
    """(n,) of SEGMENT: those of all submaps."""
    pose: Pose
    """The robot's."""
    begins: Ints
    """(s,) tick at which each submap began, rising; the first one's is 0."""
    by: Floats
    """(s, 3) motion of each submap from the torn map to this one, m, m, rad."""

    def at(self, tick: int) -> Pose:
        """The motion of what was seen at a tick. Places of two laps may lie side by side, and move apart."""
        return pose_of(self.by[max(int(np.searchsorted(self.begins, tick, "right")) - 1, 0)])

    def places(self, ticks: Ints, places: Floats) -> Floats:
        """Places (k, 2) of the torn map, at which the robot was at ticks (k,), as they are in this one; metres."""
        moved = [apply(self.at(tick), place[None])[0] for tick, place in zip(ticks.tolist(), places, strict=True)]
        return np.array(moved).reshape(-1, 2)
