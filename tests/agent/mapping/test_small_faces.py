"""Tips of thin walls and small steps are closed from their two sides, slots are not; short walls stand square."""

import math

import numpy as np
import pytest

from agent.corner_scan import FRONTIER
from agent.mapping.edges import EDGE, WALL, join
from agent.mapping.squares import square_short_walls
from protocol.geometry import Pose
from protocol.wireframe import Label
from tests.agent.mapping.test_particle_filter import Walk, farthest, ring, round_tour
from tests.ideal import ideal_lidar

NOISE_M = 0.01
OUTSIDE = ring((0, 0), (5, 0), (5, 4), (0, 4))
TOUR = round_tour((0.7, 0.7), (4.3, 0.7), (4.3, 3.3), (0.7, 3.3))
FAR_TOURS = 4 * round_tour((0.7, 1.2), (4.3, 1.2), (4.3, 3.3), (0.7, 3.3), step=0.05)


def plate(x: float, y: float, length: float, thickness: float) -> list[tuple[float, float, float, float]]:
    """Outline of a free-standing plate with its lower left corner at (x, y)."""
    return ring((x, y), (x, y + thickness), (x + length, y + thickness), (x + length, y))


def seen(
    walls: list[tuple[float, float, float, float]], seed: int = 0, tour: list[Pose] = TOUR, noise_m: float = NOISE_M
):
    walk = Walk(walls, ideal_lidar(noise_m=noise_m), seed=seed)
    for pose in tour:
        walk.see(pose)
    found = walk.filter.wireframe()
    found.check()
    return found


@pytest.mark.parametrize("thickness", [0.002, 0.01, 0.02, 0.04, 0.06])
@pytest.mark.parametrize("seed", range(3))
def test_both_faces_of_a_thin_wall_share_its_tips(thickness: float, seed: int) -> None:
    walls = OUTSIDE + plate(1.8, 2.0, 1.3, thickness)
    found = seen(walls, seed)
    assert (found.labels == Label.NOMINAL).all()
    assert len(found.points) == len(found.edges) == 8
    assert farthest(found, walls) < 0.02


@pytest.mark.parametrize("slot", [0.08, 0.16])
def test_a_slot_between_two_plates_stays_open(slot: float) -> None:
    walls = OUTSIDE + plate(1.8, 1.9, 1.3, 0.1) + plate(1.8, 2.0 + slot, 1.3, 0.1)
    found = seen(walls)
    segments = found.segments()
    middle = 2.0 + slot / 2
    across = (segments[:, 1] - middle) * (segments[:, 3] - middle) < 0
    assert not (across & (segments[:, 0] > 1.0) & (segments[:, 0] < 4.0)).any()


def corner_of(turn: float, length: float):
    """A long wall along x that ends in a short one which leaves by that turn, radians; as records."""
    edges = np.zeros(2, EDGE)
    for k, (x, angle, size) in enumerate(((-2.0, 0.0, 4.0), (0.0, turn, length))):
        e, u = edges[k], np.array([math.cos(angle), math.sin(angle)])
        e["kind"], e["hits"], e["seen"], e["link"] = WALL, 300.0, 50.0, -1
        middle = np.array([x, 0.0]) + (0.0 if k == 0 else 0.5 * size) * u
        e["x"], e["y"] = middle
        e["ux"], e["uy"] = u
        e["tip"] = middle - 0.5 * size * u, middle + 0.5 * size * u
        e["label"] = FRONTIER
    join(edges, 0, 1, 1.0)
    return edges


@pytest.mark.parametrize(
    ("off_deg", "length", "left_deg"),
    [
        (8.0, 0.11, 0.5),  # is square
        (-17.0, 0.11, 0.5),
        (2.0, 3.0, 2.0),  # is known better than by its neighbour
        (40.0, 0.11, 40.0),  # is oblique
    ],
)
def test_a_short_wall_is_square_as_far_as_its_direction_is_unsure(
    off_deg: float, length: float, left_deg: float
) -> None:
    edges = corner_of(math.radians(90.0 + off_deg), length)
    square_short_walls(edges, np.zeros(2, np.int64), NOISE_M)
    short = edges[1]
    assert abs(abs(math.degrees(math.atan2(short["uy"], short["ux"])) - 90.0) - left_deg) < 0.5
    assert np.allclose(edges[0]["tip"][1], short["tip"][0])
    assert abs(float(np.hypot(*(short["tip"][1] - short["tip"][0]))) - length) < 0.03


def test_a_short_wall_that_turns_little_from_its_neighbour_is_not_laid_along_it() -> None:
    edges = corner_of(math.radians(19.0), 0.24)
    before = edges.copy()
    square_short_walls(edges, np.zeros(2, np.int64), NOISE_M)
    assert np.abs(edges["tip"] - before["tip"]).max() < 0.01


@pytest.mark.parametrize("slot", [0.04, 0.06])
@pytest.mark.parametrize("seed", range(2))
def test_a_slot_narrower_than_beams_are_apart_is_not_closed_on_the_wall_behind(slot: float, seed: int) -> None:
    found = seen(OUTSIDE + plate(1.8, slot, 1.3, 0.4), seed, FAR_TOURS)
    segments, labels = found.segments(), found.labels[found.edges]
    sides = (np.abs(segments[:, 0] - segments[:, 2]) < 0.05) & (np.abs(segments[:, 0] - 2.45) < 0.8)
    low = np.minimum(segments[sides, 1], segments[sides, 3])
    assert (np.abs(low - slot) < 0.03).all()
    assert (labels[sides] != Label.NOMINAL).any(axis=1).all()


@pytest.mark.parametrize("noise_m", [NOISE_M, 0.02, 0.03])
@pytest.mark.parametrize("seed", range(2))
def test_a_cabinet_that_stands_at_the_wall_has_no_slot_behind_it(seed: int, noise_m: float) -> None:
    """Where ranges err by more, the last hits on a wall pass for hits on the next one, and slots were seen so."""
    walls = ring((0, 0), (1.8, 0), (1.8, 0.4), (3.1, 0.4), (3.1, 0), (5, 0), (5, 4), (0, 4))
    found = seen(walls, seed, FAR_TOURS, noise_m)
    assert (found.labels == Label.NOMINAL).all()
    assert farthest(found, walls) < 2 * noise_m
