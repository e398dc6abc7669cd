"""Back to where the robot's frame begins, and round about it, until its map is known to lie in that frame (ours).

What a robot saw from there before it moved is exact. Seen again, it puts right all that was mapped since, as far as one
scan shows both. Among columns a robot at home has few of either in view, and heads for it past one side of them. In
`hall` a map that was right to 6 mm in itself was turned by 0.55 degrees, after the robot had been home by 0.43. A lap
of 1 m about home, 35 s, left 0.15, and two more 0.01 (the same run, three robots, seed 4: recall 0.65, now 1).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from agent.exploration import standing
from agent.exploration.agenda import Task, TaskKind
from agent.exploration.planning import Roads, circle
from protocol.arrays import Floats

HOME = np.zeros(2)  # where the robot began, in its own frame
EXACT_MAP_M = 0.01  # a map whose walls are known better in its frame needs no look from there
SURE_MAP_M = 0.015
"""A map whose walls are known better needs no laps about home. Of 21 maps of three robots in `hall` 15 were known so,
with corners 8 to 24 mm off, and 6 were not, with corners 14 to 50 mm off. Walls count as found within 50 mm."""
LAPS_M = (1.0, 1.8, 1.4, 2.2)
"""Radii of the laps: each passes other sides of what stands near, and may show it together with what is farther off. In
the middle of `hall` the lap of 1 m left a map turned by 0.45 degrees as it was, that of 1.8 m left 0.1, and all of them
0.02 (three robots, seed 2). So one that is of no use says nothing of the others. Each is driven once: an end that opens
as it is seen from a lap, and closes from elsewhere, held a robot for 900 s where they began anew after it (seed 17)."""
STOPS = 6  # places on a lap
MOST_LEFT = 6
"""Times that the way home may be left before its end: as often as a robot waits for teammates that bar a goal. Past a
door that opens and closes by the side from which it is seen, one would go to and fro for ever. It may be left as often
again once all else is done."""


class Way(NamedTuple):
    """A task, and the roads that lead there."""

    task: Task
    roads: Roads


class Homing:
    """What is left to do at home."""

    def __init__(self) -> None:
        self._heads_home = False  # whether the last task is to go home
        self._was_home = False  # whether that has ended, and all since were laps
        self._left = 0  # times that it was left for another goal since it last ended, or all else was first done
        self._all_else_done = False  # whether all else was done since then
        self._lap: list[Floats] = []  # places (2,) that are left of the lap under way
        self._radii: Iterator[float] = iter(LAPS_M)  # of the laps that may follow

    def home(self, map_sd_m: Callable[[], float], ways: Iterable[Roads]) -> Way | None:
        """To go home; None where the robot just was there, where that would tell nothing new, and without a way.

        Nor is there one that was left too often.
        map_sd_m: by how much walls may be off in the frame, root mean square, worked out when it is asked. ways: the
        first that leads there is taken.
        """
        if self._was_home or self._left >= MOST_LEFT or map_sd_m() < EXACT_MAP_M:
            return None
        return _way("home", HOME, ways)

    def next(self, map_sd_m: Callable[[], float], ways: Sequence[Roads]) -> Way | None:
        """Home, or on along a lap about it; None where the map is known well enough, or there was the last lap."""
        if not self._was_home:
            if not self._all_else_done:  # who barred the way while there were open ends may have gone
                self._all_else_done, self._left = True, 0
            return self.home(map_sd_m, ways)
        if not self._lap:
            radius = next(self._radii, None) if map_sd_m() > SURE_MAP_M else None
            if radius is None:
                return None
            self._lap = [*(radius * circle(STOPS)), HOME]
        while self._lap:
            way = _way("lap", self._lap.pop(0), ways)
            if way is not None:
                return way
        return None

    def pursue(self, task: Task) -> None:
        """The robot sets out for a task, one of these or another."""
        if task.kind not in ("home", "lap"):
            self._left += self._heads_home and task.kind != "errand"  # of these there are only so many
            self._was_home = False
        self._heads_home = task.kind == "home"

    def give_up(self) -> None:
        """The way home has ended before home: it counts as left, whatever the robot does next."""
        self._heads_home, self._left = False, self._left + 1

    def done(self, task: Task) -> None:
        """A task has ended: the robot stood where it asked, or could not."""
        if task.kind == "home":
            self._heads_home, self._was_home, self._left, self._all_else_done = False, True, 0, False


def _way(kind: TaskKind, place: Floats, ways: Iterable[Roads]) -> Way | None:
    """To go to a place, or near it, by the first roads that lead there; None without any."""
    for roads in ways:
        route = standing.near(place, roads)
        if route is not None:
            return Way(Task(kind, place, route.path[-1]), roads)
    return None
