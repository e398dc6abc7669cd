"""Walls that are turned by a few degrees stay two in merged maps."""

import numpy as np
import pytest

from agent.cooperation.merging import HITS_PER_M, SAME_WALL_M
from agent.mapping.association import Gates
from agent.mapping.edges import EDGE, WALL
from agent.mapping.layers import layer_of, merged
from protocol.arrays import Floats, Records
from protocol.wireframe import Label, Wireframe, certain

GATES = Gates(0.01, SAME_WALL_M)


def own_wall(tail: tuple[float, float], head: tuple[float, float]) -> Records:
    """(1,) of EDGE: a wall that own scans have seen well, both its ends open."""
    wall, a, b = np.zeros(1, EDGE), np.array(tail), np.array(head)
    size = float(np.hypot(*(b - a)))
    hits, (ux, uy) = 800.0, (b - a) / size
    wall["alive"], wall["own"], wall["hits"], wall["seen"], wall["due"], wall["link"] = WALL, 1, hits, 60.0, 60.0, -1
    wall["x"], wall["y"] = 0.5 * (a + b)
    wall["ux"], wall["uy"] = ux, uy
    wall["xx"], wall["xy"], wall["yy"] = hits * size**2 / 12 * np.array([ux**2, ux * uy, uy**2])
    wall["tip"], wall["label"] = (a, b), Label.FRONTIER
    return wall


def angles(walls: Records) -> Floats:
    return np.sort(np.degrees(np.arctan2(walls["uy"], walls["ux"])))


def apart(theirs: list[tuple[tuple[float, float], tuple[float, float]]]) -> Wireframe:
    """Walls of a peer that share no corners."""
    return certain(np.array(theirs).reshape(-1, 2), np.arange(2 * len(theirs)).reshape(-1, 2))


def laid(own: Records, theirs: Wireframe) -> Records:
    layer = layer_of(theirs, np.zeros(3), np.zeros(len(theirs.edges), np.bool_), HITS_PER_M)
    out = merged(own, [layer], GATES)
    return out[out["alive"] == WALL]


def test_a_peers_wall_takes_the_next_one_along_to_no_own_wall() -> None:
    """Walls of `made.traced`, 2, that turn by 7 degrees and were one wall of 1.6 m, off by 10 cm at its end."""
    own = own_wall((2.535, -0.413), (2.472, 0.425))
    theirs = apart([((2.604, -0.268), (2.321, 1.136)), ((2.533, -0.367), (2.465, 0.574))])
    assert angles(laid(own, theirs)) == pytest.approx([94.2, 101.4], abs=0.3)


def test_a_wall_that_a_peer_saw_well_is_not_turned_into_the_own_one_beside_it() -> None:
    """Of `made.traced`, 3: turned by 5 degrees, and 8 cm off at its far end."""
    own = own_wall((-2.457, 0.597), (-2.549, -0.35))
    assert len(laid(own, apart([((-2.306, 1.236), (-2.575, -0.167))]))) == 2
