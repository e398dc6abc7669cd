"""Ends of walls: what is seen against one must lie near to it."""

import numpy as np
import pytest

from agent.corner_scan import FRONTIER, OCCLUSION, PIECE
from agent.mapping.edges import EDGE, WALL, set_tip, tip_at
from agent.mapping.ends import see_end
from agent.mapping.tentative import become_wall


@pytest.mark.parametrize(("seen_m", "end_m"), [(5.0, 45.0), (44.0, 44.0)])
def test_false_ends_along_a_long_wall_do_not_cut_it_and_its_own_end_may_move(seen_m: float, end_m: float) -> None:
    """In a ring of 60 m views that ended by mistake added up, and walls of 45 m were cut down to what was in sight."""
    edges = np.zeros(1, EDGE)
    edges["alive"], edges["ux"], edges["link"], edges["label"] = WALL, 1.0, -1, OCCLUSION
    set_tip(edges[0], 1, 45.0)
    for _ in range(6):
        see_end(edges, 0, 1, OCCLUSION, seen_m, 0.0, 0.0, 1.0)
    assert tip_at(edges[0], 1) == pytest.approx(end_m)


def test_views_make_an_end_surer_that_the_joint_estimate_holds_and_do_not_move_it() -> None:
    """A robot that is 4 cm off along a column took the column's ends along, and was as far off for good."""
    edges = np.zeros(1, EDGE)
    edges["alive"], edges["ux"], edges["link"], edges["label"], edges["slack"] = WALL, 1.0, -1, OCCLUSION, 0.04
    edges["held"] = 1
    set_tip(edges[0], 1, 0.4)
    see_end(edges, 0, 1, OCCLUSION, 0.42, 0.04, 0.0, 1.0)
    see_end(edges, 0, 1, FRONTIER, 0.43, 0.0, 0.0, 1.0)
    assert tip_at(edges[0], 1) == pytest.approx(0.41) and edges["slack"][0, 1] == pytest.approx(0.02)


@pytest.mark.parametrize(("hits", "label"), [(3.0, OCCLUSION), (0.3, FRONTIER)])
def test_a_wall_has_no_end_where_few_noisy_beams_show_one(hits: float, label: int) -> None:
    """In the middle of a long wall every third such end is none."""
    edges, pieces = np.zeros(1, EDGE), np.zeros(1, PIECE)
    pieces["hits"], pieces["end"], pieces["label"], pieces["slack"] = hits, (-0.2, 0.2), OCCLUSION, 0.05
    edges["ux"] = 1.0
    become_wall(edges[0], pieces[0], own=True)
    assert edges["label"][0].tolist() == [label, label]
