"""What the exact section measures of a map."""

import numpy as np
import pytest

from deploy.bench.alignment.exact import crossing_m
from protocol.wireframe import certain


@pytest.mark.parametrize(("head_y", "crossing"), [(0.03, 0.03), (-0.01, 0.0), (0.8, 0.8)])
def test_how_deep_walls_cross(head_y: float, crossing: float) -> None:
    """A wall up to another one, a corner and a parallel wall beside them."""
    points = np.array([(0, 0), (2, 0), (1, -1), (1, head_y), (5, 5), (6, 5), (6, 6), (0, 0.02), (0.9, 0.02)])
    wireframe = certain(points, np.array([(0, 1), (2, 3), (4, 5), (5, 6), (7, 8)]))
    assert crossing_m(wireframe) == pytest.approx(crossing)
    assert crossing_m(certain(points[:0], np.zeros((0, 2), np.int64))) == 0.0
