"""The bundled worlds for people: sizes, walls, free area, and a small drawing for the terminal."""

import json
import math
from dataclasses import asdict, dataclass

import numpy as np
import shapely

from protocol.walls import lengths
from world.worldfile import World, bundled, load

BRAILLE = 0x2800  # the empty character of the block of Unicode whose characters are 2 x 4 dots

DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bit of each dot of a character, rows from the top."""


@dataclass(frozen=True)
class WorldSize:
    """What `wireswarm worlds` tells of a world; lengths and areas are rounded to centimetres."""

    name: str
    width_m: float
    height_m: float
    walls: int  # straight pieces of the outline
    wall_m: float  # length of the outline
    free_m2: float  # area within the walls; of a world that nothing encloses, all up to 1 m around it
    spawns: int


def size_of(world: World) -> WorldSize:
    """Sizes of a world."""
    x0, y0, x1, y1 = world.solid.bounds
    inside = [part for part in world.free if part.within(shapely.box(x0, y0, x1, y1))]
    free = sum(part.area for part in inside or world.free)
    sizes = (round(float(value), 2) for value in (x1 - x0, y1 - y0, lengths(world.segments).sum(), free))
    wide, high, wall_m, free_m2 = sizes
    return WorldSize(world.name, wide, high, len(world.segments), wall_m, free_m2, len(world.spawns))


def drawing(world: World, columns: int = 40) -> str:
    """The solids in Braille, one dot for each square that holds something; at most so many columns wide or high."""
    x0, y0, x1, y1 = world.solid.bounds
    dot = max(x1 - x0, y1 - y0) / (2 * columns - 1)
    rows, width = (4 * math.ceil(round((y1 - y0) / dot + 1) / 4), 2 * math.ceil(round((x1 - x0) / dot + 1) / 2))
    left, top = np.meshgrid(x0 + dot * (np.arange(width) - 0.5), y1 - dot * (np.arange(rows) - 0.5))
    shapely.prepare(world.solid)
    solid = shapely.intersects(world.solid, shapely.box(left, top - dot, left + dot, top))
    bits = solid.reshape(rows // 4, 4, width // 2, 2).transpose(0, 2, 1, 3) * DOTS
    characters = BRAILLE + bits.sum(axis=(2, 3))
    return "\n".join("".join(map(chr, row)).rstrip(chr(BRAILLE)) for row in characters)


def to_text() -> str:
    """All bundled worlds with their drawings."""
    worlds = [load(name) for name in bundled()]
    return "\n\n".join(
        f"{size.name}: {size.width_m:.1f} m x {size.height_m:.1f} m, {size.walls} walls of {size.wall_m:.0f} m, "
        f"{size.free_m2:.0f} m2 free\n{drawing(world)}"
        for size, world in zip(map(size_of, worlds), worlds, strict=True)
    )


def to_json() -> str:
    """The sizes of all bundled worlds."""
    return json.dumps([asdict(size_of(load(name))) for name in bundled()], indent=1)
