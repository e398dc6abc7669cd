"""Samples of an area: inside as shapely says, seen as a look at each of them says."""

import numpy as np
import pytest
import shapely

from agent.exploration.lattice import TILE, inside, lattice_between, take_seen
from agent.exploration.planning import Roads
from agent.exploration.sweep import MOST_SAMPLES, Sweep
from agent.geometry.visibility import hidden_by
from protocol.arrays import Floats
from protocol.messages import LidarSpec
from protocol.wireframe import Wireframe

TURNED = shapely.Polygon(
    [(0.03, 0.01), (5.02, 1.03), (4.01, 6.04), (2.03, 3.02), (-1.04, 5.01)],
    [[(1.51, 1.52), (1.53, 2.54), (2.55, 1.56)], [(3.01, 2.02), (3.53, 3.04), (4.05, 2.06)]],
)
SQUARE = shapely.box(0.0, 0.0, 2.0, 1.0)  # whose edges go through samples


@pytest.mark.parametrize(
    "area", [TURNED, SQUARE, SQUARE - shapely.box(0.5, 0.5, 1.0, 1.0), TURNED | shapely.box(7.0, 0.0, 8.0, 2.05)]
)
def test_inside_are_the_samples_that_shapely_says(area: shapely.Geometry) -> None:
    bounds = shapely.bounds(area)
    lattice = lattice_between(bounds[:2] - 0.3, bounds[2:] + 0.3, 0.1)
    every = lattice.points(np.ones((len(lattice.ys), len(lattice.xs)), np.bool_))
    within = shapely.contains_xy(area, every[:, 0], every[:, 1])
    assert within.sum() > 100
    assert np.array_equal(lattice.points(inside(lattice, area)), every[within])


def test_no_sample_is_inside_of_what_is_too_small_for_one() -> None:
    area = shapely.box(0.01, 0.01, 0.05, 0.05)
    bounds = shapely.bounds(area)
    assert inside(lattice_between(bounds[:2], bounds[2:], 0.1), area).size == 0


@pytest.mark.parametrize("beyond", [0.0, 0.7])
def test_seen_is_what_a_look_from_each_eye_at_each_sample_shows(beyond: float) -> None:
    rng = np.random.default_rng(4)
    starts = rng.uniform(-3.0, 3.0, (30, 2))
    walls = np.hstack((starts, starts + rng.uniform(-1.0, 1.0, (30, 2))))
    eyes = rng.uniform(-3.5, 3.5, (12, 2))
    lattice = lattice_between(np.array([-3.0, -2.5]), np.array([3.0, 2.5]), 0.1)
    left = rng.random((len(lattice.ys), len(lattice.xs))) < 0.9
    wanted = lattice.points(left)
    take_seen(left, lattice, eyes, walls, 1.3, beyond)
    unseen = [point for point in wanted if not any(sees(eye, point, walls, 1.3, beyond) for eye in eyes)]
    assert min(left.shape) > 3 * TILE and 500 < len(unseen) < len(wanted) - 500
    assert np.array_equal(lattice.points(left), unseen)


def sees(eye: Floats, point: Floats, walls: Floats, radius: float, beyond: float) -> bool:
    away = float(np.hypot(*(point - eye)))
    return beyond < away <= radius and hidden_by(eye[0], eye[1], point[0], point[1], walls) < 0


def test_of_a_very_large_hall_the_nearest_samples_are_swept_first() -> None:
    sweep, here = Sweep(0.1, LidarSpec()), np.array([3.0, 4.0])
    lattice = lattice_between(np.array([-40.0, -40.0]), np.array([40.0, 40.0]), 0.1)
    unseen = lattice.points(np.ones((len(lattice.ys), len(lattice.xs)), np.bool_))
    tasks = sweep.tasks(unseen, Roads(Wireframe(), here, 0.2))  # 11 GB if all were asked for at once
    asked = np.unique(np.vstack([task.samples for task in tasks]), axis=0)
    nearest = np.sort(np.hypot(*(unseen - here).T))[MOST_SAMPLES - 1]
    assert 0.99 * MOST_SAMPLES < len(asked) <= MOST_SAMPLES
    assert np.hypot(*(asked - here).T).max() <= nearest
