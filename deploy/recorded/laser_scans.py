"""The lidar of a topic's LaserScans: the one that most are of, as most of its messages tell it.

Any message may be odd: drivers begin with half a revolution, and two lidars may share a topic.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, Self, TypeVar

from agent.shell.ros2.laser_scan import OTHER_VIEW, LaserScan
from agent.shell.ros2.timing import Timing

T = TypeVar("T")


class BagScan(NamedTuple):
    """One LaserScan of a bag."""

    number: int
    frame: str  # of its lidar
    limits: tuple[float, float]  # m, the least and the greatest range; 0 where the message tells none
    arrived_s: float
    scan: LaserScan

    @classmethod
    def told(cls, number: int, message: Any, arrived_s: float, timing: Timing) -> Self:
        """Of a message with this number, and what the user says of its times."""
        limits = [0.0 if math.isnan(limit) else limit for limit in (message.range_min, message.range_max)]
        frame = message.header.frame_id.lstrip("/")
        return cls(number, frame, (limits[0], limits[1]), arrived_s, timing.taken(message, arrived_s))


def of_most(entries: Sequence[BagScan], skipped: Counter[str]) -> list[BagScan]:
    """The scans of the lidar that has most, by its frame, the first of several; those of others are skipped."""
    frame = _most(entry.frame for entry in entries)
    kept = [entry for entry in entries if entry.frame == frame]
    others = len(entries) - len(kept)
    skipped += Counter({f"scans of another lidar than the one read, whose frame is {frame!r}": others})
    return kept


def typical(entries: Sequence[BagScan], notes: list[str]) -> BagScan:
    """What most of a lidar's scans tell: one with their bearings, their limits and their median revolution.

    Scans that tell something else are noted: they are read as if they were like most.
    """
    bearings, limits = _most(entry.scan.bearings for entry in entries), _most(entry.limits for entry in entries)
    alike = [entry for entry in entries if entry.scan.bearings == bearings]
    alike.sort(key=lambda entry: entry.scan.period_s)
    views = [abs(entry.scan.bearings.view / bearings.view - 1) for entry in entries]
    for count, what in (
        (sum(off > OTHER_VIEW for off in views), "have another field of view"),
        (sum(entry.limits != limits for entry in entries), "have other limits of the range"),
    ):
        if count:
            notes.append(f"{count} scans {what} than most, and are read as most are")
    return alike[(len(alike) - 1) // 2]._replace(limits=limits)


def _most(values: Iterable[T]) -> T:
    """The most frequent value, the first of several."""
    return Counter(values).most_common(1)[0][0]
