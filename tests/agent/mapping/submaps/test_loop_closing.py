"""A robot that drives: a torn map is merged anew from submaps, a whole one is left as the filter has it."""

import math

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.mapping.edges import check_records, settle_corner
from agent.mapping.particle_filter import WireframeFilter
from agent.mapping.submaps import loop_closing
from agent.mapping.submaps.loop_closing import LoopClosing
from agent.mapping.submaps.loops import Submap
from agent.mapping.submaps.pose_graph import Edges
from agent.mapping.submaps.segments import SEGMENT
from agent.mapping.submaps.wireframe import records_of
from agent.perception.perceive import perceive
from deploy.bench.rings import laps
from protocol.arrays import Bools, Floats, Records
from protocol.geometry import Pose, apply, compose, pose_of, relative
from protocol.messages import OdometrySpec
from protocol.wireframe import Wireframe
from tests.carried import observations, path_error, ring_corridor
from tests.ideal import EXACT, ideal_spec

SIDE, WIDTH = 20.0, 2.0
WALLS = ring_corridor(SIDE, WIDTH)
SPEC = ideal_spec(odometry=OdometrySpec(noisy=True, wheel_sd=0.0, axle_sd=0.0))


def driven(lost_at: int | None) -> tuple[LoopClosing, WireframeFilter, Floats, Floats, list[tuple[int, Floats]]]:
    """Two laps of a ring; the filter is put 0.8 m aside at one scan.

    The filter's path, the true one, and closings: the tick, and where the path up to there then is.
    """
    way = laps(SIDE, WIDTH, 2.0, step=0.2)
    mind, loops, path, closed = _filter(), LoopClosing(AgentConfig().filter.submaps, SPEC.lidar.view()), [], []
    for seen in observations(WALLS, way, SPEC.lidar, SPEC.odometry, 1):
        told = mind.way(seen.poses())
        scan = perceive(seen.scan(), SPEC, alone=True)
        mind.update(scan, seen.poses())
        if seen.tick == lost_at:
            torn = compose(mind.pose, (0.8, 0.0, 0.0))
            mind.edges["kind"], mind.poses[:] = 0, torn  # all that it knew of the place is gone, too
        if loops.take(seen.tick, scan, pose_of(told[-1]), mind.length_scale, mind.pose, mind.covariance):
            settled = loops.settled()
            mind.replace(records_of(settled.walls), settled.pose, settled.places)
            closed.append((seen.tick, settled.places(np.arange(seen.tick), np.array(path)[:, :2])))
        path.append(mind.pose)
    return loops, mind, np.array(path), way, closed


def _filter() -> WireframeFilter:
    return WireframeFilter(AgentConfig().filter, SPEC, np.random.SeedSequence(0))


def length_of(wireframe: Wireframe) -> float:
    return float(np.hypot(*(wireframe.segments()[:, 2:] - wireframe.segments()[:, :2]).T).sum())


def test_a_map_that_fits_itself_is_left_alone() -> None:
    loops, mind, path, way, closed = driven(None)
    assert loops.submaps.loops >= 5 and not closed
    assert path_error(path, way) < 0.1
    assert length_of(mind.wireframe()) < 1.02 * length_of(Wireframe()) + 1.02 * float(
        np.hypot(*(WALLS[:, 2:] - WALLS[:, :2]).T).sum()
    )


def test_a_torn_map_is_made_whole_by_the_loop_that_shows_it() -> None:
    _, mind, path, way, closed = driven(len(laps(SIDE, WIDTH, 0.4, step=0.2)))
    half = len(way) // 2
    assert closed and closed[0][0] > half
    true = float(np.hypot(*(WALLS[:, 2:] - WALLS[:, :2]).T).sum())
    assert 0.95 * true < length_of(mind.wireframe()) < 1.05 * true
    last, mended = closed[-1]
    assert path_error(path[last:], way[last:]) < 0.15
    torn, again = path_error(path[:last], way[:last]), path_error(mended, way[:last])
    assert torn > 0.3 and again < 0.1


def test_settled_segments_are_records_that_the_filter_can_trust() -> None:
    loops = LoopClosing(AgentConfig().filter.submaps, SPEC.lidar.view())
    start: Pose = (3.0, -2.0, 1.0)
    way, before = laps(SIDE, WIDTH, 0.25, step=0.2), None
    for seen in observations(WALLS, way, SPEC.lidar, EXACT, 1):
        by = relative(before or seen.odometry, seen.odometry)
        before = seen.odometry
        scan = perceive(seen.scan(), SPEC, alone=True)
        loops.take(seen.tick, scan, by, 1.0, compose(start, seen.odometry), np.zeros((3, 3)))
    settled = loops.settled()
    pose = settled.pose
    records = records_of(settled.walls)
    check_records(records)
    mind = _filter()
    mind.glimpses = np.zeros((1, 2))
    mind.replace(records, pose, settled.places)
    assert not len(mind.glimpses)  # of the map before
    wireframe = mind.wireframe()
    wireframe.check()
    true = apply((0.0, 0.0, 0.0), np.array([compose(start, relative(pose_of(way[0]), pose_of(way[-1])))[:2]]))
    assert np.hypot(*(np.array(pose[:2]) - true[0])) < 0.3
    assert length_of(wireframe) > 20.0


def test_a_mind_that_begins_under_way_counts_the_way_there_once() -> None:
    loops = LoopClosing(AgentConfig().filter.submaps, SPEC.lidar.view())
    before: Pose = (0.0, 0.0, 0.0)
    for seen in observations(WALLS, laps(SIDE, WIDTH, 0.25, step=0.2), SPEC.lidar, EXACT, 1)[10:]:
        by, before = relative(before, seen.odometry), seen.odometry
        loops.take(seen.tick, perceive(seen.scan(), SPEC, alone=True), by, 1.0, seen.odometry, np.zeros((3, 3)))
    assert math.dist(loops.settled().pose[:2], before[:2]) < 0.3


@pytest.mark.parametrize(
    ("pair", "second", "torn"),
    [
        ((1, 3), (1.0, 0.05, 0.0), True),
        ((1, 3), (-1.0, 0.4, 0.0), False),
        ((1, 2), (1.0, 0.05, 0.0), False),
        ((0, 3), (1.0, 0.05, 0.0), False),
    ],
)
def test_only_loops_of_two_submaps_that_agree_show_that_a_map_is_torn(
    monkeypatch: pytest.MonkeyPatch, pair: tuple[int, int], second: Pose, torn: bool
) -> None:
    """Two of one submap are one witness: its walls may lie turned in its frame. pair: submaps of the second loop."""
    loops = LoopClosing(AgentConfig().filter.submaps, SPEC.lidar.view())
    loops._frames = [(0.0, 0.0, 0.0), (0.0, 5.0, 0.0), (3.0, 5.0, 1.0), (3.0, 5.0, 1.0)]
    off = [(1.0, 0.0, 0.0), second]  # of the later submap, as two loops have it
    ends, information = np.array(((0, 2), pair)), np.tile(np.eye(3), (2, 1, 1))
    measured = [relative(loops._frames[a], compose(off[k], loops._frames[2])) for k, a in enumerate(ends[:, 0])]
    graph = Edges(ends, np.array(measured), information, np.ones(2, np.bool_))
    monkeypatch.setattr(loops.submaps, "graph", lambda: graph)
    monkeypatch.setattr(loops, "_speaks_against", lambda k: True)
    assert loops._torn(1) is False  # the second alone
    loops._against = []
    assert loops._torn(0) is torn


@pytest.mark.parametrize(
    ("shown", "known_m", "speaks"), [((1, 2), 0.5, False), ((1,), 0.5, True), ((), 0.5, True), ((), 0.03, False)]
)
def test_a_loop_among_like_columns_says_nothing_where_the_filter_has_recognised_the_place_or_knows_better(
    monkeypatch: pytest.MonkeyPatch, shown: tuple[int, ...], known_m: float, speaks: bool
) -> None:
    """The loop has the last submap at the first one, the filter 4 m from there: at the second and third, half each."""
    loops = LoopClosing(AgentConfig().filter.submaps, SPEC.lidar.view())
    loops._frames = [
        (0.0, 0.0, 0.0),
        (4.0, 0.0, 0.0),
        (4.0, 0.0, 0.0),
        (8.0, 0.0, 0.0),
        (8.0, 4.0, 0.0),
        (4.0, 0.0, 0.0),
    ]
    loops._sds = [np.array((known_m, known_m, 0.0))] * len(loops._frames)
    loops.submaps.finished = [
        Submap(np.zeros(0, SEGMENT), np.zeros((10, 4)), np.zeros((1, 3)), 4.0, math.pi) for _ in loops._frames
    ]
    places = loops.submaps.finished
    graph = Edges(np.array([(0, 5)]), np.zeros((1, 3)), 100.0 * np.eye(3)[None], np.ones(1, np.bool_))
    monkeypatch.setattr(loops.submaps, "graph", lambda: graph)

    def on_walls(walls: Records, samples: Floats, pose: Floats) -> Bools:
        k = next(k for k in range(len(places)) if places[k].walls is walls)
        halves = {0: (True, True), **{one: (one == 1, one == 2) for one in shown}}
        return np.repeat(halves.get(k, (False, False)), 5) & (not pose.any())

    monkeypatch.setattr(loop_closing, "tiles_of", lambda walls: walls)
    monkeypatch.setattr(loop_closing, "on_walls", on_walls)
    assert loops._speaks_against(0) is speaks


@pytest.mark.parametrize(("sd_deg", "speaks"), [(1.5, False), (0.3, True)])
def test_a_loop_says_nothing_of_the_map_where_the_heading_at_one_moment_was_as_unsure(
    monkeypatch: pytest.MonkeyPatch, sd_deg: float, speaks: bool
) -> None:
    """The loop turns the last submap by 4.4 degrees from where the filter had the robot when it began."""
    loops = LoopClosing(AgentConfig().filter.submaps, SPEC.lidar.view())
    loops._frames = [(0.0, 0.0, 0.0), (0.0, 0.0, math.radians(4.4))]
    loops._sds = [np.array((0.01, 0.01, math.radians(sd))) for sd in (0.0, sd_deg)]
    loops.submaps.finished = [
        Submap(np.zeros(0, SEGMENT), np.zeros((10, 4)), np.zeros((1, 3)), 4.0, math.pi) for _ in loops._frames
    ]
    graph = Edges(np.array([(0, 1)]), np.zeros((1, 3)), 1e4 * np.eye(3)[None], np.ones(1, np.bool_))
    monkeypatch.setattr(loops.submaps, "graph", lambda: graph)
    monkeypatch.setattr(loop_closing, "on_walls", lambda tiles, samples, pose: np.full(len(samples), not pose.any()))
    assert loops._speaks_against(0) is speaks


@pytest.mark.parametrize(("known_m", "speaks"), [(0.3, False), (0.06, True)])
def test_a_loop_says_nothing_where_the_filter_knows_how_far_off_it_may_be(
    monkeypatch: pytest.MonkeyPatch, known_m: float, speaks: bool
) -> None:
    """The loop lies in a corridor: it has the place 0.4 m aside, and knows nothing along it."""
    loops = LoopClosing(AgentConfig().filter.submaps, SPEC.lidar.view())
    loops._frames = [(0.0, 0.0, 0.0), (0.1, 0.4, 0.0)]
    loops._sds = [np.array((known_m, 0.0, 0.0)), np.zeros(3)]
    loops.submaps.finished = [
        Submap(np.zeros(0, SEGMENT), np.zeros((10, 4)), np.zeros((1, 3)), 4.0, math.pi) for _ in loops._frames
    ]
    information = np.diag((1e-3, 1.0 / 0.05**2, 1e4))
    graph = Edges(np.array([(0, 1)]), np.zeros((1, 3)), information[None], np.ones(1, np.bool_))
    monkeypatch.setattr(loops.submaps, "graph", lambda: graph)
    monkeypatch.setattr(loop_closing, "on_walls", lambda tiles, samples, pose: np.full(len(samples), not pose.any()))
    assert loops._speaks_against(0) is speaks


def test_walls_whose_lines_hardly_cross_share_no_corner_in_the_filter() -> None:
    """Two parts of one wall end at one place: where their lines meet is anywhere, as they are turned by noise."""
    segments = np.zeros(2, SEGMENT)
    segments["x"], segments["ux"], segments["high"], segments["seen"] = (-1.0, 1.05), 1.0, 1.0, 20
    segments["low"], segments["hits"], segments["xx"] = -1.0, 100.0, 30.0
    segments["uy"][1] = 1e-5
    segments["y"][1] = 0.01
    records = records_of(segments)
    assert (records["link"] < 0).all()
    records["link"] = ((-1, 1), (0, -1))  # as for walls that turn after they were linked
    before = records["tip"].copy()
    settle_corner(records, 0)
    assert (records["tip"] == before).all()
