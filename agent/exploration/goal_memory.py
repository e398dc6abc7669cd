"""What became of goals, remembered by place and direction, as a map's vertices come and go (ours)."""

import math
from dataclasses import dataclass, field

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Floats, Ints

SAME_PLACE_M = 0.2  # goals closer than this are the same one: the end of a wall moves by less from scan to scan
SAME_DIRECTION_RAD = 0.8
"""The directions in which the walls of two such ends go on differ by less, 45 degrees: those of the two walls at a
corner differ by 90."""
CLOSINGS = 3
"""Drives to one end that closed on the way. If it is open all the same it comes after all others, and each further one
counts as an attempt in vain. Beside a slit of 4 cm, views from either side closed the end that the other had opened: a
robot drove round it 24 times."""
REMEMBERED = 400  # most goals kept in memory; a building of 600 m2 brings about 100


@dataclass(slots=True)
class Tried:
    """What became of a goal."""

    attempts: int = 0  # in vain
    closed: int = 0  # times that it closed as the robot drove there
    blocked: int = 0  # times when a teammate was in the way; these are no attempts
    version: int = -1  # map version at the last attempt
    stands: list[tuple[float, float]] = field(default_factory=list)  # standing points that did not help
    reason: str = ""  # of the last attempt's end
    unreachable: bool = False
    told: bool = False  # whether teammates are told that it was looked at in vain

    @property
    def given_up(self) -> bool:
        """Whether it was looked at in vain, given up, or closed so often that it will open again."""
        return self.attempts + self.blocked + len(self.stands) > 0 or self.closed >= CLOSINGS


UNTRIED = Tried()  # of a goal of which nothing is remembered


@kernel
def same_ends(points: Floats, along: Floats, others: Floats) -> Ints:
    """Per open end (g,) the row of the same one among others (n, 4), place and direction, or -1.

    points, along: (g, 2) metres and unit.
    """
    like, out = math.cos(SAME_DIRECTION_RAD), np.full(len(points), -1)
    for g in range(len(points)):
        nearest = SAME_PLACE_M**2
        for n in range(len(others)):
            squared = (points[g, 0] - others[n, 0]) ** 2 + (points[g, 1] - others[n, 1]) ** 2
            if squared < nearest and along[g, 0] * others[n, 2] + along[g, 1] * others[n, 3] > like:
                nearest, out[g] = squared, n
    return out


class GoalMemory:
    """What became of goals; when there are too many, the oldest that is no longer one is forgotten, else the oldest."""

    def __init__(self) -> None:
        self.tried: list[Tried] = []
        self._table = np.zeros((0, 4))
        self._open = np.zeros(0, np.bool_)  # (n,) whether each is still a goal, as far as is known

    @property
    def nbytes(self) -> int:
        """Bytes of what is remembered."""
        return sum(48 + 16 * len(record.stands) for record in self.tried)

    def find(self, points: Floats, along: Floats) -> Ints:
        """Per goal (g,) the index of what is remembered of it, or -1; points, along: (g, 2) metres and unit."""
        return same_ends(points, along, self._table)

    @property
    def is_full(self) -> bool:
        """Whether another goal would push out one that is still there, which would be tried anew, and so for ever."""
        return len(self.tried) >= REMEMBERED and bool(self._open.all())

    def still_open(self, found: Ints) -> None:
        """Take of all goals that are there what `find` found of them."""
        self._open = np.isin(np.arange(len(self.tried)), found)

    def has_room(self, point: Floats, along: Floats, attempts: int) -> bool:
        """Whether a further attempt at a goal, of so many, would be remembered without forgetting another goal."""
        k = int(self.find(point[None], along[None])[0])
        return self.tried[k].attempts < attempts if k >= 0 else not self.is_full

    def note(self, point: Floats, along: Floats) -> Tried:
        """The record of a goal, a new one if there is none. point: (2,) metres; along: (2,) unit; frame of the map."""
        k = int(self.find(point[None], along[None])[0])
        if k >= 0:
            return self.tried[k]
        if len(self.tried) >= REMEMBERED:
            oldest = int(self._open.argmin())  # 0 where all are open
            del self.tried[oldest]
            self._table, self._open = np.delete(self._table, oldest, 0), np.delete(self._open, oldest)
        self.tried.append(Tried())
        self._table, self._open = np.vstack((self._table, (*point, *along))), np.append(self._open, True)
        return self.tried[-1]
