"""What a ROS 2 robot tells, checked, as observations: a tick for each scan, with the odometry of its revolution.

Times are those of the messages' stamps. What cannot be used is skipped and counted; nothing of it ends the robot.
"""

import math
import time
from collections import Counter, deque
from collections.abc import Callable
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from agent.shell.ros2.laser_scan import APART_S, SET_ANEW, Bearings, LaserScan
from agent.shell.ros2.ticks import Ticks, nominal_hz
from agent.shell.ros2.timing import AS_TOLD, Timing, TimingWatch
from agent.shell.ros2.wheelpath import Wheelpath
from protocol.geometry import Pose, relative, wrapped
from protocol.messages import LidarSpec, Observation, RobotSpec

WAIT_S = 0.15  # a scan waits so long for the odometry of its end, which comes every 0.05 s or more often
MOST_WAITING = 16  # scans that wait so: those of a lidar of 100 Hz
KNOTS = 5  # poses of odometry for each scan: every 40 ms of a revolution of 0.2 s
ALIKE = 3  # scans that tell one lidar before it is believed: drivers begin with odd ones, such as half a revolution
ALIKE_PERIODS = 0.1  # share by which their revolutions differ, at most: not while the motor speeds up
SAME_CLOCK_S = 5.0  # by which stamps differ from the own clock, at most, where that is theirs: it is none of a replay
LOOKED_BACK = 10  # scans among which these are: two lidars may share the topic


class SensedScan(NamedTuple):
    """An observation, and what goes with it."""

    observation: Observation
    stamp_s: float
    odometry: Pose  # as the robot told it, in its odometry's frame


class Sensing:
    """Makes observations of scans and odometry as they come."""

    def __init__(
        self,
        spec: RobotSpec,
        upside_down: bool,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
        timing: Timing = AS_TOLD,
    ) -> None:
        """spec: the body, with what is known of its lidar beforehand.

        clock: seconds, for how long something came. wall: the same as stamps tell them. timing: of its scans.
        """
        self.spec = spec
        """The body; of its lidar all is known once some scans are alike."""
        self.skipped = Counter[str]()
        """What could not be used, by reason."""
        self.news: list[str] = []
        """Reasons that occurred for the first time, for whoever tells them."""
        self.last_seen = -math.inf
        """When the last observation was made, by the clock."""
        self._upside_down, self._clock, self._wall, self._timing = upside_down, clock, wall, timing
        self.wheels = Wheelpath(spec, self.skip, wall)
        self._watch = TimingWatch(timing, self.skip)
        self._first = deque[tuple[str, Bearings, float]](maxlen=LOOKED_BACK)
        """Frames, bearings and seconds a revolution (0: unknown) of scans from before the lidar is known."""
        self._ticks: Ticks | None = None
        """None until the lidar is known."""
        self._bearings = Bearings(0, 0.0, 0.0)
        self._lidar_frame = ""
        self._waiting = deque[tuple[LaserScan, float]]()
        """Scans that wait for their odometry, and since when, in their order."""
        self._origin: Pose | None = None
        self._odd = 0
        """Scans in a row of times that cannot follow."""
        self._senders: dict[str, tuple[str, float]] = {}

    @property
    def knows_lidar(self) -> bool:
        """Whether scans have told of the lidar."""
        return self._ticks is not None

    @property
    def is_unsure(self) -> bool:
        """Whether scans have come that do not agree on a lidar yet."""
        return bool(self._first) and not self.knows_lidar

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
        scan = self._timing.taken(told, self._wall())
        if not scan.makes_sense:
            return self.skip("scans of no possible lidar")
        ticks = self._ticks = self._ticks or self._accept_lidar(scan, told)
        if ticks is None:
            return None
        if told.header.frame_id != self._lidar_frame:
            return self.skip("scans of another lidar")
        now_s = self.wheels.until_s
        if abs(self._wall() - scan.end_s) <= SAME_CLOCK_S:
            now_s = max(now_s, self._wall())
        self._watch.look(scan, 1 / self.spec.lidar.rate_hz, now_s)
        before_s = self._waiting[-1][0].end_s if self._waiting else -math.inf
        if objection := ticks.objection(scan.end_s, before_s):
            self._odd += 1
            if self._odd < SET_ANEW:
                return self.skip(objection)
            self.skip("times at which the clock of the scans was set anew")
            ticks.set_clock(scan.end_s)
            self._waiting.clear()
        self._odd = 0
        self._waiting.append((scan, self._clock()))
        self._drop(len(self._waiting) - MOST_WAITING)
        return None

    def _drop(self, number: int) -> None:
        """Leave out so many of the scans that wait longest."""
        for _ in range(number):
            self._waiting.popleft()
            self.skip("scans that came too fast to be used")

    def _accept_lidar(self, scan: LaserScan, told: Any) -> Ticks | None:
        """Learn from one of the first scans what lidar this is. Its ticks; None where it is not sure, or cannot be."""
        frame, bearings, period_s = told.header.frame_id, scan.bearings, scan.period_s or told.scan_time
        period_s = period_s if 0.01 <= period_s <= 100 else 0.0  # NaN is not
        self._first.append((frame, bearings, period_s))
        own = [other_s for at, other, other_s in self._first if at == frame and bearings.are_like(other)]
        alike = [other_s for other_s in own if abs(other_s - period_s) <= ALIKE_PERIODS * period_s]
        if len(alike) < ALIKE:
            return None
        known = self.spec.lidar.model_dump()
        if period_s:
            known["rate_hz"] = nominal_hz(1 / median(alike), self.spec.lidar.rate_hz)
        try:
            lidar = scan.lidar(
                LidarSpec.model_validate(known), (told.range_min, told.range_max), upside_down=self._upside_down
            )
        except ValueError:
            self.skip("scans of no possible lidar")
            return None
        for _ in range(len(self._first) - len(own)):
            self.skip("scans of another lidar")
        for _ in range(len(own) - len(alike)):
            self.skip("scans from before the lidar turned evenly")
        self.spec = self.spec.model_copy(update={"lidar": lidar})
        self._bearings, self._lidar_frame = bearings, frame
        return Ticks(lidar.rate_hz, scan.begin_s, self.skip)

    def due(self) -> SensedScan | None:
        """The next observation: the newest scan whose odometry is there or does not come."""
        known_s, since, lidar = self.wheels.until_s, self._clock() - WAIT_S, self.spec.lidar
        ready = [k for k, (scan, came) in enumerate(self._waiting) if scan.end_s <= known_s or came <= since]
        if not ready or self._ticks is None:
            return None
        self._drop(ready[-1])
        scan, _ = self._waiting.popleft()
        end_s = scan.end_s
        begin_s = end_s - (scan.period_s or 1 / lidar.rate_hz)
        way = self.wheels.at(np.linspace(begin_s, end_s, KNOTS + 1)[1:])
        if way is None:
            self.skip(f"scans without odometry within {APART_S} s")
            return None
        if (tick := self._ticks.next(end_s)) is None:
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
