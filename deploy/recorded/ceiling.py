"""What a lidar tells where nothing came back, by the readings of a log that does not say so, or wrongly (ours).

It is the end of the lidar's range, or a little more: 81.83 m, 51.15, 50 or 32.77 in public logs of SICKs alone, and the
range itself in those of simulators. Taken for hits they are arcs of wall at that distance, flat enough for lines. From
one place the end of a long corridor looks the same to a lidar that errs by less than 5 mm: where a robot stands for a
whole log, that wall is lost, but for `--range-max`.
"""

import numpy as np

from deploy.recorded.lidar_log import LidarLog

PILE_M = 0.2  # of the readings up to the largest one: 51.14 to 51.16 m of one lidar, with a few up to 51.25
BELOW = 0.1  # share of the range: of readings below those, which are fewer; 0 to 8 % as many in thirteen public logs
SPREAD_M = 0.025
"""From the 5 % smallest to the 5 % largest of the pile, at most: 0.02 of that lidar. Those of a wall, as at the end of
a corridor, spread by noise of 1 cm alone over 0.033."""
LEAST_READINGS = 10
LEAST_RANGE_M = 3.0  # a lidar that reaches less far is none of these logs
LEAST_HITS = 0.1  # for each reading of the pile, so many others: else they are all that the log has


def find_ceiling(log: LidarLog) -> None:
    """Let readings that pile up at the log's largest one mean that nothing came back, and note it."""
    largest = max((float(scan.ranges[np.isfinite(scan.ranges)].max(initial=0.0)) for scan in log.scans), default=0.0)
    limit = largest - PILE_M
    pile = _readings_from(limit, log)
    below, hits = _readings_from((1.0 - BELOW) * limit, log) - pile, _readings_from(0.0, log) - pile
    if limit < LEAST_RANGE_M or pile < max(LEAST_READINGS, below + 1) or hits < LEAST_HITS * pile:
        return
    piled = np.concatenate([scan.ranges[np.isfinite(scan.ranges) & (scan.ranges >= limit)] for scan in log.scans])
    if np.ptp(np.quantile(piled, (0.05, 0.95))) > SPREAD_M:
        return
    log.lidar = log.lidar.model_copy(update={"range_max_m": round(limit, 3)})
    log.scans = [scan._replace(ranges=log.lidar.cleaned(scan.ranges)) for scan in log.scans]
    log.notes.append(f"{pile} readings of {limit:.2f} m and more are taken for beams of which nothing came back")


def _readings_from(metres: float, log: LidarLog) -> int:
    """How many ranges of a log are so long or longer."""
    return sum(int((np.isfinite(scan.ranges) & (scan.ranges >= metres)).sum()) for scan in log.scans)
