"""How much longer a robot's odometry tells its way than it is, by walls that held its scans along the way (ours).

Wheels that are 2 % too small bend no path where walls stand ahead; a corridor without any comes out 2 % too long.
"""

import math

import numpy as np

from agent.mapping.submaps.stretches import Stretches
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of, relative

HELD_M = 0.06  # standard deviation along the way up to which walls hold a scan


class LengthScale:
    """Metres of way for a metre that odometry tells, as a Gaussian: each stretch between held scans measures it."""

    def __init__(self, sd: float) -> None:
        """sd: of the scale about 1 at first; 0 where it is known."""
        self._stretches = Stretches(1.0, sd, HELD_M)
        self._begin()

    @property
    def mean(self) -> float:
        """Metres for a metre."""
        return self._stretches.mean

    def lose(self) -> None:
        """Nothing tells where the robot is: a new stretch begins at the next scan that walls hold."""
        self._stretches.begin(math.inf)
        self._begin()

    def _begin(self) -> None:
        self._at: Pose = (0.0, 0.0, 0.0)  # the robot's pose as matched, in the frame of the stretch's first one
        self._told = np.zeros(2)  # that place by the lengths that odometry tells

    def learn(self, by: Pose, before: Floats, matched: Floats, prior: Floats, information: Floats) -> None:
        """Take a step: by odometry and the present mean, in the robot's frame before it; and its two poses, (3,).

        prior, information: (3, 3) of the pose that odometry tells, and of the matched one, which has the prior in it.
        """
        if self._stretches.known:
            return
        c, s = math.cos(self._at[2]), math.sin(self._at[2])
        self._told += np.array((c * by[0] - s * by[1], s * by[0] + c * by[1])) / self.mean
        self._at = compose(self._at, relative(pose_of(before), pose_of(matched)))
        if not self._stretches.may_end(math.hypot(by[0], by[1]), 1.0 / float(prior[0, 0])):
            return
        metres = float(np.hypot(*self._told))
        ahead = self._told / metres if metres > 0.0 else np.array((1.0, 0.0))
        held = _variance_along(ahead, float(matched[2]) - self._at[2], prior, information)
        if self._stretches.end(held, float(ahead @ self._at[:2]) - self.mean * metres, metres):
            self._begin()


def _variance_along(ahead: Floats, turn: float, prior: Floats, information: Floats) -> float:
    """Of a matched place by walls alone, m2, along a direction (2,) once it is turned into the matched pose's frame."""
    c, s = math.cos(turn), math.sin(turn)
    along = np.array((c * ahead[0] - s * ahead[1], s * ahead[0] + c * ahead[1]))
    before, after = (float(along @ np.linalg.inv(known)[:2, :2] @ along) for known in (prior, information))
    return after * before / (before - after) if after < before else math.inf
