"""The map: complete rooms are rings of corners, wrong walls die, teammates leave no wall, noise is corrected."""

import math

import numpy as np
import pytest

from agent.corner_scan import FRONTIER
from agent.mapping.config import FilterConfig
from agent.mapping.edges import free_record, length, set_tip
from agent.mapping.joint import AXIS
from agent.mapping.particle_filter import STILL_SCANS, WireframeFilter, systematic
from agent.perception.disc_memory import SeenDiscs
from agent.perception.perceive import Foreseen, perceive
from protocol.geometry import Pose, seen_from, wrapped
from protocol.messages import LidarSpec, OdometrySpec, RobotSpec
from protocol.wireframe import Label, Wireframe
from tests.ideal import EXACT, ideal_lidar, ideal_spec
from world.lidar.lidar import Lidar

Place = tuple[float, float]


def ring(*points: tuple[float, float]) -> list[tuple[float, float, float, float]]:
    """Closed outline through points; free space on the left."""
    return [(*a, *b) for a, b in zip(points, (*points[1:], points[0]), strict=True)]


ROOM = ring((0, 0), (5, 0), (5, 3), (3, 3), (3, 4), (0, 4)) + ring((1.5, 1.5), (1.5, 2), (2, 2), (2, 1.5))
"""An L-shaped room of 6 corners with a pillar of 4."""

FIGURE_2 = ring(
    (0, 0), (20, 0), (20, 5), (14, 5), (14, 6), (20, 6), (20, 10), (6, 10), (6, 7), (4, 7), (4, 10), (0, 10)
) + ring((13, 2), (12, 1), (9, 4), (10, 5))
"""After the paper's figure 2: its outer ring with a notch and a wall from the right (whose tip the text garbles), and
its oblique block."""


class Walk:
    """A robot that is carried along poses through walls of which it sees the true outline."""

    def __init__(
        self,
        segments: list[tuple[float, float, float, float]],
        spec: LidarSpec,
        particles: int = 1,
        odometry: OdometrySpec | None = None,
        seed: int = 0,
    ) -> None:
        self.spec = ideal_spec(lidar=spec, odometry=odometry or EXACT)
        self.lidar = Lidar(np.array(segments, np.float64), spec)
        self.rng = np.random.default_rng(seed)
        self.discs, self.tick = SeenDiscs(self.spec), 0
        self.filter = WireframeFilter(FilterConfig(particles=particles), self.spec, np.random.SeedSequence(seed))

    def see(
        self, pose: Pose, odometry: Pose | None = None, discs: np.ndarray | None = None, post: Place | None = None
    ) -> None:
        """post: where something stands that is round and no teammate."""
        ranges = self.lidar.cast(np.array([pose]), discs)
        measured = np.asarray(self.lidar.measured(ranges, [self.rng])[0], np.float64)
        odometry = odometry or pose
        posts = seen_from(pose, np.array([] if post is None else [post]).reshape(-1, 2))
        scan = perceive(measured, self.spec, foreseen=Foreseen(self.discs.expected(odometry), posts=posts))
        self.discs.add(odometry, scan.discs)
        self.filter.update(scan, odometry, tick=self.tick)
        self.tick += 1


def round_tour(*stops: tuple[float, float], step: float = 0.15) -> list[Pose]:
    """Poses along straight legs through the stops and back to the first, heading along."""
    out = []
    for a, b in zip(stops, (*stops[1:], stops[0]), strict=True):
        heading = math.atan2(b[1] - a[1], b[0] - a[0])
        n = math.ceil(math.dist(a, b) / step)
        out += [(a[0] + (b[0] - a[0]) * k / n, a[1] + (b[1] - a[1]) * k / n, heading) for k in range(n)]
    return out


ROOM_TOUR = round_tour((0.7, 0.7), (4.3, 0.7), (4.3, 2.4), (2.5, 2.5), (2.4, 3.4), (0.7, 3.4))


def farthest(wireframe: Wireframe, corners: list[tuple[float, float, float, float]]) -> float:
    """Largest distance from a true corner to the nearest nominal vertex."""
    nominal = wireframe.points[wireframe.labels == Label.NOMINAL]
    true = np.array(corners)[:, :2]
    return float(np.linalg.norm(true[:, None] - nominal[None], axis=2).min(axis=1).max())


@pytest.mark.parametrize("particles", [1, 8])
def test_a_room_seen_whole_is_rings_of_nominal_corners(particles: int) -> None:
    walk = Walk(ROOM, ideal_lidar(), particles)
    for pose in ROOM_TOUR:
        walk.see(pose)
    wireframe = walk.filter.wireframe()
    wireframe.check()
    assert (wireframe.labels == Label.NOMINAL).all()
    assert len(wireframe.points) == len(wireframe.edges) == 10
    assert farthest(wireframe, ROOM) < 0.01
    assert (wireframe.likelihood > 0.8).all()


def test_the_map_of_figure_2_is_complete_and_all_nominal() -> None:
    walk = Walk(FIGURE_2, ideal_lidar(range_max_m=12.0, beams=720))
    for pose in round_tour(
        (2, 2), (8, 2), (11.5, 0.5), (18, 2), (15, 3.5), (13, 5.5), (16, 8), (10, 8), (9, 6), (2, 6), (2, 9), (2, 6)
    ):
        walk.see(pose)
    wireframe = walk.filter.wireframe()
    assert (wireframe.labels == Label.NOMINAL).all()
    assert len(wireframe.points) == len(wireframe.edges) == 16
    assert farthest(wireframe, FIGURE_2) < 0.01


def test_one_view_of_a_room_leaves_all_three_labels() -> None:
    walk = Walk(ROOM, ideal_lidar())
    for _ in range(5):
        walk.see((0.7, 0.7, 0.3))
    assert set(walk.filter.wireframe().labels.tolist()) == set(Label)


def false_wall(walk: Walk, p: int, a: tuple[float, float], b: tuple[float, float]) -> None:
    """Put a well-supported wall from a to b into a particle."""
    edges, n = walk.filter.edges[p], int(walk.filter.counts[p])
    e = edges[n]
    u = np.subtract(b, a) / math.dist(a, b)
    e["kind"], e["own"], e["hits"], e["seen"], e["due"] = 1, 1, 400.0, 60.0, 60.0
    e["x"], e["y"] = np.add(a, b) / 2
    e["ux"], e["uy"] = u
    scatter = 400.0 * math.dist(a, b) ** 2 / 12
    e["xx"], e["xy"], e["yy"] = scatter * u[0] ** 2, scatter * u[0] * u[1], scatter * u[1] ** 2
    e["tip"], e["label"], e["link"] = (a, b), FRONTIER, -1
    walk.filter.counts[p] += 1


@pytest.mark.parametrize("particles", [1, 6])
def test_a_wall_across_the_room_in_all_particles_is_gone_after_a_few_scans(particles: int) -> None:
    walk = Walk(ROOM, ideal_lidar(), particles)
    for pose in ROOM_TOUR:
        walk.see(pose)
    for p in range(particles):
        false_wall(walk, p, (0.3, 2.8), (2.8, 2.8))
    assert len(walk.filter.wireframe().edges) == 11
    for pose in ROOM_TOUR[:50]:
        walk.see(pose)
    assert len(walk.filter.wireframe().edges) == 10


def test_a_wall_in_half_of_the_particles_loses_its_weight() -> None:
    walk = Walk(ROOM, ideal_lidar(), 6)
    for pose in ROOM_TOUR:
        walk.see(pose)
    for p in range(3):
        false_wall(walk, p, (0.3, 2.8), (2.8, 2.8))
    walk.see(ROOM_TOUR[0])
    best = walk.filter.edges[walk.filter.best]
    assert not ((best["kind"] > 0) & np.isclose(best["y"], 2.8)).any()


def test_a_missing_wall_comes_back() -> None:
    walk = Walk(ROOM, ideal_lidar())
    for pose in ROOM_TOUR:
        walk.see(pose)
    edges = walk.filter.edges[0]
    longest = int(np.argmax([length(e) if e["kind"] else 0.0 for e in edges[: walk.filter.counts[0]]]))
    for side in (0, 1):
        other = edges["link"][longest, side]
        edges["link"][other, 1 - side], edges["label"][other, 1 - side] = -1, FRONTIER
    edges["kind"][longest] = 0
    for pose in ROOM_TOUR:
        walk.see(pose)
    wireframe = walk.filter.wireframe()
    assert len(wireframe.edges) == 10
    assert (wireframe.labels == Label.NOMINAL).all()


def test_a_false_gap_closes() -> None:
    walk = Walk(ROOM, ideal_lidar())
    for pose in ROOM_TOUR:
        walk.see(pose)
    edges = walk.filter.edges[0]
    n = int(walk.filter.counts[0])
    longest = int(np.argmax([length(e) if e["kind"] else 0.0 for e in edges[:n]]))
    edges[n] = edges[longest]
    walk.filter.counts[0] += 1
    following = edges["link"][longest, 1]
    edges["link"][following, 0] = n
    edges["link"][longest, 1], edges["label"][longest, 1] = -1, FRONTIER
    edges["link"][n, 0], edges["label"][n, 0] = -1, FRONTIER
    set_tip(edges[longest], 1, -0.3)
    set_tip(edges[n], 0, 0.3)
    assert len(walk.filter.wireframe().edges) == 11
    for pose in ROOM_TOUR:
        walk.see(pose)
    wireframe = walk.filter.wireframe()
    assert len(wireframe.edges) == 10
    assert (wireframe.labels == Label.NOMINAL).all()


def test_teammates_that_stand_or_pass_leave_no_wall() -> None:
    walk = Walk(ROOM, ideal_lidar())
    for k, pose in enumerate(round_tour((0.7, 0.7), (1.2, 0.7)) * 40):  # 60 s at 5 Hz
        passing = (4.5 - 0.04 * (k % 75), 0.4, 0.105)
        walk.see(pose, discs=np.array([(2.5, 0.9, 0.105), passing]))
    wireframe = walk.filter.wireframe()
    middle = wireframe.points[wireframe.edges].mean(axis=1)
    inside = (middle[:, 0] > 2.1) & (middle[:, 0] < 4.9) & (middle[:, 1] > 0.1) & (middle[:, 1] < 1.4)
    assert not inside.any()


@pytest.mark.parametrize("particles", [1, 6])
def test_odometry_noise_is_corrected_by_the_map(particles: int) -> None:
    spec = OdometrySpec(noisy=True)
    walk = Walk(ROOM, ideal_lidar(), particles, spec, seed=3)
    rng = np.random.default_rng(8)
    start = (0.0, 0.0, 0.0)
    believed, last = start, ROOM_TOUR[0]
    for pose in ROOM_TOUR * 3:
        c, s = math.cos(last[2]), math.sin(last[2])
        dx, dy = pose[0] - last[0], pose[1] - last[1]
        step, turn = c * dx + s * dy, wrapped(pose[2] - last[2])
        side = c * dy - s * dx
        step += rng.normal() * spec.distance_sd * math.sqrt(abs(step))
        turn += rng.normal() * math.hypot(
            math.radians(spec.heading_sd_deg) * math.sqrt(abs(step)), spec.turn_sd * math.sqrt(abs(turn))
        )
        c, s = math.cos(believed[2]), math.sin(believed[2])
        believed = (believed[0] + c * step - s * side, believed[1] + s * step + c * side, believed[2] + turn)
        walk.see(pose, believed)
        last = pose
    c, s = math.cos(ROOM_TOUR[0][2]), math.sin(ROOM_TOUR[0][2])
    wireframe = walk.filter.wireframe()
    points = wireframe.points @ np.array([[c, s], [-s, c]]) + ROOM_TOUR[0][:2]
    found = Wireframe(points, wireframe.labels, wireframe.edges, wireframe.likelihood, wireframe.own)
    assert len(wireframe.edges) == 10
    assert farthest(found, ROOM) < 0.03


def test_far_columns_seen_before_the_first_move_hold_the_heading_against_wheels_that_differ() -> None:
    columns = [wall for x in (-2.0, 2.0) for y in (-2.0, 2.0) for wall in ring(*turned(x, y, 0.0, 0.4))]
    walk = Walk(columns, ideal_lidar(noise_share=0.0175), 1, OdometrySpec(noisy=True))
    for _ in range(50):
        walk.see((0.0, 0.0, 0.0))
    way = 0.0
    for _ in range(20):
        way += 0.03
        told = math.radians(6.0) * way  # they are told to bend the way by 6 degrees a metre, which is straight
        walk.see((way, 0.0, 0.0), (way, 0.5 * told * way, told))
    assert abs(walk.filter.pose[2]) < math.radians(1.0)


def test_scans_of_a_robot_that_stands_tell_no_more_and_more_of_pose_and_walls() -> None:
    """They err alike, and turned the maps of robots that had parked."""
    walk = Walk(ROOM, ideal_lidar(noise_share=0.0175), 1, OdometrySpec(noisy=True))
    for k in range(30):
        walk.see((2.5 + 0.02 * k, 0.7, 0.0), (0.02 * k, 0.0, 0.0))
    known = []
    for _ in range(2 * STILL_SCANS):
        walk.see((3.08, 0.7, 0.0), (0.58, 0.0, 0.0))
        known.append(float(walk.filter.joint[0][AXIS, AXIS]))
    assert known[0] > known[STILL_SCANS - 2] and known[STILL_SCANS - 1] == known[-1]
    walk.see((3.1, 0.7, 0.0), (0.6, 0.0, 0.0))
    assert walk.filter.joint[0][AXIS, AXIS] < known[-1]


def test_who_is_pushed_around_by_a_teammate_knows_where_it_is_by_what_it_sees() -> None:
    walk, mate = Walk(ROOM, ideal_lidar(), 1, OdometrySpec(noisy=True)), np.array([[0.205, 0.0, 0.105]])
    x, y, theta = 2.5, 0.7, 0.0
    for _ in range(30):
        walk.see((x, y, theta), (0.0, 0.0, 0.0))
    for _ in range(5):  # the wheels stand
        x, theta = x - 0.02, theta - math.radians(8.0)
        mate[0, :2] = x + 0.205 * math.cos(theta), y + 0.205 * math.sin(theta)
        walk.see((x, y, theta), (0.0, 0.0, 0.0), mate)
    for _ in range(20):
        walk.see((x, y, theta), (0.0, 0.0, 0.0))
    assert walk.filter.pose == pytest.approx((x - 2.5, 0.0, theta), abs=0.02)
    assert len(walk.filter.wireframe().edges) == 10


def test_the_same_seed_gives_the_same_bytes() -> None:
    maps = []
    for _ in range(2):
        walk = Walk(ROOM, ideal_lidar(noise_m=0.03, dropout=0.02), 5, seed=7)
        for pose in ROOM_TOUR:
            walk.see(pose)
        maps.append(walk.filter.edges.tobytes())
    assert maps[0] == maps[1]


def test_systematic_resampling_is_proportional() -> None:
    weights = np.array([0.5, 0.0, 0.3, 0.2])
    counts = np.zeros(4)
    for offset in np.linspace(0, 1, 1000, endpoint=False):
        counts += np.bincount(systematic(weights, float(offset)), minlength=4)
    assert np.allclose(counts / counts.sum(), weights, atol=0.002)


def test_memory_is_counted() -> None:
    walk = Walk(ROOM, ideal_lidar(), 3)
    walk.see(ROOM_TOUR[0])
    one = walk.filter.nbytes
    for pose in ROOM_TOUR:
        walk.see(pose)
    assert one < walk.filter.nbytes < 3 * 40 * walk.filter.edges.itemsize


PLATE = ring((0, 0), (4, 0), (4, 3), (2.01, 3), (2.01, 2.65), (1.99, 2.65), (1.99, 3), (0, 3))
"""A room with a plate of 2 cm that stands out 0.35 m from a wall."""


def faces_of_the_plate(wireframe: Wireframe) -> float:
    """Metres of map within 3 cm of the plate and along it."""
    walls = wireframe.segments()
    middle = (walls[:, :2] + walls[:, 2:]) / 2
    upright = np.abs(walls[:, 0] - walls[:, 2]) < 0.03
    near = (np.abs(middle[:, 0] - 2.0) < 0.03) & (middle[:, 1] > 2.6) & upright
    return float(np.abs(walls[near, 3] - walls[near, 1]).sum())


def test_a_thin_plate_stays_though_it_is_looked_at_edge_on() -> None:
    walk = Walk(PLATE, ideal_lidar())
    for pose in round_tour((0.7, 0.7), (0.7, 2.4), (1.6, 2.2), (2.4, 2.2), (3.3, 2.4), (3.3, 0.7)):
        walk.see(pose)
    assert faces_of_the_plate(walk.filter.wireframe()) > 0.6
    for k in range(60):  # along its line and away: few beams meet it, and those about it the wall behind
        walk.see((1.98 - 0.005 * k, 2.45 - 0.025 * k, 1.6))
    for k in range(40):
        walk.see((1.68, 0.95 + 0.001 * k, 1.6))
    assert faces_of_the_plate(walk.filter.wireframe()) > 0.6


SLOT = ring((0, 0), (4, 0), (4, 3), (0.7, 3), (0.7, 2.6), (0.2, 2.6), (0.2, 3), (0, 3))
"""A room with a cabinet that leaves a slot of 0.2 m in the corner behind it."""


def test_a_corner_prolonged_over_a_slot_is_a_guess_and_gives_way_to_what_is_seen() -> None:
    walk = Walk(SLOT, ideal_lidar())
    for k in range(60):
        walk.see((0.6 - 0.005 * k, 1.8, 2.0))
    for k in range(200):  # flat along the cabinet: its last hit is before the slot, the next beam meets the side wall
        walk.see((3.3 - 0.005 * k, 2.3 - 0.001 * k, 3.0))
    wireframe = walk.filter.wireframe()
    nominal = wireframe.points[wireframe.labels == Label.NOMINAL]
    assert np.hypot(*(nominal - (0.0, 2.6)).T).min() > 0.1
    ends = wireframe.points
    assert np.hypot(*(ends - (0.2, 2.6)).T).min() < 0.03
    assert np.hypot(*(nominal - (0.0, 3.0)).T).min() < 0.03


@pytest.mark.parametrize("shift", [(0.5, 0.0), (-0.35, 0.35), (0.0, 0.5)])
def test_a_corner_moved_by_half_a_metre_goes_also_where_a_wall_now_lies_in_solid(shift: tuple[float, float]) -> None:
    walk = Walk(ROOM, ideal_lidar())
    for pose in ROOM_TOUR:
        walk.see(pose)
    edges, n = walk.filter.edges[0], int(walk.filter.counts[0])
    e = next(k for k in range(n) if edges[k]["kind"] and math.dist(edges[k]["tip"][1], (5, 3)) < 0.03)
    f = int(edges[e]["link"][1])
    moved = np.add((5.0, 3.0), shift)
    for k, (a, b) in ((e, (edges[e]["tip"][0].copy(), moved)), (f, (moved, edges[f]["tip"][1].copy()))):
        w, u = edges[k], (b - a) / np.hypot(*(b - a))
        scatter = w["hits"] * float((b - a) @ (b - a)) / 12
        w["x"], w["y"] = (a + b) / 2
        w["ux"], w["uy"] = u
        w["xx"], w["xy"], w["yy"] = scatter * u[0] ** 2, scatter * u[0] * u[1], scatter * u[1] ** 2
        w["tip"] = a, b
    assert farthest(walk.filter.wireframe(), ROOM) > 0.3
    for k in range(50):
        walk.see((3.6 + 0.015 * k, 1.2 + 0.01 * k, 0.2))
    wireframe = walk.filter.wireframe()
    assert farthest(wireframe, ROOM) < 0.03
    assert np.hypot(*(wireframe.points - moved).T).min() > 0.3


def test_a_wall_behind_the_one_that_took_its_corner_goes() -> None:
    walk = Walk(ROOM, ideal_lidar())
    for pose in ROOM_TOUR:
        walk.see(pose)
    edges, n = walk.filter.edges[0], int(walk.filter.counts[0])
    e = next(k for k in range(n) if edges[k]["kind"] and math.dist(edges[k]["tip"][1], (5, 3)) < 0.03)
    false, count = free_record(edges, n)
    walk.filter.counts[0] = count
    edges[false] = edges[e]
    tail, head = edges[e]["tip"][0].copy(), edges[e]["tip"][1] + (0.5, 0.0)  # in the solid behind the true one
    w, u = edges[false], (head - tail) / math.dist(head, tail)
    w["x"], w["y"] = (tail + head) / 2
    w["ux"], w["uy"] = u
    w["tip"] = tail, head
    w["link"][1], w["label"][1] = -1, Label.OCCLUSION
    edges[int(edges[e]["link"][0])]["link"][1] = false  # the corner is that of the false one
    edges[e]["link"][0], edges[e]["label"][0] = -1, Label.OCCLUSION
    assert np.hypot(*(walk.filter.wireframe().points - head).T).min() < 0.01
    for k in range(50):
        walk.see((2.0 + 0.004 * k, 2.5, 0.2))  # the corner itself is out of reach, so nothing is linked anew
    wireframe = walk.filter.wireframe()
    assert farthest(wireframe, ROOM) < 0.03
    assert np.hypot(*(wireframe.points - head).T).min() > 0.3
    assert len(wireframe.edges) == len(ROOM) and (wireframe.labels == Label.NOMINAL).all()


def turned(x: float, y: float, angle: float, size: float) -> list[tuple[float, float]]:
    """Corners of a square post in their order around it, free space outside: clockwise."""
    c, s, half = math.cos(angle), math.sin(angle), 0.5 * size
    return [(x + half * (c * a - s * b), y + half * (s * a + c * b)) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]


@pytest.mark.parametrize("seed", range(8))
def test_a_turned_post_has_four_faces_though_no_scan_shows_many_beams_of_any(seed: int) -> None:
    """In hall a face showed 7 beams in 50 scans, and was known by three far ones that noise had turned to the axis."""
    x, y = 2.6, 1.6
    post = ring(*turned(x, y, 0.6, 0.1))
    walk = Walk(ring((0, 0), (5, 0), (5, 3.2), (0, 3.2)) + post, ideal_lidar(), seed=seed)
    for pose in round_tour((0.6, 0.6), (1.7, 0.8), (3.5, 0.8), (3.5, 2.4), (1.7, 2.4), (1.7, 0.8), step=0.044):
        walk.see(pose, post=(x, y))
    wireframe = walk.filter.wireframe()
    assert (wireframe.labels == Label.NOMINAL).all()
    assert len(wireframe.points) == len(wireframe.edges) == 8
    assert farthest(wireframe, post) < 0.01


def test_three_smears_over_two_faces_of_a_far_post_are_no_wall() -> None:
    """Three beams on a post lie near a line whatever its faces, and near the axis now and then."""
    for seed in range(40):
        walk = Walk(ring((0, 0), (7, 0), (7, 3), (0, 3)) + ring(*turned(5.0, 1.5, 0.6, 0.1)), ideal_lidar(), seed=seed)
        for x in (1.6, 1.65, 1.7):
            walk.see((x, 1.5, 0.0), post=(5.0, 1.5))
        points = walk.filter.wireframe().points
        assert len(points)
        assert np.hypot(*(points - (5.0, 1.5)).T).min() > 0.3


def test_what_a_scan_hit_and_is_no_wall_is_told_until_the_next_one_is_merged() -> None:
    """Above 5 Hz not every scan is: ends were given up whose walls the next scans would have shown."""
    post = 3.0, 1.5
    walk = Walk(ring((0, 0), (7, 0), (7, 3), (0, 3)) + ring(*turned(*post, 0.6, 0.3)), ideal_lidar())
    walk.see((1.6, 1.5, 0.0), post=post)
    seen = walk.filter.glimpses
    walk.filter.move((1.65, 1.5, 0.0))
    assert len(seen) and walk.filter.glimpses is seen
    walk.see((1.7, 1.5, 0.0), post=post)
    assert walk.filter.glimpses is not seen


def most_oblique_deg(wireframe: Wireframe) -> float:
    """Greatest angle of a wall to the nearest axis of the world."""
    along = np.diff(wireframe.segments().reshape(-1, 2, 2), axis=1)[:, 0]
    angles = np.degrees(np.arctan2(along[:, 1], along[:, 0]))
    return float(np.abs((angles + 45) % 90 - 45).max())


def test_a_smear_over_a_small_step_is_no_oblique_wall() -> None:
    """In pal_home_w four scans like these closed a step of 5 cm with a wall that lay 26 degrees off."""
    for seed in range(10):
        walk = Walk(ring((0, 0), (6, 0), (6, 2), (3, 2), (3, 2.05), (0, 2.05)), ideal_lidar(), seed=seed)
        for x, y, heading in ((2.83, 1.74, 1.7), (2.83, 1.74, 1.4), (2.81, 1.73, 1.1), (2.74, 1.69, 0.9)):
            walk.see((x, y, heading))
        assert most_oblique_deg(walk.filter.wireframe()) < 10


@pytest.mark.parametrize("seed", [8, 9])
def test_from_one_wall_to_the_next_over_a_step_is_no_oblique_wall_however_often_it_is_seen(seed: int) -> None:
    """In pal_home_w the beams over a step of 5 cm between known walls fitted a line well enough by and by, as of 9."""
    walk = Walk(ring((0, 0), (6, 0), (6, 2), (3, 2), (3, 2.05), (0, 2.05)), ideal_lidar(), seed=seed)
    y = np.random.default_rng(seed).uniform(0.5, 1.5)
    far, near = 2 - y / 2, 2 - y
    stops = ((5, 0.7), (3.2, 1.0), (2.7, far), (2.2, far), (1.6, far), (2.2, near), (2.7, near))
    for pose in round_tour(*stops, step=0.05):
        walk.see(pose)
    assert most_oblique_deg(walk.filter.wireframe()) < 10


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("poses", 1e9, "a pose beyond"), ("odometry", 1e9, "a pose beyond"), ("constants", 0.0, "no possible wheels")],
)
def test_a_checkpoint_whose_numbers_no_robot_has_is_refused(name: str, value: float, said: str) -> None:
    """Each was taken, and ended the mind ticks later."""
    spec = RobotSpec(odometry=OdometrySpec(noisy=True))
    state = {key: array.copy() for key, array in filter_of(spec).state().items()}
    state[name].reshape(-1)[0] = value
    with pytest.raises(ValueError, match=said):
        filter_of(spec).restore(state)


def filter_of(spec: RobotSpec) -> WireframeFilter:
    return WireframeFilter(FilterConfig(), spec, np.random.SeedSequence(0))
