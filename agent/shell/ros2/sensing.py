"""What a ROS 2 robot tells, checked, as observations: a tick for each scan, with the odometry of its revolution.

Times are those of the messages' stamps. What cannot be used is skipped and counted; nothing of it ends the robot.
"""

import math
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agent.shell.ros2.laser_scan import APART_S, LEVEL, Bearings, LaserScan, stamp_of
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, inverted, relative, wrapped
from protocol.messages import MAX_TICK, LidarSpec, Observation, RobotSpec
from protocol.settings import MAX_NUMBER

WAIT_S = 0.15  # a scan waits so long for the odometry of its end, which comes every 0.05 s or more often
KEPT_S = 10.0  # of odometry, at least
MOST_KEPT = 10_000  # messages of odometry that are kept: 1 kHz in these seconds
KNOTS = 5  # poses of odometry for each scan: every 40 ms of a revolution of 0.2 s
SET_ANEW = 10
"""Messages in a row, of times that cannot follow, after which the clock counts as set anew, and its new time holds."""
JUMP_M, JUMP_RAD = 0.3, 0.5
"""Odometry that moves by more than twice what the robot can do, and so much, began anew: its base was started again."""
ALIKE = 3  # scans that tell one lidar before it is believed: drivers begin with odd ones, such as half a revolution
LOOKED_BACK = 10  # scans among which these are: two lidars may share the topic
SLIP_TICKS = 2  # ticks counted by scans are fewer than so many off those of the clock, as no lidar is exactly on time
EPOCH_S = 1_767_225_600.0
"""Ticks count from 2026, so that those of robots whose clocks agree are alike, and rise over restarts."""
SPAN_S = 1e7
"""Where neither those since then nor those since 1970 can be counted, ticks count from the last multiple of these four
months, so that they are alike on such clocks, too."""


class SensedScan(NamedTuple):
    """An observation, and what goes with it."""

    observation: Observation
    stamp_s: float
    odometry: Pose  # as the robot told it, in its odometry's frame


class Wheelpath:
    """Where the robot's odometry led, as one way without jumps."""

    def __init__(self, spec: RobotSpec, skip: Callable[[str], None]) -> None:
        """skip: is told why a message cannot be used."""
        self._spec, self._skip = spec, skip
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
        stamp_s, place, turn = stamp_of(told), told.pose.pose.position, told.pose.pose.orientation
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
            if far or abs(turn) > JUMP_RAD + 2 * self._spec.max_turn_rps * passed_s:
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


class Sensing:
    """Makes observations of scans and odometry as they come."""

    def __init__(self, spec: RobotSpec, upside_down: bool, clock: Callable[[], float] = time.monotonic) -> None:
        """spec: the body, with what is known of its lidar beforehand. clock: seconds, for how long something came."""
        self.spec = spec
        """The body; of its lidar all is known once some scans are alike."""
        self.skipped = Counter[str]()
        """What could not be used, by reason."""
        self.news: list[str] = []
        """Reasons that occurred for the first time, for whoever tells them."""
        self.last_seen = -math.inf
        """When the last observation was made, by the clock."""
        self._upside_down, self._clock = upside_down, clock
        self.wheels = Wheelpath(spec, self.skip)
        self._first = deque[tuple[str, Bearings]](maxlen=LOOKED_BACK)
        """Frames and bearings of scans from before the lidar is known."""
        self._bearings: Bearings | None = None
        self._lidar_frame = ""
        self._pending: tuple[LaserScan, float] | None = None
        """The scan that waits for its odometry, and since when."""
        self._origin: Pose | None = None
        self._end_s = -math.inf
        self._tick = -1
        self._zero_s = 0.0
        self._odd = 0
        self._senders: dict[str, tuple[str, float]] = {}

    @property
    def knows_lidar(self) -> bool:
        """Whether scans have told of the lidar."""
        return self._bearings is not None

    def skip(self, reason: str) -> None:
        """Count what cannot be used."""
        if reason not in self.skipped:
            self.news.append(reason)
        self.skipped[reason] += 1

    def is_known(self, topic: str, sender: str, silence_s: float) -> bool:
        """Whether a message is of the one who talks on its topic; another one may follow after some silence."""
        now = self._clock()
        who, last = self._senders.get(topic, (sender, now))
        if who != sender and now - last < silence_s:
            self.skip(f"messages of a second publisher of {topic}")
            return False
        self._senders[topic] = sender, now
        return True

    def take_scan(self, told: Any) -> None:
        """Take a LaserScan message."""
        scan = LaserScan.told(told, stamp_of(told))
        if not scan.makes_sense:
            return self.skip("scans of no possible lidar")
        if self._bearings is None and not self._accept_lidar(scan, told):
            return None
        if told.header.frame_id != self._lidar_frame:
            return self.skip("scans of another lidar")
        jumps_back = scan.end_s <= self._end_s
        woke_late = self._zero_s < EPOCH_S and (scan.end_s - EPOCH_S) * self.spec.lidar.rate_hz > max(self._tick, 0)
        if jumps_back or woke_late or not self._counts(scan.end_s, self._zero_s):
            self._odd += 1
            if self._odd < SET_ANEW:
                return self.skip("scans whose time jumps back" if jumps_back else "scans of a time that cannot be")
            self.skip("times at which the clock of the scans was set anew")
            self._set_clock(scan.end_s)
        self._odd = 0
        if self._pending is not None:
            self.skip("scans that came too fast to be used")
        self._pending = scan, self._clock()
        return None

    def _accept_lidar(self, scan: LaserScan, told: Any) -> bool:
        """Learn from one of the first scans what lidar this is; whether that is sure, and can be."""
        alike = sum(frame == told.header.frame_id and scan.bearings.are_like(first) for frame, first in self._first)
        self._first.append((told.header.frame_id, scan.bearings))
        if alike + 1 < ALIKE:
            return False
        period_s = scan.period_s or told.scan_time
        known = self.spec.lidar.model_dump() | ({"rate_hz": 1 / period_s} if 0.01 <= period_s <= 100 else {})
        try:
            lidar = scan.lidar(
                LidarSpec.model_validate(known), (told.range_min, told.range_max), upside_down=self._upside_down
            )
        except ValueError:
            self.skip("scans of no possible lidar")
            return False
        for _ in range(len(self._first) - alike - 1):
            self.skip("scans of another lidar")
        self.spec = self.spec.model_copy(update={"lidar": lidar})
        self._bearings, self._lidar_frame = scan.bearings, told.header.frame_id
        self._zero_s = self._zero_of(scan.begin_s)
        return True

    def _counts(self, time_s: float, zero_s: float) -> bool:
        """Whether a time has a tick, where ticks count from zero_s."""
        return 0 <= (time_s - zero_s) * self.spec.lidar.rate_hz <= MAX_TICK

    def _zero_of(self, time_s: float) -> float:
        """From when ticks count by a clock that shows a time."""
        return next((zero_s for zero_s in (EPOCH_S, 0.0) if self._counts(time_s, zero_s)), time_s - time_s % SPAN_S)

    def _set_clock(self, end_s: float) -> None:
        """Believe that it is end_s after all. Ticks become those of other robots if they rise so, else go on."""
        before_s = end_s - 1 / self.spec.lidar.rate_hz
        zero_s = min(self._zero_of(before_s), before_s - (self._end_s - self._zero_s))
        self._end_s += zero_s - self._zero_s
        self._zero_s = zero_s

    def due(self) -> SensedScan | None:
        """The next observation, where the odometry of a scan is there or does not come."""
        if self._pending is None or self._bearings is None:
            return None
        (scan, came), lidar = self._pending, self.spec.lidar
        end_s = scan.end_s
        if self.wheels.until_s < end_s and self._clock() - came < WAIT_S:
            return None
        self._pending = None
        begin_s = end_s - 1 / lidar.rate_hz
        way = self.wheels.at(np.linspace(begin_s, end_s, KNOTS + 1)[1:])
        if way is None:
            self.skip(f"scans without odometry within {APART_S} s")
            return None
        if (tick := self._next_tick(end_s)) is None:
            return None
        x, y, theta = way[-1].tolist()
        last = (x, y, wrapped(theta))
        self._origin = self._origin or last
        poses = np.array([relative(self._origin, (x, y, theta)) for x, y, theta in way.tolist()])
        px, py, heading = poses[-1].tolist()
        observation = Observation(
            tick=tick,
            ranges=lidar.cleaned(scan.at(self._bearings)).astype("<f4").tobytes(),
            odometry=(px, py, heading),
            way=poses.astype("<f8").tobytes(),
        )
        self.last_seen = self._clock()
        return SensedScan(observation, end_s, self.wheels.told(last))

    def _next_tick(self, end_s: float) -> int | None:
        """The tick of a scan that ends then; None where it is one too many.

        Ticks follow the scans, so that none is missed or doubled by jitter, and the clock over a while.
        """
        rate_hz = self.spec.lidar.rate_hz
        by_clock = round((end_s - self._zero_s) * rate_hz)
        tick = by_clock if self._tick < 0 else self._tick + max(1, round((end_s - self._end_s) * rate_hz))
        if by_clock - tick >= SLIP_TICKS:
            tick += 1
        elif tick - by_clock >= SLIP_TICKS:
            self.skip("scans of a lidar that is faster than it says")
            self._end_s = end_s
            return None
        if tick > MAX_TICK:
            self.skip("scans of a time that cannot be")
            return None
        self._end_s, self._tick = end_s, tick
        return tick
