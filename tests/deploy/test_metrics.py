"""Our own score of a map: by hand on small maps, and against the independent scorer."""

import json
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from deploy.metrics import Score, corners_fitted, score, score_walls, truth_of
from protocol.geometry import apply
from protocol.wireframe import Label, Wireframe
from tests.conftest import SHARED
from world import worldfile
from world.recorder import map_fields
from world.worldfile import World

RADIUS, REACH = 0.105, 3.5

ROOM = {"boxes": [[0, 1.1, 0, 4.4, 0.2], [0, -1.1, 0, 4.4, 0.2], [2.1, 0, 0, 0.2, 2.4], [-2.1, 0, 0, 0.2, 2.4]]}
"""4 m by 2 m inside; lidar range does not matter."""


def wireframe(segments: np.ndarray, labels: Label = Label.NOMINAL) -> Wireframe:
    m = len(segments)
    return Wireframe(
        segments.reshape(-1, 2),
        np.full(2 * m, labels, np.uint8),
        np.arange(2 * m, dtype=np.int32).reshape(-1, 2),
        np.ones(m, np.float32),
        np.ones(m, np.bool_),
    )


@pytest.fixture(scope="module")
def room() -> World:
    return worldfile.from_document(ROOM)


def inner(world: World) -> np.ndarray:
    return world.segments[(np.abs(world.segments) < 2.05).all(1)]


def test_a_perfect_map_is_perfect_in_any_frame(room: World) -> None:
    truth = truth_of(room, (0, 0), RADIUS, REACH)
    assert truth.seen_lengths.sum() == pytest.approx(12.0)
    frame = (1.0, -0.4, 2.0)
    c, s = math.cos(frame[2]), math.sin(frame[2])
    walls = (inner(room).reshape(-1, 2) - frame[:2]) @ np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(apply(frame, walls), inner(room).reshape(-1, 2))
    got = score(wireframe(walls.reshape(-1, 4)), frame, truth)
    assert (got.wall_recall, got.wall_precision, got.corner_recall, got.corner_precision) == (1, 1, 1, 1)
    assert got.wall_rmse_m == pytest.approx(0, abs=1e-9) and got.corner_rmse_m == pytest.approx(0, abs=1e-9)
    assert got.repeated == pytest.approx(1, abs=0.02)


def test_a_missing_wall_costs_recall_and_a_false_one_precision(room: World) -> None:
    truth = truth_of(room, (0, 0), RADIUS, REACH)
    long = inner(room)[np.abs(inner(room)[:, 2] - inner(room)[:, 0]) > 3]
    missing = score_walls(long[:1], truth)
    assert missing.recall == pytest.approx(4 / 12, abs=0.01) and missing.precision == 1
    false = score_walls(np.vstack([inner(room), [[0, -1, 0, 1]]]), truth)
    assert false.recall == 1
    assert false.precision == pytest.approx(12 / 14, abs=0.02)
    assert false.rmse_m == pytest.approx(0.3 * math.sqrt(2 / 14), rel=0.05)  # far from any wall alike: capped


def test_a_wall_twice_is_repeated_and_a_shift_is_the_rmse(room: World) -> None:
    truth = truth_of(room, (0, 0), RADIUS, REACH)
    walls = inner(room)
    assert score_walls(np.vstack([walls, walls]), truth).repeated == pytest.approx(2, abs=0.04)
    shifted = walls + np.tile([0.02, 0.02], 2)
    assert score_walls(shifted, truth).rmse_m == pytest.approx(0.02, abs=0.002)
    off = score(wireframe(shifted), (0, 0, 0), truth)
    assert off.corner_rmse_m == pytest.approx(0.02 * math.sqrt(2))
    assert corners_fitted(wireframe(walls), (0.02, -0.01, 0.005), truth) == pytest.approx(0, abs=1e-9)
    open_ended = score(wireframe(walls, Label.OCCLUSION), (0, 0, 0), truth)
    assert open_ended.corner_recall == 0 and open_ended.corner_precision is None


def test_nothing_mapped_is_no_crash(room: World) -> None:
    got = score(Wireframe(), (0, 0, 0), truth_of(room, (0, 0), RADIUS, REACH))
    assert got == (0.0, 0.0, None, 1.0, 0.0, None, None)
    assert corners_fitted(Wireframe(), (0, 0, 0), truth_of(room, (0, 0), RADIUS, REACH)) is None
    with pytest.raises(worldfile.WorldFileError, match="no free space"):
        truth_of(room, (2.1, 0), RADIUS, REACH)


@pytest.mark.parametrize("name", ["maze-15", "symmetric", *map(str, (SHARED / "worlds").glob("drlnav_*.yaml"))])
def test_it_is_the_scorers(scorer: ModuleType, tmp_path: Path, name: str) -> None:
    """A map with noise, gaps, repetitions and false walls, as a run directory for the one and arrays for the other."""
    world = worldfile.load(name)
    start = tuple(world.spawns[0].tolist())
    rng = np.random.default_rng(5)
    walls = world.segments[rng.random(len(world.segments)) < 0.8]
    walls = np.vstack([walls, walls[::7], rng.uniform(-3, 3, (5, 4)) + np.tile(start[:2], 2)])
    walls = walls + rng.normal(0, 0.03, walls.shape)
    c, s = math.cos(start[2]), math.sin(start[2])
    own = ((walls.reshape(-1, 2) - start[:2]) @ np.array([[c, -s], [s, c]])).reshape(-1, 4)
    made = wireframe(own)
    made.labels[rng.random(len(made.labels)) < 0.3] = Label.FRONTIER

    (tmp_path / "maps").mkdir()
    (tmp_path / "maps/r1.json").write_text(json.dumps(map_fields("r1", made)))
    (tmp_path / "world.yaml").write_text(worldfile.to_yaml(world.document))
    facts = {"frames": {"r1": start}, "robot_radius": RADIUS, "lidar_range": REACH}
    (tmp_path / "truth.json").write_text(json.dumps(facts))
    theirs = scorer.score(tmp_path)["maps"]["r1"]
    ours = score(made, start, truth_of(world, start[:2], RADIUS, REACH))
    assert 0.3 < ours.wall_recall < 0.9 and 0.3 < ours.wall_precision < 0.9  # nothing trivial
    # one sample in a thousand may fall into another cell by rounding of the map file
    for field, value in ours._asdict().items():
        assert value == pytest.approx(theirs[field], rel=2e-3), field


def test_the_docs_define_every_measure() -> None:
    page = (Path(__file__).parents[2] / "docs/formats.md").read_text(encoding="utf-8")
    defined = page.partition("## Measures of a map")[2].partition("\n## ")[0]
    assert all(f"| `{measure}` | " in defined for measure in Score._fields)
