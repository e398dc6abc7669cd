"""What a robot saw something of from afar, too little for a wall, and passed by: places to look at (ours).

A lidar's noise grows with range. A post of 0.3 m that stands askew is hit in every scan from 2 m away, and none tells
its faces apart, so it never was a wall, and was forgotten as the robot went on: in `hall` three posts of one run.
"""

import numpy as np

from agent.exploration.agenda import Task
from agent.exploration.planning import Roads, circle
from agent.geometry.clearance import distances_to_walls
from protocol.arrays import Floats
from protocol.wireframe import Wireframe

EXPLAINED_M = 0.25
"""A glimpse is of a mapped wall that is as near. Of 57 in three runs of `hall` and pal_home_w, 7 lay farther off the
map at the end, all of them at posts that it did not have; others were of steps and corners that are in it."""
SAME_M = 0.5  # glimpses as near are of one thing: of a post of 0.3 m they lay within 0.3 m
STAND_M = 0.7
"""Metres from which it is looked at: there an oblique face of 0.1 m shows 4 hits a scan, as near ones count, and is a
wall after a dozen scans."""
STANDS = 12  # standing points that are tried around it
MOST = 50  # places that are kept: a building of 600 m2 brings about 20


class Glimpses:
    """Places of glimpses, and at which of them the robot has looked."""

    def __init__(self) -> None:
        self._places = np.zeros((0, 2))
        self._done = np.zeros(0, np.bool_)

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        return self._places.nbytes + self._done.nbytes

    def keep(self, places: Floats) -> None:
        """Remember places (k, 2), metres, of what is seen now and is no wall yet."""
        for place in places:
            if len(self._places) < MOST and not (np.hypot(*(self._places - place).T) < SAME_M).any():
                self._places, self._done = np.vstack((self._places, place)), np.append(self._done, False)

    def tasks(self, wireframe: Wireframe, roads: Roads) -> list[Task]:
        """To look at what the map still does not explain, each from the nearest standing point that shows it."""
        made, walls = [], wireframe.segments()
        for place in self._places[~self._done & (distances_to_walls(self._places, walls) > EXPLAINED_M)]:
            around = place + STAND_M * circle(STANDS)
            shown = place + EXPLAINED_M * circle(STANDS)  # what the scan shows of the thing itself bars the rest
            around = around[roads.with_view(around, shown)]
            route = roads.nearest(around, np.zeros(len(around)))
            if route is not None:
                made.append(Task("glimpse", place, route.path[-1]))
        return made

    def done(self, task: Task) -> None:
        """Its place was looked at, or could not be: it is not proposed again."""
        self._done |= (self._places == task.place).all(1)
