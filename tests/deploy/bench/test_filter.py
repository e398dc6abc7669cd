"""The filter's benchmark measures what it says: faults are faults, the grid is a grid, bars judge."""

import copy
import io
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from deploy.bench.filter import ambiguous, cost, storage, trials
from deploy.bench.filter.ambiguous import double_walls
from deploy.bench.filter.faults import KINDS, Fault
from deploy.bench.filter.recording import HERE, ScanRecording, record
from deploy.bench.filter.storage import CELLS_PER_BYTE, _cell_for
from deploy.bench.filter.trials import STAYS, WITHIN, _draw_seen, _scans_until_gone, measure_faults
from deploy.bench.tables import Table, columns, row_of
from deploy.metrics import score
from deploy.occupancy_grid import OccupancyGrid
from deploy.sensing import named, of_benchmark
from protocol.messages import LidarSpec, RobotSpec
from world import worldfile
from world.coverage import GRAZING_RAD
from world.lidar.lidar import Lidar


@pytest.fixture(scope="module")
def recording() -> ScanRecording:
    return record("apartment", 0, limit_s=60.0)


def test_a_recording_replayed_gives_the_map_and_fits_its_truth(recording: ScanRecording) -> None:
    mind = recording.new_filter()
    for tick in range(len(recording.scans)):
        recording.show(mind, tick)
    got = score(mind.wireframe(), HERE, recording.truth)
    assert got.wall_precision > 0.95 and got.wall_recall > 0.2  # a minute's worth
    assert got.wall_rmse_m is not None and got.wall_rmse_m < 0.02


def test_a_recording_with_real_sensing_is_shown_there_and_back_without_a_jump() -> None:
    run = record("apartment", 0, limit_s=20.0, real=True)
    mind, last = run.new_filter(), len(run.scans) - 1
    assert np.hypot(*(np.array(run.poses)[:, :2] - np.array([way[-1, :2] for way in run.ways])).T).max() > 0.05
    for tick in range(2 * last + 1):
        run.show(mind, tick)
        assert run.at(tick) == min(tick, 2 * last - tick)
        assert math.dist(mind.pose[:2], run.poses[run.at(tick)][:2]) < 0.05
    assert run.at(2 * last + 1) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_makes_a_right_map_wrong_and_leaves_it_sound(recording: ScanRecording, kind: str) -> None:
    mind = recording.new_filter(2)
    for tick in range(len(recording.scans)):
        recording.show(mind, tick)
    rng = np.random.default_rng(0)
    made = 0
    for _ in range(5000):
        near = np.array(recording.poses[int(rng.integers(len(recording.poses)))][:2])
        fault = KINDS[kind](mind.edges[mind.best][: mind.counts[mind.best]], recording.truth, near, rng)
        if fault is None or not fault.gone(mind.wireframe()):
            continue
        spoiled = copy.deepcopy(mind)
        for p in (0, 1):
            count = fault.inject(spoiled.edges[p], int(spoiled.counts[p]))
            if count is None:
                break
            spoiled.counts[p] = count
        else:
            assert not fault.gone(spoiled.wireframe())
            spoiled.wireframe().check()
            assert_sound(spoiled.edges[spoiled.best, : spoiled.counts[spoiled.best]])
            made += 1
        if made == 3:
            return
    pytest.fail(f"only {made} places for {kind}")


def test_scans_that_see_a_moved_corner_see_both_of_its_walls_no_flatter_than_the_scorer_asks(
    recording: ScanRecording,
) -> None:
    """A corner that was seen along one of its walls cannot be mended: no beam meets that wall."""
    mind = recording.new_filter()
    for tick in range(len(recording.scans)):
        recording.show(mind, tick)
    drawn = _draw_seen("moved-corner", mind, recording, len(recording.scans), np.random.default_rng(0))
    assert drawn is not None
    fault, views = drawn
    assert views.sum() >= WITHIN + STAYS and len(np.unique(fault.normals.round(6), axis=0)) == 2
    for x, y, _ in np.array(recording.poses)[views]:
        away = (x, y) - fault.samples
        assert ((away * fault.normals).sum(1) > math.sin(GRAZING_RAD) * np.hypot(*away.T)).all()


def test_trials_that_find_no_place_until_the_end_are_made_on_the_way_back(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []

    def draw(kind: str, mind: object, run: ScanRecording, tick: int, rng: object) -> tuple[Fault, np.ndarray] | None:
        if tick < len(run.scans):
            return None
        made.append(tick)
        nothing, right = np.zeros((0, 2)), lambda wireframe: True
        return Fault(np.zeros(2), nothing, nothing, lambda edges, count: count, right), np.ones(len(run.scans), bool)

    monkeypatch.setattr(trials, "_draw_seen", draw)
    found = measure_faults("apartment", trials=3, particles=None, scopes=["all"], limit_s=40.0)["found"]
    assert {kind: len(some["all"]) for kind, some in found.items()} == dict.fromkeys(KINDS, 3)
    assert set(made) == {201}  # the first tick after a drive of 40 s


def assert_sound(edges: np.ndarray[Any, Any]) -> None:
    """Links go both ways, linked ends are in one place, and every wall's sums lie along its line."""
    for k, wall in enumerate(edges):
        if wall["kind"] != 1:
            continue
        tail, head = wall["tip"]
        unit = np.array([wall["ux"], wall["uy"]])
        assert np.linalg.det([unit, head - tail]) == pytest.approx(0, abs=1e-6) and unit @ (head - tail) > 0
        assert math.hypot(*unit) == pytest.approx(1)
        scatter = np.array([[wall["xx"], wall["xy"]], [wall["xy"], wall["yy"]]])
        assert np.abs(np.linalg.eigh(scatter)[1][:, 1] @ unit) == pytest.approx(1, abs=1e-3)
        for side in (0, 1):
            other = int(wall["link"][side])
            if other >= 0:
                assert edges[other]["kind"] == 1 and edges[other]["link"][1 - side] == k
                np.testing.assert_allclose(edges[other]["tip"][1 - side], wall["tip"][side], atol=1e-6)


class Scripted:
    """A filter whose map is right after some scans and wrong after others."""

    def __init__(self, right: Iterator[bool]) -> None:
        self.right = right

    def update(self, scan: object, pose: object) -> None:
        self.now = next(self.right)

    def wireframe(self) -> bool:
        return self.now


@pytest.mark.parametrize(
    ("script", "scans"),
    [
        ([True] * STAYS, 1),
        ([False] * 3 + [True] * STAYS, 4),
        ([True] * (STAYS - 1) + [False] + [True] * STAYS, STAYS + 1),  # came back
        ([False] * (WITHIN - 1) + [True] * STAYS, WITHIN),
        ([False] * WITHIN, None),
    ],
)
def test_a_fault_is_gone_when_the_map_stays_right(
    recording: ScanRecording, script: list[bool], scans: int | None
) -> None:
    nothing = np.zeros((0, 2))
    fault = Fault(np.zeros(2), nothing, nothing, lambda edges, count: count, lambda wireframe: bool(wireframe))
    views = np.zeros(len(recording.scans), np.bool_)
    views[::2] = True  # only these count
    steps = (right for one in script for right in (one, False))
    assert _scans_until_gone(Scripted(steps), fault, views, recording, 0) == scans  # type: ignore[arg-type]


def test_a_grid_has_walls_where_beams_end_and_free_space_before() -> None:
    room = worldfile.from_document(
        {"boxes": [[0, 1.1, 0, 4.4, 0.2], [0, -1.1, 0, 4.4, 0.2], [2.1, 0, 0, 0.2, 2.4], [-2.1, 0, 0, 0.2, 2.4]]}
    )
    poses = np.array([[x, 0.1, x] for x in np.linspace(-1.5, 1.5, 15)])
    lidar = Lidar(room.segments, LidarSpec())
    ranges, _ = lidar.trace(poses)
    grid = OccupancyGrid((-2.2, -1.2, 2.2, 1.2), 0.05, 3.5).add(ranges, lidar.rays(poses))
    cells = grid.occupied()
    off = np.minimum(np.abs(np.abs(cells[:, 0]) - 2), np.abs(np.abs(cells[:, 1]) - 1))
    assert off.max() <= 0.05 + 1e-9 and len(cells) > 0.9 * 12 / 0.05
    assert grid.log_odds[44 + 3, 24] < 0  # the middle of the room
    assert grid.log_odds[0, 0] == 0  # inside the wall


def test_a_grid_is_as_fine_as_its_bytes_allow(recording: ScanRecording) -> None:
    outline = recording.truth.outline.reshape(-1, 2)
    width, height = outline.max(0) - outline.min(0)
    for size in (500, 5000):
        cell = _cell_for(recording, size)
        cells = math.ceil(width / cell) * math.ceil(height / cell)
        assert 0.9 * size < cells / CELLS_PER_BYTE <= size


@pytest.mark.parametrize("part", [ambiguous, cost, storage, trials])
def test_the_sensing_that_a_table_declares_is_that_of_its_recordings(
    part: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the benchmark was asked for."""
    seen: list[str] = []

    def explore(settings: dict[str, Any], *_: object) -> None:
        spec = of_benchmark(settings)["spec"]
        seen.append(named(RobotSpec.model_validate(spec)))
        raise InterruptedError

    monkeypatch.setattr("deploy.bench.filter.recording.explore", explore)
    case = part.cases(quick=True)[0]
    with pytest.raises(InterruptedError):
        case.measure(**case.arguments)
    assert all(table.sensing.split(",")[0] == seen[0] == "ideal" for table in part.TABLES)


def test_bars_judge_and_missing_figures_miss() -> None:
    heads = columns("world; recall >= 0.9; rmse <= 0.1")
    rows = [{"world": "a", "recall": 0.9, "rmse": 0.1}, {"world": "b", "recall": 0.8}, {"world": "c", "recall": 0.1}]
    section = Table("one", "One", lambda _: rows, heads, judged=lambda row: row["world"] != "c").section({})
    assert [section.missed(k) for k in range(3)] == [[], ["recall", "rmse"], None]
    assert section.met is False and Table("one", "One", lambda _: rows[:1], heads).section({}).met is True
    assert Table("one", "One", lambda _: rows, heads[:1]).section({}).met is None
    console = Console(width=100, file=io.StringIO())
    with console.capture() as capture:
        section.print(console)
    text = capture.get()
    assert ">= 0.9" in text and "0.8 !" in text and "0.1 !" not in text


def test_a_row_is_made_of_runs_as_its_columns_say_and_lacks_what_a_run_lacks() -> None:
    heads = columns("runs count; wall_recall least; wall_rmse_m most; corner_rmse_m most <= 1")
    runs = [
        {"ended": "complete", "wall_recall": 0.9, "wall_rmse_m": 0.1, "corner_rmse_m": 0.1},
        {"ended": "time", "wall_recall": 0.8, "wall_rmse_m": 0.2, "corner_rmse_m": None},
    ]
    row = row_of(heads, runs, {"world": "a"})
    assert row == {"world": "a", "runs": 2, "wall_recall": 0.8, "wall_rmse_m": 0.2, "corner_rmse_m": None}


def test_the_world_of_double_walls_is_one() -> None:
    world = worldfile.from_document(double_walls())
    assert world.region_of(1.0, 2.0, 0.105) is not None
    assert len(world.segments) > 50
