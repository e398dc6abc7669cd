"""What a file of another program says of a world: solid areas, walls without thickness, and what was left out."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from protocol.arrays import Floats
from protocol.text import printable
from world.worldfile import MAX_NAME, check_crossings, polygons_of

DIGITS = 4  # of coordinates in metres
DOOR_M = 0.1  # thickness of a wall that closes an opening: less than most outer walls have
LEAST_M = 1e-3  # half the width of a wall without thickness, while openings are closed
LEAST_M2 = 1e-6  # of a solid area: less is rounding


@dataclass(frozen=True)
class Shapes:
    """The solids of a world. Metres, y up."""

    areas: Sequence[BaseGeometry] = ()
    walls: Sequence[Floats] = ()  # (k, 2) lines without thickness
    left_out: Counter[str] = field(default_factory=Counter)  # in words, and how often
    assumed: list[str] = field(default_factory=list)  # in words: what the file does not say, or says wrongly

    def document(self, name: str, source: str) -> dict[str, Any]:
        """The fields of a world file."""
        document: dict[str, Any] = {"name": named(name), "units": "m", "source": printable(source)}
        solid = shapely.set_precision(shapely.union_all(list(self.areas)), 10.0**-DIGITS)
        polygons = [_rings(part) for part in polygons_of(solid) if part.area > LEAST_M2]
        walls = np.vstack([np.zeros((0, 4)), *(np.hstack([line[:-1], line[1:]]) for line in self.walls)]).round(DIGITS)
        long = np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > 2 * 10.0**-DIGITS
        return document | {key: rows for key, rows in (("polygons", polygons), ("walls", walls[long].tolist())) if rows}

    def refusal(self, problem: object) -> str:
        """The sentence by which they are refused, with what was assumed: that may be the cause."""
        return f"{problem} (assumed: {'; '.join(self.assumed)})" if self.assumed else str(problem)

    def closed(self, width_m: float) -> Shapes:
        """With a wall in each opening of the outer walls that is at most so wide, such as a front door.

        Raises InputError where too many walls lie over each other.
        """
        lines = [shapely.LineString(wall) for wall in self.walls if len(wall) > 1]
        check_crossings(self.areas, lines)
        solid = shapely.union_all([*self.areas, *(line.buffer(LEAST_M, cap_style="flat") for line in lines)])
        parts = shapely.get_parts(solid)  # each by itself: all at once, 1,000 boxes take 12 s and 1.3 GB
        wide = shapely.union_all(shapely.buffer(parts, width_m / 2, join_style="mitre"))
        filled = shapely.union_all([shapely.Polygon(part.exterior) for part in polygons_of(wide)])
        inside = filled.buffer(-width_m / 2, join_style="mitre")
        ring = inside.difference(inside.buffer(-DOOR_M, join_style="mitre"))
        openings = ring.difference(solid.buffer(DOOR_M))
        return replace(self, areas=[*self.areas, openings.buffer(2 * DOOR_M).intersection(ring)])


def named(text: str) -> str:
    """A name for a world, out of that of a file."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-.")[:MAX_NAME] or "world"


def _rings(polygon: shapely.Polygon) -> list[list[list[float]]]:
    rings: Iterable[Any] = (polygon.exterior, *polygon.interiors)
    return [np.asarray(ring.coords)[:-1].round(DIGITS).tolist() for ring in rings]
