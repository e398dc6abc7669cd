"""World files: walls and obstacles, and where robots start."""

import hashlib
import json
import math
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml
from numpy.typing import NDArray
from shapely import affinity
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from protocol.arrays import Bools, Floats
from protocol.document import DUMPER, read_document
from protocol.errors import InputError
from protocol.text import printable
from world import maze

BUNDLED = Path(__file__).parent / "bundled"

SLIT_M = 2e-3
"""Solids are grown and shrunk by this, which closes gaps up to twice as wide (as in the scorer): a yaw of 1.5708 is not
pi/2."""
THIN_M = 2e-4
"""Thickness given to walls without one, because a solid needs an inside (as in the scorer)."""
STRAIGHT_M = 5e-5
"""Vertices nearer than this to the chord of their neighbours are no corners; a quarter of THIN_M."""
FRAME_M = 1.0
"""Free space ends this far around the solids (as in the scorer)."""
SPAWN_DISTANCE_M = 1.0
"""Drawn starts keep this distance where there is room, so that no robot blocks another."""
SPAWN_CLEARANCE_M = 0.1
"""Drawn starts leave this between body and walls, so that a robot can turn and leave."""
MAX_WORLD_M = 1000.0
"""A file with larger coordinates is probably not in metres."""
MAX_AREA_M2 = 40_000.0
"""Largest rectangle around a world. A robot of 0.22 m/s sees a quarter of it in two hours, and the poses of a
visibility grid over it take 250 MB."""
MAX_WALL_M = 10_000.0
"""Edges of all shapes together: 200,000 pieces of wall to account for."""
MAX_CORNERS = 10_000
"""Corners of all shapes: half of what a robot's map may have."""
MAX_NEAR, MAX_CROSSINGS = 1_000_000, 50_000
"""Most pairs of edges whose rectangles overlap, and that cross or touch: each costs time and memory to join."""
TANGLED = "too many of its shapes lie over each other"
"""What is said of those, in a world file or on its way to one."""
MAX_SPAWNS = 1000
"""Twice as many as a run may have robots."""
MAX_NAME = 100
"""Characters of a world's name."""


Lines = NDArray[np.object_]
"""(n,) of shapely's lines."""

Level = tuple[str, float, float]
"""What a list must be, in words, and its least and greatest length."""

_ANY: Level = ("must be a list", 0, math.inf)
LISTS: Mapping[str, Sequence[Level]] = {
    "boxes": (_ANY, ("must be a list of 5 numbers", 5, 5)),
    "walls": (_ANY, ("must be a list of 4 numbers", 4, 4)),
    "polygons": (
        _ANY,
        ("must be a list of rings", 1, math.inf),
        ("a ring must be a list of at least 3 points", 3, math.inf),
        ("a point must be a list of 2 numbers", 2, 2),
    ),
    "spawns": ((f"must be a list of at most {MAX_SPAWNS} poses", 0, MAX_SPAWNS), ("must be a list of 3 numbers", 3, 3)),
}
"""The fields of numbers, as lists in lists."""


class WorldFileError(InputError):
    """A world file that cannot be run; the text names file and field."""


@dataclass(frozen=True, eq=False)
class World:
    """Solids, their outline, and the starts of the robots. Metres, radians, world frame."""

    name: str
    source: str
    """The file's name, for messages."""
    solid: BaseGeometry
    """Walls and obstacles, with narrow slits closed."""
    spawns: Floats
    """(k, 3) x, y, theta: r1 starts at the first."""
    document: Mapping[str, Any] = field(repr=False)
    """The file with its numbers as floats, unknown keys kept."""

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the world's geometry and spawns; layout and comments of the file do not count."""
        known = {key: self.document.get(key) or [] for key in LISTS}
        return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()

    @cached_property
    def _frame(self) -> Polygon:
        """Where robots may be that no wall keeps in."""
        x0, y0, x1, y1 = self.solid.bounds
        return shapely.box(x0 - FRAME_M, y0 - FRAME_M, x1 + FRAME_M, y1 + FRAME_M)

    @cached_property
    def _open(self) -> BaseGeometry:
        return self._frame.difference(self.solid)

    @cached_property
    def free(self) -> list[Polygon]:
        """Free space, exteriors counter-clockwise; the outermost polygon ends FRAME_M around the world."""
        return [shapely.orient_polygons(part) for part in polygons_of(self._open)]

    def outline(self, polygon: Polygon) -> Iterator[Floats]:
        """Closed (n, 2) rings of one polygon of `free` that are walls, free space on the left."""
        x0, _, x1, _ = self.solid.bounds
        for ring in (polygon.exterior, *polygon.interiors):
            points = np.asarray(ring.coords)
            if not (points[:, 0].min() < x0 - FRAME_M / 2 and points[:, 0].max() > x1 + FRAME_M / 2):
                yield points  # the frame around the world is no wall

    @cached_property
    def rings(self) -> list[Floats]:
        """All outlines as closed (n, 2) rings, free space on the left, straight runs merged."""
        rings = []
        for polygon in self.free:
            for points in self.outline(polygon):
                # simplify keeps the first vertex, so the ring starts at one that is a corner for sure
                first = int(np.lexsort((points[:-1, 1], points[:-1, 0]))[0])
                turned = np.vstack([points[first:-1], points[: first + 1]])
                rings.append(np.asarray(LineString(turned).simplify(STRAIGHT_M).coords))
        return rings

    @cached_property
    def segments(self) -> Floats:
        """The outline as (n, 4) x1, y1, x2, y2, free space on the left."""
        return np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in self.rings])

    def outlines_around(self, region: Polygon) -> list[Floats]:
        """The rings of `outline` that bound the free space around one of `regions`."""
        return [ring for polygon in self.free if polygon.intersects(region) for ring in self.outline(polygon)]

    @lru_cache(maxsize=8)  # noqa: B019  (worlds are few, and `parse` keeps them in any case)
    def regions(self, radius_m: float) -> list[Polygon]:
        """Where the centre of a robot of this radius can be: one polygon for each connected region."""
        return polygons_of(self._open.buffer(-radius_m))

    def region_of(self, x: float, y: float, radius_m: float) -> Polygon | None:
        """The one of `regions` that holds this place, or None in a wall."""
        spot = Point(x, y)
        return next((region for region in self.regions(radius_m) if region.distance(spot) < 1e-3), None)

    def region_index(self, x: float, y: float, radius_m: float) -> int:
        """Index in `regions` of the one that holds this place; raises WorldFileError in a wall."""
        region = self.region_of(x, y, radius_m)
        if region is None:
            raise WorldFileError(f"{self.source}: no free space for a robot of radius {radius_m} m at ({x:g}, {y:g})")
        return self.regions(radius_m).index(region)

    def starts(self, robots: int, radius_m: float, rng: np.random.Generator, *, drawn: bool = False) -> Floats:
        """(robots, 3) start poses: the file's spawns, missing ones (with `drawn`, all) drawn from rng.

        Drawn ones lie in one region: that of the first spawn, else the largest that is closed.
        Raises WorldFileError where a spawn leaves no room for a robot, or the world for so many.
        """
        starts = [] if drawn else self.spawns[:robots].tolist()
        for i, (x, y, _) in enumerate(starts):
            if self.region_of(x, y, radius_m) is None:
                why = f"no free space for a robot of radius {radius_m} m"
                if not self._frame.contains(Point(x, y).buffer(radius_m)):
                    why = f"it is outside, farther than {FRAME_M:g} m from the walls"
                raise WorldFileError(f"{self.source}: spawns[{i}]: {why}")
            for j, (u, v, _) in enumerate(starts[:i]):
                if math.hypot(x - u, y - v) <= 2 * radius_m:
                    raise WorldFileError(f"{self.source}: spawns[{i}]: overlaps spawns[{j}]")
        if len(starts) == robots:
            return np.array(starts, np.float64).reshape(-1, 3)
        region = self._home(radius_m)
        roomy = region.buffer(-SPAWN_CLEARANCE_M)
        roomy = region if roomy.is_empty else roomy
        shapely.prepare(roomy)
        x0, y0, x1, y1 = roomy.bounds
        distance = max(SPAWN_DISTANCE_M, 4 * radius_m)
        while len(starts) < robots:
            spots = rng.uniform((x0, y0, -math.pi), (x1, y1, math.pi), (200, 3))
            for spot in spots[shapely.contains_xy(roomy, spots[:, 0], spots[:, 1])]:
                if all(math.hypot(spot[0] - x, spot[1] - y) >= distance for x, y, _ in starts):
                    starts.append(spot.tolist())
                    break
            else:
                distance *= 0.8  # in a crowded world robots start closer, but never overlap
                if distance < 2.2 * radius_m:
                    raise WorldFileError(f"{self.source}: spawns: no room for {robots} robots")
        return np.array(starts, np.float64)

    def _home(self, radius_m: float) -> Polygon:
        """The region that drawn robots start in."""
        for x, y, _ in self.spawns[:1].tolist():
            if (region := self.region_of(x, y, radius_m)) is not None:
                return region
        regions, inside = self.regions(radius_m), shapely.box(*self.solid.bounds)
        closed = [region for region in regions if region.within(inside)]
        if not regions:
            raise WorldFileError(f"{self.source}: no free space for a robot of radius {radius_m} m")
        return max(closed or regions, key=lambda region: region.area)


def bundled() -> list[str]:
    """Names of the worlds that come with the package."""
    return sorted(path.stem for path in BUNDLED.glob("*.yaml"))


def load(name_or_path: str | Path) -> World:
    """World of a bundled or generated name, or of a YAML or JSON file; raises WorldFileError naming file and field."""
    if maze.GENERATED.fullmatch(str(name_or_path)):
        return _generated(str(name_or_path))
    path = BUNDLED / f"{name_or_path}.yaml" if str(name_or_path) in bundled() else Path(name_or_path)
    try:
        changed = path.stat()
    except (OSError, ValueError):  # a name that no file can have
        known = ", ".join(bundled())
        raise WorldFileError(
            f"{name_or_path!s:.200}: neither a file nor a bundled world ({known}), nor a maze such as generated-40x40-0"
        ) from None
    return _loaded(path, (changed.st_mtime_ns, changed.st_size))


@lru_cache(maxsize=8)
def _generated(name: str) -> World:
    try:
        return from_document(maze.named(name) or {}, name)
    except ValueError as error:
        raise WorldFileError(f"{name}: {error}") from None


@lru_cache(maxsize=8)
def _loaded(path: Path, state: tuple[int, int]) -> World:
    """World of a file; `state` tells a changed file from the one that was loaded before."""
    try:
        document = read_document(path)
    except InputError as error:
        raise WorldFileError(f"{path}: {error}") from None
    if not isinstance(document, dict):
        raise WorldFileError(f"{path}: must be a map of fields, not {type(document).__name__}")
    return from_document(document, str(path))


def from_document(document: Mapping[Any, Any], source: str = "world") -> World:
    """World of the fields of a file; raises WorldFileError naming the field."""
    units = document.get("units", "m")
    if units != "m":
        raise WorldFileError(f"{source}: units: {reprlib.repr(units)} is unknown; worlds are in m")
    name = document.get("name", printable(Path(source).stem)[:MAX_NAME])  # a file's need not even be UTF-8
    if not isinstance(name, str) or not 0 < len(name) <= MAX_NAME:
        raise WorldFileError(f"{source}: name: must be a text of 1 to {MAX_NAME} characters")
    given = {key: document[key] for key in LISTS if document.get(key) is not None}
    lists: dict[str, Any] = {key: _numbers(rows, f"{source}: {key}", LISTS[key]) for key, rows in given.items()}
    boxes, walls, polygons, spawns = (lists.get(key, []) for key in LISTS)
    if not boxes and not walls and not polygons:
        raise WorldFileError(f"{source}: has no boxes, walls or polygons")
    solids: list[BaseGeometry] = []
    for i, (cx, cy, yaw, length, thickness) in enumerate(boxes):
        if min(length, thickness) < THIN_M:
            raise WorldFileError(f"{source}: boxes[{i}]: length and thickness must be at least {THIN_M:g} m")
        box = shapely.box(-length / 2, -thickness / 2, length / 2, thickness / 2)
        solids.append(affinity.translate(affinity.rotate(box, yaw, origin=(0, 0), use_radians=True), cx, cy))
    for i, (x1, y1, x2, y2) in enumerate(walls):
        if math.hypot(x2 - x1, y2 - y1) < THIN_M:
            raise WorldFileError(f"{source}: walls[{i}]: zero length")
        solids.append(LineString([(x1, y1), (x2, y2)]).buffer(THIN_M / 2, cap_style="flat"))
    areas = [Polygon(rings[0], rings[1:]) for rings in polygons]
    try:
        _check_size([*solids, *areas], source)
        for i, area in enumerate(areas):
            solids.append(whole(area))
            if solids[-1].area < THIN_M**2:
                raise WorldFileError(f"{source}: polygons[{i}]: has no area")
        solid = shapely.union_all(solids)
        solid = solid.buffer(SLIT_M, join_style="mitre").buffer(-SLIT_M, join_style="mitre")
    except shapely.GEOSException as error:
        raise WorldFileError(f"{source}: the shapes cannot be joined: {error}") from None
    if not solid.area > 0:
        raise WorldFileError(f"{source}: its boxes, walls and polygons have no area")
    inside = solid.convex_hull if any(part.interiors for part in polygons_of(solid)) else None
    for i, (x, y, _) in enumerate(spawns):
        if solid.intersects(Point(x, y)):
            raise WorldFileError(f"{source}: spawns[{i}]: no free space, ({x:g}, {y:g}) lies in a wall")
        if inside is not None and not inside.contains(Point(x, y)):  # where nothing is closed, robots drive around it
            raise WorldFileError(f"{source}: spawns[{i}]: ({x:g}, {y:g}) lies outside of all walls")
    known = {"name": name, "units": "m", **{key: rows for key, rows in lists.items() if rows}}
    return World(name, source, solid, np.array(spawns, np.float64).reshape(-1, 3), {**document, **known})


def _check_size(shapes: Sequence[BaseGeometry], source: str) -> None:
    """Raise WorldFileError for a world that would take more than seconds, or all memory, to load."""
    x0, y0, x1, y1 = shapely.total_bounds(shapes).tolist()
    if (x1 - x0) * (y1 - y0) > MAX_AREA_M2:
        size = f"{x1 - x0:.0f} m x {y1 - y0:.0f} m"
        raise WorldFileError(f"{source}: {size} is too large; at most {MAX_AREA_M2:.0f} m2 are taken")
    edges = _edges(shapely.get_rings(shapes))
    if len(edges) > MAX_CORNERS:
        raise WorldFileError(f"{source}: {len(edges)} corners are too many; at most {MAX_CORNERS} are taken")
    if (wall_m := shapely.length(edges).sum()) > MAX_WALL_M:
        raise WorldFileError(f"{source}: {wall_m:.0f} m of wall are too much; at most {MAX_WALL_M:.0f} m are taken")
    if _tangled(edges, shapely.intersects):
        raise WorldFileError(f"{source}: {TANGLED}")


def check_crossings(shapes: Sequence[BaseGeometry], lines: Sequence[BaseGeometry] = ()) -> None:
    """Raise InputError for shapes and lines of another program's file that would take minutes, or all memory, to join.

    They may have more edges than a world, as long as these only touch, until they are joined.
    """
    if _tangled(_edges([*shapely.get_rings(shapes), *lines]), shapely.crosses):
        raise InputError(TANGLED)


def whole(area: BaseGeometry) -> BaseGeometry:
    """All that an outline encloses, also where it crosses itself; `buffer(0)` alone would lose one half of an 8."""
    return area.buffer(0) if area.is_valid else shapely.make_valid(area, method="structure")


def _edges(lines: Sequence[BaseGeometry] | Lines) -> Lines:
    """Each edge of rings and lines as a line of its own."""
    points, line = shapely.get_coordinates(lines, return_index=True)
    inside = line[1:] == line[:-1]
    edges: Lines = shapely.linestrings(np.stack([points[:-1][inside], points[1:][inside]], 1))
    return edges


def _tangled(edges: Lines, meet: Callable[[Lines, Lines], Bools]) -> bool:
    """Whether too many pairs of edges lie near each other, or meet."""
    tree, near, meetings = shapely.STRtree(edges), 0, 0
    for block in np.array_split(edges, math.ceil(len(edges) / 50) or 1):
        one, other = tree.query(block)
        near += len(one)
        if near <= MAX_NEAR:
            meetings += int(meet(block[one], edges[other]).sum())
        if near > MAX_NEAR or meetings > MAX_CROSSINGS:
            return True
    return False


def to_yaml(document: Mapping[str, Any]) -> str:
    """Text of a world file, one shape a line."""
    return str(yaml.dump(dict(document), Dumper=DUMPER, default_flow_style=None, sort_keys=False, width=120))


def polygons_of(geometry: BaseGeometry) -> list[Polygon]:
    """The polygons of a geometry, in its order."""
    parts = getattr(geometry, "geoms", [geometry])
    return [part for part in parts if isinstance(part, Polygon) and not part.is_empty]


def rings_of(geometry: BaseGeometry) -> list[Floats]:
    """The closed (n, 2) rings of all its polygons: each one's outer ring, and then those of its holes."""
    return [np.asarray(ring.coords) for part in polygons_of(geometry) for ring in (part.exterior, *part.interiors)]


def _numbers(value: object, where: str, levels: Sequence[Level]) -> Any:
    """Lists in lists of finite floats, as deep as there are levels."""
    if not levels:
        return _number(value, where)
    words, least, most = levels[0]
    if not isinstance(value, list) or not least <= len(value) <= most:
        raise WorldFileError(f"{where}: {words}")
    return [_numbers(inner, f"{where}[{i}]", levels[1:]) for i, inner in enumerate(value)]


def _number(value: object, where: str) -> float:
    """A finite float."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise WorldFileError(f"{where}: must be a number, not {reprlib.repr(value)}")
    try:
        number = float(value)
    except OverflowError:
        raise WorldFileError(f"{where}: must be a number, not {reprlib.repr(value)}") from None
    if not math.isfinite(number):
        raise WorldFileError(f"{where}: not finite")
    if abs(number) > MAX_WORLD_M:
        raise WorldFileError(f"{where}: {number:g} is more than {MAX_WORLD_M:g}; is the file in metres?")
    return number
