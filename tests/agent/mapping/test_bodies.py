"""Teammates leave no wall: where one is seen before it is heard, and where the end of a wall half hides it."""

from dataclasses import replace

import numpy as np
import pytest

from agent.mapping.bodies import NO_TEAMMATES
from agent.perception.perceive import Foreseen, perceive
from protocol.arrays import Floats
from protocol.geometry import Pose
from tests.agent.mapping.test_particle_filter import Place, Walk, ring
from tests.ideal import ideal_lidar

CORRIDOR = ring((0, 0), (9, 0), (9, 2), (0, 2))
STUB = ring((0, 0), (6, 0), (6, 4), (0, 4)) + ring((2, 2), (2, 2.15), (4, 2.15), (4, 2))
"""A room, and a wall that stands free in it."""


class Team(Walk):
    """The same with a teammate, of which the robot may hear."""

    def meet(self, pose: Pose, teammate: Place, told: Floats = NO_TEAMMATES, company: bool = True) -> None:
        """A scan from a pose. told: (t, 3) where the teammate says that it is, frame of the map."""
        bodies = np.array([[*teammate, self.spec.radius_m]])
        ranges = self.lidar.cast(np.array([pose]), bodies)
        measured = np.asarray(self.lidar.measured(ranges, [self.rng])[0], np.float64)
        scan = perceive(measured, self.spec, foreseen=Foreseen(self.discs.expected(pose)), company=company)
        self.discs.add(pose, scan.discs)
        self.filter.update(scan if company else replace(scan, discs=np.zeros((0, 2))), pose, told)

    def walls_near(self, x: float, y: float) -> int:
        """How many walls of the map are within 0.15 m of a place."""
        ends = self.filter.wireframe().segments().reshape(-1, 2, 2)
        return int((np.hypot(*(ends.mean(1) - (x, y)).T) < 0.15).sum())


@pytest.mark.parametrize("seed", range(5))
def test_a_teammate_that_was_seen_before_it_was_heard_is_no_wall_for_long(seed: int) -> None:
    """In a crowd of 30 each parked robot was a wall to those that came, and to all whom they told of it."""
    team = Team(CORRIDOR, ideal_lidar(), seed=seed)
    for k in range(25):
        team.meet((3.5 + 0.04 * k, 1.0, 0.0), (7.0, 1.1), company=False)
    assert team.walls_near(6.9, 1.1) > 0
    walls = len(team.filter.wireframe().edges)
    for k in range(25):
        team.meet((4.5 + 0.04 * k, 1.0, 0.0), (7.0, 1.1), np.array([[7.1, 1.2, 0.3]]))
    assert team.walls_near(6.9, 1.1) == 0
    assert len(team.filter.wireframe().edges) < walls


BESIDE_TIP, TO_TIP, AWAY = (
    (4.0, 2.25),
    [(4.3, 2.7 - 0.09 * k, -1.6) for k in range(12)],
    [(4.2 - 0.012 * k, 1.7 - 0.044 * k, -1.7) for k in range(30)],
)


def past_the_tip(told: Floats) -> Team:
    """A robot that has passed the end of the wall and looks back, where a teammate stands behind it."""
    team = Team(STUB, ideal_lidar(), seed=1)
    for pose in TO_TIP:
        team.meet(pose, (1.0, 3.5))
    for pose in AWAY:
        team.meet(pose, BESIDE_TIP, told)
    return team


def test_a_teammate_half_behind_the_end_of_a_wall_is_no_wall_where_it_says_that_it_is() -> None:
    assert past_the_tip(NO_TEAMMATES).walls_near(4.05, 2.2) == 2  # the tip's face and a piece of the teammate
    assert past_the_tip(np.array([[4.1, 2.35, 0.3]])).walls_near(4.05, 2.2) == 1


def test_a_post_is_a_wall_once_the_teammate_beside_it_has_gone() -> None:
    team = Team(CORRIDOR + ring((5, 1), (5, 1.15), (5.15, 1.15), (5.15, 1)), ideal_lidar())
    for k in range(20):
        team.meet((3.4 + 0.03 * k, 1.0, 0.0), (4.9, 1.7), np.array([[4.9, 1.5, 0.6]]))
    assert team.walls_near(5.0, 1.08) == 0
    for k in range(3):
        team.meet((4.0 + 0.03 * k, 1.0, 0.0), (8.0, 1.7), np.array([[8.0, 1.7, 0.2]]))
    assert team.walls_near(5.0, 1.08) == 1


@pytest.mark.parametrize(("told", "scans"), [(np.array([[5.1, 1.1, 0.3]]), 8), (NO_TEAMMATES, 40)])
def test_a_post_that_a_robot_knows_outlasts_scans_that_take_it_for_a_teammate(told: Floats, scans: int) -> None:
    """In `hall` posts of 0.2 m fit a disc in scan after scan."""
    team = Team(CORRIDOR + ring((5, 1), (5, 1.15), (5.15, 1.15), (5.15, 1)), ideal_lidar())
    for k in range(40):
        team.meet((3.4 + 0.03 * k, 0.8, 0.0), (8.0, 1.7), company=False)
    known = team.walls_near(5.08, 1.08)
    assert known > 0
    ranges = np.asarray(team.lidar.cast(np.array([(4.6, 0.8, 0.0)]))[0], np.float64)
    taken = np.array([(0.48, 0.28, 0.1)])
    for _ in range(scans):
        scan = perceive(ranges, team.spec, foreseen=Foreseen(taken))
        team.filter.update(replace(scan, discs=taken[:, :2]), (4.6, 0.8, 0.0), told)
    assert team.walls_near(5.08, 1.08) == known
