"""Walls that are turned by a few degrees meet at corners, in own maps and in merged ones."""

import math

import numpy as np
import pytest

from agent.cooperation.merging import HITS_PER_M, SAME_WALL_M
from agent.kernels import kernel
from agent.mapping.association import Gates
from agent.mapping.blunt_corners import close_blunt_corners
from agent.mapping.chords import hide_chords
from agent.mapping.edges import EDGE, WALL
from agent.mapping.layers import layer_of, merged
from agent.mapping.scan_merge import same_line
from protocol.arrays import Floats, Ints, Records
from protocol.wireframe import Label, Wireframe, certain
from tests.agent.mapping.test_particle_filter import Walk, farthest, ring, round_tour
from tests.ideal import ideal_lidar

GATES = Gates(0.01, SAME_WALL_M)


def bowed(turn_deg: float, wall_m: float, walls: int) -> list[tuple[float, float, float, float]]:
    """A room whose floor is so many walls, each turned against the one before."""
    at, corners = np.zeros(2), [(0.0, 0.0)]
    for k in range(walls):
        angle = math.radians(turn_deg) * (k - 0.5 * (walls - 1))
        at = at + wall_m * np.array([math.cos(angle), math.sin(angle)])
        corners.append((float(at[0]), float(at[1])))
    return ring(*corners, (corners[-1][0], 2.5), (0.0, 2.5))


@pytest.mark.parametrize(("turn_deg", "wall_m", "walls"), [(8.0, 1.3, 3), (12.0, 1.0, 4), (18.0, 0.8, 4)])
@pytest.mark.parametrize("seed", range(2))
def test_walls_that_turn_by_a_few_degrees_share_corners(turn_deg: float, wall_m: float, walls: int, seed: int) -> None:
    room = bowed(turn_deg, wall_m, walls)
    walk = Walk(room, ideal_lidar(), seed=seed)
    right = wall_m * (walls - 0.5)
    for pose in 2 * round_tour((0.5, 0.5), (right, 0.5), (right, 2.0), (0.5, 2.0)):
        walk.see(pose)
    found = walk.filter.wireframe()
    found.check()
    assert (found.labels == Label.NOMINAL).all() and len(found.points) == len(found.edges) == walls + 3
    assert farthest(found, room) < 0.02


def own_wall(tail: tuple[float, float], head: tuple[float, float]) -> Records:
    """(1,) of EDGE: a wall that own scans have seen well, both its ends open."""
    wall, a, b = np.zeros(1, EDGE), np.array(tail), np.array(head)
    size = float(np.hypot(*(b - a)))
    hits, (ux, uy) = 800.0, (b - a) / size
    wall["kind"], wall["own"], wall["hits"], wall["seen"], wall["due"], wall["link"] = WALL, 1, hits, 60.0, 60.0, -1
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
    return out[out["kind"] == WALL]


def test_a_peers_wall_takes_the_next_one_along_to_no_own_wall() -> None:
    """Walls of `made.traced`, 2, that turn by 7 degrees and were one wall of 1.6 m, off by 10 cm at its end."""
    own = own_wall((2.535, -0.413), (2.472, 0.425))
    theirs = apart([((2.604, -0.268), (2.321, 1.136)), ((2.533, -0.367), (2.465, 0.574))])
    assert angles(laid(own, theirs)) == pytest.approx([94.2, 101.4], abs=0.3)


def test_a_wall_that_a_peer_saw_well_is_not_turned_into_the_own_one_beside_it() -> None:
    """Of `made.traced`, 3: turned by 5 degrees, and 8 cm off at its far end."""
    own = own_wall((-2.457, 0.597), (-2.549, -0.35))
    assert len(laid(own, apart([((-2.306, 1.236), (-2.575, -0.167))]))) == 2


def test_a_stub_ends_where_a_peer_saw_a_blunt_corner() -> None:
    """The corner is none of the filter's, so what ends there must not be left as short as the own stub."""
    c, s = math.cos(math.radians(10.0)), math.sin(math.radians(10.0))
    theirs = certain(np.array([(0.0, 0.0), (3.0, 0.0), (3.0 + 2.0 * c, 2.0 * s)]), np.array([(0, 1), (1, 2)]))
    out = laid(own_wall((0.0, 0.0), (1.0, 0.0)), theirs)
    assert len(out) == 2 and out["tip"][0] == pytest.approx(np.array([(0.0, 0.0), (3.0, 0.0)]), abs=0.02)


@kernel
def published(edges: Records) -> Ints:
    """(n,) head links of walls that are all shown, -2 for chords."""
    shown = np.ones(len(edges), np.int64)
    close_blunt_corners(edges, shown, 0.01)
    hide_chords(edges, shown)
    return np.where(shown < 0, -2, edges["link"][:, 1])


def bent(turn_deg: float, past_m: float, before_m: float = 1.5) -> Records:
    """Walls of 1.5 m on either side of a corner at the origin, each that much longer: a hand's breadth behind it."""
    way = np.array([math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))])
    return np.concatenate((own_wall((-before_m, 0.0), (past_m, 0.0)), own_wall(tuple(-past_m * way), tuple(1.5 * way))))


@pytest.mark.parametrize(
    ("turn_deg", "past_m", "linked"), [(2.0, 1.0, 1), (14.0, 0.4, 1), (24.0, 0.08, 1), (24.0, 0.5, -1)]
)
def test_walls_that_cross_end_where_they_do(turn_deg: float, past_m: float, linked: int) -> None:
    """In `made.traced` each fourth map had walls that crossed, up to 3.4 cm deep."""
    edges = bent(turn_deg, past_m)
    assert published(edges).tolist() == [linked, -1]
    ends = np.array([edges["tip"][0, 1], edges["tip"][1, 0]])
    assert linked < 0 or ends == pytest.approx(np.zeros((2, 2)), abs=1e-6)


def test_two_walls_along_one_bend_end_where_they_cross_in_the_order_that_keeps_more() -> None:
    """`made.traced(3)`, seed 0: two lines along two bends of 5 degrees crossed, one with half of its length."""
    edges = np.concatenate((own_wall((-0.5, 0.0), (0.5, 0.0)), own_wall((-0.6, -0.042), (0.9, 0.063))))
    assert published(edges).tolist() == [1, -1]
    assert edges["tip"][:, :, 0] == pytest.approx(np.array([(-0.5, 0.0), (0.0, 0.9)]), abs=1e-6)


def test_of_two_walls_that_it_crosses_a_wall_ends_at_the_first() -> None:
    edges = np.concatenate((bent(5.0, 0.8), own_wall((0.307, -0.034), (2.0, 0.264))))
    assert published(edges).tolist() == [1, 2, -1]


def test_a_wall_across_a_corner_is_a_chord_and_not_shown() -> None:
    corner = bent(50.0, 0.0)
    chord = own_wall((-0.15, -0.02), (0.1, 0.1))
    edges = np.concatenate((corner, chord))
    edges["link"][0, 1], edges["link"][1, 0] = 1, 0
    assert published(edges).tolist() == [1, -1, -2]


@pytest.mark.parametrize(("tail", "shown"), [((-1.0, -0.05), -2), ((-1.0, -0.12), -1), ((-2.0, -0.05), -1)])
def test_a_wall_that_crosses_another_close_beside_it_is_that_wall(tail: tuple[float, float], shown: int) -> None:
    walls = own_wall((-1.5, 0.0), (1.5, 0.0)), own_wall(tail, (1.0, 0.06)), own_wall((9.0, 9.0), (9.0, 8.0))
    edges = np.concatenate(walls)
    edges["link"][0], edges["link"][2] = 2, 0  # it has corners, so it does not end where they cross
    assert published(edges)[1] == shown


@kernel
def are_one(walls: Records) -> bool:
    return bool(same_line(walls[0], walls[1], GATES))


def test_where_the_pose_errs_a_wall_that_was_mapped_twice_comes_together() -> None:
    """Three robots in `hall` with wheels that err, seed 2: .936 of the walls were in the worst map, now .994."""
    turned = math.radians(7.0)
    walls = np.concatenate(
        (own_wall((0.0, 0.0), (1.0, 0.0)), own_wall((0.1, 0.0), (math.cos(turned), math.sin(turned))))
    )
    assert not are_one(walls)
    walls["relative"] = (1e-4, 0.0, 1e-4)
    assert are_one(walls)
