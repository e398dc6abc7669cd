"""How far the ranges of a log err, by how they jump from beam to beam (ours).

A wall's ranges hardly bend within three beams, so what their second difference scatters by is noise. Small lidars err
by a share of the range, and no log tells by which: mapped with the constant noise of a SICK, whose far walls err as
little as near ones, paths of our own runs were off by 0.06 to 0.9 m in place of 0.03.
"""

import math

import numpy as np

from deploy.recorded.lidar_log import LidarLog
from deploy.recorded.revolution import ALL_ROUND_DEG
from protocol.arrays import Floats

FAR_M = 1.0  # nearer ranges err by the constant part
LEAST = 1000  # second differences by which a noise is told
MOST_SCANS = 1000  # that are looked at, evenly over the log
MOST_SHARE = 0.1  # a lidar that errs by more is none: these are leaves, or a fence
MEDIAN_SD = 0.6745  # median of what is normally distributed, without its sign, in standard deviations
DIFFERENCE_SD = math.sqrt(6.0)  # of a second difference, in those of a range


def measured_noise(log: LidarLog) -> None:
    """Let a small lidar, that turns or looks all around, err by the share of the range that its scans show.

    A SICK's scans show what stands in the room: with that as noise, the path of csail-drift is 0.090 m off in place of
    0.078, and that of intel-drift 0.062 in place of 0.052.
    """
    if not log.lidar.turning and log.lidar.field_of_view_deg < ALL_ROUND_DEG:
        return
    ranges = np.array([scan.ranges for scan in log.scans[:: 1 + len(log.scans) // MOST_SCANS]])
    share = _share(np.where(np.isfinite(ranges), ranges, np.nan))
    if share is not None:
        log.lidar = log.lidar.model_copy(update={"noise_share": round(min(share, MOST_SHARE), 4)})


def _share(ranges: Floats) -> float | None:
    """Standard deviation of far ranges as a share of them; NaN in (scans, beams) is no range."""
    middle = ranges[:, 1:-1]
    jumps = np.abs(ranges[:, :-2] - 2.0 * middle + ranges[:, 2:]) / middle
    told = jumps[np.isfinite(jumps) & (middle > FAR_M)]
    if len(told) < LEAST:
        return None
    return float(np.median(told)) / (MEDIAN_SD * DIFFERENCE_SD)
