"""People walk about without touching anything, and a run with them is as repeatable as one without."""

import numpy as np
import pytest
import shapely

from agent.config import AgentConfig
from deploy import inprocess
from protocol.messages import Action, LidarSpec, RobotSpec
from tests.scripted import Wanderer
from tests.tiny import digests
from world import worldfile
from world.config import WorldConfig
from world.episode import Episode
from world.people import COAT_M, GAP_M, LEG_M, SPEEDS_MPS, People
from world.tick import Outputs
from world.worldfile import WorldFileError

CONFIG = WorldConfig(world="office", robots=2, people=4, until=20.0, spec=RobotSpec(lidar=LidarSpec(turning=True)))


def crowd(count: int, seed: int = 1, radius_m: float = 0.105) -> People:
    office = worldfile.load("office")
    return People(count, office, office.spawns[:2], radius_m, 0.2, np.random.default_rng(seed))


def test_they_walk_stay_clear_of_walls_and_stop_before_others() -> None:
    office, people = worldfile.load("office"), crowd(6)
    robots = office.spawns[:2, :2].copy()
    went = np.zeros(6)
    shapely.prepare(office.solid)
    for _ in range(3000):
        before = people.places.copy()
        people.advance(robots)
        moved = np.hypot(*(people.places - before).T)
        went += moved
        assert moved.max() <= SPEEDS_MPS[1] * 0.2 + 1e-9
        for person, place in enumerate(people.places):
            others = np.vstack([robots, np.delete(people.places, person, 0)])
            assert np.hypot(*(others - place).T).min() > GAP_M - 1e-9
        discs = people.bodies(3).reshape(-1, 3)
        assert (shapely.distance(office.solid, shapely.points(discs[:, :2])) > discs[:, 2]).all()
    assert (went > 60).all() and went.mean() > 150  # of 600 s


def test_they_stay_clear_of_robots_of_any_width() -> None:
    """They walked into robots of more than half a metre."""
    radius_m, robots = 0.8, worldfile.load("office").spawns[:2, :2]
    people = crowd(6, radius_m=radius_m)
    for _ in range(300):
        people.advance(robots)
        discs = people.bodies(1)[0]
        apart = np.hypot(*(discs[:, None, :2] - robots).T) - discs[:, 2] - radius_m
        assert apart.min() > 0
        among = np.hypot(*(people.places[:, None] - people.places).T) + 9 * np.eye(6)
        assert among.min() > GAP_M - 1e-9


def test_their_bodies_move_evenly_from_tick_to_tick() -> None:
    people, office = crowd(4), worldfile.load("office")
    last = people.bodies(11)
    assert sorted(last[0, :, 2]) == [LEG_M] * 4 + [COAT_M] * 2
    jumps = []
    for _ in range(400):
        people.advance(office.spawns[:2, :2])
        now = people.bodies(11)
        assert np.array_equal(now[-1:], people.bodies(1))
        jumps.append(np.hypot(*(now[0, :2, :2] - last[-1, :2, :2]).T).max())  # coats, which do not turn
        last = now
    assert max(jumps) < 1e-9


def test_who_stands_in_a_robots_way_goes_elsewhere() -> None:
    left = 0
    for seed in range(10):
        people = crowd(1, seed)
        robot = people.places + np.array([[0.55, 0.0]])
        for _ in range(60):
            people.advance(robot)
        left += np.hypot(*(people.places - robot).T)[0] > 0.7
    assert left >= 9  # but in a corner


def test_runs_with_people_repeat_and_people_cover_nothing(tmp_path) -> None:  # type: ignore[no-untyped-def]
    for name in ("one", "two"):
        inprocess.run(CONFIG, AgentConfig(), tmp_path / name, make_mind=Wanderer)  # type: ignore[arg-type]
    assert digests(tmp_path / "one") == digests(tmp_path / "two")
    with_, without = (Episode(CONFIG.model_copy(update={"people": count}), None) for count in (4, 0))
    differs = 0
    for tick in range(100):
        scans = [episode.inputs()["r1"].observation.scan() for episode in (with_, without)]
        differs += not np.array_equal(*scans, equal_nan=True)
        for episode in (with_, without):
            still = {robot: Outputs([], Action(tick=tick, speed_mps=0, turn_rps=0), None) for robot in episode.robots}
            episode.advance(still)
    assert differs > 0
    assert with_.coverage["r1"] <= without.coverage["r1"]  # they hide walls, and are none


def test_a_world_without_room_says_so() -> None:
    narrow = worldfile.from_document(
        {"boxes": [[0, 0.3, 0, 4, 0.1], [0, -0.3, 0, 4, 0.1], [-2, 0, 0, 0.1, 0.7], [2, 0, 0, 0.1, 0.7]]}
    )
    with pytest.raises(WorldFileError, match="no room for 1 people"):
        People(1, narrow, np.zeros((1, 3)), 0.105, 0.2, np.random.default_rng(0))
