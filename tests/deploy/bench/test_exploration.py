"""The benchmark of exploration measures what it says: bounds are bounds, the dense robot explores, bars judge."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent.config import AgentConfig
from deploy import inprocess
from deploy.bench.exploration import dense, runs
from deploy.bench.exploration.dense import DenseRobot, _frontiers, _grown, _heard, _pulled, _way
from deploy.bench.exploration.mazes import measure_maze
from deploy.bench.exploration.teams import corridor
from deploy.bench.exploration.tours import best_bound, held_karp, least_ways
from deploy.bench.explored import Driven, explore
from deploy.bench.tables import Section
from deploy.sensing import IDEAL
from protocol.messages import RobotSpec
from world.config import WorldConfig
from world.worldfile import from_document

pytestmark = pytest.mark.system


def room(width: float, height: float, *walls: list[float]) -> dict[str, Any]:
    x, y = width / 2, height / 2
    boxes = [[x, 0, 0, width, 0.1], [x, height, 0, width, 0.1]]
    boxes += [[0, y, math.pi / 2, height + 0.1, 0.1], [width, y, math.pi / 2, height + 0.1, 0.1]]
    return {"name": "room", "units": "m", "boxes": boxes, "walls": list(walls), "spawns": [[1.0, y, 0.0]]}


def best_tour(cost: np.ndarray[Any, Any]) -> float:
    orders = itertools.permutations(range(1, len(cost)))
    return min(sum(cost[a, b] for a, b in itertools.pairwise((0, *order))) for order in orders)


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_of_a_tour_is_below_it_and_near(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 10, (7, 2))
    cost = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    best = best_tour(cost)
    assert 0.9 * best < held_karp(cost) <= best + 1e-9
    found, used = best_bound(cost)
    assert found <= best + 1e-9  # by the triangle inequality fewer places have no longer tour
    assert found > 0.85 * best and used <= 6


def test_what_must_be_driven_down_a_corridor_is_known() -> None:
    """From one end of 20 m the other end's wall is seen from 3.5 m before it: nearly as far must a robot drive."""
    world = from_document(room(20.0, 1.0))
    start = np.array([[0.5, 0.5]])
    cost = least_ways(world, start, RobotSpec())
    assert (cost == cost.T).all() and (cost >= 0).all()
    bound, _ = best_bound(cost)
    true = 20.0 - 0.05 - 3.5 - 0.5
    assert true - 0.5 < bound <= true


def test_no_run_is_shorter_than_its_bound(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(json.dumps(room(7.0, 4.0, [3.0, 0.0, 3.0, 2.9], [5.0, 4.0, 5.0, 1.1])))
    run = explore({"world": str(path), "robots": 1, "max_time_s": 300.0}, {})
    bound, places = best_bound(least_ways(run.episode.world, run.episode.starts[:, :2], run.episode.config.spec))
    figures = run.figures()
    assert figures["coverage"] > 0.99
    assert places > 0 and 1.0 < bound <= figures["path_m"]
    assert 0 < figures["path_90_m"] <= figures["path_99_m"] <= figures["path_m"]


def test_frontiers_are_groups_beside_the_unknown() -> None:
    log_odds = np.zeros((20, 20))
    log_odds[2:12, 2:12] = -1.0
    free = log_odds < 0
    rim = np.ones((10, 10), bool)
    rim[1:-1, 1:-1] = False
    assert np.array_equal(_frontiers(log_odds, free, 4)[2:12, 2:12], rim)
    log_odds[1, 1:13] = log_odds[12, 1:13] = log_odds[1:13, 1] = log_odds[1:13, 12] = 1.0  # walls all around
    assert not _frontiers(log_odds, free, 1).any()
    log_odds[5, 12] = 0.0  # a hole of one cell
    assert _frontiers(log_odds, free, 1).sum() == 1
    assert not _frontiers(log_odds, free, 2).any()


def test_ways_on_the_grid_are_shortest_and_pulled_straight() -> None:
    free = np.ones((30, 30), bool)
    free[15, :25] = False
    goals = np.zeros_like(free)
    goals[25, 3] = True
    way = _way(free, goals, 5, 3, 0.0)
    assert way[0].tolist() == [5, 3] and way[-1].tolist() == [25, 3]
    assert np.abs(np.diff(way, axis=0)).max() == 1 and free[tuple(way.T)].all()
    pulled = _pulled(free, way)
    assert 3 <= len(pulled) <= 5 and pulled[0].tolist() == [5, 3] and pulled[-1].tolist() == [25, 3]
    free[15, 25:] = False
    assert not len(_way(free, goals, 5, 3, 0.0))
    assert _grown(goals, 1.5).sum() == 9


def test_silence_beside_a_wall_too_near_to_be_seen_is_no_free_space() -> None:
    ranges = np.array([1.0, np.inf, 0.13, np.inf, np.inf, 2.0, np.inf, 3.0])
    known = [1.0, np.nan, 0.13, np.nan, np.nan, 2.0, np.inf, 3.0]
    assert np.array_equal(_heard(ranges, 0.2), known, equal_nan=True)


def test_the_dense_robot_explores(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(json.dumps(room(7.0, 4.0, [3.0, 0.0, 3.0, 2.9], [5.0, 4.0, 5.0, 1.1])))
    config = WorldConfig.model_validate({"world": str(path), "robots": 1, "max_time_s": 300.0, "spec": IDEAL})
    minds: list[DenseRobot] = []

    def make(name: str, spec: RobotSpec, settings: AgentConfig, seed: int) -> DenseRobot:
        minds.append(DenseRobot(name, spec, settings, seed, 12.0))
        return minds[-1]

    driven = Driven()
    robot = inprocess.run(config, AgentConfig(), None, driven, make)["robots"]["r1"]
    assert robot["ended"] == "complete" and robot["coverage"] > 0.9 and robot["wall_contacts"] == 0
    assert (minds[0].log_odds < 0).sum() > 0.93 * 6.9 * 3.9 / 0.05**2  # beams step over walls, yet all floor is known
    reached = driven.until["r1"]["path_90_m"]
    assert reached is not None and 1.0 < reached <= robot["path_m"] < 40.0
    raw, packed = minds[0].grid_bytes()
    assert 7.0 * 4.0 / 0.05**2 < raw < 1.6 * 7.0 * 4.0 / 0.05**2 and packed < raw / 10


def test_ours_and_the_dense_one_are_compared_start_by_start() -> None:
    """They were paired by their places, and where one had failed, its layout had no row."""
    rest = dict.fromkeys(("path_90_m", "map_bytes", "filter_bytes", "grid_bytes", "grid_zlib_bytes"), 1.0)
    figures: dict[str, dict[str, Any]] = {
        f"{kind}/hall/{seed}": {"path_99_m": factor * (seed + 1.0), "wall_contacts": 0, **rest}
        for kind, factor, seeds in (("runs", 1.0, (0, 2)), ("dense", 2.0, (2, 1, 0)))
        for seed in seeds
    }
    (hall, every) = dense.TABLES[0].section(figures).rows
    assert hall["ratio"] == every["ratio"] == 0.5 and hall["reached"] == "2 / 2"


def test_a_generated_maze_tells_how_it_ended() -> None:
    found = measure_maze(25)  # the smallest
    assert 8 <= found["width_m"] <= 20 and 8 <= found["height_m"] <= 20
    assert found["ended"] == "complete" and found["silent"] == 0 and found["reason"]


def test_robots_that_meet_must_change_rooms() -> None:
    for seed in range(10):
        world = from_document(corridor(seed))
        starts = world.starts(2, 0.105, np.random.default_rng(0))
        assert starts[0, 0] < -0.9 and starts[1, 0] > 0.9 and np.cos(starts[0, 2]) > 0.99 > 0 > np.cos(starts[1, 2])
        assert np.abs(starts[:, 1]).max() < 0.3 - 0.105


def run_of(**changes: Any) -> dict[str, Any]:
    good = {
        "ended": "complete", "reason": "no frontier left", "silent": 0, "unreachable": 1, "stuck": 0,
        "wall_recall": 1.0, "wall_precision": 1.0, "wall_rmse_m": 0.001, "wall_contacts": 0,
        "t_90": 400.0, "t_99": 450.0, "ended_at": 500.0, "path_m": 100.0, "path_90_m": 80.0, "path_99_m": 90.0,
    }  # fmt: skip
    return good | changes


def filled(name: str, figures: dict[str, Any]) -> Section:
    return next(table for table in runs.TABLES if table.name == name).section(figures)


@pytest.mark.parametrize(
    "changes",
    [{"ended": "time", "silent": None}, {"reason": ""}, {"silent": 1}, {"wall_recall": 0.98}, {"wall_contacts": 1}],
)
def test_one_bad_run_misses_the_bar(changes: dict[str, Any]) -> None:
    good = {f"runs/maze-15/{seed}": run_of() for seed in range(4)}
    assert filled("plain", good).met is True
    assert filled("plain", good | {"runs/maze-15/4": run_of(**changes)}).met is False


def test_the_time_in_the_maze_is_judged_by_its_median() -> None:
    figures = {f"runs/maze-15/{seed}": run_of(ended_at=t) for seed, t in enumerate((500.0, 590.0, 900.0))}
    assert filled("maze-15", figures).met is True
    figures["runs/maze-15/0"] = run_of(ended_at=700.0)
    assert filled("maze-15", figures).met is False


def test_a_run_that_is_not_complete_never_was_and_a_time_that_is_not_reached_is_the_longest() -> None:
    """Its limit counted as the time to complete, and its missing time took the median or was left out."""
    late = run_of(ended="time", ended_at=550.0, t_99=None)
    figures = {f"runs/maze-15/{seed}": run_of() for seed in range(3)} | {"runs/maze-15/3": late}
    (row,) = filled("times", figures).rows
    assert (row["ended_at"], row["ended_at_spread"]) == (500.0, "500-∞")
    assert (row["t_99"], row["t_99_spread"], row["t_90_spread"]) == (450.0, "450-∞", "400-400")
    figures |= {f"runs/maze-15/{seed}": late for seed in range(3)}
    (row,) = filled("times", figures).rows
    assert row["ended_at"] is row["t_99"] is None and row["t_90"] == 400.0
    section = filled("maze-15", figures)
    assert section.rows[0]["ended_at"] is None and section.met is False
    (state,) = filled("policies", {"policies/hall/random-vertex/0": late}).rows
    assert state["ended_at"] is None and state["path_m"] == 100.0
