"""How well what a robot sees before it first moves tells how its frame lies."""

import numpy as np
import pytest

from agent.mapping.edges import EDGE, WALL
from agent.mapping.first_look import UNKNOWN, heading_sd
from agent.mapping.joint import row_of
from protocol.arrays import Records

WALLS = ((2.0, 1.0, 0.0, 1.0), (-1.0, 2.0, -1.0, 0.0), (0.5, -2.0, 0.6, 0.8))  # each a point and a direction


def seen(number: int) -> Records:
    walls = np.zeros(number, EDGE)
    for wall, (x, y, ux, uy) in zip(walls, WALLS, strict=False):
        wall["kind"], wall["x"], wall["y"], wall["ux"], wall["uy"] = WALL, x, y, ux, uy
    return walls


def test_nothing_seen_tells_nothing() -> None:
    assert heading_sd(seen(0), np.zeros((row_of(0), row_of(0))), 0.01) == pytest.approx(UNKNOWN)


@pytest.mark.parametrize("sd_rad", [1e-4, 0.01, 0.05])
def test_one_wall_tells_the_heading_as_its_direction_is_known(sd_rad: float) -> None:
    """Where it lies tells nothing, as the place is unknown, too: no rounding may make a number of that."""
    joint = np.zeros((row_of(1), row_of(1)))
    joint[row_of(0), row_of(0)], joint[row_of(0) + 1, row_of(0) + 1] = 0.001**2, sd_rad**2
    assert heading_sd(seen(1), joint, 0.01) == pytest.approx(sd_rad, rel=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_several_walls_tell_it_as_the_best_fit_of_drawn_errors_says(seed: int) -> None:
    rng, size = np.random.default_rng(seed), row_of(len(WALLS))
    joint, rows, slopes = np.zeros((size, size)), list[int](), []
    for e, (x, y, ux, uy) in enumerate(WALLS):
        line, mixes = slice(row_of(e), row_of(e) + 2), rng.normal(0.0, 1.0, (2, 2)) * np.array([[0.003], [0.02]])
        joint[line, line] = mixes @ mixes.T
        rows += range(line.start, line.stop)
        # a robot that is (a, b) off and turned by c sees the wall farther to its left by what its point moves across
        slopes += [[uy, -ux, -x * ux - y * uy], [0.0, 0.0, -1.0]]
    errs, toward = joint[np.ix_(rows, rows)], np.array(slopes)
    weights = np.linalg.solve(toward.T @ np.linalg.solve(errs, toward), np.linalg.solve(errs, toward).T)
    headings = rng.multivariate_normal(np.zeros(len(rows)), errs, 20_000) @ weights[2]
    assert heading_sd(seen(3), joint, 0.01) == pytest.approx(float(headings.std()), rel=0.03)
