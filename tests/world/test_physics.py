"""Robots drive as commanded, stop at walls, push each other, and do it the same each time."""

import hashlib
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from protocol.messages import RobotSpec
from world import worldfile
from world.physics import Physics

SPEC = RobotSpec()
ROOM = np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], float)


def physics(*poses: tuple[float, float, float], walls: np.ndarray = ROOM) -> Physics:  # type: ignore[type-arg]
    return Physics(walls, np.array(poses, float), SPEC, 0.2)


def test_drives_straight_and_turns_as_commanded() -> None:
    body = physics((1, 1, 0.5), (3, 1, 0.0))
    for _ in range(10):
        poses = body.advance(np.array([[0.2, 0.0], [0.0, 1.0]]))
    went = math.hypot(poses[0, 0] - 1, poses[0, 1] - 1)
    assert went == pytest.approx(0.4, abs=0.005)  # less one step of starting up
    assert math.atan2(poses[0, 1] - 1, poses[0, 0] - 1) == pytest.approx(0.5, abs=1e-6)
    assert poses[1, 2] == pytest.approx(2.0, abs=0.021)
    assert poses[1, :2] == pytest.approx([3, 1], abs=1e-12)


def test_an_arc_closes_to_a_circle() -> None:
    body = physics((2, 1, 0))
    body.advance(np.array([[0.2, 0.5]]))
    track = np.array([body.advance(np.array([[0.2, 0.5]]))[0, :2] for _ in range(130)])
    middle = (track.max(0) + track.min(0)) / 2
    radius = np.hypot(*(track - middle).T)
    assert radius == pytest.approx(0.4, abs=1e-3)


def test_commands_are_clamped() -> None:
    body = physics((1, 1, 0), (1, 2, 0))
    poses = body.advance(np.array([[50.0, 0.0], [0.0, -50.0]]))
    assert poses[0, 0] - 1 <= 0.22 * 0.2 + 1e-9
    assert abs(poses[1, 2]) <= 2.84 * 0.2 + 1e-9


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_command_that_is_not_finite_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        physics((1, 1, 0)).advance(np.array([[bad, 0.0]]))


@pytest.mark.parametrize("heading", [0.0, 0.4, 0.8, 1.0, 1.5])
def test_sinks_one_millimetre_into_a_wall(heading: float) -> None:
    body = physics((3.5, 1.5, heading))
    deepest = []
    for _ in range(200):
        x, y, _ = body.advance(np.array([[0.22, 0.0]]))[0]
        deepest.append(max(x - (4 - SPEC.radius_m), y - (3 - SPEC.radius_m)))
    assert max(deepest) <= 0.22 * 0.02  # at the impact by one step's move at most
    assert -1e-4 <= max(deepest[100:]) <= 0.0011  # then by the slop
    assert body.wall_contacts[0] == 1


def test_slides_along_a_wall_in_many_pieces_as_along_one() -> None:
    cut = np.linspace(0, 4, 81)
    pieces = np.column_stack([cut[:-1], np.zeros(80), cut[1:], np.zeros(80)])
    whole = np.array([[0.0, 0.0, 4.0, 0.0]])
    went = []
    for walls in (whole, pieces):
        body = physics((0.5, 0.2, -0.3), walls=walls)
        for _ in range(60):
            poses = body.advance(np.array([[0.22, 0.0]]))
        went.append(poses[0, 0])
        assert body.wall_contacts[0] == 1
    assert went[1] == pytest.approx(went[0], rel=0.2)


def test_robots_collide_and_push_but_never_overlap() -> None:
    body = physics((1, 1.5, 0), (2, 1.5, math.pi))
    for _ in range(60):
        poses = body.advance(np.array([[0.22, 0.0], [0.22, 0.0]]))
        assert math.dist(poses[0, :2], poses[1, :2]) >= 2 * SPEC.radius_m - 0.003
    assert list(body.robot_contacts) == [1, 1]
    assert list(body.wall_contacts) == [0, 0]
    assert poses[0, 0] == pytest.approx(1.5 - SPEC.radius_m, abs=0.01)


@pytest.mark.parametrize(("speed", "radius"), [(3.0, 0.02), (10.0, 0.01)])
def test_no_speed_takes_a_robot_through_a_wall(speed: float, radius: float) -> None:
    """In steps of more than its own width it was beyond the wall before it touched it."""
    spec = RobotSpec(max_speed_mps=speed, radius_m=radius)
    body = Physics(ROOM, np.array([[1.0, 1.0, 1.0]]), spec, 0.2)
    for _ in range(20):
        poses = body.advance(np.array([[speed, 0.0]]))
    assert 0 < poses[0, 0] < 4 and 0 < poses[0, 1] < 3 and body.wall_contacts[0] > 0


def test_touching_again_counts_again() -> None:
    body = physics((3.6, 1.5, 0))
    for speed in (0.22, -0.22, 0.22, -0.22):
        for _ in range(10):
            body.advance(np.array([[speed, 0.0]]))
    assert body.wall_contacts[0] == 2


def test_goes_on_from_the_state_of_any_tick_to_the_same_bits() -> None:
    """Also while robots touch, and from between two new spaces."""
    closet = ROOM / (4, 3, 4, 3) * 0.52
    starts = (0.15, 0.15, 0.0), (0.38, 0.38, 1.0)
    commands = np.random.default_rng(0).uniform((-0.22, -2), (0.22, 2), (40, 2, 2)).repeat(2, 0)
    body = physics(*starts, walls=closet)
    states, poses, touching = [], [], []
    for command in commands:
        states.append(body.state())
        touching.append(body.touching.any())
        poses.append(body.advance(command))
    assert 10 < sum(touching) < 70 and body.robot_contacts.all()
    for tick in range(0, len(commands), 9):
        again = physics(*starts, walls=closet)
        again.restore(states[tick])
        for command, pose in zip(commands[tick:], poses[tick:], strict=True):
            assert np.array_equal(again.advance(command), pose)
        assert np.array_equal(again.wall_contacts, body.wall_contacts)


DRIVE = """
import hashlib, sys
import numpy as np
from tests.world.test_physics import wild_drive
print(wild_drive())
"""


def wild_drive() -> str:
    """Digest of a drive with many collisions."""
    world = worldfile.load("symmetric")
    rng = np.random.default_rng(3)
    poses = world.starts(12, SPEC.radius_m, rng, drawn=True)
    body = Physics(world.segments, poses, SPEC, 0.2)
    digest = hashlib.sha256()
    for _ in range(300):
        digest.update(body.advance(rng.uniform((0, -1), (0.22, 1), (12, 2))).tobytes())
    assert body.wall_contacts.sum() > 5
    return digest.hexdigest()


def test_bit_identical_in_another_process() -> None:
    root = Path(__file__).parents[2]
    there = subprocess.run(
        [sys.executable, "-c", DRIVE],
        cwd=root,
        env={"PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert there.stdout.strip() == wild_drive()
