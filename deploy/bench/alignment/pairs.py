"""Pairs of partial maps with known truth, chosen evenly over worlds and overlaps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from agent.geometry.transform import compose, inverse
from deploy.bench.alignment.recordings import Recording, Snapshot
from deploy.bench.errors import off_by, right
from protocol.arrays import Floats
from protocol.geometry import Pose, apply
from protocol.wireframe import Wireframe

MIN_CORNERS = 16
"""True corners that both maps have, in the main tables (the issue's)."""
SMALL_CORNERS = 8
"""And at least, in the table of small ones."""
RANGE_M = 4.0
"""Default radio range."""
BODIES_M = 0.25
"""Two robots are not nearer."""
NOTHING = 0.01
"""Overlap below which maps share nothing: a piece of wall or two."""
BINS = ((0.0, NOTHING), (NOTHING, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.01))
"""Overlaps of one row each; the first is without."""


@dataclass(frozen=True)
class Pair:
    """Two maps, the second moved by a random pose, and the truth between them."""

    world: str
    """Or two, for maps of different buildings."""
    mine: Wireframe
    theirs: Wireframe
    my_pose: Pose
    their_pose: Pose
    truth: Floats | None
    """(3,) their frame in mine; None in different buildings."""
    overlap: float
    """True wall in both over that of the smaller (contracts.md)."""
    contact: bool
    """Whether the robots are within radio range where they stand."""
    corners: int
    """True corners of the smaller map."""

    def errors(self, found: Pose) -> tuple[float, float]:
        """Metres at the middle of their walls, and degrees, that a transform is off; inf without a truth."""
        if self.truth is None:
            return math.inf, math.inf
        return off_by(found, self.truth, self.theirs.points.mean(0))

    def right(self, found: Pose) -> bool:
        """Whether a transform counts as right."""
        return right(*self.errors(found))


def moved(wireframe: Wireframe, by: Floats) -> Wireframe:
    """A map in another frame: by (3,) takes the old into the new."""
    return replace(wireframe, points=apply(by, wireframe.points))


def random_pose(rng: np.random.Generator) -> Floats:
    """(3,) a frame that nobody could guess."""
    return rng.uniform((-20.0, -20.0, -math.pi), (20.0, 20.0, math.pi))


@dataclass(frozen=True)
class _Choice:
    """Which snapshots make a pair."""

    one: tuple[Recording, Snapshot]
    two: tuple[Recording, Snapshot]
    overlap: float
    distance_m: float

    @property
    def contact(self) -> bool:
        return BODIES_M <= self.distance_m <= RANGE_M

    @property
    def corners(self) -> int:
        return min(self.one[1].corners, self.two[1].corners)

    def pair(self, rng: np.random.Generator) -> Pair:
        (a, mine), (b, theirs) = self.one, self.two
        by = random_pose(rng)
        x, y, theta = compose(by, np.array(theirs.pose)).tolist()
        truth = None
        if a.world == b.world:
            truth = compose(compose(inverse(np.array(a.frame)), np.array(b.frame)), inverse(by))
        return Pair(
            world=a.world if a.world == b.world else f"{a.world} and {b.world}",
            mine=mine.wireframe,
            theirs=moved(theirs.wireframe, by),
            my_pose=mine.pose,
            their_pose=(x, y, theta),
            truth=truth,
            overlap=self.overlap,
            contact=self.contact,
            corners=self.corners,
        )


def pairs_of(
    recordings: Sequence[Recording], rng: np.random.Generator, per_bin: int, low: int, high: float = math.inf
) -> list[Pair]:
    """At most `per_bin` pairs of each overlap from recordings of one world; those in contact first.

    The smaller map has at least `low` true corners and fewer than `high`.
    """
    bins: dict[int, list[_Choice]] = {}
    for one, two in combinations(recordings, 2):
        for choice in _choices(one, two):
            if low <= choice.corners < high:
                row = next(n for n, (least, most) in enumerate(BINS) if least <= choice.overlap < most)
                bins.setdefault(row, []).append(choice)
    pairs = []
    for _, choices in sorted(bins.items()):
        order = rng.permutation(len(choices))
        chosen = sorted((choices[k] for k in order), key=lambda choice: not choice.contact)[:per_bin]
        pairs += [choice.pair(rng) for choice in chosen]
    return pairs


def _choices(one: Recording, two: Recording) -> list[_Choice]:
    """All pairs of snapshots of two recordings in one world."""
    if not one.snapshots or not two.snapshots:
        return []
    a = np.array([snapshot.mapped for snapshot in one.snapshots]).astype(np.float64)
    b = np.array([snapshot.mapped for snapshot in two.snapshots]).astype(np.float64)
    both = (a * one.lengths) @ b.T
    smaller = np.minimum((a @ one.lengths)[:, None], (b @ one.lengths)[None])
    overlap = both / np.maximum(smaller, 1e-9)
    places = [
        np.array([compose(np.array(recording.frame), np.array(s.pose)) for s in recording.snapshots])[:, :2]
        for recording in (one, two)
    ]
    away = np.linalg.norm(places[0][:, None] - places[1][None], axis=2)
    return [
        _Choice((one, s), (two, u), float(overlap[i, j]), float(away[i, j]))
        for i, s in enumerate(one.snapshots)
        for j, u in enumerate(two.snapshots)
    ]


def strangers(
    by_world: Mapping[str, Sequence[Recording]], rng: np.random.Generator, count: int, low: int
) -> list[Pair]:
    """Pairs of maps of different buildings, as if their robots met."""
    large = {
        world: found
        for world, recordings in by_world.items()
        if (found := [(r, s) for r in recordings for s in r.snapshots if s.corners >= low])
    }
    worlds = sorted(large)
    pairs = []
    for _ in range(count if len(worlds) > 1 else 0):
        a, b = rng.choice(len(worlds), 2, replace=False)
        one, two = (large[worlds[k]][int(rng.integers(len(large[worlds[k]])))] for k in (a, b))
        pairs.append(_Choice(one, two, 0.0, 0.5 * RANGE_M).pair(rng))
    return pairs
