"""Posts that are round like a teammate: what stands still while nobody is heard is none (ours).

A teammate within the lidar's range is within the radio's, and sends beacons.
"""

from __future__ import annotations

import numpy as np

from agent.perception.config import PerceptionConfig
from protocol.arrays import Floats
from protocol.geometry import Pose, seen_from

_MOST = 200
"""Posts kept, the newest (16 bytes each): a hall has a dozen."""


class Posts:
    """Discs that have stood still for a while in which nobody was heard, in the frame of the map."""

    def __init__(self, config: PerceptionConfig, reach_m: float, rate_hz: float) -> None:
        """reach_m: how far discs are seen; rate_hz: scans a second."""
        self.near_m, self.reach_m = config.post_near_m, reach_m
        self._still = round(config.post_still_s * rate_hz)
        self._silence = round(config.post_silence_s * rate_hz)
        self._heard = -self._silence
        self._standing = np.zeros((0, 4))
        """(k, 4) x, y, and the ticks of the first and last sighting."""
        self.places = np.zeros((0, 2))
        """(k, 2) metres."""

    def look(self, tick: int, here: Pose, discs: Floats, heard: bool) -> None:
        """Take in a scan's discs (k, 2), frame of the map, seen from here; heard: any message at this tick.

        Where somebody is heard, no post around here is sure any more.
        """
        if heard:
            self._heard = tick
            self.places = self.places[np.hypot(*(self.places - here[:2]).T) > self.reach_m]
        if tick - self._heard < self._silence:
            self._standing = self._standing[:0]
            return
        for x, y in discs.tolist():
            away = np.hypot(self._standing[:, 0] - x, self._standing[:, 1] - y)
            if len(away) and away.min() <= self.near_m:
                self._standing[int(away.argmin()), 3] = tick
            else:
                self._standing = np.vstack((self._standing, (x, y, tick, tick)))
        stood = self._standing[:, 3] - self._standing[:, 2] >= self._still
        if stood.any():
            self.places = np.vstack((self.places, self._standing[stood, :2]))[-_MOST:]
        self._standing = self._standing[~stood & (tick - self._standing[:, 3] <= self._still)]

    def seen_from(self, pose: Pose) -> Floats:
        """(k, 2) those in reach of a pose, in its frame."""
        near = np.hypot(*(self.places - pose[:2]).T) <= self.reach_m + 1.0
        return seen_from(pose, self.places[near])
