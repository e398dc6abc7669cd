"""Where two robots were when one heard the other: within radio range, and each in free space (ours)."""

from typing import NamedTuple

import numpy as np

from agent.alignment.free_space import FreeSpace
from agent.geometry.transform import compose, inverse
from protocol.arrays import Bools, Floats
from protocol.geometry import Pose

RANGE_SLACK_M = 0.3  # a peer may be this far beyond the radio's range: both robots move while a message is under way
BODY_SLACK_M = 0.03  # a body may overlap a mapped wall by so much: 3 sigma of a corner


class Encounter(NamedTuple):
    """Both robots when a message came, each in its own frame."""

    here: Pose
    theirs: Pose

    def allows(self, transforms: Floats, mine: FreeSpace, theirs: FreeSpace, range_m: float, radius_m: float) -> Bools:
        """(k,) whether transforms (k, 3), of the peer's frame into mine, put both in range and in free space.

        mine, theirs: by my map and by the peer's. range_m: of the radio. radius_m: of either body.
        """
        clearance = max(radius_m - BODY_SLACK_M, 0.0)
        peer = compose(transforms, np.array(self.theirs))[:, :2]
        me = compose(inverse(transforms), np.array(self.here))[:, :2]
        away = np.hypot(peer[:, 0] - self.here[0], peer[:, 1] - self.here[1])
        out: Bools = (away <= range_m + RANGE_SLACK_M) & (away >= 2 * clearance)
        out[out] = mine.holds(peer[out], clearance)
        out[out] = theirs.holds(me[out], clearance)
        return out
