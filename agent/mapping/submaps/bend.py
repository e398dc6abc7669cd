"""By how much a robot turns in each metre that odometry tells as straight, by walls that held its scans (ours).

Wheels that differ by 1 % bend a straight drive by 4 degrees a metre (`wheels.py`). Where no wall is near, as in a hall
that is wider than the lidar reaches, nothing else tells.
"""

import math

from agent.mapping.submaps.stretches import Stretches
from protocol.arrays import Floats
from protocol.geometry import Pose, pose_of, relative, wrapped

HELD_RAD = math.radians(2.0)  # standard deviation up to which walls hold a scan's heading


class Bend:
    """Radians a metre, as a Gaussian: each stretch between held scans measures it."""

    def __init__(self, sd: float) -> None:
        """sd: about 0 at first; 0 where it is known."""
        self._stretches = Stretches(0.0, sd, HELD_RAD)
        self._off = self._ahead = 0.0  # rad of turns that odometry does not tell, and metres ahead

    @property
    def mean(self) -> float:
        """Radians that are added to the odometry's turn for each metre ahead."""
        return self._stretches.mean

    def lose(self) -> None:
        """Nothing tells where the robot looks: a new stretch begins at the next scan that walls hold."""
        self._stretches.begin(math.inf)
        self._off = self._ahead = 0.0

    def learn(self, by: Pose, before: Floats, matched: Floats, prior: Floats, information: Floats) -> None:
        """Take a step: by odometry, with the present mean in it, and its two poses, (3,).

        prior, information: (3, 3) of the pose that odometry tells, and of the matched one, which has the prior in it.
        """
        if self._stretches.known:
            return
        self._off += wrapped(relative(pose_of(before), pose_of(matched))[2] - by[2] + self.mean * by[0])
        self._ahead += by[0]
        if not self._stretches.may_end(math.hypot(by[0], by[1]), 1.0 / float(prior[2, 2])):
            return
        walls = float(information[2, 2] - prior[2, 2])
        held = 1.0 / walls if walls > 0.0 else math.inf
        if self._stretches.end(held, self._off - self.mean * self._ahead, self._ahead):
            self._off = self._ahead = 0.0
