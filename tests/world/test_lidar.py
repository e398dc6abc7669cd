"""The lidar against a plain reference that tests every beam against every wall."""

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from protocol.messages import LidarSpec
from world import maze, worldfile
from world.lidar import DISC, NOTHING, Lidar

SPEC = LidarSpec()
ROOM = np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], float)


def reference(segments: NDArray[np.float64], pose: NDArray[np.float64], beams: int, reach: float) -> list[float]:
    """Ranges of one scan by GEOS: each beam as a line, cut with each wall."""
    walls = shapely.linestrings(segments.reshape(-1, 2, 2))
    angles = pose[2] + np.arange(beams) * 2 * math.pi / beams
    tips = pose[:2] + reach * np.stack([np.cos(angles), np.sin(angles)], 1)
    here = shapely.Point(pose[:2])
    out = []
    for tip in tips:
        cut = shapely.intersection(shapely.linestrings([pose[:2], tip]), walls)
        cut = cut[~shapely.is_empty(cut)]
        out.append(float(shapely.distance(here, cut).min()) if len(cut) else math.inf)
    return out


@pytest.mark.parametrize("reach", [3.5, 12.0])
def test_agrees_with_every_beam_against_every_wall(reach: float) -> None:
    rng = np.random.default_rng(5)
    world = worldfile.from_document(maze.generate(12, 10, rng))
    poses = world.starts(12, 0.105, rng, drawn=True)
    spec = LidarSpec(range_max_m=reach, beams=180)
    ranges = Lidar(world.segments, spec).cast(poses)
    for got, pose in zip(ranges, poses, strict=True):
        want = np.array(reference(world.segments, pose, 180, reach))
        assert (np.isinf(got) == np.isinf(want)).mean() > 0.99  # a hit at the very range may go either way
        both = np.isfinite(got) & np.isfinite(want)
        assert both.sum() > 90
        np.testing.assert_allclose(got[both], want[both], atol=1e-6)


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
    assert (met[:, 0] == DISC).all()
    seen = np.flatnonzero(met[0] == DISC)
    half = math.degrees(math.asin(0.105))
    assert len(seen) == 2 * math.floor(half) + 1
    for beam in seen:  # every hit lies on the rim
        x = 1 + ranges[0, beam] * math.cos(math.radians(beam))
        y = 1 + ranges[0, beam] * math.sin(math.radians(beam))
        assert math.hypot(x - 2, y - 1) == pytest.approx(0.105)
    behind = Lidar(np.array([[1.5, -5, 1.5, 5]], float), SPEC).trace(poses, discs)[1]
    assert not (behind == DISC).any()


def test_chunks_do_not_show() -> None:
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(0.2, 3.8, 45), rng.uniform(0.2, 2.8, 45), rng.uniform(-9, 9, 45)])
    discs = np.hstack([poses[:, :2], np.full((45, 1), 0.05)])
    lidar = Lidar(ROOM, SPEC)
    together = lidar.cast(poses, discs)
    alone = np.vstack([lidar.cast(pose[None], discs) for pose in poses])
    assert np.array_equal(together, alone)


def test_noise_dropouts_and_minimum() -> None:
    spec = LidarSpec(noise_m=0.02, dropout=0.1)
    lidar = Lidar(ROOM, spec)
    true = np.repeat(lidar.cast(np.array([[2.0, 1.5, 0.0]])), 50, 0)
    out = lidar.measured(true, [np.random.default_rng(i) for i in range(50)])
    assert np.isinf(out).mean() == pytest.approx(0.1, abs=0.01)
    off = (out - true)[np.isfinite(out)]
    assert off.std() == pytest.approx(0.02, rel=0.05)
    assert abs(off.mean()) < 1e-3
    near = lidar.measured(np.full((1, 360), 0.05), [np.random.default_rng(0)])
    assert np.isinf(near).all()
    far = lidar.measured(np.full((1, 360), 3.5), [np.random.default_rng(0)])
    assert far[np.isfinite(far)].max() <= 3.5
    again = lidar.measured(true, [np.random.default_rng(i) for i in range(50)])
    assert np.array_equal(out, again)


def rotated(segments: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    return np.hstack([segments[:, :2] @ turn, segments[:, 2:] @ turn])
