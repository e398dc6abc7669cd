"""A robot that comes late takes the map of a whole building at its first contact; a strewn one of that size waits."""

import numpy as np
import pytest

from agent.communication.receiving import ReceivedMap
from agent.cooperation.peer import PeerLog
from agent.cooperation.weight import COMPARED_WALLS, is_too_large, weigh
from protocol.wireframe import Wireframe
from world.worldfile import load


def whole(world: str) -> Wireframe:
    """The true map of a world, as a robot has it that has seen all."""
    rings = [ring[:-1] for ring in load(world).rings]
    sizes = np.array([len(ring) for ring in rings])
    row = np.arange(sizes.sum())
    after = row + 1
    after[sizes.cumsum() - 1] -= sizes
    n = len(row)
    edges = np.column_stack((row, after)).astype(np.int32)
    return Wireframe(np.vstack(rings), np.zeros(n, np.uint8), edges, np.ones(n, np.float32), np.ones(n, np.bool_))


def strewn(count: int) -> Wireframe:
    """So many walls, each by itself."""
    points = np.random.default_rng(0).uniform(0.0, 15.0, (2 * count, 2))
    edges = np.arange(2 * count, dtype=np.int32).reshape(-1, 2)
    ones = np.ones(count, np.float32), np.ones(count, np.bool_)
    return Wireframe(points, np.full(2 * count, 2, np.uint8), edges, *ones)


def a_look_around() -> Wireframe:
    """What a robot has mapped after its first seconds."""
    return strewn(8)


def test_only_corners_that_stick_out_and_ends_are_bends() -> None:
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    ring = np.array([(0, 1), (1, 2), (2, 3), (3, 0)], np.int32)
    labels, likelihood, own = np.zeros(4, np.uint8), np.ones(4, np.float32), np.ones(4, np.bool_)
    assert weigh(Wireframe(square, labels, ring, likelihood, own)).bends == 0  # a room, from inside
    assert weigh(Wireframe(square, labels, ring[:, ::-1].copy(), likelihood, own)).bends == 4  # a pillar
    assert weigh(strewn(3)) == (3, 12)
    to_and_fro = np.array([(0, 1), (1, 2), (2, 3)], np.int32)  # a way around the turn of such a wall bends twice, too
    there_and_back = np.array([(0.0, 0.0), (5.0, 0.0), (0.0, 0.0), (5.0, 0.0)])
    assert weigh(Wireframe(there_and_back, labels, to_and_fro, likelihood[:3], own[:3])) == (3, 8)
    assert weigh(Wireframe()) == (0, 0)


@pytest.mark.parametrize("world", ["office", "maze-15", "apartment", "generated-20x20-0"])
def test_a_latecomer_takes_the_map_of_a_building_but_not_as_many_strewn_walls(world: str) -> None:
    building, own = whole(world), a_look_around()
    assert not is_too_large(weigh(building), weigh(own))
    assert is_too_large(weigh(strewn(max(100, len(building.edges)))), weigh(own))


def test_a_map_that_would_take_long_to_compare_waits_whatever_its_bends_are() -> None:
    flat = Wireframe(
        np.column_stack((np.arange(COMPARED_WALLS + 10.0), np.zeros(COMPARED_WALLS + 10))),
        np.zeros(COMPARED_WALLS + 10, np.uint8),
        np.column_stack((np.arange(COMPARED_WALLS + 9), np.arange(1, COMPARED_WALLS + 10))).astype(np.int32),
        np.ones(COMPARED_WALLS + 9, np.float32),
        np.ones(COMPARED_WALLS + 9, np.bool_),
    )
    assert weigh(flat).bends == 4 and is_too_large(weigh(flat), weigh(a_look_around()))


def test_a_map_of_many_waits_until_another_merged_peer_tells_one_of_its_weight() -> None:
    log, own, crowd = PeerLog("x"), a_look_around(), strewn(120)
    log.offer_map(ReceivedMap(crowd, 1))
    assert log.take_map([weigh(own)]) and log.map is None
    assert not log.take_map([weigh(own), weigh(strewn(60))]) and log.map is not None and log.waiting is None
