"""Slots beside a corner: a wall that never shows its last centimetres before the wall it seems to meet (ours).

A cabinet stands 6 cm off a wall. From the room its side and the wall seem to meet, as one beam meets the side and the
next one the wall. But where the side goes on to the corner, its last hit is no farther off than two beams are apart;
before a slot it often is. Views from many places tell slots so that are narrower than beams are apart.
"""

import math

from agent.geometry.lines import Record
from agent.kernels import kernel

SCORE, MISSED, GAPS, APART, BEARING = range(5)
"""Of EDGE's `bare`: log odds of a slot, number of views whose beam missed the side, sums of their gaps and of their
distances of beams, metres, and the bearing of the last hit in the last view, rad."""
OTHER_VIEW_RAD = 0.02
"""A view in which the lidar sees the end at a bearing that differs by less is none of its own: from one place, the last
hit lies at the same point of the wall in each scan. A beam of 360 is 0.017 rad."""
NOISE_M = 0.01  # by which a gap may exceed the distance of two beams where there is no slot: a corner's error
MISS, FALSE_MISS = 0.4, 0.1
"""Share of views with a larger gap, before slots of 4 and 6 cm and before corners without any: 0.35 to 0.56 and 0.09 to
0.13, seen from 0.7 to 1.6 m away. With a slot some miss nothing: hits on the wall behind pass for the side."""
SURE_LOG_ODDS = math.log(1000.0)
"""Log odds at which a slot is taken to be there: of a thousand corners with none, one seems to have one (Wald)."""
HIT_SCORE, MISS_SCORE = math.log((1.0 - MISS) / (1.0 - FALSE_MISS)), math.log(MISS / FALSE_MISS)


@kernel
def see_bare(e: Record, side: int, gap: float, apart: float, bearing: float) -> None:
    """Count a view of the corner at an end: metres without a hit before it, and between two beams there.

    apart: 0 counts nothing. bearing: of the last hit in the robot's frame, rad.
    """
    b = e.bare[side]
    if apart <= 0.0 or abs(math.sin(0.5 * (bearing - b[BEARING]))) < 0.5 * OTHER_VIEW_RAD:
        return
    b[BEARING] = bearing
    if gap <= apart + NOISE_M:
        b[SCORE] += HIT_SCORE
        return
    b[SCORE] += MISS_SCORE
    b[MISSED] += 1.0
    b[GAPS] += gap
    b[APART] += apart


@kernel
def show_slot(e: Record, side: int, gap: float, apart: float) -> None:
    """Take a slot to be there, as views showed the wall's end before the corner, and beams that passed behind it.

    gap: metres from that end to the corner. apart: from its last hit to where the next beam would have met the wall, m.
    """
    b = e.bare[side]
    b[SCORE], b[MISSED], b[GAPS], b[APART] = SURE_LOG_ODDS, 1.0, gap, apart


@kernel
def slot_before(e: Record, side: int) -> float:
    """Width of the slot between an end of a wall and the corner there, metres; 0: none is known.

    Gaps are spread evenly over [width, width + apart], and only those that exceed apart count. Their mean is apart +
    width / 2 where width < apart, else width + apart / 2: the lesser of both inverts it.
    """
    b = e.bare[side]
    if b[SCORE] < SURE_LOG_ODDS:
        return 0.0
    gap, apart = b[GAPS] / b[MISSED], b[APART] / b[MISSED]
    return float(min(2.0 * (gap - apart), gap - 0.5 * apart))


@kernel
def forget_bare(e: Record, side: int) -> None:
    """Count views of a new corner from the first."""
    for k in range(5):
        e.bare[side, k] = 0.0
