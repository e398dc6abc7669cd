"""A wall that scans steadily place or turn elsewhere is not as well known as its covariance says (ours).

A wall that is wrong by a few centimetres, by whatever mistake, and that the joint covariance takes to be known to
millimetres, would stay: each scan moves the robot instead. What is off by chance is so to either side.
"""

from agent.geometry.lines import Record
from agent.kernels import kernel
from agent.mapping.edges import length
from agent.mapping.kalman import Innovation
from protocol.arrays import Floats

SHARE = 0.1  # weight of the newest piece in the mean of its wall, which forgets
STEADY_SIGMAS = 2.0
"""Mean, in deviations, at which a wall is not known: 9 of that mean's own. None is reached in `hall`, seeds 0 to 4; of
38 corners that were moved by the filter's fault bench 32 are put right instead of 28. With 1.0 it is 32, too, and walls
that were only seen amiss let go: paths in `hall` are 18 instead of 16 mm off (rms, means of five)."""
STEADY_TURN_SIGMAS = 1.5
"""The same of pieces' directions: 6 deviations of that mean's own. Of a wall that is tilted about one end the near half
is in its place, and most hits are there. In two sets of 100 moved corners 9 and 12 more are put right by this and by
`edges.has_slot`; with 2.0 one and three fewer, with 1.0 one more and none."""


@kernel
def strain(wall: Record, row: int, joint: Floats, t: float, aside: Innovation) -> None:
    """Count a piece t metres along a wall and beside it, m; where steadily so, widen what is known of it.

    row: of the wall's line in the joint covariance.
    """
    if _steady(wall, 0, aside.deviations, STEADY_SIGMAS):
        lever = max(0.5 * length(wall), abs(t))
        joint[row, row] += aside.off**2
        joint[row + 1, row + 1] += (aside.off / lever) ** 2


@kernel
def strain_direction(wall: Record, row: int, joint: Floats, aside: Innovation, turn: Innovation) -> None:
    """The same of a piece that is turned against a wall, rad."""
    if _steady(wall, 1, turn.deviations, STEADY_TURN_SIGMAS):
        joint[row, row] += aside.off**2
        joint[row + 1, row + 1] += turn.off**2


@kernel
def _steady(wall: Record, which: int, deviations: float, most: float) -> bool:
    """Count a piece: whether the mean of such deviations exceeds `most`, and counting begins anew."""
    wall.strain[which] += SHARE * (deviations - wall.strain[which])
    if abs(wall.strain[which]) <= most:
        return False
    wall.strain[which] = 0.0
    return True
