"""Paths around known walls."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.exploration import sweep as sweeping
from agent.exploration.config import DrivingConfig
from agent.exploration.frontiers import open_ends
from agent.exploration.path import still_clear
from agent.exploration.planning import Roads, hurdles_of
from agent.exploration.sweep import LEAST_SAMPLES, MOST_AWAY_M, MOST_SLIVERS, Sweep, Viewpoints, free_face
from agent.geometry.clearance import distance_to_walls, distances_to_walls, keeps_clear
from protocol.arrays import Floats
from protocol.geometry import apply
from protocol.messages import RobotSpec
from protocol.walls import neighbours
from protocol.wireframe import Label, Wireframe
from tests.ideal import ideal_lidar

ROOMY_M = RobotSpec().radius_m + DrivingConfig().path_air_m
NOWHERE = np.zeros((0, 2))
TIGHT_M = RobotSpec().radius_m + DrivingConfig().tight_path_air_m


def chain(*lines: list[tuple[float, float]], labels: Label = Label.NOMINAL) -> Wireframe:
    """A wireframe of polylines, free space on their left; one that ends where it begins is a ring."""
    points: list[tuple[float, float]] = []
    edges = []
    for line in lines:
        ring = line[0] == line[-1]
        first = len(points)
        points += line[:-1] if ring else line
        n = len(points) - first
        edges += [(first + k, first + (k + 1) % n) for k in range(n if ring else n - 1)]
    m = len(edges)
    return Wireframe(
        np.array(points, float).reshape(-1, 2),
        np.full(len(points), labels, np.uint8),
        np.array(edges, np.int32).reshape(m, 2),
        np.ones(m, np.float32),
        np.ones(m, np.bool_),
    )


def room(width: float, height: float) -> list[tuple[float, float]]:
    return [(0, 0), (width, 0), (width, height), (0, height), (0, 0)]


def two_rooms(door: float) -> Wireframe:
    """Rooms of 3 m x 3 m side by side, a wall 0.1 m thick between them, a door in its middle."""
    low, high = 1.5 - door / 2, 1.5 + door / 2
    outer = [(0, 0), (2.95, 0), (2.95, low), (3.05, low), (3.05, 0), (6, 0), (6, 3), (3.05, 3), (3.05, high)]
    return chain([*outer, (2.95, high), (2.95, 3), (0, 3), (0, 0)])


def go(roads: Roads, x: float, y: float) -> tuple[float, np.ndarray] | None:
    found = roads.nearest(np.array([[x, y]]), np.zeros(1))
    return None if found is None else (found.cost, found.path)


coordinate = st.floats(-3, 3, allow_nan=False, width=32)
point = st.tuples(coordinate, coordinate)


@settings(max_examples=200, deadline=None)
@given(point, point, st.lists(st.tuples(point, point), min_size=1, max_size=4), st.floats(0.01, 1.0))
def test_clearance_is_that_of_a_geometry_library(a, b, walls, clearance):
    array = np.array([[*p, *q] for p, q in walls])
    lines = shapely.multilinestrings([shapely.linestrings(wall) for wall in walls])
    true = shapely.distance(shapely.linestrings([a, b]), lines)
    if abs(true - clearance) > 1e-6:
        assert keeps_clear(*a, *b, array, clearance) == (true > clearance)
    assert distance_to_walls(*a, array) == pytest.approx(shapely.distance(shapely.points(a), lines), abs=1e-6)


@pytest.mark.parametrize("door", [0.5, 0.6, 0.9])
def test_a_door_is_passed_with_clearance(door):
    wireframe = two_rooms(door)
    cost, path = go(Roads(wireframe, np.array((1.0, 0.5)), ROOMY_M), 5.0, 0.5)
    line = shapely.linestrings(path)
    walls = shapely.multilinestrings(list(shapely.linestrings(wireframe.segments().reshape(-1, 2, 2))))
    assert shapely.distance(line, walls) >= ROOMY_M - 1e-9
    assert shapely.length(line) == pytest.approx(cost)
    around = 2 * math.hypot(1.95, 1.0) + 0.1  # through the middle of the door
    assert 4.0 < cost < around


def test_a_door_too_narrow_for_comfort_is_passed_tightly_and_one_for_the_robot_not_at_all():
    start = np.array((1.0, 0.5))
    assert go(Roads(two_rooms(0.3), start, ROOMY_M), 5.0, 0.5) is None
    assert go(Roads(two_rooms(0.3), start, TIGHT_M), 5.0, 0.5) is not None
    assert go(Roads(two_rooms(0.2), start, TIGHT_M), 5.0, 0.5) is None


def test_paths_are_the_shortest_there_are():
    """Against Dijkstra on a fine lattice, which is at most 9 % too long, in a room with three pillars."""
    boxes = [
        [(x, y), (x, y + 0.6), (x + 0.8, y + 0.6), (x + 0.8, y), (x, y)] for x, y in ((1, 1), (2.6, 1.4), (1.2, 2.6))
    ]
    wireframe = chain(room(5, 4), *boxes)
    start, goal = np.array((0.5, 0.5)), np.array((4.4, 3.4))
    cost, _ = go(Roads(wireframe, start, ROOMY_M), *goal)
    step = 0.05
    n = (100, 80)
    lattice = np.stack(np.meshgrid(np.arange(n[0]) * step, np.arange(n[1]) * step, indexing="ij"), -1)
    free = distances_to_walls(lattice.reshape(-1, 2), wireframe.segments()).reshape(n) >= ROOMY_M
    import heapq

    best = np.full(n, np.inf)
    queue = [(0.0, 10, 10)]
    while queue:
        d, i, j = heapq.heappop(queue)
        if d >= best[i, j]:
            continue
        best[i, j] = d
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                k, m = i + di, j + dj
                if (di or dj) and 0 <= k < n[0] and 0 <= m < n[1] and free[k, m]:
                    heapq.heappush(queue, (d + step * math.hypot(di, dj), k, m))
    assert cost <= best[88, 68] + 0.02
    assert cost >= best[88, 68] / 1.09


def test_a_start_too_near_to_a_wall_gets_away_from_it():
    start, pillar = np.array((0.11, 2.0)), [(0.6, 1.5), (0.6, 2.9), (2.0, 2.9), (2.0, 1.5), (0.6, 1.5)]
    wireframe = chain(room(4, 4), pillar)
    _, path = go(Roads(wireframe, start, ROOMY_M), 3.0, 2.0)
    walls = shapely.multilinestrings(list(shapely.linestrings(wireframe.segments().reshape(-1, 2, 2))))
    assert (path[0] == start).all() and len(path) > 2
    assert shapely.distance(shapely.linestrings(path[:2]), walls) >= 0.98 * 0.11 - 1e-9
    assert shapely.distance(shapely.linestrings(path[1:]), walls) >= ROOMY_M - 1e-9


def test_beyond_a_frontier_end_the_way_costs_a_toll():
    """The wall between start and goal was seen up to its frontier end; a detour the other way round is dearer."""
    wall = chain([(0.0, -1.0), (0.0, 1.0)], labels=Label.FRONTIER)
    roads = Roads(wall, np.array((-1.0, 0.8)), ROOMY_M)
    straight = math.hypot(1, 0.5) * 2
    cost, _ = go(roads, 1.0, 0.8)
    assert cost > straight + 0.5
    assert len(hurdles_of(open_ends(wall))) == 2
    nominal = Roads(chain([(0.0, -1.0), (0.0, 1.0)]), np.array((-1.0, 0.8)), ROOMY_M)
    assert go(nominal, 1.0, 0.8)[0] < straight


def test_a_path_is_given_up_when_a_wall_appears_on_it():
    path = np.array(((0.5, 0.5), (3.5, 0.5)))
    assert still_clear(path, chain(room(4, 4)).segments(), 0.15)
    assert not still_clear(path, chain(room(4, 4), [(2, 0), (2, 1)]).segments(), 0.15)


def test_no_walls_no_obstacles():
    empty = Wireframe()
    into, out_of = neighbours(empty.edges, len(empty.points))
    assert len(into) == len(out_of) == 0
    assert go(Roads(empty, np.zeros(2), 0.2), 3.0, 4.0)[0] == pytest.approx(5.0)


def looked_from(own: Floats, teammates: Floats = NOWHERE) -> Viewpoints:
    """Viewpoints at these places (k, 2)."""
    viewpoints = Viewpoints()
    viewpoints.own, viewpoints.teammates = own.tolist(), teammates
    return viewpoints


@pytest.mark.parametrize("turn", np.linspace(0.1, 1.5, 8))
def test_what_a_teammate_has_swept_on_its_lattice_is_swept_on_any(turn: float) -> None:
    sweep = Sweep(0.1, ideal_lidar())
    wireframe = chain(room(9, 8))
    looked = np.array([[4.0, 4.0]])
    while tasks := sweep.tasks(sweep.unseen(wireframe, looked_from(looked)), Roads(wireframe, looked[0], ROOMY_M)):
        looked = np.vstack((looked, tasks[0].stand))
    frame = (0.33, 0.21, turn)
    other = replace(wireframe, points=apply(frame, wireframe.points))
    there = apply(frame, looked)
    assert not sweep.tasks(sweep.unseen(other, looked_from(NOWHERE, there)), Roads(other, there[0], ROOMY_M))


def test_a_sweep_by_a_lidar_that_sees_less_far_than_its_stands_were_apart_leaves_little():
    """They were 0.6 m apart, whatever it sees, and half of this room was left."""
    sweep, walls, looked = Sweep(0.1, ideal_lidar(range_max_m=0.25)), chain(room(2, 2)), np.array([[1.0, 1.0]])
    first = len(sweep.unseen(walls, looked_from(looked)))
    while tasks := sweep.tasks(unseen := sweep.unseen(walls, looked_from(looked)), Roads(walls, looked[-1], TIGHT_M)):
        sweep.stood(tasks[0].stand)
        looked = np.vstack((looked, tasks[0].stand))
    assert len(unseen) < 0.05 * first


@pytest.mark.parametrize(("aside_m", "radius_m"), [(0.0, 0.95 * 1.2), (0.4, 0.95 * 0.8), (1.5, 0.1)])
def test_what_a_lidar_that_is_mounted_aside_does_not_reach_on_the_other_side_is_not_swept(aside_m, radius_m):
    lidar = ideal_lidar(range_max_m=1.2, mount_x_m=-aside_m)
    assert Sweep(0.1, lidar).radius == pytest.approx(radius_m)


def test_a_lidar_that_mixes_readings_at_edges_sees_less_far():
    clean, mixing = (Sweep(0.06, ideal_lidar(mixed=mixed)).radius for mixed in (0.0, 0.2))
    assert mixing == pytest.approx(1.43, abs=0.01) and clean > mixing


def test_the_free_face_leaves_out_what_is_solid():
    pillar = [(1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]
    face = free_face(chain(room(4, 4), pillar), np.array([[0.5, 0.5]]), 3.0)
    assert shapely.area(face) == pytest.approx(15.0)
    leak = chain([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (0.0, 0.5)], labels=Label.FRONTIER)
    assert shapely.area(free_face(leak, np.array([[0.5, 0.5]]), 3.0)) == pytest.approx(16.0)


def test_around_walls_that_hold_no_robot_free_area_goes_on():
    column = chain([(1, 1), (2, 1), (2, 2), (1, 2), (1, 1)])
    here = np.array([[0.5, 0.5]])
    assert free_face(column, here, 3.0).area > 36.0
    sweep = Sweep(0.1, ideal_lidar())
    unseen = sweep.unseen(column, looked_from(here))
    assert len(sweep.tasks(unseen, Roads(column, here[0], ROOMY_M))) > 0  # else it would be complete


def test_what_poses_see_within_the_radius_is_no_longer_unseen():
    sweep = Sweep(0.06, ideal_lidar())
    assert sweep.radius == pytest.approx(1.72, abs=0.01)  # where it has two beams
    wall = [(2.0, 0.0), (2.0, 2.0), (2.02, 2.0), (2.02, 0.0)]  # a screen that hides a part from the pose
    wireframe = chain([(0, 0), *wall, (4, 0), (4, 4), (0, 4), (0, 0)])
    pose = np.array([[1.0, 1.0]])
    unseen = sweep.unseen(wireframe, looked_from(pose))
    assert len(unseen) > 0
    far = np.hypot(*(unseen - pose[0]).T) > sweep.radius
    hidden = unseen[:, 0] > 2.0
    assert (far | hidden).all()
    assert (hidden & ~far).any()
    roads = Roads(wireframe, pose[0], ROOMY_M)
    tasks = sweep.tasks(unseen, roads)
    shown = np.vstack([task.samples for task in tasks])
    assert len(np.unique(shown, axis=0)) >= len(unseen) - 5 * LEAST_SAMPLES
    assert (roads.standable(np.array([task.stand for task in tasks]))).all()


def test_what_a_sweep_has_left_stays_left_where_a_wall_moves():
    """A sample that was too near to the wall, with the two that were left, would make a sliver one to go for."""
    sweep, eyes = Sweep(0.1, ideal_lidar()), looked_from(np.array([[0.1, 0.15]]))
    before, after = chain(room(3.06, 0.345)), chain(room(3.06, 0.355))
    left = sweep.unseen(before, eyes)
    assert len(left) == LEAST_SAMPLES - 1
    assert len(sweep.unseen(after, eyes)) == LEAST_SAMPLES
    sweep.leave(left)
    assert len(sweep.unseen(after, eyes)) == 1
    assert not len(sweep.unseen(chain(room(1.0, 0.3)), eyes))  # a map that holds none of them any more


def test_what_sweeps_have_left_is_kept_once_and_not_for_ever():
    sweep, left = Sweep(0.1, ideal_lidar()), 0.1 * np.array([(1, 1), (2, 1)])
    for _ in range(3):
        sweep.leave(left)
    assert sweep.nbytes == left.nbytes
    assert not len(sweep.left(left, NOWHERE, NOWHERE, np.zeros((0, 4)))[0])
    for row in range(MOST_SLIVERS):
        sweep.leave(left + np.array((0.0, 0.1 * row)))
    assert sweep.nbytes == 16 * MOST_SLIVERS
    assert len(sweep.left(left, NOWHERE, NOWHERE, np.zeros((0, 4)))[0]) == 2  # the oldest are forgotten


def test_nothing_is_unseen_where_no_middle_of_the_smallest_object_can_be():
    """The corners of a room are full of samples that are nearer to a wall than half of such an object."""
    unseen = Sweep(0.1, ideal_lidar()).unseen(chain(room(4.02, 4.02)), looked_from(np.array([[2.0, 0.3]])))
    assert len(unseen) and unseen.min() > 0.09 and unseen.max() < 3.95  # 4.0 is 2 cm before the wall


def test_free_area_is_sampled_no_farther_than_a_building_reaches_beyond_where_the_robot_has_been() -> None:
    """Four walls that a merged peer tells may lie kilometres apart: their samples took all memory."""
    hall, been = chain(room(400.0, 4.0)), np.array([(20.0, 2.0)])
    unseen = Sweep(0.1, ideal_lidar()).unseen(hall, looked_from(been, np.array([(399.0, 2.0)])))
    assert unseen[:, 0].max() == pytest.approx(20.0 + MOST_AWAY_M)


def test_of_standing_points_that_are_too_many_the_nearest_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few samples that lie kilometres apart have millions of places between them."""
    sweep, hall, here = Sweep(0.1, ideal_lidar()), chain(room(50.0, 4.0)), np.array([(2.0, 2.0)])
    unseen = sweep.unseen(hall, looked_from(here))
    every = [task.stand[0] for task in sweep.tasks(unseen, Roads(hall, here[0], ROOMY_M))]
    monkeypatch.setattr(sweeping, "MOST_VIEWS", 100 * len(unseen))
    nearest = [task.stand[0] for task in sweep.tasks(unseen, Roads(hall, here[0], ROOMY_M))]
    assert max(every) > 45.0 and 0 < max(nearest) < 12.0
    far = unseen[unseen[:, 0] > 30.0]  # what is near has been seen: places there show nothing
    monkeypatch.setattr(sweeping, "MOST_VIEWS", 100 * len(far))
    assert min(task.stand[0] for task in sweep.tasks(far, Roads(hall, here[0], ROOMY_M))) > 25.0
