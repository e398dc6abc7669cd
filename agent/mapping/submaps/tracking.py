"""Where a scan lies by the walls that were seen last, with what odometry tells as the prior (ours)."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agent.mapping.submaps.loops import Submap, due
from agent.mapping.submaps.matching import (
    COARSE_GATE_M,
    SUBMAP_GATES_M,
    TRUST,
    Match,
    costs_around,
    poses_around,
    refine,
    tiles_of,
)
from agent.mapping.submaps.segments import every
from agent.mapping.submaps.tiles import SegmentTiles
from protocol.arrays import Floats
from protocol.geometry import wrapped

ROUNDS = 6  # Gauss-Newton steps for each gate
TRACKING_GATES_M = np.array((*SUBMAP_GATES_M, 0.2))
"""Of a scan, whose odometry is nearer than a loop's guess. With the third gate, clutter beside known walls pulls less
at the pose: paths of intel-drift and csail-drift err by a twentieth less; with 0.15 m those of csail-drift do not."""
LOST_SHARE = 0.6
"""Of a scan's samples that the last scan should have shown, those on walls, below which the pose is searched for, too.
Counted over all samples, a lidar of half a turn that was turned by 50 degrees was lost, and the search put new walls
onto old ones."""
HELD_SHARE = 0.25
"""The same of all samples. Where a turn brings a new room into view, a few known walls fit a wrong pose as well as the
right one: of 588 made-up slips by 20 degrees on ways through a doorway 14 were believed, now none."""
SEARCH, SEARCH_STEP = np.array((0.4, 0.4, math.radians(24.0))), np.array((0.2, 0.2, math.radians(4.0)))
"""m, m and rad to either side of the odometry's pose, and from one pose that is tried to the next."""
SPARSE = 25  # samples that are enough to tell those poses apart
TRIED = 4  # of those poses, the best are refined
SAMPLE_WEIGHT = 0.5  # of a sample in the search, against the odometry: neighbours on one wall err alike
UNKNOWN = 0.5
"""Cost of a sample that the last scan could not show from a pose: between those of one on a wall and of one on none.
With none at all the search is for poses that hide what is seen. Asked of all poses alike, by what odometry's had in
view, wheels that slipped by 9 degrees were believed: half of the scan lay where nobody had looked."""
SLIP = 7.0  # what it costs to believe that odometry has slipped, whatever the way: one scan in a thousand


class Tracked(NamedTuple):
    """Where a scan lies."""

    pose: Floats  # (3,)
    information: Floats  # (3, 3) of that pose, with the prior's
    held: bool  # whether it lies on walls near to where the first guess has it, and not elsewhere or nowhere sure
    overruled: bool  # whether walls say otherwise than all guesses


def track(samples: Floats, last_view: Submap, guesses: Sequence[Floats], prior: Floats) -> Tracked:
    """The pose of samples (k, 5) of a scan among the walls of the last view.

    Where few that it should have shown lie on walls, the pose is searched for around the odometry's, which may have
    slipped. guesses: poses (3,) by odometry, with prior (3, 3); a second one where the odometry was overruled at the
    last scan, as that scan's stamp may have been wrong, and not the wheels: three scans of csail-drift are off by 10 to
    20 degrees. Both are tried: when the first one was believed wherever it found enough walls, a room of csail-drift
    came out turned by 5 degrees, and 42 of 672 made-up wrong stamps bent the way after them, now 28.
    """
    tiles = tiles_of(last_view.walls)
    matches = [_matched(samples, tiles, guess, prior) for guess in guesses]
    taken = 0
    if len(matches) > 1:
        taken = _likeliest(last_view, tiles, samples, np.array([match.pose for match in matches]), guesses, prior)
    match = matches[taken]
    known, met = due(last_view, tiles, samples, match.pose)
    if met.sum() >= max(LOST_SHARE * known.sum(), HELD_SHARE * len(samples)):
        information = TRUST * (match.information - prior) + prior
        overruled = bool(against(match.pose[None], guesses, prior)[0] >= SLIP)
        return Tracked(match.pose, information, taken == 0, overruled)
    poses = np.vstack([poses_around(one, SEARCH, SEARCH_STEP) for one in guesses])
    few = every(samples, len(samples) // SPARSE)
    costs = len(samples) / len(few) * costs_around(few, tiles, poses, COARSE_GATE_M)
    best = np.argsort(SAMPLE_WEIGHT * costs + against(poses, guesses, prior), kind="stable")[:TRIED]
    found = [refine(samples, tiles, pose, prior, TRACKING_GATES_M[1:], ROUNDS) for pose in poses[best]]
    tried = np.array([match.pose for match in (*matches, *found)])
    pose = tried[_likeliest(last_view, tiles, samples, tried, guesses, prior)]
    return Tracked(np.asarray(pose), prior, False, True)


def _matched(samples: Floats, tiles: SegmentTiles, guess: Floats, prior: Floats) -> Match:
    """The pose of samples (k, 5) near to one by odometry, (3,), with prior (3, 3).

    It is refined twice, the second time with the prior about the first result. Of the odometry's error in what walls
    hold, a share of a share is left then, and what no wall holds stays where odometry has it (iterated Tikhonov
    regularisation). Once left up to a fifth of it at doorways: headings behind those of csail-drift differ by a third
    less between 14 seeds of drift. A third time adds nothing there, and bends corridors of made-up halls.
    """
    first = refine(samples, tiles, guess, prior, TRACKING_GATES_M, ROUNDS)
    return refine(samples, tiles, first.pose, prior, TRACKING_GATES_M[-1:], ROUNDS)


def _likeliest(
    last_view: Submap, tiles: SegmentTiles, samples: Floats, poses: Floats, guesses: Sequence[Floats], prior: Floats
) -> int:
    """Which of the poses (n, 3) walls and guesses together speak least against."""
    costs = np.array([_unlikely(last_view, tiles, samples, pose) for pose in poses])
    return int(np.argmin(SAMPLE_WEIGHT * costs + against(poses, guesses, prior)))


def _unlikely(last_view: Submap, tiles: SegmentTiles, samples: Floats, pose: Floats) -> float:
    """What speaks against a pose (3,) of samples (k, 5), by those of the walls that the last view should show there."""
    known, _ = due(last_view, tiles, samples, pose)
    cost = float(costs_around(samples[known], tiles, pose[None], SUBMAP_GATES_M[-1])[0])
    return cost + UNKNOWN * float(len(samples) - known.sum())


def against(poses: Floats, guesses: Sequence[Floats], prior: Floats) -> Floats:
    """(n,) what speaks against poses (n, 3) that are off those by odometry, (3,) each. prior: its information."""
    out = np.full(len(poses), SLIP)
    for guess in guesses:
        off = np.column_stack((poses[:, :2] - guess[:2], wrapped(poses[:, 2] - guess[2])))
        out = np.minimum(out, 0.5 * np.einsum("ni,ij,nj->n", off, prior, off))
    return out
