"""Where a complete robot parks, and where it shows itself to somebody who does not know its frame (ours)."""

from collections.abc import Sequence

import numpy as np

from agent.exploration import standing
from agent.exploration.agenda import Target, Task
from agent.exploration.path import ARRIVED_M
from agent.exploration.planning import Roads
from protocol.arrays import Floats

MOST_SHOWN = 8
"""Places where a complete robot shows itself to a stranger: three sightings decide, who never merges gains no more."""
MOST_MOVES = 3 * MOST_SHOWN
"""And to all together, until there is something new to do, as ever new names would move it for ever: three sightings
for each of eight that come one after the other."""
AGAIN_S = 1.0  # seconds after which a robot that is barred asks again for such a place, as planning takes its time
AT_HOME_M = 2.0  # from there to where a complete robot parks: it may have begun in a doorway


class Parking:
    """The choice of a place to park, and where a robot that has parked has shown itself since."""

    def __init__(self) -> None:
        self._shown: list[Floats] = []  # (2,) each, since the last stranger came
        self._moves: dict[str, int] = {}  # for each stranger, how often the robot has shown itself on its account
        self._around: Sequence[str] = ()  # the strangers of this tick
        self._again = 0  # tick before which no further place is asked for

    def leave(self) -> None:
        """The robot has something to do again."""
        self._shown, self._moves = [], {}

    def choose(self, here: Floats, own: Floats, roads: Roads, parked: Target | None) -> Target:
        """Home, or else an own former place (k, 2), where others have room to pass.

        A crowd is complete together, around the last corner. Stragglers found nobody there who would have told them
        all; at home robots stand apart, or wait where all of them began. here: (2,). parked: the last target, which is
        kept where it was a place to park.
        """
        places = np.vstack((here[None], own))
        if parked is not None and parked.task.kind != "park":
            parked = None
        if parked is not None:
            places = np.vstack((parked.task.stand, places))
        route = None if parked is not None else standing.out_of_the_way(own[np.hypot(*own.T) <= AT_HOME_M], roads)
        route = route or standing.out_of_the_way(places, roads)
        return _at_end_of(here[None] if route is None else route.path, roads)

    def meet(self, strangers: Sequence[str]) -> None:
        """Note the names of those around who do not know the robot's frame. Who comes later has seen it nowhere yet."""
        if any(name not in self._moves for name in strangers):
            self._shown = []
        moved_for = {name: moves for name, moves in self._moves.items() if moves}
        self._moves, self._around = dict.fromkeys(strangers, 0) | moved_for, strangers

    def may_step_aside(self, tick: int, here: Floats, parked: Target | None) -> bool:
        """Whether a robot that has arrived where it parks shows itself to one of those met; no if barred just now."""
        if parked is None or tick < self._again or sum(self._moves.values()) >= MOST_MOVES:
            return False
        return parked.within(ARRIVED_M, here) and any(self._moves[name] < MOST_SHOWN for name in self._around)

    def aside(self, again: int, here: Floats, own: Floats, roads: Roads) -> Target | None:
        """A place near one where it has parked (2,), apart from all where it has shown itself; None without any.

        What stands still may be a post, and is no evidence of where its frame lies. own: (k, 2) former places.
        again: tick at which it is asked again where there is none, as a teammate may bar it for a moment.
        The move is on the account of the one, of those met, with the fewest.
        """
        shown = [*self._shown, here]
        route = standing.aside(np.array(shown), own, roads)
        if route is None:
            self._again = again
            return None
        self._shown = shown
        self._moves[min(self._around, key=self._moves.__getitem__)] += 1
        return _at_end_of(route.path, roads)


def _at_end_of(path: Floats, roads: Roads) -> Target:
    return Target(Task("park", path[-1], path[-1]), path, roads.clearance)
