"""Where to stand for what is no exploration: near a proposal's place, away from a teammate, out of the way (ours)."""

import numpy as np

from agent.exploration.planning import Roads, Route, circle
from agent.geometry.clearance import distances_to_walls
from agent.geometry.wall_tiles import WallTiles
from protocol.arrays import Floats

_RINGS_M = (0.3, 0.6)  # distances from an errand's place at which standing points are looked for, in eight directions
_OFF_COST = 2.0  # metres of path that a metre of distance from an errand's place is worth
_APART_M = 0.35  # a robot that shows itself goes so far from all places where it did: what is seen nearer is no news
_ASIDE_M, _ASIDE_MOST_M = 0.5, 2.0  # ... about so far from where it is, and at most
_RETREAT_M = 1.2  # a robot that makes room goes at least this far from the teammate: it can turn off in between
_RETREAT_CLEARANCES = 4.0  # ... and so many clearances of a large one: two bodies and one between
_PASSING_M = 0.45  # from walls to a parked robot: another (0.21 m wide) passes on either side; no doorway is blocked
_PARK_ROOM_M = 1.0  # more room than this is no better for parking: half the width of a corridor of the mazes
_PARK_GAIN = 4.0  # metres of path that a metre of room is worth: a robot in a doorway of 1 m goes on into the room


def near(place: Floats, roads: Roads, hiding: WallTiles | None = None) -> Route | None:
    """The way to a place (2,), or to a point nearby from where no wall hides it; None if there is no way.

    hiding: of `with_view`. A teammate that the roads lead around may be the peer that the robot comes to look at.
    """
    points = np.vstack((place, *(place + radius * circle(8) for radius in _RINGS_M)))
    away = np.hypot(*(points - place).T)
    good = roads.with_view(points, np.repeat(place[None], len(points), 0), hiding)
    return roads.nearest(points[good], _OFF_COST * away[good])


def aside(taken: Floats, places: Floats, roads: Roads) -> Route | None:
    """The way to a place out of the way that is apart from places (k, 2) that were taken, the last of them now."""
    points = np.vstack((places, taken[-1] + _ASIDE_M * circle(8)))
    away = np.hypot(*(points[:, None] - taken[None]).transpose(2, 0, 1))
    return out_of_the_way(points[(away.min(1) >= _APART_M) & (away[:, -1] <= _ASIDE_MOST_M)], roads)


def away_from(teammate: tuple[float, float], places: Floats, walls: Floats, roads: Roads) -> Route | None:
    """The way to that of the robot's former places (k, 2) that leaves a teammate room: near, and off the walls."""
    away = np.hypot(places[:, 0] - teammate[0], places[:, 1] - teammate[1])
    far = away >= max(_RETREAT_M, _RETREAT_CLEARANCES * roads.clearance)
    places = places[far & (distances_to_walls(places, walls) >= roads.clearance)]
    return roads.nearest(places, -np.minimum(distances_to_walls(places, walls), _PASSING_M))


def out_of_the_way(places: Floats, roads: Roads) -> Route | None:
    """The way to that of places (k, 2) where others can pass: near, but rather roomy than in a doorway."""
    if not len(places):
        return None
    room = distances_to_walls(places, roads.walls)
    roomy = room >= min(_PASSING_M, float(room.max()))
    places, room = places[roomy], np.minimum(room[roomy], _PARK_ROOM_M)
    if len(roads.nodes):  # around the jambs of doors, where the ways of others bend
        bends = np.hypot(*(places[:, None] - roads.nodes[None]).transpose(2, 0, 1)).min(1)
        room = np.minimum(room, 0.5 * bends)
    return roads.nearest(places, -_PARK_GAIN * room)
