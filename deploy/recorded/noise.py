"""How far the ranges of a log err, by how they jump from beam to beam (ours).

On a flat wall the inverse of the range is a sine of the bearing, so that of one beam follows from those beside it. By
how much it does not is noise. Small lidars err by a share of the range, and no log tells by which: mapped with the
constant noise of a SICK, whose far walls err as little as near ones, paths of our own runs were off by several times as
much (docs/mapping.md). What stands in a room makes ranges jump, too, but not as normal noise does.
"""

import math

import numpy as np

from agent.shell.ros2.laser_scan import ALL_ROUND_DEG
from deploy.recorded.lidar_log import LidarLog
from protocol.arrays import Floats

FAR_M = 1.0  # nearer ranges err by the constant part
LEAST = 1000  # beams between two others by which a noise is told
MOST_SCANS = 1000  # that are looked at, evenly over the log
MOST_SHARE = 0.1  # a lidar that errs by more is none: these are leaves, or a fence
CLEARLY = 1.5  # times the constant noise, of which the larger holds (`LidarSpec`): less may be that and corners alone
TAIL = 2.0
"""Upper quartile of the jumps of far ranges, in medians, from which they are of what stands in the room: 1.71 of normal
noise, and 4.1 to 12.6 in four public logs of SICKs."""
GROWS = 0.8  # the share of far ranges is at least so much of that of near ones: a constant noise's falls
MEDIAN_SD = 0.6745  # median of what is normally distributed, without its sign, in standard deviations


def measured_noise(log: LidarLog) -> None:
    """Let a lidar err by a share of the range, if its scans show that this is larger than its constant noise.

    Who looks at less than all around may be a SICK, whose scans show what stands in the room: with that as noise, the
    path of csail-drift is 0.090 m off in place of 0.078, and that of intel-drift 0.062 in place of 0.052. There the
    jumps must be those of normal noise that grows with the range.
    """
    if not log.scans:
        return
    ranges = np.array([scan.ranges for scan in log.scans[:: 1 + len(log.scans) // MOST_SCANS]])
    jumps, at_m = _jumps(np.where(np.isfinite(ranges) & (ranges > 0.0), ranges, np.nan), log.lidar.beam_step)
    if len(jumps) < LEAST or (log.lidar.field_of_view_deg < ALL_ROUND_DEG and not _are_noise(jumps, at_m)):
        return
    share = float(np.median(jumps))
    if share * float(np.median(at_m)) > CLEARLY * log.lidar.noise_m:
        log.lidar = log.lidar.model_copy(update={"noise_share": round(min(share, MOST_SHARE), 4)})


def _are_noise(jumps: Floats, at_m: Floats) -> bool:
    """Whether jumps are distributed as noise that grows with the range."""
    far = at_m > np.median(at_m)
    if not far.any():
        return False
    middle, upper = np.quantile(jumps[far], (0.5, 0.75))
    return bool(upper < TAIL * middle and middle > GROWS * np.median(jumps[~far]))


def _jumps(ranges: Floats, step: float) -> tuple[Floats, Floats]:
    """By how much far ranges (scans, beams), m and `step` rad apart, jump, as a share; NaN is no range.

    Their median is the standard deviation of noise. Returns the ranges, too.
    """
    middle, inverse = ranges[:, 1:-1], 1.0 / ranges
    expected = 2.0 * math.cos(step)
    jumps = np.abs(inverse[:, :-2] - expected * inverse[:, 1:-1] + inverse[:, 2:]) * middle
    told = np.isfinite(jumps) & (middle > FAR_M)
    return jumps[told] / (MEDIAN_SD * math.hypot(math.sqrt(2.0), expected)), middle[told]
