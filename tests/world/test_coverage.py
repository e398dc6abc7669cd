"""Visible wall as the independent scorer defines it, and what beams cover of it."""

from types import ModuleType

import numpy as np
import pytest
from shapely.geometry import Point

from protocol.messages import LidarSpec
from tests.conftest import SHARED
from world import worldfile
from world.coverage import Coverage, visible_wall
from world.lidar.lidar import Lidar
from world.worldfile import World

RADIUS, REACH = 0.105, 3.5


def layouts() -> list[str]:
    return worldfile.bundled() + sorted(str(path) for path in (SHARED / "worlds").glob("*.yaml"))


@pytest.mark.parametrize("name", layouts())
def test_visible_wall_is_the_scorers(scorer: ModuleType, name: str) -> None:
    world = worldfile.load(name)
    start = world.spawns[0]
    truth = scorer.truths(world.document, {"r1": tuple(start)}, RADIUS, REACH)["r1"]
    regions = world.regions(RADIUS)
    home = next(i for i, region in enumerate(regions) if region.covers(Point(start[:2])))
    wall = visible_wall(world, home, RADIUS, REACH)
    middles = (wall.ends[:, :2] + wall.ends[:, 2:])[wall.visible] / 2
    assert wall.lengths[wall.visible].sum() == pytest.approx(truth.lengths.sum(), abs=1e-6)
    assert len(middles) == len(truth.points)
    ours, theirs = (points[np.lexsort(points.T.round(6))] for points in (middles, truth.points))
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def look(world: World, coverage: Coverage, poses: np.ndarray, robots: np.ndarray, t: float) -> None:  # type: ignore[type-arg]
    lidar = Lidar(world.segments, LidarSpec(beams=2000))
    coverage.update(t, round(5 * t), robots, lidar.rays(poses), *lidar.trace(poses))


def test_a_look_covers_what_is_in_view_and_all_looks_cover_all() -> None:
    world = worldfile.load("symmetric")
    starts = world.starts(2, RADIUS, np.random.default_rng(0))
    coverage = Coverage(world, starts, RADIUS, REACH)
    look(world, coverage, starts, np.arange(2), 0.0)
    # both rooms look alike, and hold about an eighth of the wall each
    assert coverage.own[0] == pytest.approx(coverage.own[1], abs=1e-3)
    assert 0.08 < coverage.own[0] < 0.16
    assert coverage.team == pytest.approx(coverage.own.sum(), abs=1e-9)  # they share nothing yet
    assert coverage.team_reached == {}
    spots = np.random.default_rng(1).uniform((0, 0, 0), (16, 10, 6), (1500, 3))
    spots = spots[[world.region_of(x, y, RADIUS) == world.region_of(2, 2, RADIUS) for x, y, _ in spots]]
    for i, spot in enumerate(spots):
        look(world, coverage, spot[None], np.array([0]), i * 0.2)
    assert coverage.own[0] > 0.999
    assert coverage.team == pytest.approx(coverage.own[0], abs=1e-3)
    assert coverage.reached[0][0.9] < coverage.reached[0][0.99]
    assert coverage.reached[1] == {}
    assert coverage.team_reached[0.9] <= coverage.reached[0][0.9]


def test_the_same_look_twice_adds_nothing() -> None:
    world = worldfile.load("maze-15")
    starts = world.starts(2, RADIUS, np.random.default_rng(0))
    coverage = Coverage(world, starts, RADIUS, REACH)
    look(world, coverage, starts, np.arange(2), 0.0)
    own, team = coverage.own.copy(), coverage.team
    look(world, coverage, starts, np.arange(2), 0.2)
    assert np.array_equal(coverage.own, own) and coverage.team == team


def test_robots_behind_walls_from_each_other_have_their_own_visible_wall() -> None:
    boxes = [[0, 0, 0, 9, 0.2], [0, 4, 0, 9, 0.2], [-4.4, 2, 0, 0.2, 4], [4.4, 2, 0, 0.2, 4], [1, 2, 0, 0.2, 4]]
    world = worldfile.from_document({"boxes": boxes, "spawns": [[-2, 2, 0], [3, 2, 0]]})
    coverage = Coverage(world, world.spawns, RADIUS, 10.0)
    lidar = Lidar(world.segments, LidarSpec(beams=2000, range_max_m=10))
    coverage.update(0.0, 0, np.arange(2), lidar.rays(world.spawns), *lidar.trace(world.spawns))
    assert coverage.own == pytest.approx([1.0, 1.0])
    assert coverage.team == pytest.approx(1.0)
    assert coverage.overlap == pytest.approx(0.0)  # it was 1, as of two that saw the same wall


def test_a_merged_map_covers_what_its_sender_had_covered_then_and_undoing_takes_it_back() -> None:
    world = worldfile.load("symmetric")
    starts = world.starts(3, RADIUS, np.random.default_rng(0))
    coverage = Coverage(world, starts, RADIUS, REACH)
    look(world, coverage, starts, np.arange(3), 0.0)
    before = coverage.own.copy()
    look(world, coverage, np.array([[8.0, 5.0, 0.0]]), np.array([1]), 2.0)  # the second robot in the corridor
    look(world, coverage, starts[:1], np.array([0]), 2.2)
    assert coverage.covered[1] == coverage.own[1] > before[1]

    def covered_by(merged: dict[int, int], robot: int = 0) -> float:
        coverage.merge(12, robot, merged)
        look(world, coverage, starts[:1], np.array([0]), 2.4)
        return float(coverage.covered[robot])

    early, late = covered_by({1: 5}), covered_by({1: 10})
    assert early == pytest.approx(coverage.own[0] + before[1], abs=0.02)
    assert late == pytest.approx(early + coverage.own[1] - before[1], abs=0.02)
    assert coverage.own[0] == before[0] and coverage.team < late + coverage.own[2]
    through_a_third = covered_by({0: 12}, robot=2)  # who has it from the second
    assert through_a_third == pytest.approx(coverage.own[2] + late, abs=0.02)
    assert covered_by({1: 10, 2: 11}) > late
    assert covered_by({2: 3}) == pytest.approx(coverage.own[0] + coverage.own[2], abs=0.02)
    assert covered_by({}) == pytest.approx(coverage.own[0])


def test_undoing_a_merge_leaves_what_others_told_where_it_was() -> None:
    """It counted from then on, and a third robot lost what it had merged before."""
    world = worldfile.load("symmetric")
    starts = world.starts(4, RADIUS, np.random.default_rng(0))
    coverage = Coverage(world, starts, RADIUS, REACH)
    look(world, coverage, starts[:3], np.arange(3), 0.0)
    coverage.merge(5, 0, {1: 5})
    coverage.merge(10, 0, {1: 5, 2: 5})
    coverage.merge(20, 3, {0: 15, 2: 5})  # the first robot's map, with both in it
    coverage.merge(25, 0, {1: 5})
    coverage.merge(30, 3, {0: 15})
    coverage.judge(6.0)
    assert coverage.covered[0] > coverage.own[0] + 0.05
    assert coverage.covered[3] == coverage.covered[0]
