"""How far the map may be off in its frame, and what a look at each of its walls would tell."""

import math

import numpy as np
import pytest

from agent.mapping.edges import EDGE, TENTATIVE, WALL
from agent.mapping.exactness import LOOK_M, LOOK_SD_M, Exactness
from agent.mapping.joint import row_of
from protocol.geometry import Pose

POSE: Pose = (1.0, -0.5, 2.0)
WALLS = ((0.0, 2.0, -1.0, 0.0), (2.0, 0.0, 0.0, 1.0), (-1.0, 5.0, 0.6, 0.8))  # each a point and a direction


def known(joint: np.ndarray, pose: Pose = POSE) -> Exactness:
    """Three walls of 2 m and one that is not published, and what is known of them."""
    walls = np.zeros(len(WALLS) + 1, EDGE)
    for wall, (x, y, ux, uy) in zip(walls, WALLS, strict=False):
        wall["kind"], wall["seen"], wall["x"], wall["y"], wall["ux"], wall["uy"] = WALL, 9.0, x, y, ux, uy
        wall["tip"] = [(x - 0.5 * ux, y - 0.5 * uy), (x + 1.5 * ux, y + 1.5 * uy)]
    walls[-1]["kind"], walls[-1]["seen"] = TENTATIVE, 9.0
    return Exactness(walls, joint, pose)


def drawn(seed: int = 0) -> np.ndarray:
    """A covariance of pose and walls that err together."""
    mixes = np.random.default_rng(seed).normal(0.0, 0.01, (row_of(len(WALLS) + 1),) * 2)
    return np.asarray(mixes @ mixes.T)


def test_the_map_may_be_off_as_its_walls_are_across_their_lines() -> None:
    joint = np.zeros((row_of(4), row_of(4)))
    for e, sd_m in enumerate((0.01, 0.03, 0.05, 7.0)):  # the last one is no wall of the map
        joint[row_of(e), row_of(e)] = sd_m**2
    assert known(joint).sd_m() == pytest.approx(math.sqrt((0.01**2 + 0.03**2 + 0.05**2) / 3))
    assert Exactness().sd_m() == 0.0
    assert len(Exactness().looks().places) == 0


@pytest.mark.parametrize("seed", range(5))
def test_a_look_tells_what_an_update_by_it_leaves(seed: int) -> None:
    """Against the Kalman update itself, by a measurement that is differentiated numerically."""
    joint = drawn(seed)
    exactness = known(joint)
    looks, rows = exactness.looks(), [row_of(e) for e in range(len(WALLS))]
    for e, (x, y, ux, uy) in enumerate(WALLS):
        middle = np.array((x, y)) + 0.5 * np.array((ux, uy))

        def beside(errors: np.ndarray, e: int = e, middle: np.ndarray = middle) -> float:
            """How far left of where the robot sees the middle of the wall its line is; errors: of all rows."""
            x, y, ux, uy = WALLS[e]
            aside, turn = errors[row_of(e)], errors[row_of(e) + 1]
            c, s = math.cos(errors[2]), math.sin(errors[2])
            seen = np.array(((c, -s), (s, c))) @ (middle - POSE[:2]) + POSE[:2] + errors[:2]
            angle = math.atan2(uy, ux) + turn
            normal = np.array((-math.sin(angle), math.cos(angle)))
            return float(normal @ (np.array((x - aside * uy, y + aside * ux)) - seen))

        step = 1e-6 * np.eye(len(joint))
        slopes = np.array([(beside(by) - beside(-by)) / 2e-6 for by in step])
        shared = joint @ slopes
        after = joint - np.outer(shared, shared) / (slopes @ shared + LOOK_SD_M**2)
        assert looks.sds_m[e] == pytest.approx(math.sqrt(np.diag(after)[rows].mean()), rel=1e-6)
        assert looks.places[e] == pytest.approx(middle + LOOK_M * np.array((-uy, ux)))
    assert (looks.sds_m <= exactness.sd_m()).all()


def test_a_wall_that_is_known_better_than_the_pose_tells_most() -> None:
    """As one seen soon after the start, of a map whose other walls were placed after a drive by wheels alone."""
    joint, lost, early = np.zeros((row_of(4), row_of(4))), 0.04, 0.01
    joint[1, 1] = lost**2  # the robot does not know how far along y it is
    joint[row_of(0), row_of(0)] = early**2  # a wall along x was seen before
    for e, (_, _, ux, _) in enumerate(WALLS[1:], 1):  # the others are as far off as the robot, in y
        joint[row_of(e), row_of(e)] = (ux * lost) ** 2
        joint[1, row_of(e)] = joint[row_of(e), 1] = ux * lost**2
    exactness = known(joint)
    told = exactness.sd_m() - exactness.looks().sds_m
    assert told[0] > 0.4 * exactness.sd_m()
    assert told[1:] == pytest.approx((0.0, 0.0), abs=1e-9)


def test_walls_of_a_map_that_was_just_mended_are_as_far_off_as_the_robot() -> None:
    """They have no rows until the next scan: the map counted as exact, and a robot may say complete."""
    joint = np.zeros((row_of(4), row_of(4)))
    joint[:2, :2] = place = np.array(((16.0, 3.0), (3.0, 4.0))) * 1e-4
    across = np.array([(-uy, ux) for _, _, ux, uy in WALLS])
    assert known(joint).sd_m() == pytest.approx(math.sqrt(np.einsum("ki,ij,kj", across, place, across) / len(WALLS)))
    assert len(known(joint).looks().places) == 0
    joint[row_of(1), row_of(1)] = 1e-4
    assert known(joint).looks().places == pytest.approx(np.array([(2.0 - LOOK_M, 0.5)]))
