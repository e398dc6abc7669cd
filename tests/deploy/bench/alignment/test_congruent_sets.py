"""4PCS, the baseline: it succeeds where it must, and is fooled where the paper says so (figure 5)."""

import math

import numpy as np
import pytest

from agent.alignment.candidates import FINE_M
from agent.geometry.transform import inverse
from deploy.bench.alignment.baselines import by_congruent_sets
from deploy.bench.alignment.congruent_sets import BASE_RADIUS_M, BASE_SIDE_M, draw_bases, matched_clouds
from deploy.bench.errors import distance
from protocol.geometry import apply
from tests.agent.alignment.test_alignment import chain, found, moved


@pytest.mark.parametrize("seed", range(8))
def test_overlapping_noisy_clouds_are_brought_onto_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = rng.uniform(0, 10, (60, 2))
    frame = rng.uniform((-9, -9, -math.pi), (9, 9, math.pi))
    target = cloud[:45] + rng.normal(0, 0.01, (45, 2))
    source = apply(frame, cloud[15:] + rng.normal(0, 0.01, (45, 2)))
    got = matched_clouds(source, target, np.random.default_rng(1))
    metres, turn = distance(got[0], inverse(frame), source.mean(0))
    assert metres < 0.1 and turn < math.radians(2.0)


def test_a_mirrored_cloud_is_not_matched() -> None:
    cloud = np.random.default_rng(2).uniform(0, 10, (40, 2))
    got = matched_clouds(cloud * (-1.0, 1.0), cloud, np.random.default_rng(1))
    gaps = [np.linalg.norm(apply(t, cloud * (-1.0, 1.0))[:, None] - cloud, axis=2).min(1) for t in got[:20]]
    assert max((int((gap < FINE_M).sum()) for gap in gaps), default=0) < 10


def test_bases_cross_within_the_radius_and_lines_have_none() -> None:
    points = np.random.default_rng(0).uniform(0, 20, (50, 2))
    bases = draw_bases(points, np.random.default_rng(0))
    assert len(bases) > 100
    for a, b, c, d in points[bases]:
        for other in (b, c, d):
            assert BASE_SIDE_M < np.hypot(*(other - a)) <= BASE_RADIUS_M
        sides = [np.sign(np.linalg.det([q - p, r - p])) for p, q, r in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
        assert sides[0] != sides[1] and sides[2] != sides[3]
    line = np.column_stack([np.arange(20.0), np.zeros(20)])
    assert not len(draw_bases(line, np.random.default_rng(0)))
    assert not len(matched_clouds(line[:3], points, np.random.default_rng(0)))


WEST_FACE = [
    (0.0, 8.0), (0.0, 7.1), (-0.6, 7.1), (-0.6, 6.2), (0.0, 6.2), (0.0, 5.0), (-0.9, 5.0), (-0.9, 4.3), (0.0, 4.3),
    (0.0, 2.4), (-0.6, 2.4), (-0.6, 1.3), (0.0, 1.3), (0.0, 0.4),
]  # fmt: skip
"""One face of a thick wall with pilasters. The other face has the same corners half a metre on, as its pilasters
are recesses: seen as points, the two faces are one."""
THICK_M = 0.5
HALL = [
    (-2.0, 9.0), (-2.0, 10.3), (-0.7, 10.3), (-0.7, 11.0), (0.4, 11.0), (0.4, 10.2), (1.9, 10.2), (1.9, 11.6),
    (3.0, 11.6), (3.0, 9.0),
]  # fmt: skip
"""What both robots have seen."""


def test_figure_5_points_of_the_two_faces_of_a_wall_fool_4pcs_and_not_directed_walls() -> None:
    red = chain(HALL[::-1], WEST_FACE[::-1])
    cyan = chain(HALL[::-1], [(x + THICK_M, y) for x, y in WEST_FACE])
    frame = np.array([3.0, -2.0, 0.8])
    theirs = moved(cyan, frame)
    truth = inverse(frame)

    ours = found(red, theirs, min_corners=12)
    assert ours.transform is not None
    metres, turn = distance(np.array(ours.transform), truth, theirs.points.mean(0))
    assert metres < 0.05 and turn < math.radians(1.0)

    fooled = found(red, theirs, method=by_congruent_sets, min_corners=12)
    assert fooled.transform is not None
    metres, _ = distance(np.array(fooled.transform), truth, theirs.points.mean(0))
    assert metres == pytest.approx(THICK_M, abs=0.05)
    assert fooled.residual < 0.01 and fooled.inliers > 10  # "a perfect alignment between the chosen vertices"
    assert fooled.agreement < 0.5 * ours.agreement  # "but not between the maps"
