"""How much longer a robot's odometry tells its way than it is, by walls that held its scans along the way (ours).

Wheels that are 2 % too small bend no path where walls stand ahead; a corridor without any comes out 2 % too long.
"""

import math

import numpy as np

from protocol.arrays import Floats

SURE = 1.0  # a match tells of a step's length where it is known at least so much better than by odometry, in variances
SIGMAS = 3.0  # of a length's error: what differs by more was matched to another wall, or the wheels slipped


class LengthScale:
    """Metres of way for a metre that odometry tells, as a Gaussian: each held step is a measurement of it."""

    def __init__(self, sd: float) -> None:
        """sd: of the scale about 1 at first; 0 where it is known."""
        self.mean, self._variance = 1.0, sd**2

    def learn(self, before: Floats, told: Floats, matched: Floats, prior: Floats, information: Floats) -> None:
        """Take the step from one pose to the next, all (3,): as odometry tells it by the present mean, and as matched.

        prior, information: (3, 3) of the told pose, and of the matched one, which has the prior in it.
        """
        step = told[:2] - before[:2]
        far = math.hypot(step[0], step[1])
        if self._variance == 0.0 or far == 0.0:
            return
        ahead = step / far
        odometry = float(ahead @ np.linalg.inv(prior)[:2, :2] @ ahead)
        after = float(ahead @ np.linalg.inv(information)[:2, :2] @ ahead)
        if after * (1.0 + SURE) > odometry:
            return  # nothing holds the scan along the way
        match = after * odometry / (odometry - after)
        off = float(ahead @ (matched[:2] - told[:2])) * (odometry + match) / odometry
        metres = far / self.mean
        variance = odometry + match + metres**2 * self._variance
        if off**2 > SIGMAS**2 * variance:
            return
        gain = metres * self._variance / variance
        self.mean += gain * off
        self._variance -= gain * metres * self._variance
