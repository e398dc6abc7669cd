"""Teammates seen a moment ago: a disc that one scan misses hides its beams all the same (ours)."""

from __future__ import annotations

from collections import deque

import numpy as np

from protocol.arrays import Floats
from protocol.geometry import Pose, apply, seen_from


class SeenDiscs:
    """Discs of the last few scans, in the frame of the odometry."""

    def __init__(self, scans: int, step_m: float) -> None:
        """scans: how long a disc is remembered; step_m: how far a teammate moves between two scans at most."""
        self.step_m = step_m
        self._scans: deque[Floats] = deque(maxlen=scans)

    def expected(self, pose: Pose) -> Floats:
        """(k, 3) discs in the robot's frame: centre, and by how much the teammate may have moved; metres."""
        newest = len(self._scans)
        seen = [(d, self.step_m * (newest - k)) for k, d in enumerate(self._scans) if len(d)]
        if not seen:
            return np.zeros((0, 3))
        discs = np.vstack([np.column_stack((d, np.full(len(d), slack))) for d, slack in seen])
        return np.column_stack((seen_from(pose, discs[:, :2]), discs[:, 2]))

    def see(self, pose: Pose, discs: Floats) -> None:
        """Remember the discs (k, 2) of a scan, given in the robot's frame."""
        self._scans.append(apply(pose, discs))
