"""A path as it is driven: what is left of it, and whether walls still let it pass (ours)."""

import numpy as np

from agent.geometry.clearance import distance_to_walls, keeps_clear, path_clear
from protocol.arrays import Floats

ARRIVED_M = 0.08  # nearer is there: nearly what two ticks drive at full speed, so that no robot overshoots
GIVE_M = 0.03  # a path stays good while walls come this much nearer than its clearance, and may be cut by as much
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
    """What is left of a path (k, 2) from here (2,) on, without waypoints that can be left out.

    A robot that cuts a corner passes its waypoint at some distance: what is left then begins beside the robot. Else
    it grew while the robot drove on, which took itself to be stuck in each third doorway at 0.1 m/s.
    """
    x, y = here
    while len(path) > 2 and keeps_clear(x, y, path[2][0], path[2][1], walls, clearance_m):
        path = path[1:]
    left = path[1:].copy() if len(path) > 1 else path
    if len(left) > 1:
        point = _beside(here, left[0], left[1])
        if keeps_clear(x, y, point[0], point[1], walls, first_clearance(here, walls, clearance_m)):
            left[0] = point
    return np.vstack((here, left))


def _beside(here: Floats, start: Floats, end: Floats) -> Floats:
    """The point (2,) of a piece of a path, from start to end, that is nearest to here; all (2,)."""
    along = end - start
    share = float((here - start) @ along) / max(float(along @ along), 1e-12)
    point: Floats = start + min(max(share, 0.0), 1.0) * along
    return point
