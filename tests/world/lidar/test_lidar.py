"""The lidar against a plain reference that tests every beam against every wall."""

import math

import numpy as np
import pytest
import shapely

from protocol.arrays import Floats
from protocol.geometry import relative
from tests.ideal import ideal_lidar
from world import maze, worldfile
from world.lidar.lidar import DISC, NOTHING, Lidar
from world.lidar.readings import readings
from world.way import interpolated

SPEC = ideal_lidar()
ROOM = np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], float)


def reference(segments: Floats, rays: Floats, reach: float, circles: Floats | None = None) -> Floats:
    """Ranges of one scan by GEOS: each of rays (beams, 3) as a line, cut with each wall, and (beams, m, 3) circles."""
    walls = shapely.linestrings(segments.reshape(-1, 2, 2))
    tips = rays[:, :2] + reach * np.stack([np.cos(rays[:, 2]), np.sin(rays[:, 2])], 1)
    out = []
    for k, (ray, tip) in enumerate(zip(rays, tips, strict=True)):
        cut = shapely.intersection(shapely.linestrings([ray[:2], tip]), walls)
        cut = cut[~shapely.is_empty(cut)]
        near = float(shapely.distance(shapely.Point(ray[:2]), cut).min()) if len(cut) else math.inf
        for x, y, radius in [] if circles is None else circles[k].tolist():
            ahead, aside = relative(tuple(ray.tolist()), (x, y, 0.0))[:2]
            if abs(aside) < radius and ahead > radius:
                near = min(near, ahead - math.sqrt(radius**2 - aside**2))
        out.append(near if near <= reach else math.inf)
    return np.array(out)


def agree(got: Floats, want: Floats) -> None:
    assert (np.isinf(got) == np.isinf(want)).mean() > 0.99  # a hit at the very range may go either way
    both = np.isfinite(got) & np.isfinite(want)
    np.testing.assert_allclose(got[both], want[both], atol=1e-6)


@pytest.mark.parametrize("reach", [3.5, 12.0])
def test_agrees_with_every_beam_against_every_wall(reach: float) -> None:
    rng = np.random.default_rng(5)
    world = worldfile.from_document(maze.generate(12, 10, rng))
    poses = world.starts(12, 0.105, rng, drawn=True)
    spec = ideal_lidar(range_max_m=reach, beams=180)
    lidar = Lidar(world.segments, spec)
    ranges = lidar.cast(poses)
    assert np.isfinite(ranges).mean() > 0.5
    for got, rays in zip(ranges, lidar.rays(poses), strict=True):
        agree(got, reference(world.segments, rays, reach))


MOUNTED = {"mount_x_m": -0.03, "mount_y_m": 0.02, "mount_yaw_deg": 170.0}
LIDARS = {
    "burger": ideal_lidar(turning=True),
    "clockwise": ideal_lidar(turning=True, clockwise=True, first_beam_deg=90.0, beams=90),
    "half": ideal_lidar(turning=True, field_of_view_deg=180.0, first_beam_deg=-90.0, beams=180, range_max_m=12.0),
    "mounted": ideal_lidar(turning=True, field_of_view_deg=270.0, first_beam_deg=-135.0, beams=270, **MOUNTED),
    "all-at-once": ideal_lidar(field_of_view_deg=270.0, first_beam_deg=135.0, beams=270, clockwise=True, **MOUNTED),
}


@pytest.mark.parametrize("turn", [0.0, 0.57, -0.57, 4.0, -4.0])
@pytest.mark.parametrize("name", LIDARS)
def test_each_beam_is_cast_at_its_own_moment(name: str, turn: float) -> None:
    spec, rng = LIDARS[name], np.random.default_rng(5)
    world = worldfile.from_document(maze.generate(8, 8, rng))
    starts = world.starts(4, 0.15, rng, drawn=True)
    ways = drives(starts, turn, rng)
    around = np.array([[0.3, 0.0], [-0.2, 0.3], [-0.1, -0.3]])
    bodies = np.concatenate([ways[..., :2], *(ways[::-1, :, :2] + offset for offset in around)], 1)  # some come back
    discs = np.concatenate([bodies, np.full((*bodies.shape[:2], 1), 0.105)], 2)
    lidar = Lidar(world.segments, spec, one_sided=True)
    ranges, met = lidar.trace(ways, discs)
    places = interpolated(discs, spec.moments())
    for robot in range(4):
        others = np.delete(places, robot, 1)
        agree(ranges[robot], reference(world.segments, lidar.rays(ways)[robot], spec.range_max_m, others))
    assert (met <= DISC).any() and (met >= 0).mean() > 0.2
    two_sided = Lidar(world.segments, spec).trace(ways, discs)
    assert np.array_equal(ranges, two_sided[0]) and np.array_equal(met, two_sided[1])


def drives(starts: Floats, turn: float, rng: np.random.Generator) -> Floats:
    """(11, k, 3) ways of robots that begin as they were told before, and in the last steps turn by `turn` a period."""
    ways = np.repeat(starts[None], 11, 0)
    before = rng.uniform(-0.5, 0.5, len(starts))
    for step in range(1, 11):
        turns = before if step == 1 else np.full(len(starts), turn)
        ways[step] = ways[step - 1]
        ways[step, :, 2] += turns / 10
        heading = (ways[step - 1, :, 2] + ways[step, :, 2]) / 2
        ways[step, :, :2] += 0.0044 * np.stack([np.cos(heading), np.sin(heading)], 1)
    return ways


def test_a_period_of_very_many_steps_fits_into_memory() -> None:
    """The largest speed, the smallest body and the slowest lidar took a matrix of all steps by all steps."""
    ways = np.linspace([1.0, 1.0, 0.0], [1.5, 1.0, 0.0], 200_001)[:, None]
    ranges = Lidar(ROOM, ideal_lidar(turning=True, beams=8)).cast(ways)[0]
    assert ranges[[0, 7]] == pytest.approx([4 - 1.0625, math.sqrt(2) * 1.0], abs=1e-9)


def test_rays_begin_where_the_mount_is_at_their_moment() -> None:
    spec = ideal_lidar(turning=True, beams=8, mount_x_m=0.1, mount_yaw_deg=90.0)
    rays = Lidar(ROOM, spec).rays(np.array([[[1.0, 1.0, 0.0]], [[2.0, 1.0, math.pi]]]))[0]
    assert rays[3] == pytest.approx([1.5, 1.1, math.pi / 2 + math.pi / 2 + 3 * math.pi / 4])  # halfway, facing +y
    assert rays[7] == pytest.approx([1.9, 1.0, math.pi + math.pi / 2 + 7 * math.pi / 4])


def test_a_turning_lidar_that_stands_sees_what_one_sees_that_looks_at_once() -> None:
    world = worldfile.load("office")
    poses = world.starts(30, 0.105, np.random.default_rng(2), drawn=True)
    poses[::2, 2] = np.arange(15) * math.pi / 4  # beams through corners and along walls
    for spec in LIDARS.values():
        ranges, met = (
            Lidar(world.segments, spec.model_copy(update={"turning": turning}), one_sided=True).trace(poses)[0]
            for turning in (True, False)
        )
        np.testing.assert_allclose(ranges, met, atol=1e-8)


def test_a_beam_along_a_wall_returns_its_near_end_while_the_lidar_turns() -> None:
    spec = ideal_lidar(turning=True)
    way = np.array([[[0.0, 0.0, 0.0]], [[0.04, 0.0, 0.0]]])
    for wall in ([1.0, 0, 2, 0], [2.0, 0, 1, 0]):
        ranges = Lidar(np.array([wall]), spec).cast(way)[0]
        assert ranges[0] == pytest.approx(1 - 0.04 / 360, abs=1e-9) and np.isinf(ranges[1:]).all()


def test_walls_seen_from_behind_are_hidden_anyway() -> None:
    for name in worldfile.bundled():
        world = worldfile.load(name)
        poses = world.starts(30, 0.105, np.random.default_rng(2), drawn=True)
        both, front = (Lidar(world.segments, SPEC, one_sided=side).trace(poses) for side in (False, True))
        assert np.array_equal(both[0], front[0]) and np.array_equal(both[1], front[1])


def test_what_was_met_is_the_wall_that_the_hit_lies_on() -> None:
    rng = np.random.default_rng(6)
    world = worldfile.from_document(maze.generate(10, 10, rng))
    poses = world.starts(5, 0.105, rng, drawn=True)
    ranges, met = Lidar(world.segments, SPEC).trace(poses)
    robot, beam = np.nonzero(np.isfinite(ranges))
    angle = poses[robot, 2] + beam * 2 * math.pi / 360
    hits = poses[robot, :2] + ranges[robot, beam, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    walls = shapely.linestrings(world.segments[met[robot, beam]].reshape(-1, 2, 2))
    assert shapely.distance(shapely.points(hits), walls).max() < 1e-8
    assert (met[np.isinf(ranges)] == NOTHING).all()


def test_no_leak_through_a_shared_vertex() -> None:
    # beams 0, 45, 90 ... meet corners and wall joints exactly, from many headings
    square = np.array([[1, -1, 1, 0], [1, 0, 1, 1], [1, 1, -1, 1], [-1, 1, -1, -1], [-1, -1, 1, -1]], float)
    for heading in np.linspace(-7, 7, 400):
        spun = rotated(square, heading)
        ranges = Lidar(spun, SPEC).cast(np.array([[0.0, 0.0, heading]]))[0]
        assert np.isfinite(ranges).all()
        assert ranges[0] == pytest.approx(1.0, abs=1e-9)
        assert ranges[45] == pytest.approx(math.sqrt(2), abs=1e-9)


def test_beam_along_a_wall_returns_its_near_end() -> None:
    wall = np.array([[1, 0, 2, 0]], float)
    for heading in np.linspace(-4, 4, 101):
        for ends in (wall, wall[:, [2, 3, 0, 1]]):
            ranges = Lidar(rotated(ends, heading), SPEC).cast(np.array([[0.0, 0.0, heading]]))[0]
            assert ranges[0] == pytest.approx(1.0, abs=1e-9)
            assert np.isinf(ranges[1:]).all()


def test_beam_along_a_wall_within_its_length() -> None:
    ranges = Lidar(ROOM, SPEC).cast(np.array([[2.0, 0.0, 0.3]]))[0]
    assert (ranges == 0).all()  # on a wall every beam starts on it


def test_grazing_beams_stay_on_the_wall() -> None:
    wall = np.array([[-3, 0, 3, 0]], float)
    for off in (1e-3, 1e-6, 1e-8, 1e-12):
        for y in (off, -off):
            ranges = Lidar(wall, SPEC).cast(np.array([[0.2, y, 0.0]]))[0]
            hit = ranges[np.isfinite(ranges)]
            assert len(hit) and (hit >= 0).all() and (hit <= 3.2).all()
            assert ranges.min() <= 2 * off + 1e-9


def test_walls_without_length_are_dropped_and_keep_the_index_of_the_others() -> None:
    walls = np.array([[1, 1, 1, 1], [1, -1, 1, 1]], float)
    ranges, met = Lidar(walls, SPEC).trace(np.array([[0.0, 0.0, 0.0]]))
    assert ranges[0, 0] == pytest.approx(1.0)
    assert met[0, 0] == 1


def test_no_walls_and_no_robots() -> None:
    lidar = Lidar(np.zeros((0, 4)), SPEC)
    assert np.isinf(lidar.cast(np.zeros((1, 3)))).all()
    assert lidar.cast(np.zeros((0, 3))).shape == (0, 360)


def test_range_ends_at_the_maximum() -> None:
    lidar = Lidar(np.array([[3.49, -1, 3.49, 1], [-3.51, -1, -3.51, 1]], float), SPEC)
    ranges = lidar.cast(np.array([[0.0, 0.0, 0.0]]))[0]
    assert ranges[0] == pytest.approx(3.49)
    assert np.isinf(ranges[180])


def test_teammates_are_discs_and_none_is_its_own() -> None:
    poses = np.array([[1.0, 1.0, 0.0], [2.0, 1.0, math.pi]])
    discs = np.hstack([poses[:, :2], np.full((2, 1), 0.105)])
    ranges, met = Lidar(ROOM, SPEC).trace(poses, discs)
    assert ranges[:, 0] == pytest.approx(0.895)
    assert list(met[:, 0]) == [DISC - 1, DISC]
    seen = np.flatnonzero(met[0] == DISC - 1)
    half = math.degrees(math.asin(0.105))
    assert len(seen) == 2 * math.floor(half) + 1
    for beam in seen:  # every hit lies on the rim
        x = 1 + ranges[0, beam] * math.cos(math.radians(beam))
        y = 1 + ranges[0, beam] * math.sin(math.radians(beam))
        assert math.hypot(x - 2, y - 1) == pytest.approx(0.105)
    behind = Lidar(np.array([[1.5, -5, 1.5, 5]], float), SPEC).trace(poses, discs)[1]
    assert (behind > DISC).all()


@pytest.mark.parametrize("turning", [False, True])
def test_a_lidar_beyond_its_own_body_looks_through_the_one_that_it_is_in(turning: bool) -> None:
    poses = np.array([[1.0, 1.0, 0.0], [1.32, 1.0, 0.0]])
    discs = np.hstack([poses[:, :2], np.full((2, 1), 0.105)])
    met = Lidar(ROOM, ideal_lidar(turning=turning, mount_x_m=0.3)).trace(poses, discs)[1]
    assert (met[0] > DISC).all()


def test_chunks_do_not_show() -> None:
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(0.2, 3.8, 45), rng.uniform(0.2, 2.8, 45), rng.uniform(-9, 9, 45)])
    discs = np.hstack([poses[:, :2], np.full((45, 1), 0.05)])
    lidar = Lidar(ROOM, SPEC)
    together = lidar.cast(poses, discs)
    alone = np.vstack([lidar.cast(pose[None], discs) for pose in poses])
    assert np.array_equal(together, alone)


def test_noise_dropouts_and_minimum() -> None:
    spec = ideal_lidar(noise_m=0.02, dropout=0.1)
    lidar = Lidar(ROOM, spec)
    true = np.repeat(lidar.cast(np.array([[2.0, 1.5, 0.0]])), 50, 0)
    out = lidar.measured(true, [np.random.default_rng(i) for i in range(50)])
    assert np.isnan(out).mean() == pytest.approx(0.1, abs=0.01)
    assert not np.isinf(out).any()
    off = (out - true)[np.isfinite(out)]
    assert off.std() == pytest.approx(0.02, rel=0.05)
    assert abs(off.mean()) < 1e-3
    near = lidar.measured(np.full((1, 360), 0.05), [np.random.default_rng(0)])
    assert np.isnan(near).all()
    far = lidar.measured(np.full((1, 360), 3.5), [np.random.default_rng(0)])
    assert far[np.isfinite(far)].max() <= 3.5 and np.isinf(far).any()
    assert np.array_equal(
        np.isnan(lidar.measured(np.full((1, 360), np.inf), [np.random.default_rng(0)])), np.isnan(far)
    )
    again = lidar.measured(true, [np.random.default_rng(i) for i in range(50)])
    assert np.array_equal(out, again, equal_nan=True)


def test_noise_grows_with_range() -> None:
    spec = ideal_lidar(beams=4096, noise_share=0.0175)
    out = readings(spec, np.tile([0.2, 0.5, 1.0, 3.0], 1024)[None].repeat(8, 0), rngs(8))
    off = (out - np.tile([0.2, 0.5, 1.0, 3.0], 1024)).reshape(8, -1, 4)
    assert np.nanstd(off, axis=(0, 1)) == pytest.approx([0.01, 0.01, 0.0175, 0.0525], rel=0.04)
    assert np.isinf(readings(spec, np.full((1, 4096), np.inf), rngs(1))).all()


@pytest.mark.parametrize(("turned", "lost"), [(90, 0.0), (30, 0.0001), (8, 0.07), (3, 0.3679), (0.3, 0.905)])
def test_grazing_beams_are_lost(turned: float, lost: float) -> None:
    # one wall, on which beams of a narrow view fall nearly alike
    spec = ideal_lidar(beams=1000, grazing_deg=3, range_max_m=50).model_copy(update={"field_of_view_deg": 0.01})
    wall = rotated(np.array([[-40.0, 0.0, 40.0, 0.0]]), math.radians(turned)) + np.array([1.0, 0, 1, 0])
    lidar = Lidar(wall, spec)
    ranges, met = lidar.trace(np.zeros((1, 3)))
    assert (met == 0).all()
    out = lidar.measured(ranges.repeat(10, 0), rngs(10), met.repeat(10, 0), lidar.rays(np.zeros((1, 3))).repeat(10, 0))
    assert np.isnan(out).mean() == pytest.approx(lost, abs=0.012)
    assert not np.isinf(out).any()


def test_what_meets_no_wall_grazes_none() -> None:
    """With 90 degrees a third of the beams into open space, and at teammates, was lost."""
    lidar = Lidar(np.array([[9.0, -1, 9, 1]]), ideal_lidar(grazing_deg=90))
    ranges, met = lidar.trace(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.1]]))
    out = lidar.measured(ranges, rngs(1), met, lidar.rays(np.zeros((1, 3))))
    assert np.isfinite(out).sum() == np.isfinite(ranges).sum() > 5 and not np.isnan(out).any()


def test_readings_at_an_edge_lie_between_its_surfaces() -> None:
    walls = np.array([[1.0, 5, 1, 0.003], [2.0, 5, 2, -5], [1.0, -0.4, 1, -5]])
    spec = ideal_lidar(noise_m=0, mixed=0.2, dropout=0.1)
    lidar = Lidar(walls, spec)
    ranges, met = lidar.trace(np.zeros((1, 3)))
    out = lidar.measured(ranges.repeat(4000, 0), rngs(4000), met.repeat(4000, 0), lidar.rays(np.zeros((4000, 3))))
    same = (out == ranges) | np.isnan(out) | np.isinf(ranges)
    edges = np.flatnonzero(~same.all(0))
    assert list(edges) == [0, 1, 338, 339]
    for near, far in ((1, 0), (338, 339)):
        between = out[:, [near, far]][~same[:, [near, far]]]
        assert (between > ranges[0, near]).all() and (between < ranges[0, far]).all()
        assert (~same[:, near] | ~same[:, far]).mean() == pytest.approx(0.2, abs=0.03)
    assert np.isnan(out[:, :10]).mean() == pytest.approx(0.1, abs=0.01)


def rngs(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(k) for k in range(count)]


def rotated(segments: Floats, angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    return np.hstack([segments[:, :2] @ turn, segments[:, 2:] @ turn])
