"""Where the team has looked from: what merged peers told, and what the robot may pass on (ours).

Viewpoints go as far as the walls that were seen from them: a robot tells its own and those of peers that it has merged,
but none that those have from others. So in a crowd nobody needs to meet everybody, or to sweep what others have swept.
Open ends that one has looked at in vain, behind furniture, the peers that have merged its map leave to it.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agent.communication.receiving import KEPT_VIEWS, PeerViews
from agent.cooperation.peer import Merged
from protocol.arrays import Floats
from protocol.geometry import apply
from protocol.viewpoints import Looked

SAME_VIEW_M = 0.25
"""Cell in which one viewpoint from second hand stands for all: several peers pass on the same ones. Half of the
distance between two of one robot."""
TOLD_A_TICK = 10
"""Viewpoints that become known to peers in a tick, in order: those of one tick go into the shortest message."""


class _Taken(NamedTuple):
    """What was taken of one peer's viewpoints."""

    editions: int
    """How often the peer had told all anew."""
    heard: int
    """How many from second hand, those included that the peer's list holds no more."""
    places: Floats
    """(k, 2) those of them that were kept, the newest KEPT_VIEWS: metres, the robot's own frame."""


class _Usable(NamedTuple):
    """Those of a peer's viewpoints of which the merged map holds what was seen from there."""

    transform: Floats
    views: PeerViews
    tick: int
    """Of the merged map."""
    first_hand: Floats
    """(k, 2) its own ones, metres, the robot's own frame."""
    heard: Floats
    """(j, 2) from second hand, its frame."""
    ends: Floats
    """(g, 4) metres and unit, the robot's own frame: open ends that it looked at in vain, and where walls go on."""


def _own_of_both(old: PeerViews, new: PeerViews) -> tuple[Floats, Floats]:
    """(k, 2) and (j, 2) a peer's own viewpoints of two lists, both from the first one on that both of them hold."""
    first = max(old.forgotten[0], new.forgotten[0])
    one, other = (views.points[~views.heard][first - views.forgotten[0] :] for views in (old, new))
    return one, other


def _agree(old: PeerViews, new: PeerViews) -> bool:
    """Whether a peer's own viewpoints are the same in two lists, as far as both go."""
    one, other = _own_of_both(old, new)
    both = min(len(one), len(other))
    return np.array_equal(one[:both], other[:both])


def _to_use(views: PeerViews, tick: int, before: _Usable | None) -> PeerViews:
    """The newest list of a peer; where it tells the same anew, bit by bit, the older one until as much is usable.

    tick: of the merged map.
    """
    if before is None or before.views.editions == views.editions or not _agree(before.views, views):
        return views
    old, new = _own_of_both(before.views, views)
    return before.views if len(new) < len(old) or (views.need > tick).any() else views


def _usable_of(peer: Merged, views: PeerViews, before: _Usable | None) -> _Usable:
    """Those of a peer's viewpoints that are usable; as before where nothing of it is new."""
    transform, tick = peer.transform, peer.map.tick
    if before is not None and before.transform is transform and before.views is views and before.tick == tick:
        return before
    usable = views.need <= tick
    first_hand = apply(transform, views.points[usable & ~views.heard])
    turn = np.array((0.0, 0.0, transform[2]))
    ends = np.hstack((apply(transform, views.ends[:, :2]), apply(turn, views.ends[:, 2:])))
    return _Usable(transform, views, tick, first_hand, views.points[usable & views.heard], ends)


def _new_of(places: Floats, forgotten: int, count: int) -> tuple[Floats, int]:
    """Those of places (k, 2) that were not taken yet, and how many there ever were.

    forgotten: older ones that the list holds no more. count: of all, those that were taken.
    """
    return places[max(count - forgotten, 0) :], forgotten + len(places)


def _cells(places: Floats) -> list[int]:
    """A number of the cell of each of places (k, 2)."""
    x, y = np.floor(places / SAME_VIEW_M).astype(np.int64).T
    cells: list[int] = ((x << 32) + y).tolist()
    return cells


class TeamViews:
    """Viewpoints of merged peers."""

    def __init__(self) -> None:
        self.places = np.zeros((0, 2))
        """(k, 2) metres, the robot's own frame: what was seen from there is in merged maps."""
        self.ends = np.zeros((0, 4))
        """(g, 4) metres and unit, the same frame: open ends that peers looked at in vain, and where walls go on."""
        self.withdrawn = 0
        """Times that some of the places were taken back, with a merge or by who had told them."""
        self._usable: dict[str, _Usable] = {}
        self._first_hand: dict[str, Floats] = {}
        self._taken: dict[str, _Taken] = {}
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Tell all again, as some of it no longer holds: nobody's tick of the last one known is as late."""
        self._looked = Looked.nowhere()
        self._waiting = deque[tuple[float, float, str, int]]()
        self._ready = 0  # of those that wait, the first ones: the map that is told holds what was seen from there
        self._cells = set[int]()
        self._passed_on = dict[str, int]()  # first-hand viewpoints of each peer that were passed on, or known already
        self._own, self._own_tick, self._ends = 0, -1, 0

    def mend(self) -> None:
        """The robot's map was torn and is merged anew: all places are elsewhere, and are taken and told again."""
        self._taken = {}
        self._begin_anew()

    def gather(self, merged: Sequence[Merged]) -> None:
        """Take what these peers told, where the merged maps hold what was seen from there."""
        held, before_now = {peer.log.name: peer for peer in merged}, self._usable
        told = {name: _to_use(peer.log.views, peer.map.tick, before_now.get(name)) for name, peer in held.items()}
        anew = [name for name, old in self._taken.items() if name not in told or told[name].editions != old.editions]
        untrue = {name for name in anew if name not in told or not _agree(before_now[name].views, told[name])}
        heard_is_lost = any(len(self._taken[name].places) for name in anew)
        self.withdrawn += heard_is_lost or any(len(self._first_hand[name]) for name in untrue)
        for name in anew:
            del self._taken[name]
        if not self._passed_on.keys().isdisjoint(untrue):
            self._begin_anew()
        self._usable = {name: _usable_of(peer, told[name], before_now.get(name)) for name, peer in held.items()}
        self._first_hand = {name: usable.first_hand for name, usable in self._usable.items()}
        kept = [*self._first_hand.values(), *(taken.places for taken in self._taken.values())]
        known: set[int] | None = None  # cells of these, once a peer tells more from second hand
        for name, peer in held.items():
            views, before = told[name], self._taken.get(name)
            heard = self._usable[name].heard
            _, count, places = before or _Taken(views.editions, 0, np.zeros((0, 2)))
            new, total = _new_of(heard, views.forgotten[1], count)
            if len(new):
                if known is None:
                    known = set(_cells(np.vstack([np.zeros((0, 2)), *kept])))
                more, rows = apply(peer.transform, new), []
                for row, cell in enumerate(_cells(more)):
                    if cell not in known:
                        known.add(cell)
                        rows.append(row)
                places = np.vstack((places, more[rows]))[-KEPT_VIEWS:]
            self._taken[name] = _Taken(views.editions, total, places)
        self.places = np.vstack(
            [np.zeros((0, 2)), *self._first_hand.values(), *(taken.places for taken in self._taken.values())]
        )
        self.ends = np.vstack([np.zeros((0, 4)), *(usable.ends for usable in self._usable.values())])

    def looked(
        self,
        tick: int,
        own_ticks: Sequence[int],
        own_places: Sequence[tuple[float, float]],
        ends: Sequence[tuple[float, float, int]] = (),
        is_laid: bool = True,
    ) -> Looked:
        """What may be told: own viewpoints (k,) with their ticks, and merged peers' first-hand ones.

        ends: (g,) x, y and turn of open ends that the robot itself looked at in vain, in the order in which it did.
        is_laid: whether the map that peers are told holds all that was seen by now; else what is new waits for that.
        """
        if len(own_ticks) < self._own:  # every second one was forgotten
            self._begin_anew()
        self._waiting.extend((x, y, "", turn) for x, y, turn in ends[self._ends :])
        self._ends = len(ends)
        first = bisect_right(own_ticks, self._own_tick)
        if first < len(own_ticks):
            self._waiting.extend((x, y, "", -1) for x, y in own_places[first:])
            self._own_tick = own_ticks[-1]
        self._own = len(own_ticks)
        for name, places in self._first_hand.items():
            forgotten = self._usable[name].views.forgotten[0]
            new, total = _new_of(places, forgotten, self._passed_on.get(name, 0))
            if len(new):
                self._passed_on[name] = total
                self._pass_on(name, new)
        if is_laid:
            self._ready = len(self._waiting)
        for _ in range(min(TOLD_A_TICK, self._ready)):
            self._looked.add(tick, *self._waiting.popleft())
            self._ready -= 1
        return self._looked

    def _pass_on(self, name: str, places: Floats) -> None:
        """Queue a peer's viewpoints (k, 2) that are not as good as known to those that are told."""
        for cell, (x, y) in zip(_cells(places), places.tolist(), strict=True):
            if cell not in self._cells and len(self._looked.ticks) + len(self._waiting) < KEPT_VIEWS:
                self._cells.add(cell)
                self._waiting.append((x, y, name, -1))
