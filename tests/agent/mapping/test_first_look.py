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
    rng = np.random.default_rng(seed)
    joint, blocks, slopes = np.zeros((row_of(3), row_of(3))), [], []
    for e, (x, y, ux, uy) in enumerate(WALLS):
        mixes = rng.normal(0.0, 1.0, (2, 2)) * np.array([[0.003], [0.02]])
        blocks.append(mixes @ mixes.T)
        joint[row_of(e) : row_of(e) + 2, row_of(e) : row_of(e) + 2] = blocks[-1]
        # a robot that is (a, b) off and turned by c sees the wall farther to its left by what its point moves across
        slopes += [[uy, -ux, -x * ux - y * uy], [0.0, 0.0, -1.0]]
    info = np.zeros((3, 3))
    for e, block in enumerate(blocks):
        rows = np.array(slopes[2 * e : 2 * e + 2])
        info += rows.T @ np.linalg.inv(block) @ rows
    weights = np.linalg.solve(info, np.concatenate([rows.T @ np.linalg.inv(b) for rows, b in zip(
        np.array(slopes).reshape(3, 2, 3), blocks, strict=True)], axis=1))  # fmt: skip
    drawn = np.concatenate([rng.multivariate_normal((0.0, 0.0), block, 20_000) for block in blocks], axis=1)
    assert heading_sd(seen(3), joint, 0.01) == pytest.approx(float((drawn @ weights.T)[:, 2].std()), rel=0.03)
