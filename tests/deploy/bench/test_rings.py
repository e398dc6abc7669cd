"""A robot that is carried around a ring, and the judge of its loops."""

import math

import numpy as np
import pytest
import shapely

from agent.mapping.config import SubmapConfig
from agent.mapping.submaps.chain import Submaps
from deploy.bench.rings import FALSE_M, WIDTH_M, Mapper, carried, false_loops, laps, measure_ring, ring_world
from deploy.sensing import IDEAL, REAL
from protocol.geometry import Pose, pose_of, relative
from protocol.messages import Observation, RobotSpec
from protocol.wireframe import Wireframe


@pytest.mark.parametrize("niches", [True, False])
def test_laps_stay_in_the_corridor_and_end_where_they_began(niches: bool) -> None:
    world, way = ring_world(10.0, niches), laps(10.0, WIDTH_M, 2.0, step=0.1, turns=8)
    region = world.regions(0.105)[world.region_index(1.0, 1.0, 0.105)]
    assert shapely.contains_xy(region, way[:, 0], way[:, 1]).all()
    assert np.hypot(*np.diff(way[:, :2], axis=0).T).max() < 0.11
    assert math.dist(way[0, :2], way[-1, :2]) < 1e-9 and len(way) == 2 * 4 * (80 + 8)


def test_headings_go_on_from_lap_to_lap() -> None:
    """They began anew, so each lap had a revolution that was taken while turning back by 2 pi."""
    way = laps(10.0, WIDTH_M, 2.0, step=0.1, turns=8)
    assert np.abs(np.diff(way[:, 2])).max() < math.pi / 8


def test_the_map_of_a_ring_is_judged_in_its_own_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was judged in that of the submaps, which is turned by what the filter has put right."""

    class Carried(Mapper):
        """One whose map is true, and whose submaps are bent."""

        def step(self, observation: Observation) -> None:
            self.loops.submaps.poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.5, 0.0), (1.0, 1.5, 0.0)])

        def wireframe(self) -> Wireframe:
            ends = ring_world(3.0 + WIDTH_M, False).segments - 0.5 * WIDTH_M  # as seen from the start
            numbers = np.arange(2 * len(ends))
            return Wireframe(ends.reshape(-1, 2), np.zeros(len(numbers), np.uint8), numbers.reshape(-1, 2))

    monkeypatch.setattr("deploy.bench.rings.Mapper", Carried)
    figures = measure_ring(3.0, 0.25, False, 1.0, 0)
    assert figures["wall_recall"] == 1.0 and figures["path_rms_m"] > 0.1


def test_one_who_is_carried_sees_the_walls_and_is_told_its_way() -> None:
    spec, world = RobotSpec.model_validate(IDEAL), ring_world(10.0, True)
    way = laps(10.0, WIDTH_M, 0.25, step=0.0044, turns=80)
    seen = list(carried(world, way, spec, 0))
    assert [observation.tick for observation, _ in seen] == list(range((len(way) - 1) // 10))
    observation, true = seen[50]
    assert true == pose_of(way[510])
    assert observation.odometry == pytest.approx(relative(pose_of(way[0]), true))
    assert observation.scan()[90] == pytest.approx(WIDTH_M / 2, abs=0.05)  # the inner wall, on the left
    drifted = [observation for observation, _ in carried(world, way, RobotSpec.model_validate(REAL), 0)]
    assert drifted[-1].odometry != seen[-1][0].odometry and len(drifted[-1].poses()) == spec.poses_per_scan


def test_a_loop_to_another_place_is_false_and_one_that_errs_a_little_is_not() -> None:
    begun: list[Pose] = [(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (5.0, 0.2, 0.1)]
    sure, along = np.eye(3) * 0.1**-2, np.diag((0.1**-2, 30.0**-2, 0.1**-2))
    for measured, information, loop, wrong in (
        ((5.0, 0.2 + 0.9 * FALSE_M, 0.1), sure, True, 0),
        ((5.0, 0.2 + 1.1 * FALSE_M, 0.1), sure, True, 1),
        ((5.0, 0.2 + 1.1 * FALSE_M, 0.1), along, True, 0),  # it leaves open how far along a corridor
        ((5.0, 0.2, 0.1 + math.pi / 2), along, True, 1),
        ((9.0, 0.2, 0.1), sure, False, 0),  # what the way measured is no loop
    ):
        submaps = Submaps(SubmapConfig())
        submaps._add_edge(0, 2, np.array(measured), information, loop)
        assert false_loops(submaps, begun) == wrong
