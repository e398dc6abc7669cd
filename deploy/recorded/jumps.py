"""Odometry that begins anew or jumps, as that of a base that is started again: what follows goes on from there (ours).

A ROS 2 robot knows its top speed, and stands for that moment (`Wheelpath`). A log tells how the robot moved before: the
path of csail-drift whose odometry begins anew at scan 200 is 0.088 m off in place of 19, and 0.446 where it stands.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deploy.recorded.lidar_log import LidarLog, Scan
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, compose, inverted, relative

JUMP_M, JUMP_MPS = 0.5, 10.0  # more than these from one moment to the next, by odometry, is no robot's way


def are_jumps(metres: Floats, seconds: Floats) -> NDArray[np.bool_]:
    """Which of ways (n,) by odometry, each in its time (n,), no robot has gone."""
    return metres > JUMP_M + JUMP_MPS * seconds


def mend_jumps(log: LidarLog) -> None:
    """Let a scan to which odometry jumps move as the one before it did, and what follows along with it; and note it."""
    scans, times = log.scans, np.array([scan.time_s for scan in log.scans])
    places = np.array([scan.odometry[:2] for scan in scans]).reshape(-1, 2)
    ways, steps_s = np.hypot(*np.diff(places, axis=0).T), np.diff(times)
    at = np.flatnonzero(are_jumps(ways, steps_s)) + 1
    for begin, end in pairwise([*at.tolist(), len(scans)]):
        last, step = scans[begin - 1], (0.0, 0.0, 0.0)
        if begin > 1:
            # who pauses does not go on for all of it
            share = min(float(steps_s[begin - 1] / max(steps_s[begin - 2], 1e-9)), 1.0)
            x, y, turn = relative(scans[begin - 2].odometry, last.odometry)
            step = share * x, share * y, share * turn
        now = compose(last.odometry, step)
        fix = compose(now, inverted(scans[begin].odometry))
        scans[begin:end] = [_moved(scan, fix) for scan in scans[begin:end]]
        as_last = _moved(last, compose(now, inverted(last.odometry)))
        scans[begin] = scans[begin]._replace(way=as_last.way)  # its own one may lead from before the jump to behind it
    if len(at):
        log.notes.append(
            f"{len(at)} jumps of odometry, of up to {ways[at - 1].max():.1f} m from scan to scan: there the robot is "
            "taken to go on as before"
        )
        log.skip_far()


def _moved(scan: Scan, by: Pose) -> Scan:
    """A scan whose frame of odometry is moved by a transform."""
    way = None if scan.way is None else np.column_stack((apply(by, scan.way[:, :2]), scan.way[:, 2] + by[2]))
    return scan._replace(odometry=compose(by, scan.odometry), way=way)
