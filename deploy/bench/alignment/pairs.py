"""Pairs of partial maps with known truth, chosen evenly over worlds and overlaps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from deploy.bench.alignment.recordings import Recording, Snapshot
from deploy.bench.errors import errors, right
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, compose, inverted
from protocol.wireframe import Wireframe

MIN_CORNERS = 16  # true corners that both maps have, in the main tables (the issue's)
SMALL_CORNERS = 8  # true corners that both maps have at least, in the table of small maps
RANGE_M = 4.0  # default radio range
BODIES_M = 0.25  # the centres of two robots are at least this far apart
NOTHING = 0.01  # overlap below which maps share nothing: a piece of wall or two
BINS = ((0.0, NOTHING), (NOTHING, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.01))
"""Least and most overlap of each row of the tables; maps of the first row share nothing."""


def moved(wireframe: Wireframe, by: Sequence[float] | Floats) -> Wireframe:
    """A map in another frame: by (3,) takes the old into the new."""
    return replace(wireframe, points=apply(by, wireframe.points))


def random_pose(rng: np.random.Generator) -> Pose:
    """A frame within 20 m, turned by any angle."""
    x, y, theta = rng.uniform((-20.0, -20.0, -math.pi), (20.0, 20.0, math.pi)).tolist()
    return x, y, theta


class Pair(NamedTuple):
    """Two maps without a common frame, and the truth between them."""

    one: Recording
    mine: Snapshot
    two: Recording
    theirs: Snapshot
    overlap: float = 0.0  # true wall in both over that of the smaller (contracts.md)
    contact: bool = True  # whether the robots are within radio range where they stand

    @property
    def stranger(self) -> bool:
        """Whether the maps are of different buildings."""
        return self.one.world != self.two.world

    @property
    def corners(self) -> int:
        """True corners of the smaller map."""
        return min(self.mine.corners, self.theirs.corners)

    def right(self, found: Pose) -> bool:
        """Whether a transform counts as right, by its errors at the middle of their walls: their frame is drawn."""
        off = errors(found, self.one.frame, self.two.frame, self.theirs.wireframe.points.mean(0))
        return not self.stranger and right(*off)

    def elsewhere(self, by: Pose) -> "Pair":
        """The same with their frame moved: by takes the old into the new."""
        theirs = self.theirs._replace(pose=compose(by, self.theirs.pose), wireframe=moved(self.theirs.wireframe, by))
        two = self.two._replace(frame=compose(self.two.frame, inverted(by)))
        return self._replace(two=two, theirs=theirs)


def pairs_of(
    recordings: Sequence[Recording], rng: np.random.Generator, per_bin: int, low: int, high: float = math.inf
) -> list[Pair]:
    """At most `per_bin` pairs of each overlap from recordings of one world; those in contact first.

    The smaller map has at least `low` true corners and fewer than `high`.
    """
    bins: list[list[Pair]] = [[] for _ in BINS]
    for one, two in combinations(recordings, 2):
        for mine, theirs in product(one.snapshots, two.snapshots):
            if low <= min(mine.corners, theirs.corners) < high:
                choice = _choice(one, mine, two, theirs)
                bins[next(n for n, (_, most) in enumerate(BINS) if choice.overlap < most)].append(choice)
    pairs = []
    for choices in bins:
        order = rng.permutation(len(choices))
        chosen = sorted((choices[k] for k in order), key=lambda choice: not choice.contact)[:per_bin]
        pairs += [choice.elsewhere(random_pose(rng)) for choice in chosen]
    return pairs


def _choice(one: Recording, mine: Snapshot, two: Recording, theirs: Snapshot) -> Pair:
    """Two snapshots in one world, and what they have in common."""
    smaller_m = min(float(one.lengths[snapshot.mapped].sum()) for snapshot in (mine, theirs))
    overlap = float(one.lengths[mine.mapped & theirs.mapped].sum()) / max(smaller_m, 1e-9)
    away_m = math.dist(compose(one.frame, mine.pose)[:2], compose(two.frame, theirs.pose)[:2])
    return Pair(one, mine, two, theirs, overlap, BODIES_M <= away_m <= RANGE_M)


def strangers(
    by_world: Mapping[str, Sequence[Recording]], rng: np.random.Generator, count: int, low: int
) -> list[Pair]:
    """Pairs of maps of different buildings, as if their robots met."""
    kept = ([(r, s) for r in found for s in r.snapshots if s.corners >= low] for _, found in sorted(by_world.items()))
    large = [some for some in kept if some]
    pairs = []
    for _ in range(count if len(large) > 1 else 0):
        a, b = rng.choice(len(large), 2, replace=False)
        one, two = (large[k][int(rng.integers(len(large[k])))] for k in (a, b))
        pairs.append(Pair(*one, *two).elsewhere(random_pose(rng)))
    return pairs
