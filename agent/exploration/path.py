"""A path as it is driven: what is left of it, and whether walls still let it pass (ours)."""

import math

import numpy as np

from agent.geometry.clearance import distance_to_walls, keeps_clear, path_clear
from protocol.arrays import Floats

ARRIVED_M = 0.08  # nearer is there: nearly what two ticks drive at full speed, so that no robot overshoots
GIVE_M = 0.03  # a path stays good while walls come this much nearer than its clearance, and may be cut by as much
_WAYPOINT_M = 0.03  # a waypoint this near is passed
_START_SHARE = 0.98  # a start nearer to a wall than the clearance keeps this share of its distance, to get away


def length_of(path: Floats) -> float:
    """Metres along a path (k, 2)."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def first_clearance(start: Floats, walls: Floats, clearance_m: float) -> float:
    """Distance, metres, that the first piece of a way from start (2,) keeps from walls (m, 4).

    A robot that is too near to one may leave it.
    """
    return min(clearance_m, _START_SHARE * distance_to_walls(start[0], start[1], walls))


def still_clear(path: Floats, walls: Floats, clearance_m: float) -> bool:
    """Whether a path (k, 2) still keeps the clearance from walls (m, 4); its first piece may begin nearer."""
    if len(path) < 2:
        return True
    first = first_clearance(path[0], walls, clearance_m)
    return bool(path_clear(path[:2], walls, first) and path_clear(path[1:], walls, clearance_m))


def ahead_of(path: Floats, here: Floats, walls: Floats, clearance_m: float) -> Floats:
    """What is left of a path (k, 2) from here (2,) on, without waypoints that are passed or can be left out."""
    x, y = here
    while len(path) > 2:
        (ax, ay), (bx, by) = path[1], path[2]
        passed = math.hypot(ax - x, ay - y) < _WAYPOINT_M
        if not passed and not keeps_clear(x, y, bx, by, walls, clearance_m):
            break
        path = path[1:]
    return np.vstack((here, path[1:] if len(path) > 1 else path))
