"""The way of a robot of ROS 2 by its odometry, without jumps, whatever happens to its base and its clock."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agent.shell.ros2.laser_scan import APART_S, LEVEL, SET_ANEW, stamp_of
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, inverted, relative, wrapped
from protocol.messages import RobotSpec
from protocol.settings import MAX_NUMBER

KEPT_S = 10.0  # of odometry, at least
MOST_KEPT = 10_000  # messages of odometry that are kept: 1 kHz in these seconds
JUMP_M, JUMP_RAD = 0.3, 0.5
"""Odometry that moves by more than twice what the robot can do, and so much, began anew: its base was started again."""

BEGUN = 0.05
"""Metres and radians within which odometry is at its origin."""


def begins_anew(before: Floats, after: Floats) -> NDArray[np.bool_]:
    """Whether odometry that told poses (..., 3) and, after a pause, others began anew between.

    The robot may have come far, but hardly to where odometry begins.
    """
    return _at_origin(after, BEGUN, BEGUN) & ~_at_origin(before, JUMP_M, JUMP_RAD)


def _at_origin(poses: Floats, within_m: float, within_rad: float) -> NDArray[np.bool_]:
    return (np.hypot(poses[..., 0], poses[..., 1]) <= within_m) & (np.abs(wrapped(poses[..., 2])) <= within_rad)


class Wheelpath:
    """Where the robot's odometry led, as one way without jumps."""

    def __init__(self, spec: RobotSpec, skip: Callable[[str], None], wall: Callable[[], float]) -> None:
        """skip: is told why a message cannot be used. wall: time, for messages without a stamp."""
        self._spec, self._skip, self._wall = spec, skip, wall
        self.frame, self.robot_frame = "odom", "base_link"
        """Of the odometry and of the robot, as the first message names them (REP 105 where it does not)."""
        self._rows: list[tuple[float, float, float, float]] = []
        """Time and pose; theta is not wrapped."""
        self._fix: Pose = (0.0, 0.0, 0.0)
        """The frame of odometry that began anew, in that of the first."""
        self._back = 0

    @property
    def until_s(self) -> float:
        """Time of the last pose."""
        return self._rows[-1][0] if self._rows else -math.inf

    def take(self, told: Any) -> None:
        """Take an Odometry message."""
        stamp_s, place, turn = stamp_of(told, self._wall()), told.pose.pose.position, told.pose.pose.orientation
        x, y, z, w = (float(value) for value in (turn.x, turn.y, turn.z, turn.w))
        size = x * x + y * y + z * z + w * w
        if not all(abs(value) <= MAX_NUMBER for value in (place.x, place.y, size)) or size < 0.5:
            return self._skip("odometry that is no number")
        if 1 - 2 * (x * x + y * y) / size < LEVEL:
            return self._skip("odometry of a robot that is not level")
        frame = told.header.frame_id.lstrip("/")
        if not self._rows:
            self.frame = frame or self.frame
            self.robot_frame = told.child_frame_id.lstrip("/") or self.robot_frame
        elif frame not in ("", self.frame):
            return self._skip("odometry of another frame")
        pose = (float(place.x), float(place.y), math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
        if stamp_s <= self.until_s:
            self._back += 1
            if self._back < SET_ANEW:
                return self._skip("odometry whose time jumps back")
            self._skip("times at which the clock of the odometry was set anew")
            self._rows = [(stamp_s, *self._rows[-1][1:])]
        self._back = 0
        self._add(stamp_s, pose)
        return None

    def _add(self, stamp_s: float, pose: Pose) -> None:
        own = compose(self._fix, pose)
        if self._rows:
            before, *last = self._rows[-1]
            dx, dy, turn = relative((last[0], last[1], last[2]), own)
            passed_s = max(stamp_s - before, 0.0)
            far = math.hypot(dx, dy) > JUMP_M + 2 * self._spec.max_speed_mps * passed_s
            anew = False
            if passed_s > APART_S:
                anew = bool(begins_anew(np.array(self.told((last[0], last[1], last[2]))), np.array(pose)))
            if anew or far or abs(turn) > JUMP_RAD + 2 * self._spec.max_turn_rps * passed_s:
                self._skip("times at which odometry began anew")
                own, turn = (last[0], last[1], wrapped(last[2])), 0.0
                self._fix = compose(own, inverted(pose))
            own = (own[0], own[1], last[2] + turn)
        self._rows.append((stamp_s, *own))
        if len(self._rows) > MOST_KEPT or self._rows[0][0] < stamp_s - 2 * KEPT_S:
            self._rows = [row for row in self._rows[-MOST_KEPT // 2 :] if row[0] >= stamp_s - KEPT_S]

    def at(self, times: Floats) -> Floats | None:
        """(n, 3) poses at times (n,), rising; None where no odometry is near to the last."""
        rows = np.array(self._rows).reshape(-1, 4)
        if not len(rows) or times[-1] > rows[-1, 0] + APART_S or times[-1] < rows[0, 0] - APART_S:
            return None
        return np.column_stack([np.interp(times, rows[:, 0], column) for column in rows[:, 1:].T])

    def told(self, own: Pose) -> Pose:
        """A pose of the way in the frame in which the odometry tells poses now."""
        return relative(self._fix, own)
