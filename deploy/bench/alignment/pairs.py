"""Pairs of partial maps with known truth, chosen evenly over worlds and overlaps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from agent.geometry.transform import compose, inverse
from deploy.bench.alignment.recordings import Recording, Snapshot
from deploy.bench.errors import off_by, right, true_transform
from protocol.arrays import Floats
from protocol.geometry import Pose, apply
from protocol.wireframe import Wireframe

MIN_CORNERS = 16  # true corners that both maps have, in the main tables (the issue's)
SMALL_CORNERS = 8  # true corners that both maps have at least, in the table of small maps
RANGE_M = 4.0  # default radio range
BODIES_M = 0.25  # the centres of two robots are at least this far apart
NOTHING = 0.01  # overlap below which maps share nothing: a piece of wall or two
BINS = ((0.0, NOTHING), (NOTHING, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.01))
"""Least and most overlap of each row of the tables; maps of the first row share nothing."""


@dataclass(frozen=True)
class Pair:
    """Two maps, the second moved by a random pose, and the truth between them."""

    world: str  # name of the world, or of both where the maps are of different buildings
    mine: Wireframe
    theirs: Wireframe
    my_pose: Pose
    their_pose: Pose
    truth: Floats | None  # (3,) their frame in mine; None in different buildings
    overlap: float  # true wall in both over that of the smaller (contracts.md)
    contact: bool  # whether the robots are within radio range where they stand
    corners: int  # true corners of the smaller map

    def right(self, found: Pose) -> bool:
        """Whether a transform counts as right, by its error at the middle of their walls."""
        return self.truth is not None and right(*off_by(found, self.truth, self.theirs.points.mean(0)))


def moved(wireframe: Wireframe, by: Sequence[float] | Floats) -> Wireframe:
    """A map in another frame: by (3,) takes the old into the new."""
    return replace(wireframe, points=apply(by, wireframe.points))


def random_pose(rng: np.random.Generator) -> Floats:
    """(3,) a frame within 20 m, turned by any angle."""
    return rng.uniform((-20.0, -20.0, -math.pi), (20.0, 20.0, math.pi))


class _Choice(NamedTuple):
    """Which snapshots make a pair."""

    one: Recording
    mine: Snapshot
    two: Recording
    theirs: Snapshot
    overlap: float
    contact: bool

    @property
    def corners(self) -> int:
        return min(self.mine.corners, self.theirs.corners)

    def pair(self, rng: np.random.Generator) -> Pair:
        a, mine, b, theirs, overlap, contact = self
        by = random_pose(rng)
        x, y, theta = compose(by, np.array(theirs.pose)).tolist()
        world, truth = f"{a.world} and {b.world}", None
        if a.world == b.world:
            world, truth = a.world, compose(true_transform(a.frame, b.frame), inverse(by))
        maps = mine.wireframe, moved(theirs.wireframe, by)
        return Pair(world, *maps, mine.pose, (x, y, theta), truth, overlap, contact, self.corners)


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
    here, there = (
        compose(np.array(recording.frame), np.array([s.pose for s in recording.snapshots]))[:, :2]
        for recording in (one, two)
    )
    away = np.linalg.norm(here[:, None] - there[None], axis=2)
    contact = (away >= BODIES_M) & (away <= RANGE_M)
    return [
        _Choice(one, s, two, u, float(overlap[i, j]), bool(contact[i, j]))
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
        pairs.append(_Choice(*one, *two, 0.0, True).pair(rng))
    return pairs
