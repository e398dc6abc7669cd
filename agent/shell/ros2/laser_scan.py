"""What a LaserScan of ROS tells: how its readings point and when they were taken (sensor_msgs/msg/LaserScan)."""

import math
from typing import Any, NamedTuple, Self

import numpy as np

from protocol.arrays import Floats
from protocol.messages import MAX_AROUND, MAX_BEAMS, LidarSpec

APART_S = 0.5  # a scan farther than this from all odometry is left out: at 0.5 m/s the robot is elsewhere by then
LEVEL = 0.9  # cosine of a lidar's tilt, up or down, below which what it sees is no floor plan
MAX_RANGE_M = 100.0  # as in LidarSpec
MIN_VIEW = math.radians(1)  # as in LidarSpec
OTHER_VIEW = 0.05  # share by which a scan's field of view differs from a lidar's: a few beams more or less are less
MAX_VIEW = 7.0  # rad: a whole revolution, and some directions again
ALL_ROUND_DEG = 350.0  # who looks at so much must turn; what looks at less is asked for nothing
MAX_PERIOD_S = 10.0  # one that takes longer is told in a wrong unit
SET_ANEW = 10
"""Messages in a row, of times that cannot follow, after which the clock counts as set anew, and its new time holds."""


def stamp_of(message: Any, arrived_s: float) -> float:
    """Seconds of a message's header, or of its arrival where that has none."""
    stamp = message.header.stamp
    return float(stamp.sec + 1e-9 * stamp.nanosec) or arrived_s


def believed_range(told_m: float) -> float:
    """Metres that a lidar reaches which tells so many: any that there may be, where it tells none or more."""
    return min(told_m, MAX_RANGE_M) if told_m > 0 else MAX_RANGE_M


class Bearings(NamedTuple):
    """How the readings of a LaserScan point."""

    number: int
    first: float  # rad
    step: float  # rad; negative where they go clockwise

    @property
    def view(self) -> float:
        """Radians that they look at."""
        return self.number * abs(self.step)

    def are_like(self, other: Self) -> bool:
        """Whether one lidar may make both: it looks at as much, with as many readings."""
        shares = self.view / other.view, self.number / other.number
        return all(abs(share - 1) <= OTHER_VIEW for share in shares)


class LaserScan(NamedTuple):
    """One LaserScan, whose stamp is that of its first reading."""

    begin_s: float
    between_s: float  # from one reading to the next
    bearings: Bearings
    readings: Floats  # (number,) m

    @classmethod
    def told(cls, message: Any, stamp_s: float) -> Self:
        """Of a message with this stamp. Where the first direction comes again at its end, that is left out."""
        count, step = len(message.ranges), message.angle_increment
        around = round(2 * math.pi / abs(step)) if MIN_VIEW < abs(step) * count < MAX_VIEW else count
        bearings = Bearings(min(count, around), message.angle_min, step)
        return cls(stamp_s, message.time_increment, bearings, message.ranges[:around])

    @property
    def makes_sense(self) -> bool:
        """Whether there is a lidar that measures so."""
        count, first, _ = self.bearings
        view, takes_s = self.bearings.view, self.between_s * count  # NaN is in no range
        is_scan = 8 <= count <= MAX_BEAMS and abs(first) < 10 and 0 <= takes_s < MAX_PERIOD_S
        return is_scan and MIN_VIEW < view < MAX_VIEW and count * 360 / math.degrees(view) <= MAX_AROUND

    @property
    def end_s(self) -> float:
        """When the last reading was taken."""
        return self.begin_s + self.between_s * (self.bearings.number - 1)

    @property
    def period_s(self) -> float:
        """Seconds of a revolution; 0 where it looks everywhere at once."""
        return self.between_s * 2 * math.pi / abs(self.bearings.step)

    def lidar(self, known: LidarSpec, limits: tuple[float, float], *, upside_down: bool = False) -> LidarSpec:
        """The lidar that makes such scans, with the mount, the errors and the rate that are known of it.

        limits: metres, the least and the greatest range. Raises ValueError where there is none.
        """
        count, first, step = self.bearings
        low, high = limits
        high = believed_range(high)
        told = {
            "beams": count,
            "turning": self.between_s > 0,
            "field_of_view_deg": min(math.degrees(self.bearings.view), 360.0),
            "first_beam_deg": math.degrees(math.remainder(-first if upside_down else first, 2 * math.pi)),
            "clockwise": upside_down is not (step < 0),
            "range_min_m": low if 0 <= low < high else 0.0,
            "range_max_m": high,
        }
        return LidarSpec.model_validate(known.model_dump() | told)

    def at(self, bearings: Bearings) -> Floats:
        """Readings (bearings.number,) at other bearings: at each the nearest, NaN where none is within a step.

        Some lidars give a few readings more or less in each revolution.
        """
        if bearings == self.bearings:
            return self.readings
        count, first, step = self.bearings
        at = (bearings.first - first + bearings.step * np.arange(bearings.number)) / step
        around = 2 * math.pi / abs(step)
        nearest = np.rint(at - around * np.floor((at + 0.5) / around)).astype(np.int64)
        return np.where(nearest < count, self.readings[np.minimum(nearest, count - 1)], np.nan)
