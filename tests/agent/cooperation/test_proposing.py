"""How well the walls of two maps must fit: exactly where odometry is exact; where it errs, maps are bent."""

import math
from dataclasses import replace

import numpy as np
import pytest

from agent.alignment.by_sight import Sighting
from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.communication.receiving import ReceivedMap
from agent.cooperation.peer import PeerLog
from agent.cooperation.proposing import Aligner, off_its_map
from agent.geometry.transform import inverse
from deploy.bench.alignment import exact
from deploy.bench.made import traced
from deploy.sensing import IDEAL_BENCHMARK
from protocol.geometry import apply
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe
from tests.agent.alignment.test_alignment import chain, maze
from tests.agent.mapping.test_layers import scan_at
from tests.agent.mapping.test_particle_filter import ROOM
from world.worldfile import from_document

CORRIDOR = chain([(6.0, 2.0), (0.0, 2.0), (0.0, 0.0), (6.0, 0.0)])
FRAME = np.array([4.0, 1.0, math.pi])  # of the peer that was passed
MET = Encounter((0.5, 0.5, 0.0), (0.5, 0.9, 0.0))


def aligner(*, noisy: bool) -> Aligner:
    spec = RobotSpec.model_validate({"odometry": {"noisy": noisy}})
    return Aligner(AlignmentConfig(), spec, np.random.default_rng(0))


def heard(wireframe: Wireframe) -> PeerLog:
    return PeerLog("r2", map=ReceivedMap(wireframe, 0), encounters=[MET])


def bent(wireframe: Wireframe, by_m: float) -> Wireframe:
    """Both sides of a map lie farther up than its middle."""
    x = wireframe.points[:, 0]
    off = by_m * ((x - x.mean()) / (0.5 * np.ptp(x))) ** 2
    return replace(wireframe, points=wireframe.points + np.column_stack([np.zeros(len(x)), off]))


@pytest.mark.parametrize(("by_m", "noisy", "fits"), [(0.06, True, True), (0.06, False, False), (0.1, True, False)])
def test_maps_may_be_bent_by_more_where_odometry_errs(by_m: float, noisy: bool, fits: bool) -> None:
    """A fifth of the walls lies 3 to 5 cm beside itself; bent by 10 cm, as much lies farther off."""
    own = maze(0)
    said = aligner(noisy=noisy).align(heard(bent(own, by_m)), own)
    assert (said.transform is not None) == fits
    assert fits or said.reason == "inexact"


@pytest.mark.parametrize(
    ("noisy", "spare_nats", "fits"), [(True, 0.0, False), (True, 30.0, True), (False, 30.0, False)]
)
def test_a_bent_map_is_merged_once_enough_else_speaks_for_it(noisy: bool, spare_nats: float, fits: bool) -> None:
    """A right pair that had seen each other 14 times refused one another 25 times, as r1's map was bent by 22 mm."""
    own = maze(0)
    log = heard(bent(own, 0.1))
    assert aligner(noisy=noisy).walls_agree(log, own, np.zeros(3), True, spare_nats) == fits


@pytest.mark.parametrize("seed", range(6))
def test_the_half_turn_of_a_hall_needs_more_than_what_decides(seed: int) -> None:
    """Each of its walls lies centimetres beside itself, as in maps that are bent."""
    world = from_document(traced(seed))
    rings = [[(float(x), float(y)) for x, y in ring] for part in world.free for ring in world.outline(part)]
    own = chain(*[[*ring[:-1], ring[0]] for ring in rings])
    for noisy in (True, False):
        assert not aligner(noisy=noisy).walls_agree(heard(own), own, np.array([0.0, 0.0, math.pi]), True)


def passed(*, alone: bool) -> PeerLog:
    """A peer that drove straight along a corridor, with a disc seen at five places; its map has two true corners."""
    scan = scan_at((1.0, 1.0, 0.0), ROOM)
    places = np.column_stack([np.linspace(-2.0, 0.0, 5), np.zeros(5)])
    discs = apply(FRAME, places)
    log = heard(replace(CORRIDOR, points=apply(inverse(FRAME), CORRIDOR.points)))
    for (x, y), disc in zip(places.tolist(), discs, strict=True):
        log.take_sighting(Sighting((3.0, 1.0, 0.0), (x, y, 0.0), disc[None], scan, alone))
    return log


def test_two_that_pass_each_other_straight_know_their_frames_if_nobody_else_is_heard() -> None:
    found = aligner(noisy=False).align_by_sight(passed(alone=True), CORRIDOR)
    assert found is not None and found[0].spread_m < 0.01 and found[1].transform is not None
    assert np.allclose(found[1].transform, FRAME, atol=0.005)
    assert aligner(noisy=False).walls_agree(passed(alone=True), CORRIDOR, FRAME, True)


def test_where_others_are_heard_a_straight_pass_tells_nothing() -> None:
    assert aligner(noisy=False).align_by_sight(passed(alone=False), CORRIDOR) is None
    assert not aligner(noisy=False).walls_agree(passed(alone=False), CORRIDOR, FRAME, True)


def test_walls_along_a_corridor_do_not_tell_how_far_along_it() -> None:
    sides = chain([(0.0, 0.0), (6.0, 0.0)], [(6.0, 2.0), (0.0, 2.0)])
    log = passed(alone=True)
    log.map = ReceivedMap(replace(sides, points=apply(inverse(FRAME), sides.points)), 0)
    found = aligner(noisy=False).align_by_sight(log, sides)
    assert found is not None and found[1].transform is None


@pytest.mark.parametrize(("world", "seed", "ideal", "most_deg"), [("loop-3", 0, True, 0.1), ("loop-4", 10, False, 0.2)])
def test_robots_in_a_loop_of_like_corners_merge_as_they_pass(
    world: str, seed: int, ideal: bool, most_deg: float
) -> None:
    """Before, they had to meet again round a corner, 40 s later. Where wheels err they look about for 10 s first."""
    token = IDEAL_BENCHMARK.set(ideal)
    run = exact.measure(world, seed, limit_s=26.0)
    IDEAL_BENCHMARK.reset(token)
    pairs = {(merge["robot"], merge["peer"]): merge["at_once"] for merge in run["merges"]}
    assert run["false"] == 0 and {("r1", "r2"), ("r2", "r1")} <= pairs.keys()
    assert all(metres < 0.02 and degrees < most_deg for metres, degrees in pairs.values())


@pytest.mark.parametrize(("reach_m", "off"), [(3.5, True), (25.0, False)])
def test_a_peer_is_off_its_map_by_what_its_lidar_reaches(reach_m: float, off: bool) -> None:
    """A robot in the middle of a hall of 40 m x 30 m was not believed, though its lidar of 25 m saw all the walls."""
    log = heard(chain([(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0), (0.0, 0.0)]))
    log.pose = (20.0, 15.0, 0.0)
    assert off_its_map(log, reach_m) is off
