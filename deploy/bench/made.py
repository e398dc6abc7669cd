"""Worlds that are hard to merge or to map, drawn from a seed: like rooms, loops of corridors, thin walls, posts."""

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
