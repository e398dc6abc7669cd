"""What a log does not tell, as far as its scans show it; what is found first, the rest looks at."""

from deploy.recorded.ceiling import find_ceiling
from deploy.recorded.jumps import mend_jumps
from deploy.recorded.lidar_log import Given, LidarLog
from deploy.recorded.noise import measured_noise
from deploy.recorded.revolution import Revolution, unroll


def find_untold(log: LidarLog, given: Given, told: Revolution | None = None, *, from_stamp: bool = False) -> None:
    """Complete a log of which all scans are read.

    told, from_stamp: as for `unroll`, which is left out where each scan tells its own revolution. Raises InputError
    for one that is given and too long.
    """
    if given.range_max_m is None:
        find_ceiling(log)
    mend_jumps(log)
    if not log.lidar.turning:
        unroll(log, told, given.revolution_s, from_stamp)
    measured_noise(log)
    log.note_odd()
