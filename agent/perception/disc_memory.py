"""What is remembered of discs in scans: teammates seen a moment ago, and posts that only look like teammates (ours)."""

import math

import numpy as np

from agent.corner_scan import STILL_M
from agent.kernels import kernel
from agent.period import in_ticks
from protocol.arrays import Bools, Floats
from protocol.geometry import Pose, apply, seen_from
from protocol.messages import RobotSpec

SEEN_SCANS = 4  # scans for which a disc is expected that they miss: one in ten misses it, four in a row almost never
POST_STILL_S = 3.0  # a disc still for so long while nobody is heard is a post; an exploring robot stands for 0.8 s
SILENCE_S = 21.0  # without any message nobody is near: of four beacons all are lost one time in 120 at 30 % loss
MAX_POSTS = 200  # posts that are kept, the newest (16 bytes each): a hall has a dozen


class SeenDiscs:
    """Teammates of the last few scans, in the frame of the odometry: a scan that misses one hides its beams as well."""

    def __init__(self, spec: RobotSpec) -> None:
        self._step_m = spec.max_speed_mps / spec.lidar.rate_hz
        self._seen = np.zeros((0, 4))  # (k, 4) x, y in m, scans since it was last seen, and scans in a row that saw it

    def expected(self, pose: Pose) -> Floats:
        """(k, 3) discs in the robot's frame: centre, and by how much the teammate may have moved; metres."""
        return np.column_stack((seen_from(pose, self._seen[:, :2]), self._step_m * self._seen[:, 2]))

    def add(self, pose: Pose, discs: Floats) -> None:
        """Remember the discs (k, 2) of a scan, given in the robot's frame, instead of where they were before.

        What is no teammate is seldom seen as a disc twice, so a disc is expected for no more scans than it was seen in.
        """
        if not len(discs) and not len(self._seen):
            return
        self._seen = np.asarray(_seen_now(self._seen, apply(pose, discs), self._step_m))


@kernel
def _seen_now(before: Floats, new: Floats, step_m: float) -> Floats:
    """What is remembered, rows as of `SeenDiscs`: those (k, 4) that a scan has missed, and its own discs (d, 2)."""
    out, count = np.empty((len(before) + len(new), 4)), 0
    missed, seen = np.ones(len(before), np.bool_), np.ones(len(new))
    for j in range(len(before)):
        x, y, scans, times = before[j]
        for k in range(len(new)):
            if math.hypot(new[k, 0] - x, new[k, 1] - y) <= step_m * scans + STILL_M:
                missed[j], seen[k] = False, max(seen[k], 1.0 + times)
        if missed[j] and scans < min(times, SEEN_SCANS):
            out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x, y, scans + 1.0, times
            count += 1
    for k in range(len(new)):
        out[count, 0], out[count, 1], out[count, 2], out[count, 3] = new[k, 0], new[k, 1], 1.0, seen[k]
        count += 1
    return out[:count].copy()


class Posts:
    """Discs that have stood still for a while where nobody can be, in the frame of the map.

    They are no teammates: a teammate within the lidar's range is within the radio's, and sends beacons. So nobody was
    heard in that while, or only those who have told where they are, and that is elsewhere: of three robots in `hall`
    somebody is heard for most of a run, and a post of 0.15 m was taken for a teammate by all three to the end.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self._reach_m = spec.lidar.range_max_m
        self._still = in_ticks(POST_STILL_S, spec.lidar.rate_hz)
        self._silence = in_ticks(SILENCE_S, spec.lidar.rate_hz)
        self._heard = -self._silence  # tick of the last message
        self._strange = -self._silence  # tick of the last one from somebody whose place is not known
        self._candidates = np.zeros((0, 4))  # (k, 4) of discs: x, y, and the ticks of the first and last sighting
        self.places = np.zeros((0, 2))  # (k, 2) metres

    def company(self, tick: int) -> bool:
        """Whether anybody was heard so lately that a disc may be a teammate."""
        return tick - self._heard < self._silence

    def hear(self, tick: int, here: Pose, *, stranger: bool) -> None:
        """Somebody is heard. Of a stranger no place is known, so no post around here is sure any more.

        here: the robot's pose.
        """
        self._heard = tick
        if stranger:
            self._strange = tick
            self.places = self.places[np.hypot(*(self.places - here[:2]).T) > self._reach_m]

    def add(self, tick: int, discs: Floats, teammates: Floats) -> None:
        """Take in a scan's discs (k, 2). teammates: (t, 3) their places, and by how much each may be off.

        Metres, frame of the map.
        """
        if tick - self._strange < self._silence:
            self._candidates = self._candidates[:0]
            return
        self.places = self.places[~_may_be_of(self.places, teammates)]
        if not len(discs) and not len(self._candidates):
            return  # so it is of most scans
        for x, y in discs[~_may_be_of(discs, teammates)].tolist():
            away = np.hypot(self._candidates[:, 0] - x, self._candidates[:, 1] - y)
            if len(away) and away.min() <= STILL_M:
                self._candidates[int(away.argmin()), 3] = tick
            else:
                self._candidates = np.vstack((self._candidates, (x, y, tick, tick)))
        still = self._candidates[:, 3] - self._candidates[:, 2] >= self._still
        if still.any():
            self.places = np.vstack((self.places, self._candidates[still, :2]))[-MAX_POSTS:]
        self._candidates = self._candidates[~still & (tick - self._candidates[:, 3] <= self._still)]

    def forget(self) -> None:
        """Begin anew; who was heard, and when, stays known."""
        self._candidates, self.places = self._candidates[:0], self.places[:0]

    def seen_from(self, pose: Pose) -> Floats:
        """(k, 2) the posts in the frame of a pose."""
        return seen_from(pose, self.places)


def _may_be_of(points: Floats, teammates: Floats) -> Bools:
    """(n,) at which of points (n, 2) one of teammates (t, 3), place and slack, may be."""
    if not len(points) or not len(teammates):
        return np.zeros(len(points), np.bool_)
    away = np.hypot(*(points[:, None] - teammates[None, :, :2]).transpose(2, 0, 1))
    return np.asarray((away <= teammates[:, 2]).any(1))
