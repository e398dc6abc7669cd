"""The chain of submaps: loops close, the error is spread, no wall stands twice, and what is alike is no loop."""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest

from agent.config import AgentConfig
from agent.corner_scan import PIECE, CornerScan, Sight
from agent.mapping.submaps import chain, tracking
from agent.mapping.submaps.loops import Found, Submap, due, find
from agent.mapping.submaps.matching import tiles_of
from agent.mapping.submaps.merging import united
from agent.mapping.submaps.pose_graph import Edges, covariances_from, relaxed
from agent.mapping.submaps.segments import SEGMENT, moved, samples_along
from agent.mapping.submaps.wireframe import records_of, wireframe_of
from agent.passenger import Passenger
from deploy.bench.rings import laps
from protocol.arrays import Floats, Records
from protocol.geometry import apply, compose, relative, wrapped
from protocol.grid_map import MAX_TOLD
from protocol.messages import LidarSpec, Observation
from tests.carried import DRIFT, HALF_TURN, Wall, observations, outline, path_error, ring_corridor
from tests.ideal import ideal_spec

SIDE, WIDTH = 18.0, 2.2


@cache
def carried(seed: int, count: float = 2.0) -> tuple[Passenger, Floats, Floats]:
    """A mind after some laps of a ring, the true way, and the one by odometry."""
    way = laps(SIDE, WIDTH, count)
    seen = observations(ring_corridor(SIDE, WIDTH), way, HALF_TURN, DRIFT, seed)
    mind = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig())
    for observation in seen:
        mind.step(observation)
    mind.finish()
    return mind, way, np.array([observation.odometry for observation in seen])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_ring_closes_and_the_error_is_spread_over_the_way(seed: int) -> None:
    mind, way, odometry = carried(seed)
    assert path_error(odometry, way) > 0.5
    assert mind.submaps.loops >= 10
    assert path_error(mind.path(), way) < 0.08


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_wall_stands_twice(seed: int) -> None:
    mind, _, _ = carried(seed)
    wireframe = mind.wireframe()
    wireframe.check()
    walls = ring_corridor(SIDE, WIDTH)
    true = float(np.hypot(*(walls[:, 2:] - walls[:, :2]).T).sum())
    found = float(np.hypot(*(wireframe.segments()[:, 2:] - wireframe.segments()[:, :2]).T).sum())
    assert 0.9 * true < found < 1.02 * true


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_sparse_beams_along_a_corridor_hold_the_heading(seed: int) -> None:
    way, lidar = laps(SIDE, WIDTH, 1.5, step=1.0), HALF_TURN.model_copy(update={"beams": 60})
    mind = Passenger(ideal_spec(lidar=lidar), AgentConfig())
    for observation in observations(ring_corridor(SIDE, WIDTH), way, lidar, DRIFT, seed):
        mind.step(observation)
    mind.finish()
    assert path_error(mind.path(), way) < 0.09


def test_a_lap_that_tracking_bent_by_25_degrees_is_closed() -> None:
    way = laps(SIDE, WIDTH, 1.5)
    mind = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig())
    submaps, begun, bend = mind.submaps, 1, math.radians(2.1)
    for observation in observations(ring_corridor(SIDE, WIDTH), way, HALF_TURN, DRIFT, 1):
        mind.step(observation)
        if len(submaps.poses) > begun and not submaps.loops:
            submaps._measured[-1][2] += bend
            submaps.poses[-1, 2] += bend
        begun = len(submaps.poses)
    mind.finish()
    assert path_error(mind.path(), way) < 0.08


def test_no_scan_waits_for_more_than_one_comparison_of_submaps(monkeypatch: pytest.MonkeyPatch) -> None:
    compared, mind, most = [0], Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig()), 0

    def counted(*given: Any) -> Found | None:
        compared[0] += 1
        return find(*given)

    monkeypatch.setattr(chain, "find", counted)
    for observation in observations(ring_corridor(SIDE, WIDTH), laps(SIDE, WIDTH, 2.0), HALF_TURN, DRIFT, 0):
        before = compared[0]
        mind.step(observation)
        most = max(most, compared[0] - before)
    assert compared[0] > 10 and most == 1
    assert mind.submaps.loops >= 5


def test_without_a_second_lap_there_is_no_loop_to_find() -> None:
    mind, _, _ = carried(0, 0.75)
    assert mind.submaps.loops == 0


def test_the_way_is_as_long_as_the_scale_that_was_learned_later_tells() -> None:
    """Where nothing is to be seen the wheels' metres count; that they tell too many shows only later."""
    submaps = chain.Submaps(AgentConfig().filter.submaps)
    nothing = CornerScan(
        np.zeros(0, PIECE),
        Sight(np.zeros((0, 3)), np.zeros((0, 3)), 3.5, 0.01, 0.0),
        np.zeros((0, 2)),
        np.zeros((0, 3)),
    )
    for scale, steps in ((1.0, 60), (0.98, 10)):
        for _ in range(steps):
            submaps.take(nothing, (0.25 * scale, 0.0, 0.0), scale)
    graph = submaps.graph()
    assert graph.measured[:2, 0] == pytest.approx(0.98 * submaps.poses[1:3, 0] / (1, 2))
    submaps._add_edge(0, 2, np.array((10.0, 0.0, 0.0)), np.eye(3), True)
    assert submaps.graph().measured[-1, 0] == 10.0  # where a loop leads is told by walls


HALL = outline((0, 0), (10, 0), (10, 10), (0, 10))


def test_the_way_is_as_sure_as_walls_held_it() -> None:
    """Between walls ahead and aside it is known, and along a corridor without ends only as odometry tells it."""
    xs = np.arange(-3.0, 3.0, 0.5)
    way = np.column_stack((xs, np.zeros(len(xs)), np.zeros(len(xs))))
    room, corridor = (outline((-x, -y), (x, -y), (x, y), (-x, y)) for x, y in ((6.0, 3.0), (60.0, 1.0)))
    sds = []
    for walls in (room, corridor):
        mind = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig())
        for observation in observations(np.array(walls), way, HALF_TURN, DRIFT, 0):
            mind.step(observation)
        sds.append(np.sqrt(np.diag(np.linalg.inv(mind.submaps.graph().information[0]))))
    assert (sds[0] < (0.05, 0.05, math.radians(0.5))).all()
    assert sds[1][0] > 1.4 * sds[0][0] and sds[1][1] < sds[0][0]


def test_many_scans_from_one_place_leave_the_way_no_less_sure() -> None:
    """A robot that stood for 3000 scans in a corridor knew the way to there to 0.4 m and 6 degrees."""
    corridor = np.array(outline((-60.0, -1.0), (60.0, -1.0), (60.0, 1.0), (-60.0, 1.0)))
    coarse, fine = np.arange(-3.0, 3.0, 0.2), np.arange(-3.0, 3.0, 0.05)
    sds = []
    for xs in (coarse, fine, np.insert(coarse, 15, np.full(100, coarse[15]))):
        mind, way = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig()), np.zeros((len(xs), 3))
        way[:, 0] = xs
        for observation in observations(corridor, way, HALF_TURN, DRIFT, 0):
            mind.step(observation)
        sds.append(np.sqrt(np.diag(np.linalg.inv(mind.submaps.graph().information[0]))))
    assert sds[1] == pytest.approx(sds[0], rel=0.2) and sds[2] == pytest.approx(sds[0], rel=0.2)


def test_a_lidar_that_looks_aside_need_not_show_what_is_on_the_other_side() -> None:
    """As one of all around, it should have shown it, and a quarter of its loops was lost."""
    lidar = HALF_TURN.model_copy(update={"mount_yaw_deg": -90.0})
    mind, way = Passenger(ideal_spec(lidar=lidar), AgentConfig()), np.zeros((30, 3))
    way[:, 0] = np.arange(30) * 0.2
    for observation in observations(np.array(outline((-9, -2), (9, -2), (9, 2), (-9, 2))), way, lidar, DRIFT, 0):
        mind.step(observation)
    place, aside = mind.submaps.finished[0], np.array([(1.0, 1.0, -1.0, 0.0), (1.0, -1.0, 1.0, 0.0)])
    assert due(place, tiles_of(place.walls), aside, np.zeros(3))[0].tolist() == [False, True]


def filled(walls: list[Wall], boxes: int, seed: int, clear: Callable[[float, float], bool]) -> Floats:
    """(n, 4) walls in a hall of 10 m, and those of boxes in it whose middles are clear of a way."""
    rng, walls, empty = np.random.default_rng(seed), list(walls), len(walls)
    while len(walls) < empty + 4 * boxes:
        x, y = rng.uniform(1, 9, 2).tolist()
        turn, half = rng.uniform(0, 2 * math.pi), rng.uniform(0.2, 0.5)
        corners = turn - 0.5 * math.pi * np.arange(4)
        if clear(x, y):
            walls += outline(*((x + half * math.cos(a), y + half * math.sin(a)) for a in corners.tolist()))
    return np.array(walls)


def cluttered(boxes: int) -> Floats:
    """(n, 4) walls of a hall of 10 m, and of boxes in it that keep clear of a circle of 2.5 m about its middle."""
    return filled(HALL, boxes, 1, lambda x, y: not 1.8 < math.hypot(x - 5, y - 5) < 3.2)


def two_rooms(seed: int) -> Floats:
    """(n, 4) walls of a hall of 10 m with a doorway in the wall across its middle, and boxes beside a way through."""
    south, north = ((4.95, 0), (4.95, 4.4), (5.05, 4.4), (5.05, 0)), ((4.95, 5.6), (4.95, 10), (5.05, 10), (5.05, 5.6))
    walls = HALL + outline(*south) + outline(*north)
    return filled(walls, 10, seed, lambda x, y: abs(y - 5) > 1.2 and abs(x - 5) > 0.8)


def mapped(seen: Sequence[Observation], scan: int, slip_deg: float, lidar: LidarSpec = HALF_TURN) -> Floats:
    """(n, 3) path by observations, where wheels slip before one of the scans."""
    mind, at = Passenger(ideal_spec(lidar=lidar), AgentConfig()), seen[scan].odometry
    slipped = compose(at, (0.0, 0.0, math.radians(slip_deg)))
    for k, observation in enumerate(seen):
        odometry = observation.odometry if k < scan else compose(slipped, relative(at, observation.odometry))
        mind.step(observation.model_copy(update={"odometry": odometry}))
    return mind.path()


@pytest.mark.parametrize(("scan", "slip_deg"), [(6, 24.0), (7, -24.0), (12, -20.0)])
def test_wheels_that_slip_in_a_turn_do_not_bend_the_way(scan: int, slip_deg: float) -> None:
    turns = np.arange(0, 7.5, 0.35)
    way = np.column_stack((5 + 2.5 * np.cos(turns), 5 + 2.5 * np.sin(turns), turns + math.pi / 2))
    assert path_error(mapped(observations(cluttered(12), way, HALF_TURN, DRIFT, 2), scan, slip_deg), way) < 0.02


@pytest.mark.parametrize(
    ("seed", "looks_aside_deg", "scan", "slip_deg"),
    [(3, 80.0, 2, 20.0), (4, 75.0, 3, -24.0), (4, 80.0, 8, 24.0), (5, 75.0, 4, 24.0), (7, 75.0, 4, 24.0)],
)
def test_a_slip_where_few_samples_lie_on_known_walls_turns_nothing(
    seed: int, looks_aside_deg: float, scan: int, slip_deg: float
) -> None:
    xs = np.arange(1.5, 8.6, 0.7)
    way = np.column_stack((xs, np.full(len(xs), 5.0), np.radians(looks_aside_deg) * (-1.0) ** np.arange(len(xs))))
    path = mapped(observations(two_rooms(seed), way, HALF_TURN, DRIFT, seed), scan, slip_deg)
    assert np.abs(wrapped(path[:, 2] - (way[:, 2] - way[0, 2]))).max() < math.radians(1.0)


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
def test_walls_leave_nothing_of_what_odometry_errs_at_a_doorway(seed: int) -> None:
    """With a lidar of 2.5 m only the door's jambs and some boxes are in view of both sides."""
    lidar, xs = HALF_TURN.model_copy(update={"range_max_m": 2.5}), np.arange(1.5, 8.6, 1.0)
    way = np.column_stack((xs, np.full(len(xs), 5.0), np.zeros(len(xs))))
    seen = observations(two_rooms(seed), way, lidar, DRIFT, seed)
    left, right = (mapped(seen, 3, turn, lidar)[-1, 2] for turn in (6.0, -6.0))
    assert abs(wrapped(left - right)) < math.radians(0.1)


def test_a_robot_that_faces_back_in_its_submap_is_as_near_to_the_odometry_as_one_that_faces_ahead() -> None:
    """A pose of 179 degrees by odometry, and one of -179 by walls."""
    off = np.array([[0.0, 0.0, math.radians(2.0)], [0.0, 0.0, math.radians(2.0 - 360.0)]])
    ahead, back = tracking.against(off, [np.zeros(3)], np.diag((1.0, 1.0, 1000.0))).tolist()
    assert back == pytest.approx(ahead) and 0.0 < ahead < 1.0


@pytest.mark.parametrize(
    ("seed", "nods_deg", "scan", "off_deg"),
    [
        *((1, 25.0, 7, -20.0), (1, 50.0, 5, -20.0), (1, 50.0, 7, 20.0), (2, 50.0, 3, 20.0), (3, 50.0, 3, -20.0)),
        *((2, 60.0, 3, 12.0), (7, 60.0, 7, 20.0)),
    ],
)
def test_a_scan_with_a_wrong_stamp_bends_nothing_after_it(
    seed: int, nods_deg: float, scan: int, off_deg: float
) -> None:
    """The odometry of one scan in a turn is that of another moment, and the next one's is right again."""
    turns = np.arange(0, 6.5, 0.7)
    nods = math.radians(nods_deg) * (-1.0) ** np.arange(len(turns))
    way = np.column_stack((5 + 2.5 * np.cos(turns), 5 + 2.5 * np.sin(turns), turns + math.pi / 2 + nods))
    walls = filled(HALL, 30, seed, lambda x, y: not 1.8 < math.hypot(x - 5, y - 5) < 3.2)
    seen = observations(walls, way, HALF_TURN, DRIFT, seed)
    wrong = compose(seen[scan].odometry, (0.0, 0.0, math.radians(off_deg)))
    seen[scan] = seen[scan].model_copy(update={"odometry": wrong})
    mind = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig())
    for observation in seen:
        mind.step(observation)
    assert np.abs(wrapped(mind.path()[:, 2] - (way[:, 2] - way[0, 2]))).max() < math.radians(1.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_walls_that_a_turn_brings_into_view_are_not_put_onto_known_ones(seed: int) -> None:
    turns = np.arange(0, 7.5, 0.7)
    nods = math.radians(25.0) * (-1.0) ** np.arange(len(turns))
    way = np.column_stack((5 + 2.5 * np.cos(turns), 5 + 2.5 * np.sin(turns), turns + math.pi / 2 + nods))
    mind = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig())
    for observation in observations(cluttered(12), way, HALF_TURN, DRIFT, seed):
        mind.step(observation)
    assert path_error(mind.path(), way) < 0.006


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_was_put_before_a_wall_since_hardly_pulls_at_the_pose(seed: int) -> None:
    xs = np.arange(2.0, 6.0, 0.3)
    way = np.column_stack((xs, np.full(len(xs), 4.0), np.zeros(len(xs))))
    shelf = outline((9.85, 2), (9.85, 6), (9.99, 6), (9.99, 2))
    empty, furnished = (observations(np.array(w), way, HALF_TURN, DRIFT, seed) for w in (HALL, HALL + shelf))
    mind = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig())
    for observation in empty[:7] + furnished[7:8]:
        mind.step(observation)
    assert abs(mind.path()[7, 0] - (xs[7] - xs[0])) < 0.02


def test_the_same_scans_make_the_same_bytes() -> None:
    way = laps(SIDE, WIDTH, 1.25, step=0.5)
    paths = []
    for _ in range(2):
        mind = Passenger(ideal_spec(lidar=HALF_TURN), AgentConfig())
        for observation in observations(ring_corridor(SIDE, WIDTH), way, HALF_TURN, DRIFT, 3):
            mind.step(observation)
        mind.finish()
        paths.append(mind.path().tobytes() + mind.wireframe().points.tobytes())
    assert paths[0] == paths[1]


def segments(*walls: tuple[float, float, float, float]) -> Records:
    """Segments that three scans have seen."""
    out = np.zeros(len(walls), SEGMENT)
    ends = np.array(walls)
    size = np.hypot(*(ends[:, 2:] - ends[:, :2]).T)
    out["x"], out["y"] = (0.5 * (ends[:, :2] + ends[:, 2:])).T
    out["ux"], out["uy"] = ((ends[:, 2:] - ends[:, :2]) / size[:, None]).T
    out["low"], out["high"], out["hits"], out["seen"] = -0.5 * size, 0.5 * size, size, 3.0
    out["xx"], out["yy"] = size**3 / 12 * out["ux"] ** 2, size**3 / 12 * out["uy"] ** 2
    out["xy"] = size**3 / 12 * out["ux"] * out["uy"]
    return out


def place(walls: Records) -> Submap:
    return Submap(walls, samples_along(walls), np.array(((1.0, 1.0, 0.0), (4.0, 1.0, 0.0))), 12.0, math.pi)


ROOM = segments((0, 0, 6, 0), (6, 0, 6, 2), (6, 2, 3, 2), (3, 2, 3, 3), (3, 3, 0, 3), (0, 3, 0, 0))
CORRIDOR, STRETCH = segments((-5, 0, 10, 0), (10, 2, -5, 2)), segments((0, 0, 5, 0), (5, 2, 0, 2))
PRIOR, WINDOW = np.diag((1.0, 1.0, 10.0)), np.array((3.0, 3.0, 0.3))


def test_a_room_seen_again_is_found_metres_off() -> None:
    off = np.array((0.9, -0.7, 0.15))
    found = find(place(ROOM), place(moved(ROOM, off)), np.zeros(3), WINDOW, PRIOR)
    assert found is not None and found.accepted
    assert np.abs(found.pose - off).max() < 0.03


def bays(first: int, last: int) -> Submap:
    """A corridor with a pier on both sides every 1.4 m, as robots see it that can look on for two of them."""
    walls = [(0.0, 0.0, 1.0, 0.0), (1.0, 0.0, 1.0, 0.4), (1.0, 0.4, 1.4, 0.4), (1.4, 0.4, 1.4, 0.0)]
    one = np.array([*walls, *((x2, 3.0 - y2, x1, 3.0 - y1) for x1, y1, x2, y2 in walls)])
    ends = np.concatenate([np.add(one, (1.4 * k, 0.0, 1.4 * k, 0.0)) for k in range(first, last)])
    all_of = segments(*map(tuple, ends))
    views = np.array([(1.4 * k + 0.7, 1.5, 0.0) for k in range(first + 1, last - 1)])
    return Submap(all_of, samples_along(all_of), views, 3.0, math.pi)


@pytest.mark.parametrize(("window_m", "off_m"), [(1.5, 1.4), (1.05, 0.0)])
def test_no_loop_is_farther_off_than_the_way_can_err(window_m: float, off_m: float) -> None:
    """One pier on, both show more of the same walls. In `symmetric` a loop was taken that eight deviations excluded."""
    window, prior = np.array((window_m, window_m, 0.3)), np.diag((25.0, 25.0, 400.0))
    found = find(bays(1, 5), bays(0, 4), np.zeros(3), window, prior)
    assert found is not None and found.accepted
    assert found.pose == pytest.approx((-off_m, 0.0, 0.0), abs=0.05)


def test_a_corridor_without_ends_is_no_place() -> None:
    found = find(place(STRETCH), place(CORRIDOR), np.zeros(3), WINDOW, PRIOR)
    assert found is not None and not found.accepted and found.rival > 0.85


def test_a_room_of_another_shape_is_no_loop() -> None:
    other = segments((0, 0, 2, 0), (2, 0, 2, 5), (2, 5, 0, 5), (0, 5, 0, 0))
    found = find(place(ROOM), place(other), np.zeros(3), WINDOW, PRIOR)
    assert found is None or not found.accepted


def test_a_corridor_around_a_hall_is_not_the_inside_of_its_corner() -> None:
    """The corridor's outer wall lies on the hall's, and the wall between both in the middle of what the hall's show."""
    walls = segments((0, 0, 20, 0), (0, 15, 0, 0))
    views = np.array(((10.0, 5.0, math.radians(-150.0)), (5.0, 6.0, math.radians(-120.0))))
    hall = Submap(walls, samples_along(walls), views, 12.0, math.pi / 2)
    walls = segments((0, 0, 14, 0), (0, 10, 0, 0), (14, 3, 3, 3), (3, 3, 3, 10))
    views = np.array(((1.5, 6.0, math.radians(-90.0)), (1.5, 1.5, math.radians(-45.0)), (5.0, 1.5, 0.0)))
    corridor = Submap(walls, samples_along(walls), views, 12.0, math.pi / 2)
    for later, earlier in ((corridor, hall), (hall, corridor)):
        found = find(later, earlier, np.array((0.1, -0.1, 0.0)), np.array((0.4, 0.4, 0.1)), PRIOR)
        assert found is not None and np.abs(found.pose).max() < 0.01 and not found.accepted


def test_a_graph_spreads_the_error_and_resists_one_wrong_loop() -> None:
    angles = np.linspace(0, 2 * math.pi, 12, endpoint=False)
    true = np.column_stack((10 * np.cos(angles), 10 * np.sin(angles), angles))
    start = true[0].copy()

    def between(a: int, b: int) -> Floats:
        return np.array(relative(tuple(true[a]), tuple(true[b])))

    ends = [(k, k + 1) for k in range(11)] + [(0, 11), (1, 11), (0, 10), (3, 9)]
    measured = [between(a, b) + (np.array((0.05, 0.0, 0.01)) if b == a + 1 else 0.0) for a, b in ends]
    measured[-1] = measured[-1] + np.array((3.0, 2.0, 0.5))  # wrong
    way, loop = np.diag((1 / 0.06**2, 1 / 0.06**2, 1 / 0.02**2)), np.diag((1 / 0.03**2, 1 / 0.03**2, 1 / 0.01**2))
    edges = Edges(
        np.array(ends), np.array(measured), np.array([way] * 11 + [loop] * 4), np.array([False] * 11 + [True] * 4)
    )
    poses = [tuple(start)]
    for k in range(11):
        poses.append(compose(poses[-1], tuple(measured[k])))
    before = np.array(poses)
    after = relaxed(before, edges)
    assert np.hypot(*(before - true)[:, :2].T).max() > 1.0
    assert np.hypot(*(after - true)[:, :2].T).max() < 0.25
    assert np.array_equal(after[0], before[0])
    known = covariances_from(0, after, edges)
    assert np.trace(known[11]) < np.trace(known[5]), "a node with a loop is surer than one far along the way"


@pytest.mark.parametrize("node", [0, 1])
def test_how_an_edge_errs_in_heading_moves_its_far_end_whichever_way_it_is_walked(node: int) -> None:
    """Seen from its second end, the first one was as unsure as if the edge had measured where it lies itself."""
    sd, length = np.array((0.05, 0.05, math.radians(1.0))), 5.0
    edges = Edges(np.array([(0, 1)]), np.array([(length, 0.0, 0.0)]), np.diag(sd**-2.0)[None], np.zeros(1, np.bool_))
    across = covariances_from(node, np.array(((0.0, 0.0, 0.0), (length, 0.0, 0.0))), edges)[1 - node, 1, 1]
    assert across == pytest.approx(sd[1] ** 2 + (0.0 if node == 0 else length * sd[2]) ** 2)


def test_segments_of_several_maps_are_united_once() -> None:
    turned = moved(ROOM, np.array((0.02, -0.02, 0.01)))
    walls = united([ROOM, turned, ROOM])
    assert len(walls) == len(ROOM)
    assert (walls["seen"] == 9.0).all()


def test_a_wireframe_of_segments_has_corners_where_ends_meet() -> None:
    wireframe = wireframe_of(ROOM, 0.0)
    wireframe.check()
    assert len(wireframe.points) == len(wireframe.edges) == 6
    assert (wireframe.labels == 0).all()


def test_a_wireframe_leaves_out_the_short_and_what_one_look_showed() -> None:
    walls = segments((0, 0, 6, 0), (1, 1, 1.1, 1), (2, 1, 4, 1))
    walls["seen"][2] = 1.0
    assert np.allclose(apply(np.zeros(3), wireframe_of(walls, 0.0).points), [[0, 0], [6, 0]])


def test_only_what_is_told_is_without_the_shortest_walls_of_a_large_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of an office had lost 122 of its walls, silently."""
    n = MAX_TOLD // 2 + 30
    lengths = 0.2 + 1e-4 * np.arange(n)
    mind, walls = Passenger(ideal_spec(), AgentConfig()), segments(*((0, y, x, y) for y, x in enumerate(lengths)))
    monkeypatch.setattr(mind.submaps, "walls", lambda *_: walls)
    mind._look_at_own()
    assert len(mind.drawn().edges) == len(mind.wireframe().edges) == n
    told = mind.own.segments()
    assert len(mind.own.points) == MAX_TOLD and (told[:, 2] - told[:, 0]).min() == pytest.approx(lengths[30])
    assert len(records_of(walls)) == MAX_TOLD // 2
