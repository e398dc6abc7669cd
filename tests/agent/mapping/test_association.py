"""Which walls are asked whether a piece is on them: all that could take it."""

import math

import numpy as np
import pytest

from agent.corner_scan import FRONTIER, NOMINAL, OCCLUSION, PIECE
from agent.kernels import kernel
from agent.mapping.association import (
    OF_TWO_WALLS,
    OFFSET_GATE_M,
    Gates,
    associate,
    cost,
    is_off,
    lines_of,
    overlap,
    walls_near,
)
from agent.mapping.edges import EDGE, WALL
from agent.mapping.layers import Layer, merged
from protocol.arrays import Bools, Records


def pieces_of(rng: np.random.Generator, count: int) -> Records:
    """Pieces (count,) of 0.1 to 6 m along two directions in a square of 12 m, of few hits and of many."""
    pieces = np.zeros(count, PIECE)
    length, angle = (
        rng.uniform(0.1, 6.0, count),
        0.5 * math.pi * rng.integers(4, size=count) + 0.05 * rng.normal(size=count),
    )
    pieces["hits"] = rng.choice([2.0, 8.0, 100.0], count)
    pieces["x"], pieces["y"] = rng.uniform(0.0, 12.0, (2, count)).round()
    pieces["x"] += 0.05 * rng.normal(size=count)
    pieces["y"] += 0.05 * rng.normal(size=count)
    pieces["ux"], pieces["uy"] = np.cos(angle), np.sin(angle)
    pieces["spread"] = pieces["hits"] * length**2 / 12.0
    pieces["end"] = np.column_stack([-0.5 * length, 0.5 * length])
    pieces["link"] = -1
    pieces["label"] = 1
    return pieces


@kernel
def asked(edges: Records, pieces: Records, gates: Gates) -> tuple[Bools, Bools]:
    """(k, n) which walls could take each piece, and which are asked."""
    lines, near = lines_of(edges, len(edges), 0, gates), np.empty(len(edges), np.int64)
    could, are = np.zeros((len(pieces), len(edges)), np.bool_), np.zeros((len(pieces), len(edges)), np.bool_)
    for k in range(len(pieces)):
        p = pieces[k]
        for j in near[: walls_near(lines, len(edges), p, gates, near)]:
            are[k, j] = not is_off(lines.rows[j], p, gates)
        for j in range(len(edges)):
            finite = math.isfinite(overlap(edges[j], p, gates)) and math.isfinite(cost(edges[j], p, gates))
            could[k, j] = edges[j].kind == 1 and finite
    return could, are


def test_every_wall_that_could_take_a_piece_is_asked() -> None:
    rng = np.random.default_rng(0)
    for noise in (0.01, 0.05):
        gates = Gates(noise, 0.06)
        walls = pieces_of(rng, 200)
        edges = merged(np.zeros(0, EDGE), [Layer(walls, np.ones(200), np.zeros((0, 3)))], gates)
        edges["relative"][::2] = (1e-4, 5e-5, 1e-4)  # as the walls that a robot knows together with its pose
        could, are = asked(edges, pieces_of(rng, 500), gates)
        assert could.sum() > 300 and not (could & ~are).any()
        assert are.sum() < 3 * could.sum()


def walls_of(count: int, sd_m: float) -> Records:
    """Walls (count,) of 4 m along x through the origin, known to so many metres."""
    walls = np.zeros(count, EDGE)
    walls["kind"], walls["hits"], walls["ux"], walls["xx"] = WALL, 1000.0, 1.0, 1000.0
    walls["tip"], walls["link"], walls["label"] = [(-2.0, 0.0), (2.0, 0.0)], -1, OCCLUSION
    walls["relative"] = (sd_m**2, 0.0, 0.004**2) if sd_m > 0.0 else 0.0
    return walls


@pytest.mark.parametrize(
    ("middle_m", "off_m", "seen", "taken"),
    [
        (0.1, 0.03, True, OF_TWO_WALLS),  # half on the back of the shelf, half on the wall beside it
        (0.1, 0.03, False, 1),  # as another robot tells it: that wall may be where no scan of ours looked
        (-0.5, 0.02, True, 0),  # nearer to the wall, but there the shelf hides it
        (1.0, 0.03, True, 1),  # beside the shelf
    ],
)
def test_a_piece_over_the_end_of_a_wall_before_another_is_of_neither(
    middle_m: float, off_m: float, seen: bool, taken: int
) -> None:
    """From afar the back of a shelf and the wall 65 mm behind it are one piece, by which the wall was moved onto it."""
    walls, piece = walls_of(2, 0.003), np.zeros(1, PIECE)
    walls["y"][0], walls["tip"][0] = 0.065, [(-1.0, 0.065), (0.0, 0.065)]
    piece["hits"], piece["x"], piece["y"], piece["ux"], piece["spread"] = 1.0, middle_m, off_m, 1.0, 0.2
    piece["end"], piece["label"], piece["link"] = (-0.4, 0.4), OCCLUSION, -1
    found = associate(walls, 2, piece, Gates(0.01, OFFSET_GATE_M), np.zeros(1), seen)
    assert found.tolist() == [taken]


@pytest.mark.parametrize(
    ("off_m", "label", "known", "taken"),
    [
        (0.05, OCCLUSION, True, True),
        (0.05, NOMINAL, True, False),
        (0.02, NOMINAL, True, True),
        (0.05, NOMINAL, False, False),
    ],
)
def test_the_back_of_a_shelf_is_not_the_wall_behind_it(off_m: float, label: int, known: bool, taken: bool) -> None:
    """A robot that came round to it knew the wall to 24 mm, and was moved by 60."""
    wall, piece = walls_of(1, 0.024 if known else 0.0), np.zeros(1, PIECE)
    piece["hits"], piece["y"], piece["ux"], piece["spread"], piece["end"] = 3.0, off_m, 1.0, 0.2, (-0.4, 0.4)
    piece["label"], piece["link"] = (label, OCCLUSION), -1
    found = associate(wall, 1, piece, Gates(0.01, OFFSET_GATE_M), np.zeros(1))
    assert found.tolist() == [0 if taken else -1]


@pytest.mark.parametrize(
    ("wall_mm", "other_mm", "other_x", "spread", "taken"),
    [
        (40.0, 6.0, 3.5, 0.01, False),
        (40.0, 6.0, 5.5, 0.01, True),  # what is known is too far to tell where the wall is
        (40.0, 40.0, 3.5, 0.01, True),  # the other wall is known no better
        (20.0, 6.0, 3.5, 0.01, True),  # the robot knows where the wall is
        (40.0, 6.0, 3.5, 1.0, True),  # the piece tells its direction
        (40.0, 6.0, 1.0, 0.01, True),  # it is the same wall, mapped twice
    ],
)
def test_a_few_beams_at_an_uncertain_wall_are_of_none_where_a_known_one_goes_by(
    wall_mm: float, other_mm: float, other_x: float, spread: float, taken: bool
) -> None:
    """Beams on the back of a shelf, between the two known ends of a wall, moved a robot by 60 mm."""
    walls, piece = walls_of(2, 1.0), np.zeros(1, PIECE)
    walls["relative"] = [((0.001 * sd) ** 2, 0.0, 0.001**2) for sd in (wall_mm, other_mm)]
    walls["x"][1], walls["y"][1], walls["tip"][1] = other_x, 0.01, [(other_x - 1.0, 0.01), (other_x + 1.0, 0.01)]
    piece["hits"], piece["x"], piece["y"], piece["ux"], piece["spread"] = 2.0, 1.7, 0.05, 1.0, spread
    piece["end"], piece["label"], piece["link"] = (-0.15, 0.15), OCCLUSION, -1
    found = associate(walls, 2, piece, Gates(0.01, OFFSET_GATE_M), np.zeros(1))
    assert found.tolist() == [0 if taken else -1]


@pytest.mark.parametrize("sd_m", [0.01, 0.0])
@pytest.mark.parametrize(
    ("label", "ends_m", "hits_m", "from_m", "taken"),
    [
        (NOMINAL, (-4.0, 0.08), -1.0, 0.0, 1),  # the wall before the corner is mapped 8 cm too long
        (NOMINAL, (-4.0, 0.08), 1.5, 0.0, 1),  # and is what was left when the rest was cut off, where most hits were
        (NOMINAL, (-4.0, 0.0), -1.0, -0.15, 1),  # the piece is prolonged past the corner by a beam
        (NOMINAL, (-4.0, 0.0), -1.0, -3.0, 0),  # it shows more of the other wall
        (FRONTIER, (-4.0, 0.08), -1.0, 0.0, 0),  # where nothing parts them, both are one wall
        (NOMINAL, (0.2, 1.5), 1.0, 0.0, 0),  # there is no corner between the two: a shelf before a wall
    ],
)
def test_of_two_walls_on_a_line_a_piece_is_of_the_one_along_it_up_to_its_corner(
    label: int, ends_m: tuple[float, float], hits_m: float, from_m: float, taken: int, sd_m: float
) -> None:
    """Walls on both sides of a partition became one, as the one took views of the other.

    With an exact pose, what was left before the partition grew over the wall beyond, and both stood on one line.
    """
    walls, piece = walls_of(2, sd_m), np.zeros(1, PIECE)
    walls["tip"], walls["x"] = [[(ends_m[0], 0.0), (ends_m[1], 0.0)], [(0.0, 0.0), (2.0, 0.0)]], (hits_m, 1.0)
    walls["label"][1, 0], walls["y"][1] = label, 0.003
    half = 0.5 * (2.2 - from_m)  # past the other end of the wall, which is open
    piece["hits"], piece["x"], piece["ux"], piece["spread"], piece["end"] = 2.0, 2.2 - half, 1.0, 0.7, (-half, half)
    piece["label"], piece["link"] = FRONTIER, -1
    found = associate(walls, 2, piece, Gates(0.01, OFFSET_GATE_M), np.zeros(1))
    assert found.tolist() == [taken]
