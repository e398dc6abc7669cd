"""Back to what tells how the map lies in the robot's frame, until that is known: home, telling walls, laps (ours).

What a robot saw from home before it moved is exact. Seen again, it puts right all that was mapped since, as far as one
scan shows both. Among columns a robot at home has few of either in view, and heads for it past one side of them. In
`hall` a map that was right to 6 mm in itself was turned by 0.55 degrees, after the robot had been home by 0.43. A lap
of 1 m about home, 35 s, left 0.15, and two more 0.01 (the same run, three robots, seed 4: recall 0.65, now 1).

Where home shows too little, the next best is what was seen soon after. One robot began beside a single wall, knew to 16
mm where along it its frame begins while it saw what stands 3 to 6 m off, and lost that in the empty middle of the hall.
Its map lay 50 mm off after 190 s of laps (three robots, seed 13: recall 0.78). A look at one of those walls left 15.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from agent.exploration import standing
from agent.exploration.agenda import Task, TaskKind
from agent.exploration.path import length_of
from agent.exploration.planning import Roads, circle
from agent.mapping.exactness import Exactness
from protocol.arrays import Floats

HOME = np.zeros(2)  # where the robot began, in its own frame
EXACT_MAP_M = 0.01  # a map whose walls are known better in its frame needs no look from there
SURE_MAP_M = 0.015
"""A map whose walls are known better needs neither looks nor laps. Of 21 maps of three robots in `hall` 15 were known
so, with corners 8 to 24 mm off, and 6 were not, with corners 14 to 50 mm off. Walls count as found within 50 mm."""
TELLING = 0.2  # share of what is not known of the map that a look must take away: less is not worth the way
NEARLY = 0.9  # of looks that take away so large a share of what the best one does, the nearest is taken
MOST_BARRED = 40  # walls without a way that are asked for one at a time: among 144 columns 400 of them took a second
APART_M, MOST_LOOKS = 1.0, 4  # looks are so far from each other, and there are so many at most
LAPS_M = (1.0, 1.8, 1.4, 2.2)
"""Radii of the laps: each passes other sides of what stands near, and may show it together with what is farther off. In
the middle of `hall` the lap of 1 m left a map turned by 0.45 degrees as it was, that of 1.8 m left 0.1, and all of them
0.02 (three robots, seed 2). So one that is of no use says nothing of the others. Each is driven once: an end that opens
as it is seen from a lap, and closes from elsewhere, held a robot for 900 s where they began anew after it (seed 17)."""
STOPS = 6  # places on a lap
MOST_LEFT = 6
"""Times that the way home may be left before its end: as often as a robot waits for teammates that bar a goal. Past a
door that opens and closes by the side from which it is seen, one would go to and fro for ever. It may be left as often
again once all else is done. Looks are left so often at most, all together."""


class Way(NamedTuple):
    """A task, the roads that lead there, and the path."""

    task: Task
    roads: Roads
    path: Floats  # (k, 2)


class Homing:
    """What is left to do at home."""

    def __init__(self) -> None:
        self._heads_home = False  # whether the last task is to go home
        self._was_home = False  # whether that has ended, and all since were looks and laps
        self._left = 0  # times that it was left for another goal since it last ended, or all else was first done
        self._all_else_done = False  # whether all else was done since then
        self._looked: list[Floats] = []  # places (2,) before the walls that it looked at, or could not
        self._looks_begun = 0  # times that it set out for one
        self._lap: list[Floats] = []  # places (2,) that are left of the lap under way
        self._radii: Iterator[float] = iter(LAPS_M)  # of the laps that may follow

    def home(self, exactness: Exactness, ways: Iterable[Roads]) -> Way | None:
        """To go home; None where the robot just was there, where that would tell nothing new, and without a way.

        Nor is there one that was left too often. ways: the first that leads there is taken.
        """
        if self._was_home or self._left >= MOST_LEFT or exactness.sd_m() < EXACT_MAP_M:
            return None
        return _way("home", HOME, ways)

    def next(self, exactness: Exactness, ways: Sequence[Roads]) -> Way | None:
        """Home, then to telling walls, then on along laps about home; None where the map is known well enough.

        Nor is there anything after the last lap.
        """
        if not self._was_home:
            if not self._all_else_done:  # who barred the way while there were open ends may have gone
                self._all_else_done, self._left = True, 0
            return self.home(exactness, ways)
        if not self._lap:
            if exactness.sd_m() <= SURE_MAP_M:
                return None
            if (look := self._look(exactness, ways)) is not None:
                return look
            if (radius := next(self._radii, None)) is None:
                return None
            self._lap = [*(radius * circle(STOPS)), HOME]
        while self._lap:
            way = _way("lap", self._lap.pop(0), ways)
            if way is not None:
                return way
        return None

    def _look(self, exactness: Exactness, ways: Sequence[Roads]) -> Way | None:
        """To the nearest of those that tell the most among walls with a way; None without, and after the last look."""
        if len(self._looked) == MOST_LOOKS or self._looks_begun == MOST_LOOKS + MOST_LEFT:
            return None
        sd_m, (places, left_m) = exactness.sd_m(), exactness.looks()
        told_m = sd_m - left_m
        for place in self._looked:
            told_m[np.hypot(*(places - place).T) < APART_M] = 0.0
        looks, barred, enough_m = list[Way](), 0, TELLING * sd_m
        for k in np.argsort(-told_m, kind="stable"):
            if told_m[k] < enough_m or barred == MOST_BARRED:
                break
            if (look := _way("look", places[k], ways)) is not None:
                looks.append(look)
                enough_m = max(enough_m, NEARLY * told_m[k])
            else:
                barred += 1
        return min(looks, key=lambda look: length_of(look.path), default=None)

    def pursue(self, task: Task) -> None:
        """The robot sets out for a task, one of these or another."""
        if task.kind not in ("home", "look", "lap"):
            self._left += self._heads_home and task.kind != "errand"  # of these there are only so many
            self._was_home = False
        self._heads_home = task.kind == "home"
        self._looks_begun += task.kind == "look"

    def give_up(self) -> None:
        """The way home has ended before home: it counts as left, whatever the robot does next."""
        self._heads_home, self._left = False, self._left + 1

    def done(self, task: Task) -> None:
        """A task has ended: the robot stood where it asked, or could not."""
        if task.kind == "home":
            self._heads_home, self._was_home, self._left, self._all_else_done = False, True, 0, False
        elif task.kind == "look":
            self._looked.append(task.place)


def _way(kind: TaskKind, place: Floats, ways: Iterable[Roads]) -> Way | None:
    """To go to a place, or near it, by the first roads that lead there; None without any."""
    for roads in ways:
        route = standing.near(place, roads)
        if route is not None:
            return Way(Task(kind, place, route.path[-1]), roads, route.path)
    return None
