"""Worlds that are hard to merge or to map, drawn from a seed: like rooms, loops, near symmetry, thin walls, posts."""

import math
from typing import Any

import numpy as np

from world.maze import generate

WALL_M = 0.15
DOOR_M = 0.9
Box = list[float]  # of a world file: centre, yaw, length, thickness


def rooms(seed: int, columns: int = 10, rows: int = 4, room_m: float = 3.0) -> dict[str, Any]:
    """An office of like rooms in pairs of rows along corridors; its doors are where the seed puts them."""
    rng, corridor_m = np.random.default_rng(seed), 2.0
    width, boxes, y, free = columns * room_m, list[Box](), 0.0, list[list[float]]()
    bands = [corridor_m if k % 3 == 1 else room_m for k in range(rows + rows // 2)]
    for k, band in enumerate(bands):
        open_to_next = k + 1 < len(bands) and corridor_m in (band, bands[k + 1])
        boxes += _across(width, y + band, rng, columns, room_m) if open_to_next else []
        if k + 1 < len(bands) and not open_to_next:  # back to back; one door leads through
            boxes += _across(width, y + band, rng, columns, room_m, [int(rng.integers(columns))])
        for i in range(1, columns):
            if band == room_m:
                boxes.append([i * room_m, y + band / 2, math.pi / 2, band + WALL_M, WALL_M])
        free += [[(i + 0.5) * room_m, y + band / 2, rng.uniform(-math.pi, math.pi)] for i in range(columns)]
        y += band
    boxes += _around(width, y)
    order = rng.permutation(len(free))[:6]
    return _world(f"rooms-{seed}", boxes, [free[k] for k in order])


def loop(seed: int, corridor_m: float = 1.8) -> dict[str, Any]:
    """A square loop of corridors, whose four corners outside and four inside are alike."""
    rng = np.random.default_rng(seed)
    side = round(float(rng.uniform(8.0, 16.0)), 2)
    inner = side - 2 * corridor_m
    middle, c = side / 2, corridor_m / 2
    spawns = [(middle, c, 0.0), (side - c, middle, math.pi / 2), (middle, side - c, math.pi), (c, middle, -math.pi / 2)]
    boxes = [[middle, middle, 0.0, inner, inner], *_around(side, side)]
    return _world(f"loop-{seed}", boxes, [[*map(float, spawn)] for spawn in spawns])


def turned(seed: int) -> dict[str, Any]:
    """A hall that is nearly the same after a half turn (even seeds) or a quarter turn; one of its parts is not.

    By the seed that is a stub of wall more, a post more, a door or a wall 5, 15 or 30 cm off its twins.
    """
    rng, turns = np.random.default_rng(seed), 4 if seed % 2 else 2
    x, y = (4.0, 4.0) if turns == 4 else (5.0, 3.5)
    wall_x, depth, door = rng.uniform(-0.6, 0.1) * x, rng.uniform(2.2, 2.8), rng.uniform(0.3, 0.6)
    cabinet = [rng.uniform(0.35, 0.6) * x, -0.7 * y, rng.uniform(-0.5, 0.5), 0.8, 0.4]
    change, off = ("stub", "post", "door", "wall", "cabinet")[seed // 2 % 5], float(rng.choice([0.05, 0.15, 0.3]))
    boxes = [[a - x, b - y, *rest] for a, b, *rest in _around(2 * x, 2 * y)]
    for k in range(turns):
        first, moved = k == 0, dict.fromkeys(("door", "wall", "cabinet"), 0.0)
        if first and change in moved:
            moved[change] = off
        at, gap = wall_x + moved["wall"], door + moved["door"]
        sector = [
            [at, -y + gap / 2, math.pi / 2, gap, WALL_M],
            [at, (-y + gap + DOOR_M - y + depth) / 2, math.pi / 2, depth - gap - DOOR_M, WALL_M],
            [cabinet[0] + moved["cabinet"], *cabinet[1:]],
        ]
        if first and change == "stub":
            sector.append([at + 0.2, -y + depth - 0.075, 0.0, 0.4, WALL_M])
        if first and change == "post":
            sector.append([0.2 * x, -0.45 * y, 0.0, 0.1, 0.1])
        turn = k * 2 * math.pi / turns
        c, s = math.cos(turn), math.sin(turn)
        boxes += [[c * a - s * b, s * a + c * b, yaw + turn, *size] for a, b, yaw, *size in sector]
    return _world(f"turned-{seed}", boxes, [])


def traced(seed: int) -> dict[str, Any]:
    """A hall of six sides with nine pillars, traced from a robot's map: a half turn shifts each corner by centimetres.

    turtlebot3's own map is of this kind.
    """
    rng = np.random.default_rng(seed)
    right = [(2.5, 0.4), (2.3, 1.1), (1.85, 1.95), (1.4, 1.95), (1.15, 2.5)]
    upper = [*right, *((-x, y) for x, y in reversed(right))]
    hall = [*upper, *((-x, -y) for x, y in upper)]
    square = [(0.16, -0.14), (0.16, 0.14), (-0.16, 0.14), (-0.16, -0.14)]
    pillars = [[(a + x, b + y) for x, y in square] for a in (-1.1, 0.0, 1.1) for b in (-1.1, 0.0, 1.1)]
    outside = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]]
    exact = [np.array(ring) for ring in (hall, *pillars)]
    rings = [np.round(ring + rng.uniform(-0.05, 0.05, ring.shape), 4).tolist() for ring in exact]
    polygons = [[outside, rings[0]], *([pillar] for pillar in rings[1:])]
    return {"name": f"traced-{seed}", "units": "m", "polygons": polygons, "spawns": []}


def thin(seed: int, thickness_m: float) -> dict[str, Any]:
    """A maze of thin walls, 8 m x 8 m."""
    maze = generate(8.2, 8.2, np.random.default_rng(seed), thickness_m=thickness_m)
    return {**maze, "name": f"thin-{1000 * thickness_m:g}mm-{seed}"}


def posts(seed: int) -> dict[str, Any]:
    """A room with rooms of 1 cm plywood, posts of 4 cm, and a cabinet 6 cm off the wall."""
    rng = np.random.default_rng(seed)
    boxes = [*_around(8.0, 6.0), [3.0, 1.2, math.pi / 2, 2.4, 0.01], [5.5, 4.6, math.pi / 2, 2.8, 0.01]]
    boxes += [[1.5, 3.4, 0.0, 1.8, 0.01], [6.9, 0.31, 0.0, 1.0, 0.5]]
    for x, y in ((1.2, 5.0), (4.2, 3.0), (4.2, 1.2), (7.0, 3.2), (6.6, 5.1)):
        dx, dy = rng.uniform(-0.3, 0.3, 2).tolist()
        boxes.append([x + dx, y + dy, 0.0, 0.04, 0.04])
    return _world(f"posts-{seed}", boxes, [[4.2, 5.0, 0.0]])


def _world(name: str, boxes: list[Box], spawns: list[list[float]]) -> dict[str, Any]:
    rounded = [[[round(float(value), 12) for value in row] for row in rows] for rows in (boxes, spawns)]
    return {"name": name, "units": "m", "boxes": rounded[0], "spawns": rounded[1]}


def _around(width: float, height: float) -> list[Box]:
    """Walls just outside of a rectangle from the origin."""
    w, t = WALL_M, WALL_M / 2
    return [
        [width / 2, -t, 0.0, width + 2 * w, w],
        [width / 2, height + t, 0.0, width + 2 * w, w],
        [-t, height / 2, math.pi / 2, height + 2 * w, w],
        [width + t, height / 2, math.pi / 2, height + 2 * w, w],
    ]


def _across(
    width: float, y: float, rng: np.random.Generator, columns: int, room_m: float, doors: list[int] | None = None
) -> list[Box]:
    """A wall along x with a door into each room, or into those that are named."""
    x, boxes = 0.0, []
    for i in range(columns) if doors is None else doors:
        door = i * room_m + 0.3 + float(rng.choice([0.0, room_m - 0.6 - DOOR_M]))
        boxes.append([(x + door) / 2, y, 0.0, door - x, WALL_M])
        x = door + DOOR_M
    return [*boxes, [(x + width) / 2, y, 0.0, width - x, WALL_M]]
