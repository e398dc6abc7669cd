"""Wheels that are wrong all the time are found out by the scans that correct the pose."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from agent.mapping.joint import BEGIN, WALLS
from agent.mapping.kalman import observe
from agent.mapping.wheels import Wheels, moves_of
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, relative
from protocol.messages import OdometrySpec
from world.odometry import Odometry

SPEC = OdometrySpec(noisy=True)
STEPS, RATE_HZ = 5, 5.0
PLACE_SD, HEADING_SD = 0.003, math.radians(0.15)  # of a pose that a scan has corrected


def drive(ticks: int) -> list[np.ndarray]:
    """The true way of each tick, (STEPS, 3): bends to both sides at full speed."""
    ways, pose = [], (0.0, 0.0, 0.0)
    for tick in range(ticks):
        turn, way = math.sin(0.1 * tick), []
        for _ in range(STEPS):
            angle, length = turn * 0.2 / STEPS, 0.22 * 0.2 / STEPS
            pose = compose(pose, (length * math.cos(angle / 2), length * math.sin(angle / 2), angle))
            way.append(pose)
        ways.append(np.array(way))
    return ways


def test_of_a_lidar_that_takes_long_to_turn_the_last_move_counts() -> None:
    """Half a move was the most that counted: what the wheels were said to drive grew without bounds."""
    wheels, joint = Wheels(SPEC, 1, 0.2), np.zeros((1, WALLS, WALLS))
    joint[:, :6, :6] = wheels.first
    told = np.tile((0.01, 0.0, 0.0), (100, 1))
    for k in range(200):
        wheels.move(np.zeros((1, 3)), joint, told if k % 2 else 0.9 * told)
    assert 0.8 < wheels.steady[0] < 1.1


def test_the_worst_wheels_that_settings_allow_are_possible() -> None:
    """A bound in rad a metre refused the checkpoints of robots with short axles."""
    spec = OdometrySpec(noisy=True, wheel_sd=0.2, axle_sd=0.2, axle_m=0.01)
    wheels = Wheels(spec, 1, RATE_HZ)
    sd = np.sqrt(np.diag(wheels.first)[3:])
    assert wheels.are_possible(wheels.constants + 3 * sd) and wheels.are_possible(wheels.constants - 3 * sd)
    assert not wheels.are_possible(np.array([[0.0, 0.0, 1.0]]))


def joint_of(wheels: Wheels) -> Floats:
    """(1, m, m) joint covariance at the start, without walls."""
    joint = np.zeros((1, WALLS, WALLS))
    joint[:, :6, :6] = wheels.first
    return joint


def straight(ticks: int) -> list[np.ndarray]:
    """The same straight on."""
    length = 0.22 * 0.2
    return [
        np.column_stack((length * (tick + np.arange(1, STEPS + 1) / STEPS), np.zeros((STEPS, 2))))
        for tick in range(ticks)
    ]


def learned(
    seed: int, ticks: int, drive: Callable[[int], list[np.ndarray]] = drive
) -> tuple[Wheels, Floats, Odometry, float]:
    """Wheels after a drive, the joint covariance, the true ones, and by how far the last 10 m by wheels end off."""
    rng = np.random.default_rng(seed)
    real, wheels, poses, stamp = (
        Odometry(np.zeros(3), SPEC, rng),
        Wheels(SPEC, 1, RATE_HZ),
        np.zeros((1, 3)),
        np.zeros(3),
    )
    joint = joint_of(wheels)
    blind: Pose = (0.0, 0.0, 0.0)
    ways = drive(ticks)
    from_tick = ticks - round(10 / 0.044)
    for tick, way in enumerate(ways):
        told = real.update(way)
        moves, stamp = moves_of(np.vstack((stamp, told))), told[-1]
        if tick >= from_tick:
            x, y, theta = wheels.way(moves, 0)[-1].tolist()
            blind = compose(blind, (x, y, theta))
        wheels.move(poses, joint, moves)
        shift = np.zeros(WALLS)
        for k, sd in enumerate((PLACE_SD, PLACE_SD, HEADING_SD)):
            off = way[-1, k] + rng.normal(0, sd) - poses[0, k]
            observe(joint[0], shift, np.array((k,)), np.array((1.0,)), off, sd**2, math.inf)
        poses[0] += shift[:3]
        wheels.constants[0] += shift[3:6]
    x, y, _ = relative(tuple(ways[from_tick - 1][-1].tolist()), tuple(ways[-1][-1].tolist()))
    return wheels, joint[0], real, math.hypot(x - blind[0], y - blind[1])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_constants_are_found_within_their_deviations(seed: int) -> None:
    wheels, joint, real, _ = learned(seed, 1000)
    off = wheels.constants[0] - (real._size, real._bend, real._axle)
    sd = np.sqrt(joint.diagonal()[3:6])
    assert (np.abs(off) < 4 * sd).all()
    assert sd[1] < 0.2 * SPEC.wheel_sd * math.sqrt(2) / SPEC.axle_m


def test_a_straight_way_whose_every_step_is_seen_tells_no_false_size_or_axle() -> None:
    off = []
    for seed in range(12):
        wheels, _, real, _ = learned(seed, 600, straight)
        off.append(wheels.constants[0] - (real._size, real._bend, 1.0))
    size, _, axle = np.mean(off, axis=0)
    assert abs(size) < 0.003
    assert abs(axle) < 0.001  # nothing was told of it


def test_dead_reckoning_is_better_by_known_wheels_than_by_none() -> None:
    known = [learned(seed, 1000)[3] for seed in range(4)]
    unknown = [learned(seed, round(10 / 0.044))[3] for seed in range(4)]
    assert np.mean(known) < 0.7 * np.mean(unknown)


def test_wheels_as_they_should_be_change_nothing() -> None:
    wheels, told = Wheels(SPEC, 1, RATE_HZ), np.vstack((np.zeros((1, 3)), drive(3)[2] - drive(3)[1][-1]))
    assert np.allclose(wheels.way(moves_of(told), 0), told, atol=1e-12)
    assert joint_of(wheels)[0, :3, :3].sum() == 0.0


def test_what_turns_the_begin_of_a_revolution_swings_its_end_as_much() -> None:
    wheels, poses = Wheels(SPEC, 1, RATE_HZ), np.zeros((1, 3))
    joint = joint_of(wheels)
    joint[0, 2, 2] = 0.1**2
    wheels.move(poses, joint, np.array([(0.3, 0.1, 0.0)]))
    error = joint[0, BEGIN : BEGIN + 3, 2] / joint[0, BEGIN + 2, 2]
    assert error == pytest.approx((-0.1, 0.3, 1.0), abs=0.01)


def test_a_robot_that_turns_on_the_spot_stays_there_though_odometry_tells_a_little_sideways() -> None:
    """Odometry of a frame beside the axle: what wheels drive more than was told is ahead, however little was told."""
    wheels = Wheels(SPEC, 1, RATE_HZ)
    wheels.constants[0] = 1.0, 0.09, 1.0
    steps = np.array([(ahead, 1e-4, 0.3) for ahead in (-1.6e-5, -1.5e-5, -1.4e-5, 0.0)])
    assert np.abs(np.diff(wheels.way(steps, 0)[:, :2], axis=0)).max() < 1e-3
