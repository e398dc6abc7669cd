"""How much longer a robot's odometry tells its way than it is, by walls that held its scans along the way (ours).

Wheels that are 2 % too small bend no path where walls stand ahead; a corridor without any comes out 2 % too long.
"""

import math

import numpy as np

from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of, relative

STRETCH_M = 1.0
"""Of way, at least, that is compared at once. Odometry's error grows as the root of the way: steps of 0.1 m err by a
tenth, and more of those that were told too long count as held. Learned from steps, the scale came out 0.86 for 0.98."""
LOST_M = 10.0  # of way without a place that walls hold, after which a new stretch begins
HELD_M = 0.06  # standard deviation along the way up to which walls hold a scan
SIGMAS = 3.0  # of a length's error: what differs by more was matched to another wall, or the wheels slipped


class LengthScale:
    """Metres of way for a metre that odometry tells, as a Gaussian: each stretch between held scans measures it."""

    def __init__(self, sd: float) -> None:
        """sd: of the scale about 1 at first; 0 where it is known."""
        self.mean, self._variance = 1.0, sd**2
        self.lose()

    def lose(self) -> None:
        """Nothing tells where the robot is: a new stretch begins at the next scan that walls hold."""
        self._begin(math.inf)

    def _begin(self, variance: float) -> None:
        """Begin a stretch at a pose with a variance along the way, m2."""
        self._at: Pose = (0.0, 0.0, 0.0)  # the robot's pose as matched, in the frame of the stretch's first one
        self._told = np.zeros(2)  # that place by the lengths that odometry tells
        self._way, self._odometry, self._first = 0.0, 0.0, variance

    def learn(self, by: Pose, before: Floats, matched: Floats, prior: Floats, information: Floats) -> None:
        """Take a step: by odometry and the present mean, in the robot's frame before it; and its two poses, (3,).

        prior, information: (3, 3) of the pose that odometry tells, and of the matched one, which has the prior in it.
        """
        if self._variance == 0.0:
            return
        c, s = math.cos(self._at[2]), math.sin(self._at[2])
        self._told += np.array((c * by[0] - s * by[1], s * by[0] + c * by[1])) / self.mean
        self._at = compose(self._at, relative(pose_of(before), pose_of(matched)))
        self._way += math.hypot(by[0], by[1])
        self._odometry += 1.0 / float(prior[0, 0])
        lost = math.isinf(self._first) or self._way > LOST_M
        if not lost and self._way < STRETCH_M:
            return
        metres = float(np.hypot(*self._told))
        ahead = self._told / metres if metres > 0.0 else np.array((1.0, 0.0))
        held = _variance_along(ahead, float(matched[2]) - self._at[2], prior, information)
        if lost:
            self._begin(held if held <= HELD_M**2 else math.inf)
        elif held <= HELD_M**2:
            off = float(ahead @ self._at[:2]) - self.mean * metres
            variance = self._odometry + self._first + held + metres**2 * self._variance
            if off**2 > SIGMAS**2 * variance:
                self.lose()
                return
            gain = metres * self._variance / variance
            self.mean += gain * off
            self._variance -= gain * metres * self._variance
            self._begin(held)


def _variance_along(ahead: Floats, turn: float, prior: Floats, information: Floats) -> float:
    """Of a matched place by walls alone, m2, along a direction (2,) once it is turned into the matched pose's frame."""
    c, s = math.cos(turn), math.sin(turn)
    along = np.array((c * ahead[0] - s * ahead[1], s * ahead[0] + c * ahead[1]))
    before, after = (float(along @ np.linalg.inv(known)[:2, :2] @ along) for known in (prior, information))
    return after * before / (before - after) if after < before else math.inf
