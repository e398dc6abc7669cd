"""How far the ranges of a log err, by how they jump from beam to beam (ours).

On a flat wall the inverse of the range is a sine of the bearing, so that of one beam follows from those beside it. By
how much it does not is noise. Small lidars err by a share of the range, and no log tells by which: mapped with the
constant noise of a SICK, whose far walls err as little as near ones, paths of our own runs were off by several times as
much (docs/mapping.md).
"""

import math

import numpy as np

from deploy.recorded.lidar_log import LidarLog
from deploy.recorded.revolution import ALL_ROUND_DEG
from protocol.arrays import Floats

FAR_M = 1.0  # nearer ranges err by the constant part
LEAST = 1000  # beams between two others by which a noise is told
MOST_SCANS = 1000  # that are looked at, evenly over the log
MOST_SHARE = 0.1  # a lidar that errs by more is none: these are leaves, or a fence
CLEARLY = 1.5  # times the constant noise, of which the larger holds (`LidarSpec`): less may be that and corners alone
MEDIAN_SD = 0.6745  # median of what is normally distributed, without its sign, in standard deviations


def measured_noise(log: LidarLog) -> None:
    """Let a lidar that looks all around err by a share of the range, if its scans show that this is the larger part.

    A SICK's scans show what stands in the room: with that as noise, the path of csail-drift is 0.090 m off in place of
    0.078, and that of intel-drift 0.062 in place of 0.052.
    """
    if log.lidar.field_of_view_deg < ALL_ROUND_DEG or not log.scans:
        return
    ranges = np.array([scan.ranges for scan in log.scans[:: 1 + len(log.scans) // MOST_SCANS]])
    ranges = np.where(np.isfinite(ranges) & (ranges > 0.0), ranges, np.nan)
    share, at_m = _share(ranges, log.lidar.beam_step)
    if share * at_m > CLEARLY * log.lidar.noise_m:
        log.lidar = log.lidar.model_copy(update={"noise_share": round(min(share, MOST_SHARE), 4)})


def _share(ranges: Floats, step: float) -> tuple[float, float]:
    """Standard deviation of far ranges (scans, beams), m and `step` rad apart, as a share of them; NaN is no range.

    Returns the median range that it was told by, too; zeros where too little is told.
    """
    middle, inverse = ranges[:, 1:-1], 1.0 / ranges
    expected = 2.0 * math.cos(step)
    jumps = np.abs(inverse[:, :-2] - expected * inverse[:, 1:-1] + inverse[:, 2:]) * middle
    told = np.isfinite(jumps) & (middle > FAR_M)
    if told.sum() < LEAST:
        return 0.0, 0.0
    share = float(np.median(jumps[told])) / (MEDIAN_SD * math.hypot(math.sqrt(2.0), expected))
    return share, float(np.median(middle[told]))
