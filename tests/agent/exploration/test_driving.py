"""Drive control: arrives, and touches nothing."""

import math

import numpy as np
import pytest

from agent.exploration import driving
from agent.exploration.config import DrivingConfig
from agent.exploration.driving import Driver, Obstacles
from agent.exploration.path import ARRIVED_M, GIVE_M
from agent.geometry.clearance import distance_to_walls
from protocol.geometry import compose
from protocol.messages import RobotSpec
from tests.agent.exploration.test_planning import ROOMY_M, Roads, chain, go, room, two_rooms

SPEC = RobotSpec()
CONFIG = DrivingConfig()
TICK_S = 1 / SPEC.lidar.rate_hz
DRIVER = Driver(CONFIG, SPEC)
NOBODY = np.zeros((0, 2))


def drive(pose, path, walls, discs=NOBODY, seconds=60.0, clearance=ROOMY_M - GIVE_M):
    """Follow the path as the world would let the robot; returns poses and the least distance from a wall."""
    x, y, theta = pose
    poses, least = [(x, y, theta)], math.inf
    for _ in range(round(seconds / TICK_S)):
        if math.hypot(path[-1, 0] - x, path[-1, 1] - y) < 0.05:
            break
        motion = DRIVER.follow(path, (x, y, theta), Obstacles(walls, discs), clearance)
        assert 0 <= motion.speed_mps <= SPEC.max_speed_mps
        assert abs(motion.turn_rps) <= SPEC.max_turn_rps
        for _ in range(10):
            dt = TICK_S / 10
            x += motion.speed_mps * dt * math.cos(theta + 0.5 * dt * motion.turn_rps)
            y += motion.speed_mps * dt * math.sin(theta + 0.5 * dt * motion.turn_rps)
            theta += dt * motion.turn_rps
            least = min(least, distance_to_walls(x, y, walls))
        poses.append((x, y, theta))
    return np.array(poses), least


@pytest.mark.parametrize("heading", [0.0, 1.5, math.pi, -2.0])
@pytest.mark.parametrize("door", [0.5, 0.9])
def test_a_door_is_driven_through_without_a_touch(door, heading):
    wireframe = two_rooms(door)
    _, path = go(Roads(wireframe, np.array((1.0, 0.5)), ROOMY_M), 5.0, 0.5)
    poses, least = drive((1.0, 0.5, heading), path, wireframe.segments())
    assert math.hypot(*(poses[-1, :2] - path[-1])) < 0.05
    assert least > SPEC.radius_m + 0.02
    assert len(poses) * TICK_S < 1.35 * 4.5 / SPEC.max_speed_mps


def test_a_path_through_a_wall_is_not_driven():
    walls = np.array([[1.0, -2.0, 1.0, 2.0]])
    poses, least = drive((0.0, 0.0, 0.0), np.array(((0.0, 0.0), (2.0, 0.0))), walls, seconds=20)
    assert least >= SPEC.radius_m + CONFIG.wall_air_m - 1e-6
    assert poses[-1, 0] > 0.7  # it went as far as it could


def test_any_command_is_safe_from_any_place_in_a_room():
    walls = chain(room(1.5, 1.5)).segments()
    rng = np.random.default_rng(1)
    for _ in range(200):
        x, y, theta = rng.uniform((0.13, 0.13, -4), (1.37, 1.37, 4))
        before = distance_to_walls(x, y, walls)
        motion = DRIVER.safely(rng.uniform(0, 0.22), rng.uniform(-2.84, 2.84), (x, y, theta), Obstacles(walls, NOBODY))
        for _ in range(10):
            x += motion.speed_mps * 0.02 * math.cos(theta)
            y += motion.speed_mps * 0.02 * math.sin(theta)
            theta += 0.02 * motion.turn_rps
            clear = distance_to_walls(x, y, walls)
            assert clear > min(SPEC.radius_m + CONFIG.wall_air_m, before) - 2e-3


def test_a_robot_too_near_to_a_wall_may_leave_it():
    walls = np.array([[0.0, -2.0, 0.0, 2.0]])
    assert DRIVER.safely(0.2, 0.0, (0.107, 0.0, 0.0), Obstacles(walls, NOBODY)).speed_mps == 0.2
    assert DRIVER.safely(0.2, 0.0, (0.107, 0.0, math.pi), Obstacles(walls, NOBODY)).speed_mps == 0.0


def test_a_standing_teammate_is_passed_at_a_distance():
    walls = chain(room(4, 2)).segments()
    disc = np.array([[2.0, 1.0]])
    poses, _ = drive((0.5, 1.0, 0.0), np.array(((0.5, 1.0), (3.5, 1.0))), walls, disc)
    assert math.hypot(*(poses[-1, :2] - (3.5, 1.0))) < 0.05
    assert np.hypot(*(poses[:, :2] - disc).T).min() >= 2 * SPEC.radius_m + CONFIG.teammate_air_m - 1e-3
    beside = poses[np.abs(poses[:, 0] - 2.0).argmin()]
    assert beside[1] < 1.0  # on the right


@pytest.mark.parametrize("radius_m", [SPEC.radius_m, 0.6, 2.0])
def test_two_robots_that_meet_pass_each_other_however_large_they_are(radius_m):
    """From 0.57 m on they stood before each other for ever."""
    spec, far = RobotSpec(radius_m=radius_m), 8.0
    driver, poses, walls = Driver(CONFIG, spec), [(0.0, 0.0, 0.0), (far, 0.0, math.pi)], np.zeros((0, 4))
    for _ in range(300):
        motions = []
        for (x, y, theta), other, end in zip(poses, poses[::-1], (2 * far, -far), strict=True):
            obstacles = Obstacles(walls, np.array([other[:2]]))
            motions.append(driver.follow(np.array(((x, y), (end, 0.0))), (x, y, theta), obstacles, radius_m))
        ways = [(motion.speed_mps * TICK_S, 0.0, motion.turn_rps * TICK_S) for motion in motions]
        poses = [compose(pose, way) for pose, way in zip(poses, ways, strict=True)]
        assert math.dist(poses[0][:2], poses[1][:2]) > 2 * radius_m
    assert poses[0][0] > poses[1][0] + 2 * radius_m


@pytest.mark.parametrize(("radius_m", "speed_mps", "behind_m"), [(0.6, 0.5, 1.51), (1.0, 1.0, 2.4), (2.0, 2.0, 5.0)])
def test_a_goal_before_a_parked_teammate_is_reached_however_large_the_robot_is(radius_m, speed_mps, behind_m):
    """It circled about the goal, as it moved over for who stood behind."""
    spec, pose, goal = RobotSpec(radius_m=radius_m, max_speed_mps=speed_mps), (0.0, 0.0, 0.0), (3.0, 0.0)
    driver, obstacles = Driver(CONFIG, spec), Obstacles(np.zeros((0, 4)), np.array([[goal[0] + behind_m, 0.0]]))
    for _ in range(300):
        if there := math.dist(pose[:2], goal) < 0.5 * ARRIVED_M:
            break
        motion = driver.follow(np.array((pose[:2], goal)), pose, obstacles, radius_m)
        pose = compose(pose, (motion.speed_mps * TICK_S, 0.0, motion.turn_rps * TICK_S))
    assert there


@pytest.mark.parametrize(
    "air",
    [{"wall_air_m": 1e-3, "teammate_air_m": 1.0}, dict.fromkeys(("wall_air_m", "tight_path_air_m", "path_air_m"), 1.0)],
)
def test_room_beside_a_teammate_is_looked_for_in_bounded_steps(air, monkeypatch):
    tries = []
    monkeypatch.setattr(driving, "keeps_clear", lambda *_: tries.append(1))  # there is no room at all
    spec = RobotSpec(radius_m=5.0)
    obstacles = Obstacles(np.zeros((0, 4)), np.array([[1.0, 0.0]]))
    assert Driver(DrivingConfig(**air), spec)._aside((0.5, 0.0), 0.0, 0.0, obstacles, 0.5) == (0.5, 0.0)
    assert 0 < len(tries) <= 101


@pytest.mark.parametrize("name", DrivingConfig.model_fields)
def test_air_that_lets_through_no_door_is_refused(name):
    with pytest.raises(ValueError, match="less than or equal to 1"):
        DrivingConfig(**{name: 1e9})
