"""A wall that its sender has cut, to tell what it saw itself from what others told it, is one wall in a layer."""

import numpy as np
import pytest

from agent.mapping.layers import layer_of
from agent.mapping.uncut import uncut
from protocol.wireframe import Label, Wireframe

N, OC, F = Label.NOMINAL, Label.OCCLUSION, Label.FRONTIER
Wall = tuple[float, float, Label, Label, bool]


def row(*walls: Wall, off: float = 0.0) -> Wireframe:
    """Walls along the x axis, each from x to x with its labels, seen by the sender or not; every second one aside."""
    points = [(x, off * (k % 2)) for k, wall in enumerate(walls) for x in wall[:2]]
    labels = [label for wall in walls for label in wall[2:4]]
    edges = np.arange(2 * len(walls), dtype=np.int32).reshape(-1, 2)
    own = np.array([wall[4] for wall in walls])
    return Wireframe(np.array(points), np.array(labels, np.uint8), edges, np.ones(len(walls), np.float32), own)


def whole(map_: Wireframe) -> list[tuple[float, float]]:
    edges, _ = uncut(map_.points, map_.labels, map_.edges.astype(np.int64), map_.own)
    return [(a, b) for a, b in map_.points[edges, 0].tolist()]


def test_a_cut_wall_is_whole_in_the_layer_and_its_first_hand_part_alone_is_not() -> None:
    cut = row((0.0, 2.0, N, F, False), (2.01, 3.0, F, F, True), (3.0, 5.0, F, OC, False), off=0.01)
    layer = layer_of(cut, np.zeros(3), np.zeros(3, np.bool_), 3.0)
    assert len(layer.pieces) == 1
    assert layer.pieces["end"][0] == pytest.approx([-2.5, 2.5]) and layer.pieces["label"][0].tolist() == [OC, OC]
    first_hand = layer_of(cut, np.zeros(3), ~cut.own, 3.0)
    assert first_hand.pieces["end"].tolist() == [pytest.approx([-0.495, 0.495])]


def test_an_own_wall_beside_the_heard_one_that_took_it_in_is_no_second_wall() -> None:
    assert whole(row((0.0, 4.0, N, N, False), (2.0, 4.0, F, OC, True), off=0.006)) == [(0.0, 4.0)]
    assert whole(row((2.0, 4.02, F, OC, True), (0.0, 4.0, N, N, False), off=0.006)) == [(0.0, 4.0)]


def test_of_two_starts_in_one_place_the_corner_is_taken_too() -> None:
    assert whole(row((0.0, 4.0, N, N, False), (0.0, 2.0, OC, F, True), off=0.006)) == [(0.0, 4.0)]
    assert whole(row((-0.02, 2.0, OC, F, True), (0.0, 4.0, N, N, False), off=0.006)) == [(0.0, 4.0)]
    assert whole(row((0.0, 2.0, N, F, True), (-0.02, 4.0, OC, N, False), off=0.006)) == [(0.0, 4.0)]


@pytest.mark.parametrize(("gap_m", "parts"), [(0.045, 1), (0.055, 2)])
def test_parts_end_within_5_cm_of_each_other(gap_m: float, parts: int) -> None:
    assert len(whole(row((0.0, 2.0, N, F, False), (2.0 + gap_m, 3.0, F, N, True)))) == parts
    assert len(whole(row((0.0, 1.0, N, F, True), (1.0 + gap_m, 3.0, F, N, False)))) == parts


def test_a_heard_wall_joins_the_own_ones_on_both_of_its_sides() -> None:
    assert whole(row((0.0, 1.0, N, F, True), (1.0, 2.0, F, F, False), (2.0, 3.0, F, N, True))) == [(0.0, 3.0)]


@pytest.mark.parametrize(
    "walls",
    [
        row((0.0, 2.0, N, F, False), (2.1, 3.0, F, N, True)),  # a gap
        row((0.0, 2.0, N, F, False), (2.0, 3.0, F, N, True), off=0.05),  # another line
        row((0.0, 2.0, N, N, False), (2.0, 3.0, F, N, True)),  # a corner ends it
        row((0.0, 2.0, N, F, True), (2.0, 3.0, F, N, True)),  # the sender saw both, and has not cut them
        row((0.0, 2.0, N, F, False), (3.0, 2.0, N, F, True)),  # the other face
    ],
)
def test_what_is_no_cut_stays_apart(walls: Wireframe) -> None:
    assert len(whole(walls)) == 2
