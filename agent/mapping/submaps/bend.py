"""By how much a robot turns in each metre that odometry tells as straight, by walls that held its scans (ours).

Wheels that differ by 1 % bend a straight drive by 4 degrees a metre (`wheels.py`). Where no wall is near, as in a hall
that is wider than the lidar reaches, nothing else tells.
"""

import math

from protocol.arrays import Floats
from protocol.geometry import Pose, pose_of, relative, wrapped

STRETCH_M = 1.0  # of way, at least, that is compared at once: headings of neighbouring scans share their errors
LOST_M = 10.0  # of way without a heading that walls hold, after which a new stretch begins
HELD_RAD = math.radians(2.0)  # standard deviation up to which walls hold a scan's heading
SIGMAS = 3.0  # of a turn's error: what differs by more was matched to another wall, or the wheels slipped


class Bend:
    """Radians a metre, as a Gaussian: each stretch between held scans measures it."""

    def __init__(self, sd: float) -> None:
        """sd: about 0 at first; 0 where it is known."""
        self.mean, self._variance = 0.0, sd**2
        self.lose()

    def lose(self) -> None:
        """Nothing tells where the robot looks: a new stretch begins at the next scan that walls hold."""
        self._begin(math.inf)

    def _begin(self, variance: float) -> None:
        self._off, self._ahead, self._way, self._odometry, self._first = 0.0, 0.0, 0.0, 0.0, variance

    def learn(self, by: Pose, before: Floats, matched: Floats, prior: Floats, information: Floats) -> None:
        """Take a step: by odometry, with the present mean in it, and its two poses, (3,).

        prior, information: (3, 3) of the pose that odometry tells, and of the matched one, which has the prior in it.
        """
        if self._variance == 0.0:
            return
        self._off += wrapped(relative(pose_of(before), pose_of(matched))[2] - by[2] + self.mean * by[0])
        self._ahead += by[0]
        self._way += math.hypot(by[0], by[1])
        self._odometry += 1.0 / float(prior[2, 2])
        lost = math.isinf(self._first) or self._way > LOST_M
        if not lost and self._way < STRETCH_M:
            return
        walls = float(information[2, 2] - prior[2, 2])
        held = 1.0 / walls if walls > 0.0 else math.inf
        if lost:
            self._begin(held if held <= HELD_RAD**2 else math.inf)
        elif held <= HELD_RAD**2:
            off = self._off - self.mean * self._ahead
            variance = self._odometry + self._first + held + self._ahead**2 * self._variance
            if off**2 > SIGMAS**2 * variance:
                self.lose()
                return
            gain = self._ahead * self._variance / variance
            self.mean += gain * off
            self._variance -= gain * self._ahead * self._variance
            self._begin(held)
