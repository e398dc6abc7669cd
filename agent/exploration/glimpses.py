"""What a robot saw something of from afar, too little for a wall, and passed by: places to look at (ours).

A lidar's noise grows with range. A post of 0.3 m that stands askew is hit in every scan from 2 m away, and none tells
its faces apart, so it never was a wall, and was forgotten as the robot went on: in `hall` three posts of one run. Nor
do such hits lie on one line. A post of 0.2 m that a robot passed at 1.8 m was hit in forty scans, and no line of them
was hit in more than six. So hits on all lines near to each other count together.

People are seen from afar, too, and move on. Each scan that sees past a place counts against it: ten people in `hall`
had filled the memory before the robot came to the columns, three of which it never went to look at (recall 0.970, now
1), and after the last open end it looked at 37 places, nearly all of them empty (now 5).
"""

from collections.abc import Callable

import numpy as np

from agent.exploration.agenda import Task
from agent.exploration.goal_memory import REMEMBERED
from agent.exploration.planning import Roads, circle
from agent.geometry.clearance import distances_to_walls
from agent.period import in_ticks
from protocol.arrays import Bools, Floats
from protocol.messages import LidarSpec
from protocol.wireframe import Wireframe

EXPLAINED_M = 0.25
"""A glimpse is of a mapped wall that is as near. Of 57 in three runs of `hall` and pal_home_w, 7 lay farther off the
map at the end, all of them at posts that it did not have; others were of steps and corners that are in it."""
SAME_M = 0.5  # glimpses as near are of one thing: of a post of 0.3 m they lay within THING_M
THING_M = 0.3  # what a scan that sees past a place must see past to either side of it
STAND_M = 0.7
"""Metres from which it is looked at: there an oblique face of 0.1 m shows 4 hits a scan, as near ones count, and is a
wall after a dozen scans."""
STANDS_AROUND = 12  # standing points that are tried around it
LEAST_SCANS = 10
"""Scans in a row, but for short breaks, that must hit a thing, less those that see past its place: a mixed reading
shows in one or two."""
BREAK_S = 5.0
"""Longest break between two of them. Of a post that is passed every second scan or so shows something. People who walk
by at different times are not one thing."""
MOST = 50
"""Places that are kept until the robot has looked there: a building of 600 m2 brings about 20. Where it has looked,
as many are kept as of goals, and no more: else it would look at what stays unexplained for ever."""

SeesPast = Callable[[Floats, float], Bools]
"""Which (n,) of places (n, 2) a scan sees past, and so many metres to either side of them."""


def sees_nothing(places: Floats, aside_m: float) -> Bools:
    """None of them, where there is no scan."""
    return np.zeros(len(places), np.bool_)


class Glimpses:
    """Places of glimpses, how many more scans hit than saw past each, and at which of them the robot has looked."""

    def __init__(self, lidar: LidarSpec) -> None:
        self._places = np.zeros((0, 2))
        self._scans, self._last = np.zeros(0, np.int64), np.zeros(0, np.int64)  # how many, and the tick of the last
        self._done = np.zeros(0, np.bool_)
        self._kept: Floats | None = None  # what was kept last
        self._break = in_ticks(BREAK_S, lidar.rate_hz)

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        return self._places.nbytes + self._scans.nbytes + self._last.nbytes + self._done.nbytes

    def keep(self, tick: int, places: Floats, sees_past: SeesPast = sees_nothing) -> None:
        """Remember places (k, 2), metres, of what a scan hit and is no wall yet. The same array is the same scan.

        sees_past: the scan's.
        """
        if places is self._kept:
            return
        self._kept = places
        self._scans = np.maximum(self._scans - sees_past(self._places, THING_M), 0)
        self._select((self._scans >= LEAST_SCANS) | (tick - self._last <= self._break))
        for place in places:
            away = np.hypot(*(self._places - place).T)
            if (away < SAME_M).any():
                k = int(away.argmin())
                self._scans[k] += tick > self._last[k]
                self._last[k] = tick
            elif np.count_nonzero(~self._done) < MOST:
                self._add(place, 1, tick)

    def _add(self, place: Floats, scans: int, tick: int) -> None:
        """Keep one more place (2,), where there is room."""
        if len(self._places) < REMEMBERED:
            self._places, self._done = np.vstack((self._places, place)), np.append(self._done, False)
            self._scans, self._last = np.append(self._scans, scans), np.append(self._last, tick)

    def _select(self, kept: Bools) -> None:
        """Forget all others, but for those that were looked at: they would be looked at again."""
        kept = kept | self._done
        if not kept.all():
            self._places, self._scans = self._places[kept], self._scans[kept]
            self._last, self._done = self._last[kept], self._done[kept]

    def tasks(self, wireframe: Wireframe, roads: Roads) -> list[Task]:
        """To look at what the map still does not explain, each from the nearest standing point that shows it."""
        made, walls = [], wireframe.segments()
        due = (self._scans >= LEAST_SCANS) & ~self._done
        for place in self._places[due & (distances_to_walls(self._places, walls) > EXPLAINED_M)]:
            around = place + STAND_M * circle(STANDS_AROUND)
            shown = place + EXPLAINED_M * circle(STANDS_AROUND)  # what the scan shows of the thing itself bars the rest
            around = around[roads.with_view(around, shown)]
            route = roads.nearest(around, np.zeros(len(around)))
            if route is not None:
                made.append(Task("glimpse", place, route.path[-1]))
        return made

    def done(self, task: Task) -> None:
        """Its place was looked at, or could not be: it is not proposed again."""
        if not (self._places == task.place).all(1).any():  # forgotten on the way, as scans saw past it
            self._add(task.place, 0, 0)
        self._done |= (self._places == task.place).all(1)
