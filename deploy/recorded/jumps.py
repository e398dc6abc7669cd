"""Odometry that begins anew or jumps, as that of a base that is started again: what follows goes on from there (ours).

A ROS 2 robot knows its top speed, and stands for that moment (`Wheelpath`). A log tells how the robot moved before: the
path of csail-drift whose odometry begins anew at scan 200 is 0.088 m off in place of 19, and 0.446 if it is taken to
stand.
"""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from agent.shell.ros2.laser_scan import APART_S
from agent.shell.ros2.wheelpath import begins_anew
from deploy.recorded.lidar_log import LidarLog, Scan
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, compose, inverted, relative, wrapped

JUMP_M, JUMP_MPS = 0.5, 10.0  # more than these from one moment to the next, by odometry, is no robot's way
LONG_MPS = 2.0  # and more than this in what of the time is beyond APART_S: nobody keeps up the former for long
JUMP_RAD, JUMP_RPS = 1.0, 4.0  # so are turns


def are_jumps(before: Floats, after: Floats, seconds: Floats, gap_s: float) -> NDArray[np.bool_]:
    """(n,) which ways from poses (n, 3) to others, each in its time (n,), no robot has gone.

    Poses are those that odometry tells of the robot. gap_s: as of `gap_of`. Only after a pause it may have begun anew.
    """
    metres, turns = np.hypot(*(after - before)[:, :2].T), np.abs(wrapped(after[:, 2] - before[:, 2]))
    far = metres > JUMP_M + JUMP_MPS * np.minimum(seconds, APART_S) + LONG_MPS * np.maximum(seconds - APART_S, 0.0)
    anew = (seconds > max(APART_S, gap_s)) & begins_anew(before, after)
    return np.asarray(far | anew | (turns > JUMP_RAD + JUMP_RPS * seconds), np.bool_)


def mend_jumps(log: LidarLog) -> None:
    """Let a scan to which odometry jumps move as the one before it did, and what follows along with it; and note it."""
    scans, steps_s = log.scans, np.diff([scan.time_s for scan in log.scans])
    if not len(steps_s):
        return
    off = inverted(log.mount or (0.0, 0.0, 0.0))
    poses = np.array([compose(scan.odometry, off) for scan in scans])
    at = np.flatnonzero(are_jumps(poses[:-1], poses[1:], steps_s, log.gap_s())) + 1
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
        ways = (poses[at] - poses[at - 1]).T
        metres, turn = np.hypot(*ways[:2]).max(), np.abs(wrapped(ways[2])).max()
        log.notes.append(
            f"{len(at)} jumps of odometry, of up to {metres:.1f} m and {math.degrees(turn):.0f} degrees from scan to "
            "scan: there the robot is taken to go on as before"
        )
        log.skip_far()


def _moved(scan: Scan, by: Pose) -> Scan:
    """A scan whose frame of odometry is moved by a transform."""
    way = None if scan.way is None else np.column_stack((apply(by, scan.way[:, :2]), scan.way[:, 2] + by[2]))
    return scan._replace(odometry=compose(by, scan.odometry), way=way)
