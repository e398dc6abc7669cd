"""What views told of a slot beside a corner is of that corner alone, whatever becomes of the wall's record."""

import numpy as np
import pytest

from agent.corner_scan import FRONTIER, OCCLUSION, PIECE
from agent.mapping.association import OFFSET_GATE_M, Gates
from agent.mapping.edges import EDGE, WALL, cut_out, remove
from agent.mapping.scan_merge import _unite
from agent.mapping.slots import show_slot, slot_before
from agent.mapping.tentative import take_piece
from protocol.arrays import Records

SLOT_M = 0.06


def walls_of(*spans_m: tuple[float, float]) -> Records:
    """Walls along the x axis, with a slot beside the head of the first, and room for one more."""
    edges = np.zeros(len(spans_m) + 1, EDGE)
    for wall, (tail, head) in zip(edges, spans_m, strict=False):
        wall["kind"], wall["hits"], wall["x"], wall["ux"], wall["xx"] = WALL, 50.0, 0.5 * (tail + head), 1.0, 10.0
        wall["tip"], wall["label"], wall["link"] = [(tail, 0.0), (head, 0.0)], (FRONTIER, OCCLUSION), -1
    show_slot(edges[0], 1, SLOT_M, 0.0)
    assert slot_before(edges[0], 1) == pytest.approx(SLOT_M)
    return edges


def test_a_new_wall_in_the_record_of_one_that_is_gone_has_no_slot() -> None:
    """Its true corner was refused until 17 views had spoken against the slot of a wall that it had never met."""
    edges, piece = walls_of((-1.0, 1.0)), np.zeros(1, PIECE)
    remove(edges, 0)
    piece["hits"], piece["x"], piece["uy"], piece["spread"], piece["end"], piece["link"] = 30.0, 7.0, 1.0, 5.0, 1.0, -1
    wall, _ = take_piece(edges, 1, piece[0], Gates(0.01, OFFSET_GATE_M))
    assert wall == 0
    assert slot_before(edges[0], 1) == 0.0


def test_of_two_walls_that_become_one_the_slot_at_the_end_that_is_left_counts() -> None:
    edges = walls_of((0.0, 2.0), (2.1, 5.0))
    _unite(edges, 0, 1)
    assert edges["tip"][0, 1].tolist() == [5.0, 0.0]
    assert slot_before(edges[0], 1) == 0.0


def test_where_a_wall_is_cut_no_slot_is_known() -> None:
    edges = walls_of((0.0, 4.0))
    new, _ = cut_out(edges, 1, 0, 1.0, 2.0)
    assert slot_before(edges[0], 1) == 0.0
    assert slot_before(edges[new], 1) == pytest.approx(SLOT_M)
