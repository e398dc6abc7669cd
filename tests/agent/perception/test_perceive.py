"""Perception against the truth: corners within noise, ends labelled by what the wall does, teammates left out."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from agent.corner_scan import CornerScan, to_map_frame
from agent.perception.config import Segmentation
from agent.perception.perceive import Foreseen, perceive
from protocol.arrays import Floats, Records
from protocol.geometry import pose_of
from protocol.messages import LidarSpec, RobotSpec
from protocol.wireframe import Label
from tests.ideal import ideal_lidar, ideal_spec
from world.lidar.lidar import Lidar
from world.worldfile import World, load

SHARED = Path(__file__).parents[4] / "shared" / "worlds"
SPEC = ideal_lidar()
BEAM = 2 * math.pi / SPEC.beams
ROOM = np.array([(-2.0, -2, 2, -2), (2, -2, 2, 2), (2, 2, -2, 2), (-2, 2, -2, -2)])


def poses_in(world: World, count: int, seed: int) -> np.ndarray:
    """(count, 3) random poses of a robot in the region of the first spawn."""
    rng = np.random.default_rng(seed)
    region = world.region_of(*world.spawns[0][:2], 0.12)
    x0, y0, x1, y1 = region.bounds
    out: list[tuple[float, float, float]] = []
    while len(out) < count:
        x, y = rng.uniform((x0, y0), (x1, y1))
        if shapely.contains_xy(region, x, y):
            out.append((x, y, rng.uniform(-math.pi, math.pi)))
    return np.array(out)


def wall_ends_before(segment: np.ndarray, pose: np.ndarray, beam: int) -> bool:
    """Whether the wall (x1, y1, x2, y2) does not reach the ray of a beam."""
    angle = pose[2] + beam * BEAM
    d, a, e = np.array([math.cos(angle), math.sin(angle)]), segment[:2] - pose[:2], segment[2:] - segment[:2]
    cross = d[0] * e[1] - d[1] * e[0]
    if abs(cross) < 1e-12:
        return False
    t, u = (a[0] * e[1] - a[1] * e[0]) / cross, (a[0] * d[1] - a[1] * d[0]) / cross
    return t > 0 and not 0 <= u <= 1


def judge(world: World, count: int, seed: int, method: Segmentation = "piecewise") -> tuple[np.ndarray, int, int]:
    """Errors of nominal corners, and how many chain ends are labelled wrongly of how many."""
    lidar = Lidar(world.segments, SPEC)
    poses = poses_in(world, count, seed)
    ranges, met = lidar.trace(poses)
    measured = lidar.measured(ranges, [np.random.default_rng([seed, k]) for k in range(count)])
    corners = np.unique(world.segments.reshape(-1, 2).round(6), axis=0)
    errors, wrong, ends = [], 0, 0
    for pose, scan_ranges, walls in zip(poses, measured, met, strict=True):
        scan = perceive(np.asarray(scan_ranges, np.float64), ideal_spec(), method)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        for piece in scan.pieces:
            for side in (0, 1):
                if piece["label"][side] == Label.NOMINAL:
                    x = piece["x"] + piece["end"][side] * piece["ux"]
                    y = piece["y"] + piece["end"][side] * piece["uy"]
                    at = pose[:2] + np.array((c * x - s * y, s * x + c * y))
                    errors.append(np.linalg.norm(corners - at, axis=1).min())
                    continue
                beam = round(piece["bearing"][side] / BEAM)
                wall = walls[beam % SPEC.beams]
                if wall < 0:
                    continue
                ended = wall_ends_before(world.segments[wall], pose, beam + (1 if side else -1))
                ends += 1
                wrong += piece["label"][side] != (Label.OCCLUSION if ended else Label.FRONTIER)
    return np.array(errors), wrong, ends


@pytest.mark.parametrize("name", ["maze-15", "office", "apartment"])
def test_corners_and_labels_in_plain_worlds(name: str) -> None:
    first, second = judge(load(name), 500, seed=1), judge(load(name), 500, seed=2)
    errors, wrong, ends = np.hstack((first[0], second[0])), first[1] + second[1], first[2] + second[2]
    assert len(errors) > 1000
    assert np.median(errors) <= 0.005
    assert wrong <= 0.08 * ends


@pytest.mark.parametrize("name", ["drlnav_house_tomas", "hurtado_apartment", "pal_home_w"])
def test_labels_in_furnished_worlds(name: str) -> None:
    if not (SHARED / f"{name}.yaml").exists():
        pytest.skip("the shared layouts are not here")
    errors, wrong, ends = judge(load(str(SHARED / f"{name}.yaml")), 500, seed=2)
    assert len(errors) > 300
    assert wrong <= 0.12 * ends


def test_split_and_merge_sees_like_the_paper_and_the_piecewise_fit_sees_better() -> None:
    world = load("maze-15")
    errors, wrong, ends = judge(world, 200, seed=3)
    plain_errors, plain_wrong, plain_ends = judge(world, 200, seed=3, method="split-and-merge")
    assert np.median(plain_errors) <= 0.008
    assert plain_wrong <= 0.2 * plain_ends
    assert len(errors) >= len(plain_errors)
    assert wrong / ends < plain_wrong / plain_ends


def view(
    segments: list[tuple[float, float, float, float]], noise: float = 0.0, reach: float = 3.5, **extra
) -> CornerScan:
    """Corner scan from the origin; extra: discs (m, 3), and those of them that were seen before."""
    spec = ideal_lidar(noise_m=noise, range_max_m=reach)
    lidar = Lidar(np.array(segments, np.float64), spec)
    ranges = lidar.cast(np.zeros((1, 3)), extra.get("discs"))
    if noise:
        ranges = lidar.measured(ranges, [np.random.default_rng(4)])
    expected = extra.get("before", np.zeros((0, 3))) * (1.0, 1.0, 0.0)
    return perceive(np.asarray(ranges[0], np.float64), ideal_spec(lidar=spec), foreseen=Foreseen(expected))


def test_one_view_gives_all_three_labels() -> None:
    """After the paper's figure 3: a corner seen whole, a wall that ends at a depth jump, and one hidden behind it."""
    room = [(-1, -1, 3, -1), (3, -1, 3, 2), (3, 2, -1, 2), (-1, 2, -1, -1)]
    plate = [(1, 0.4, 1, 2)]  # hangs from the far wall and hides a part of it
    scan = view([*room, *plate])
    wireframe = scan.wireframe()
    wireframe.check()
    assert set(wireframe.labels.tolist()) == set(Label)
    occlusion = wireframe.points[wireframe.labels == Label.OCCLUSION]
    assert np.linalg.norm(occlusion - (1, 0.4), axis=1).min() < 0.03
    frontier = wireframe.points[wireframe.labels == Label.FRONTIER]
    assert (np.abs(frontier[:, 0] - 3) < 0.02).any()  # the right wall, up to the plate's shadow
    nominal = wireframe.points[wireframe.labels == Label.NOMINAL]
    assert np.linalg.norm(nominal - (3, -1), axis=1).min() < 1e-3


def test_free_space_lies_left_of_every_edge() -> None:
    scan = view([(-1, -1, 3, -1), (3, -1, 3, 2), (3, 2, -1, 2), (-1, 2, -1, -1)], noise=0.01)
    for piece in scan.pieces:
        assert piece["ux"] * -piece["y"] - piece["uy"] * -piece["x"] > 0


def test_a_wall_cut_by_range_is_a_frontier() -> None:
    scan = view([(-10, 1, 10, 1)], noise=0.01)
    assert len(scan.pieces) == 1
    assert scan.pieces["label"].tolist() == [[Label.FRONTIER, Label.FRONTIER]]
    assert len(scan.sight.open) == 1


@pytest.mark.parametrize("off", [0.5, 2.0, 3.0, 3.3])
def test_who_stands_for_long_takes_the_end_of_the_range_for_no_corner(off: float) -> None:
    lidar = Lidar(np.array([[-10.0, off, 10.0, off]]), ideal_lidar(noise_m=0.01))
    ranges, rng = lidar.cast(np.zeros((1, 3))), np.random.default_rng(0)
    scans = (perceive(np.asarray(lidar.measured(ranges, [rng])[0], np.float64), ideal_spec()) for _ in range(300))
    labels = np.concatenate([scan.pieces["label"].ravel() for scan in scans])
    assert len(labels) >= 600 and (labels == Label.OCCLUSION).sum() <= 1


@pytest.mark.parametrize("off", [0.05, 0.08, 0.11, 0.15])
def test_an_open_door_that_is_looked_at_along_its_wall_is_no_wall(off: float) -> None:
    walls = np.array([[-1.0, 4.0, -1.0, -4.0], [0.0, 0.2, 0.0, 1.6], [0.0, 2.5, 0.0, 2.9], [1.0, 2.9, -1.0, 2.9]])
    ranges = Lidar(walls, ideal_lidar()).cast(np.array([[-off, 0.0, 0.0]]))[0]
    scan = perceive(np.asarray(ranges, np.float64), ideal_spec()).wireframe()
    a, b = scan.points[scan.edges].transpose(1, 0, 2)
    along = (np.abs(a[:, 0] - off) < 0.05) & (np.abs(b[:, 0] - off) < 0.05)
    assert along.any()
    assert not (along & (np.minimum(a[:, 1], b[:, 1]) < 1.6) & (np.maximum(a[:, 1], b[:, 1]) > 2.3)).any()


def test_a_teammate_is_a_disc_and_no_wall() -> None:
    wall = [(-3, 1.5, 3, 1.5)]
    for x, y in ((0.3, 0.8), (1.0, 0.0), (-1.2, 1.2), (0.0, -2.5)):
        scan = view(wall, noise=0.01, discs=np.array([(x, y, 0.105)]))
        assert len(scan.discs), (x, y)
        assert np.linalg.norm(scan.discs - (x, y), axis=1).min() < 0.03
        assert all(abs(piece["y"] - 1.5) < 0.02 for piece in scan.pieces)


@pytest.mark.parametrize(("away", "touching"), [(0.205, True), (0.25, False)])
def test_who_is_so_near_that_no_range_is_measured_may_be_touched(away: float, touching: bool) -> None:
    for bearing in (0.0, 2.0):
        mate = np.array([(away * math.cos(bearing), away * math.sin(bearing), 0.105)])
        assert view([(-3, 1.5, 3, 1.5)], noise=0.01, discs=mate).touching is touching


@pytest.mark.parametrize(("beams", "lost"), [(90, 0.05), (360, 0.05), (360, 0.2), (1440, 0.2)])
def test_beams_that_drop_out_here_and_there_are_nothing_that_touches(beams: int, lost: float) -> None:
    lidar, rng = ideal_lidar(beams=beams, dropout=lost), np.random.default_rng(0)
    for near in (False, True):
        mate = np.array([(0.205 if near else 2.0, 0.0, 0.105)])
        ranges = lidar.cleaned(Lidar(ROOM, lidar).cast(np.zeros((1, 3)), mate)[0])
        scans = [np.where(rng.random(beams) < lost, np.nan, ranges) for _ in range(50)]
        touching = [perceive(scan, ideal_spec(lidar=lidar)).touching for scan in scans]
        assert np.mean(touching) == near


@pytest.mark.parametrize(("gap", "touching"), [(0.005, True), (1.0, False)])
def test_open_space_that_is_not_measured_is_nothing_that_touches(gap: float, touching: bool) -> None:
    """Many drivers say 0 where nothing came back. A robot with one took its wheels to slip in each scan."""
    spec = RobotSpec()
    ranges = Lidar(np.array([(-10.0, spec.radius_m + gap, 10.0, spec.radius_m + gap)]), spec.lidar).cast(
        np.zeros((1, 3))
    )
    seen = spec.lidar.cleaned(np.where(np.isinf(ranges[0]), 0.0, ranges[0]))
    assert perceive(seen, spec).touching is touching


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("mount_x_m", [-0.032, 0.02])
def test_what_touches_the_body_is_near_it_wherever_the_lidar_is(mount_x_m: float, side: int) -> None:
    """With the lidar 32 mm back, no wall ahead touched."""
    spec = RobotSpec(lidar=LidarSpec(mount_x_m=mount_x_m))
    for gap, touching in ((0.0, True), (0.06, False)):
        x = side * (spec.radius_m + gap)
        ranges = Lidar(np.array([(x, -10.0, x, 10.0)]), spec.lidar).cast(np.zeros((1, 3)))[0]
        assert perceive(spec.lidar.cleaned(ranges), spec).touching is touching


def test_a_post_half_as_wide_as_a_teammate_is_no_disc() -> None:
    """Beams pass where the rest of a teammate would be."""
    square = np.array([(-0.05, -0.05), (-0.05, 0.05), (0.05, 0.05), (0.05, -0.05)])
    discs = 0
    for k in range(24):
        away, bearing = 0.6 + 0.05 * k, 2.4 * k
        place = np.array([away * math.cos(bearing), away * math.sin(bearing)])
        post = np.hstack((square + place, np.roll(square, -1, axis=0) + place))
        scan = view([(-3, 2.8, 3, 2.8), *map(tuple, post.tolist())], noise=0.01)
        discs += int((np.hypot(*(scan.discs - place).T) < 0.15).sum())
    assert discs <= 4


def test_two_teammates_side_by_side_are_two_discs() -> None:
    scan = view([(-3, 2.5, 3, 2.5)], noise=0.01, discs=np.array([(0.0, 1.2, 0.105), (0.23, 1.25, 0.105)]))
    for centre in ((0.0, 1.2), (0.23, 1.25)):
        assert np.linalg.norm(scan.discs - centre, axis=1).min() < 0.04
    assert all(abs(piece["y"] - 2.5) < 0.02 for piece in scan.pieces)


@pytest.mark.parametrize("away", [0.21, 0.5, 1.0])
def test_a_teammate_that_peeps_out_behind_another_one_is_no_wall(away: float) -> None:
    for aside in np.linspace(0.0, 0.3, 16):
        pair = np.array([(away, 0.0, 0.105), (away + 0.25, aside, 0.105)])
        scan = view([(2.5, -3, 2.5, 3)], noise=0.01, discs=pair, before=pair[:1])
        assert all(abs(piece["x"] - 2.5) < 0.05 for piece in scan.pieces), aside


@pytest.mark.parametrize("aside", [0.0, 0.06, 0.12])
def test_a_post_before_a_teammate_is_a_wall(aside: float) -> None:
    """It was taken for one that peeps out, and two robots of a hundred teams drove into a post."""
    post, mate = (0.2, aside + 0.05, 0.2, aside - 0.05), np.array([(1.25, 0.0, 0.105)])
    scan = view([(2.5, -3, 2.5, 3), post], noise=0.01, discs=mate, before=mate)
    assert (np.abs(scan.pieces["x"] - 0.2) < 0.03).any()


@pytest.mark.parametrize("away", [0.14, 0.2, 0.6])
def test_what_is_close_is_known_to_be_there_though_it_is_taken_for_a_teammate_that_is_seen_no_more(away: float) -> None:
    """A post that had been a disc in the last scan was neither piece nor disc in the next one."""
    post, before = (away, 0.05, away, -0.05), np.array([(away + 0.1, 0.03, 0.105)])
    scan = view([(2.5, -3, 2.5, 3), post], noise=0.01, before=before)
    assert not (np.abs(scan.pieces["x"] - away) < 0.05).any()
    assert len(scan.close) == (away < 0.5)
    for first, last, near in scan.close:
        assert near == pytest.approx(away, abs=0.04)
        assert math.cos(first) > 0.9 and math.cos(last) > 0.9 and last - first > 0.3


def test_a_teammate_that_is_close_is_no_unknown_thing_and_a_pole_before_it_is_one() -> None:
    mate, pole = np.array([(0.4, 0.0, 0.105)]), (0.18, 0.015, 0.18, -0.015)
    for walls, close in ([], False), ([pole], True):
        scan = view([(2.5, -3, 2.5, 3), *walls], noise=0.01, discs=mate, before=mate)
        known = [math.hypot(piece["x"], piece["y"]) < 0.2 for piece in scan.pieces]
        assert any(known) or len(scan.close) == close


def test_what_is_nearer_than_the_lidar_measured_a_moment_ago_is_close() -> None:
    """A lidar that is blind to 0.3 m, on a body of 0.1 m."""
    spec = ideal_spec(lidar=ideal_lidar(range_min_m=0.3))
    ranges = Lidar(np.array([(0.35, 0.05, 0.35, -0.05)]), spec.lidar).cast(np.zeros((1, 3)))[0]
    foreseen = Foreseen(np.array([(0.45, 0.03, 0.105)]))
    assert len(perceive(np.asarray(ranges, np.float64), spec, foreseen=foreseen).close) == 1


def test_a_teammate_of_which_too_little_is_seen_for_a_disc_is_no_wall_where_it_says_that_it_is() -> None:
    spec, rng = ideal_lidar(noise_m=0.01), np.random.default_rng(0)
    lidar, taken = Lidar(np.array([(1.0, 0.0, 1.0, -3.0), (3.0, 3.0, 3.0, -3.0)]), spec), 0
    for away, aside in rng.uniform((1.2, -0.1), (2.8, 0.1), (200, 2)):  # half behind the end of a wall
        ranges = lidar.measured(lidar.cast(np.zeros((1, 3)), np.array([(away, aside, 0.105)])), [rng])[0]
        seen, told = (
            perceive(np.asarray(ranges, np.float64), ideal_spec(lidar=spec), foreseen=Foreseen(places=places))
            for places in (np.zeros((0, 3)), np.array([(away - 0.1, aside + 0.2, 0.4)]))
        )
        between = [(scan.pieces["x"] > 1.1) & (scan.pieces["x"] < 2.9) for scan in (seen, told)]
        taken += bool(between[0].any())
        assert not between[1].any()
    assert taken > 10


def test_a_post_is_a_wall_beside_a_teammate_that_is_seen() -> None:
    disc, post = np.array([(1.5, 0.0, 0.105)]), (1.5, 0.55, 1.5, 0.65)
    scan = perceive(
        Lidar(np.array([post, (3.0, -3.0, 3.0, 3.0)]), ideal_lidar())
        .cast(np.zeros((1, 3)), disc)[0]
        .astype(np.float64),
        ideal_spec(),
        foreseen=Foreseen(places=np.array([(1.5, 0.1, 0.8)])),
    )
    assert len(scan.discs) == 1 and (np.abs(scan.pieces["x"] - 1.5) < 0.02).any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 0.0, 1e9])
def test_nonsense_ranges_are_silence(value: float) -> None:
    scan = perceive(np.full(360, value), ideal_spec())
    assert len(scan.pieces) == 0
    assert len(scan.wireframe().points) == 0


def test_dropouts_do_not_open_walls() -> None:
    ranges = Lidar(np.array([(-10.0, 1, 10, 1)]), SPEC).cast(np.zeros((1, 3)))[0].astype(np.float64)
    ranges[np.random.default_rng(5).random(len(ranges)) < 0.05] = np.inf
    scan = perceive(ranges, ideal_spec(lidar=ideal_lidar(dropout=0.05)))
    assert (np.abs(scan.pieces["y"] - 1) < 1e-6).all()
    assert (scan.pieces["label"] == Label.FRONTIER).all()


def test_the_end_of_a_known_wall_is_no_teammate_and_a_teammate_beside_a_wall_is_one() -> None:
    spec = ideal_lidar()
    wall = [(1.0, -0.075, 1.0, 0.075), (1.0, 0.075, 3.0, 0.075), (3.0, -0.075, 1.0, -0.075)]
    walls = np.array([w[2:] + w[:2] for w in wall])
    sides = np.array(wall[1:])
    hidden_without, seen_with = 0, 0
    for seed in range(20):
        lidar = Lidar(walls, spec)
        rng = np.random.default_rng(seed)
        pose = np.array([[-0.3, 0.05 * (seed % 3 - 1), 0.0]])
        ranges = np.asarray(lidar.measured(lidar.cast(pose), [rng])[0], np.float64)
        known = sides - np.tile(pose[0, :2], 2)
        hidden_without += len(perceive(ranges, ideal_spec()).discs)
        scan = perceive(ranges, ideal_spec(), foreseen=Foreseen(walls=known))
        assert len(scan.discs) == 0
        seen_with += len(scan.pieces) > 0
        beside = np.array([[2.0, 0.075 + 0.2, 0.105]])
        pose = np.array([[1.2, 0.9, 0.0]])
        ranges = np.asarray(lidar.measured(lidar.cast(pose, beside), [rng])[0], np.float64)
        scan = perceive(ranges, ideal_spec(), foreseen=Foreseen(walls=sides - np.tile(pose[0, :2], 2)))
        assert np.hypot(*(scan.discs - (beside[0, :2] - pose[0, :2])).T).min() < 0.05
    assert hidden_without > 0
    assert seen_with == 20


def test_what_fits_a_disc_on_a_known_wall_is_the_wall_and_a_teammate_before_it_is_none() -> None:
    """Few beams on a far wall that is seen obliquely fit a circle, too: its middle lies a radius behind the wall."""
    wall, spec, rng = np.array([(2.0, 2.0, -3.0, 2.0)]), ideal_spec(), np.random.default_rng(0)
    lidar, mate = Lidar(wall, spec.lidar), np.array([[-0.3, 2.0 - 1.3 * spec.radius_m, spec.radius_m]])
    on_wall, left, on_mate, told = 0, 0, 0, 0
    for _ in range(40):
        for discs in (None, mate):
            ranges = np.asarray(lidar.measured(lidar.cast(np.zeros((1, 3)), discs), [rng])[0], np.float64)
            found, judged = (perceive(ranges, spec, foreseen=Foreseen(walls=known)).discs for known in (wall[:0], wall))
            if discs is None:
                on_wall, left = on_wall + len(found), left + len(judged)
            else:
                found, judged = (np.hypot(*(places - mate[0, :2]).T) < 0.1 for places in (found, judged))
                on_mate, told = on_mate + found.any(), told + judged.any()
    assert on_wall > 40 and left == 0
    assert told == on_mate > 30


def test_a_far_piece_shows_where_it_ends_however_noisy_its_beams_are() -> None:
    bearings = ideal_spec().lidar.bearings() - 0.5 * math.pi
    panel = np.where(np.abs(2.5 * np.tan(bearings)) < 0.15, 2.5 / np.cos(bearings), np.inf)
    panel[panel < 0] = np.inf
    for share in (0.0, 0.0175):
        piece = perceive(panel, ideal_spec(lidar=ideal_lidar(noise_share=share)), alone=True).pieces[0]
        assert set(piece["label"].tolist()) == {int(Label.OCCLUSION)}
        assert (np.abs(piece["end"]) < 0.16).all() and (np.abs(piece["end"]) + piece["slack"] > 0.14).all()


def seen_from_the_middle(dropout: float, past: Callable[[Floats], None]) -> Records:
    """Pieces of a panel of 0.3 m, 2.5 m away; `past` sets the ranges of the beams past its head, from the next on."""
    bearings = ideal_spec().lidar.bearings() - 0.5 * math.pi
    panel = np.where(np.abs(2.5 * np.tan(bearings)) < 0.15, 2.5 / np.cos(bearings), np.inf)
    panel[panel < 0] = np.inf
    past(panel[np.flatnonzero(np.isfinite(panel))[-1] + 1 :])
    lidar = ideal_lidar(dropout=dropout, noise_share=0.0175)
    return perceive(panel, ideal_spec(lidar=lidar), alone=True).pieces


@pytest.mark.parametrize("farther", [False, True])
@pytest.mark.parametrize("dropout", [0.0, 0.02])
def test_a_wall_ends_before_the_first_beam_from_which_nothing_came_back(dropout: float, farther: bool) -> None:
    """Where one may have dropped out, it takes two to tell; ends seemed 0.24 of their slack too far out so, and a
    corridor with doors came out 1 % too short."""

    def past(ranges: Floats) -> None:
        if farther:
            ranges[1] = 3.3

    piece = seen_from_the_middle(dropout, past)[0]
    assert set(piece["label"].tolist()) == {int(Label.OCCLUSION)}
    assert (piece["slack"] < 1.05 * 2.5 * BEAM).all() and (piece["slack"] > 0.0).all()


def seen_past_a_stray(sigmas: float) -> Records:
    """Pieces of the panel where a stray follows one beam that may have dropped out, and then the wall goes on."""

    def past(ranges: Floats) -> None:
        ranges[1], ranges[2:8] = 2.5 + sigmas * 0.0175 * 2.5, 2.52

    return seen_from_the_middle(0.02, past)


def test_a_stray_beam_is_one_too_after_one_that_may_have_dropped_out() -> None:
    pieces = seen_past_a_stray(6.5)
    panel = pieces[np.argmax(pieces["end"][:, 1])]
    assert panel["stray"].tolist() == [0, 1] and (panel["slack"] < 1.05 * 2.5 * BEAM).all()


def test_a_wall_goes_on_past_a_beam_that_noise_explains() -> None:
    """It ended there, as the beam's point was more than 0.25 m from the next one's."""
    (whole,) = seen_past_a_stray(5.0)
    assert whole["end"][1] - whole["end"][0] > 0.5


def test_a_wall_hardly_ever_ends_in_its_middle_and_if_so_by_a_stray() -> None:
    """Of 1,000 scans in a corridor 14 had such an end, where a beam's point and the next one's were 0.25 m apart."""
    lidar, rng = ideal_lidar(noise_share=0.0175), np.random.default_rng(0)
    corridor = Lidar(np.array([[-10.0, 1.0, 10.0, 1.0], [10.0, -1.0, -10.0, -1.0]]), lidar)
    ranges = corridor.cast(np.zeros((1, 3)))
    scans = [np.asarray(corridor.measured(ranges, [rng])[0], np.float64) for _ in range(1000)]
    pieces = np.concatenate([perceive(scan, ideal_spec(lidar=lidar), alone=True).pieces for scan in scans])
    strays = pieces["stray"][pieces["label"] == Label.OCCLUSION]
    assert 1 <= len(strays) <= 3 and strays.all()


def test_a_door_that_one_beam_passes_has_jambs_and_no_strays() -> None:
    lidar = ideal_lidar(noise_share=0.0175)
    ranges = np.asarray(Lidar(np.array([[-10.0, 1.0, 10.0, 1.0]]), lidar).cast(np.zeros((1, 3)))[0], np.float64)
    ranges[np.argmin(np.abs(lidar.bearings() - math.radians(30)))] *= 1.2
    pieces = perceive(ranges, ideal_spec(lidar=lidar), alone=True).pieces
    inner = pieces["label"] == Label.OCCLUSION
    assert inner.sum() == 2 and not pieces["stray"][inner].any()


@pytest.mark.parametrize("dropout", [0.0, 0.02])
@pytest.mark.parametrize("away", [0.5, 1.5, 2.0])
def test_two_walls_in_one_line_are_two_where_the_slit_between_them_is_open(away: float, dropout: float) -> None:
    lidar = ideal_lidar(noise_share=0.0175, dropout=dropout)
    walls = np.array([[-2.0, away, -0.1, away], [0.1, away, 2.0, away]])
    ranges = Lidar(walls, lidar).cast(np.array([[0.0, 0.0, 0.3]]))[0].astype(np.float64)
    pieces = to_map_frame(perceive(ranges, ideal_spec(lidar=lidar), alone=True).pieces, (0.0, 0.0, 0.3))
    tips = np.sort(pieces["x"][:, None] + pieces["end"] * pieces["ux"][:, None])
    assert len(tips) == 2 and not ((tips[:, 0] < 0.0) & (tips[:, 1] > 0.0)).any()


def test_a_wall_at_the_end_of_the_range_goes_on_past_beams_that_noise_has_made_too_long() -> None:
    lidar = ideal_lidar(noise_share=0.0175)
    ranges = Lidar(np.array([[-10.0, 3.33, 10.0, 3.33]]), lidar).cast(np.zeros((1, 3)))[0].astype(np.float64)
    ahead = np.argmin(np.abs(lidar.bearings() - 0.5 * math.pi))
    ranges[ahead - 1 : ahead + 2] = np.inf
    assert len(perceive(ranges, ideal_spec(lidar=lidar), alone=True).pieces) == 1


def test_beams_on_the_tip_of_a_wall_do_not_move_its_long_side() -> None:
    """Noise takes beams on the tip for ones on the side, and these lie behind it: it seemed 5 mm too far away."""
    lidar = ideal_lidar(noise_share=0.0175)
    side, count, rng = 0.5, 400, np.random.default_rng(0)
    plate = np.array([[side, 0.0, -side, 0.0], [-side, 0.0, -side, -0.15], [side, -0.15, side, 0.0]])
    poses = np.column_stack((rng.uniform(0.9, 2.2, count), rng.uniform(1.2, 2.3, count), rng.uniform(-3, 3, count)))
    weight, moment = 0.0, 0.0
    seen = Lidar(plate, lidar).cast(poses)
    for pose, ranges in zip(poses, Lidar(plate, lidar).measured(seen, [rng] * count), strict=True):
        for piece in to_map_frame(perceive(ranges, ideal_spec(lidar=lidar), alone=True).pieces, pose_of(pose)):
            if abs(piece["uy"]) < 0.3 and abs(piece["x"]) < side:
                weight += piece["hits"]
                moment += piece["hits"] * piece["y"]
    assert abs(moment / weight) < 0.003


@pytest.mark.parametrize(("hits", "bridge_m", "pieces"), [(5, 2.0, 1), (5, 0.25, 0), (4, 2.0, 0)])
def test_sparse_hits_of_a_sure_line_are_one_wall_where_it_is_bridged(hits: int, bridge_m: float, pieces: int) -> None:
    lidar = ideal_lidar(beams=90, field_of_view_deg=180.0, first_beam_deg=-90.0, range_max_m=20.0, turning=False)
    ranges, angles = np.full(90, np.inf), np.radians(-90.0 + 2.0 * np.arange(90))
    ahead = np.arange(56, 56 + hits)  # at 22 degrees and more off the heading, half a metre and more apart on the wall
    ranges[ahead] = 3.0 / np.sin(angles[ahead])
    assert len(perceive(ranges, ideal_spec(lidar=lidar), alone=True, bridge_m=bridge_m).pieces) == pieces


@pytest.mark.parametrize("bearing_deg", [-4.5, -1.5, 0.0, 2.5, 90.0])
def test_a_post_straight_ahead_is_seen_in_company_though_the_seam_of_a_revolution_is_there(bearing_deg: float) -> None:
    spec = ideal_spec(lidar=ideal_lidar(turning=True))
    off = (spec.lidar.bearings() - math.radians(bearing_deg) + math.pi) % (2 * math.pi) - math.pi
    on_post = (np.abs(0.7 * np.tan(off)) <= 0.05) & (np.abs(off) < 1.0)
    on_wall = np.abs(off) > 2.5  # 1 m behind the robot
    ranges = np.where(on_post, 0.7 / np.cos(off), np.where(on_wall, -1.0 / np.cos(off), np.inf))
    alone, in_company = (perceive(ranges, spec, company=company).pieces for company in (False, True))
    assert (alone["x"] > 0.0).any() or (alone["y"] > 0.5).any()
    assert np.array_equal(alone, in_company)


@pytest.mark.parametrize("bearing_deg", [-2.5, 0.0, 1.5, 180.0])
def test_a_lone_post_is_one_piece_wherever_the_ring_of_beams_begins(bearing_deg: float) -> None:
    off = (SPEC.bearings() - math.radians(bearing_deg) + math.pi) % (2 * math.pi) - math.pi
    on_post = (np.abs(0.7 * np.tan(off)) <= 0.05) & (np.abs(off) < 1.0)
    piece = perceive(np.where(on_post, 0.7 / np.cos(off), np.inf), ideal_spec()).pieces
    assert np.diff(piece["end"]).tolist() == [[pytest.approx(0.09, abs=0.01)]]


def seen_wall(away_m: float, scans: int, half_m: float = 1.5, spec: RobotSpec | None = None) -> Floats:
    """(n, 2) of the pieces of a wall straight ahead: metres behind it, and hits; the lidar is that of real sensing."""
    spec, rng = spec or RobotSpec(), np.random.default_rng(0)
    lidar = Lidar(np.array([(away_m, -half_m, away_m, half_m)]), spec.lidar)
    found = []
    for heading in rng.uniform(-math.pi, math.pi, scans):
        pose = np.array([(0.0, 0.0, heading)])
        ranges, met = lidar.trace(pose)
        ranges = lidar.measured(ranges, [rng], met, lidar.rays(pose))[0].astype(np.float64)
        pieces = to_map_frame(perceive(ranges, spec, alone=True).pieces, pose_of(pose[0]))
        found += [(piece["x"] - away_m, piece["hits"]) for piece in pieces]
    return np.array(found)


@pytest.mark.parametrize("away_m", [0.8, 1.6])
def test_a_wall_is_where_it_is_in_the_mean(away_m: float) -> None:
    """The fit has squares of ranges that err, and put walls 0.03 % behind their places."""
    off, hits = seen_wall(away_m, 1500).T
    assert abs(np.average(off, weights=hits)) < 1e-4 * away_m


def test_sparse_beams_that_err_show_a_far_wall_whole_and_where_it_is() -> None:
    """Noise put far hits farther apart than near ones, so that they were left out: it was three walls, 8 mm nearer."""
    spec = RobotSpec(lidar=LidarSpec(beams=180, range_max_m=12.0, mixed=0.0))
    off, hits = seen_wall(5.0, 400, half_m=3.0, spec=spec).T
    assert len(off) < 1.1 * 400
    assert abs(np.average(off, weights=hits)) < 0.004


def test_a_wall_of_which_the_lidar_cuts_off_the_farther_hits_is_not_seen() -> None:
    """Only what noise has shortened comes back: it seemed 30 mm nearer, in scan after scan."""
    assert len(seen_wall(3.45, 100)) < 10
    off, hits = seen_wall(3.2, 100).T
    assert len(off) >= 100 and abs(np.average(off, weights=hits)) < 0.005


def test_no_piece_ends_before_it_begins_or_out_of_sight() -> None:
    """A robot whose lidar was not where its specification says took a wall to end 1e9 m away, and was no more.

    Clutter within reach of a robot that turns: beams run along the lines that are fitted to what they met.
    """
    spec = RobotSpec()
    for seed in range(50):
        rng = np.random.default_rng(seed)
        ranges = np.repeat(rng.uniform(0.12, 0.4, 24), 15) + 0.01 * rng.standard_normal(360)
        way = np.linspace((0.0, 0.0, 0.0), (0.2, 0.0, rng.uniform(-0.6, 0.6)), 11)
        ends = perceive(ranges, spec, way=way).pieces["end"]
        assert (ends[:, 0] < ends[:, 1]).all()
        assert (np.abs(ends) < 2 * spec.lidar.range_max_m + 0.1).all()
