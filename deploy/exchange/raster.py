"""Worlds from pictures: maps of ROS's map_server, bitmaps of Stage, and outlines that were traced from pictures.

Cells become areas whose outlines run along the cells' edges. Then walls are straightened: those near the main axis, in
which most of them run, are laid along it, oblique ones are simplified. Outlines move by less than two cells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from warnings import catch_warnings

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image
from shapely import affinity
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from deploy.exchange.map_server import FREE, OCCUPIED, UNKNOWN
from deploy.exchange.shapes import Shapes
from protocol.arrays import Bools, Floats
from protocol.document import check_is_file
from protocol.errors import InputError
from protocol.messages import RobotSpec
from world.worldfile import MAX_CORNERS, polygons_of

FORMATS = ("BMP", "GIF", "JPEG", "PNG", "PPM", "TIFF")
"""Of pictures. Pillow alone reads these: PostScript it hands to Ghostscript, which nothing bounds."""
MAX_CELLS = 25_000_000
MAX_JAGS = 5 * MAX_CORNERS
"""Corners of a picture's outlines: a floor of 58 m x 47 m at 5 cm, as scanned, has 38,000, of which straightening
leaves 10,000. More is noise, and takes minutes."""
MAX_SIDES = 100_000
"""Cells along columns of a picture's outlines, each with a point: with as many along rows, at 5 cm a cell, they are the
10 km that a world may have."""
BODY_M = RobotSpec().radius_m  # of the default robot: free areas too narrow for it are filled
FRAME_CELLS = 3  # of solid around the picture
WHITE = 255  # for free, where a picture of map_saver was edited
DARK = 0.5  # a bitmap's pixel that is darker is solid
ALIGNED_RAD = math.radians(0.25)  # an axis nearer to the picture's is the picture's
LONG_CELLS = 6  # a run of an outline along the axis
SPREAD_CELLS = 1.6  # across a straight wall: what cells make of an oblique line, and a cell of noise
SLANT_CELLS = 1.0  # from end to end of a wall that runs along the axis
CORNER_CELLS = 2.0  # between two walls that meet in a corner
MAX_RUN = 400  # edges
AT_ONCE = 100  # points of a ring from which runs are looked for together
WIDE = 0.9  # cells by which other outlines may move: less than a wall that is one cell thick


def read_map_server(about: Mapping[Any, Any], folder: Path, straighten: bool) -> Shapes:
    """The world of a map_server's YAML and of its picture beside it: what is not known to be free is solid.

    Unknown cells amid free ones, without any occupied cell, count as free. Raises InputError.
    """
    image = about.get("image")
    if not isinstance(image, str):
        raise InputError("image: must name a picture")
    cell = _number(about, "resolution", None, 1e-3, 1.0)
    free_below, occupied_above = (
        _number(about, f"{kind}_thresh", d, 0, 1) for kind, d in (("free", 0.25), ("occupied", 0.65))
    )
    if occupied_above < free_below:
        raise InputError(f"occupied_thresh: {occupied_above:g} is below free_thresh, {free_below:g}; exchange them")
    origin = about.get("origin", [0.0, 0.0, 0.0])
    if not isinstance(origin, list) or len(origin) != 3 or not all(_finite(value) for value in origin):
        raise InputError("origin: must be a list of 3 numbers")
    if (negate := about.get("negate", 0)) not in (0, 1):
        raise InputError("negate: must be 0 or 1")
    if (mode := about.get("mode", "trinary")) not in ("trinary", "scale"):
        raise InputError("mode: must be trinary or scale; of other modes no threshold tells walls")
    darkness = read_darkness(folder / image, negate=bool(negate), mode=mode)
    free, occupied = darkness < free_below, darkness > occupied_above
    unknown = free & _saved_unknown(darkness) if mode == "trinary" else np.zeros_like(free)
    free &= ~unknown
    x, y, yaw = map(float, origin)
    if not free.any():
        raise InputError("no cell of it is free")
    part = tuple(slice(cells.min(), cells.max() + 1) for cells in np.nonzero(free))  # all around it is solid
    area = solid_area(~free[part], occupied[part], cell, straighten, pad=FRAME_CELLS)
    area = affinity.translate(area, part[1].start * cell, part[0].start * cell)
    turned = affinity.rotate(area, yaw, origin=(0, 0), use_radians=True)
    shapes = Shapes([affinity.translate(turned, x, y)])
    if unknown.any():
        shapes.assumed.append(f"grey {UNKNOWN} is unknown, as map_saver has it, though free_thresh is {free_below:g}")
    return shapes


def _saved_unknown(darkness: NDArray[np.float32]) -> Bools:
    """(rows, columns) what map_saver wrote as unknown; nothing in pictures with greys that it does not write.

    From Humble to Jazzy it wrote thresholds beside it by which that is free (navigation2, pull request 5278).
    """
    greys = np.rint(255 * (1 - darkness))
    saved = np.isin(greys, (OCCUPIED, UNKNOWN, FREE, WHITE)).all() and (greys >= FREE).any()
    unknown: Bools = (greys == UNKNOWN) & saved
    return unknown


def read_bitmap(file: Path, width_m: float, straighten: bool, boundary: bool) -> Shapes:
    """The world of a picture that is so many metres wide: what is dark is solid. Its middle is the origin, as in Stage.

    boundary: a wall is around the picture, as `boundary 1` makes it in Stage. Raises InputError.
    """
    solid = read_darkness(file, negate=False) > DARK
    rows, columns = solid.shape
    cell = width_m / columns
    area = solid_area(solid, solid, cell, straighten, pad=FRAME_CELLS if boundary else 0)
    shapes = Shapes([affinity.translate(area, -width_m / 2, -rows * cell / 2)])
    if not (boundary or all(edge.all() for edge in (solid[0], solid[-1], solid[:, 0], solid[:, -1]))):
        shapes.left_out["a wall around the picture, whose edge is free: --boundary puts it there"] += 1
    return shapes


def read_darkness(file: Path, *, negate: bool, mode: str | None = None) -> NDArray[np.float32]:
    """(rows, columns) 0 to 1 of a picture, row 0 the lowest y; NaN where it is not known. Raises InputError.

    mode: of map_server, for what is transparent: it is not known in `scale`, and opacity counts as a fourth colour in
    `trinary` (nav2_map_server, map_io.cpp). Without a mode it is white.
    """
    try:
        check_is_file(file)
        with catch_warnings(action="ignore"), Image.open(file, formats=FORMATS) as image:
            # Pillow warns of what is refused here
            if image.width * image.height > MAX_CELLS:
                raise InputError(f"{image.width} x {image.height} pixels are too many")
            bright = _brightness(image, mode)
    except InputError as error:
        raise InputError(f"{file.name}: {error}") from None
    except Exception as error:  # decoders raise what they like for damaged pictures
        cause = getattr(error, "strerror", None) or type(error).__name__
        raise InputError(f"{file.name}: no picture that can be read: {cause}") from None
    return np.asarray(bright if negate else 1 - bright, np.float32)[::-1]


def _brightness(image: Image.Image, mode: str | None) -> NDArray[np.float32]:
    """(rows, columns) 0 to 1, row 0 the first, else as above. Raises InputError for pixels whose white is not known."""
    if image.mode.startswith("I"):  # 16 bits; `convert` would take all from 255 on for white
        grey = np.asarray(np.asarray(image, np.float32) / 65_535, np.float32)
        if grey.min() < 0 or grey.max() > 1:
            raise InputError("its pixels have more than 16 bits; save it with 8 or 16")
        return grey
    if image.mode == "F":
        raise InputError("its pixels are fractions; save it with 8 or 16 bits")
    rgba = np.asarray(image.convert("RGBA"))
    bright: NDArray[Any] = rgba[..., :3].mean(2, dtype=np.float32) / 255
    opacity = rgba[..., 3].astype(np.float32) / 255
    if mode == "scale":
        bright = np.where(opacity < 1, np.nan, bright)
    elif mode == "trinary" and image.has_transparency_data:
        bright = (3 * bright + opacity) / 4
    else:
        bright = bright * opacity + 1 - opacity
    return np.asarray(bright, np.float32)


def solid_area(solid: Bools, sure: Bools, cell: float, straighten: bool, pad: int) -> BaseGeometry:
    """The solid cells (rows, columns) as an area in metres, lower left corner 0, 0.

    sure: of these, the ones where something was seen; an island without any is nothing.
    pad: so many cells around the picture are solid, too.
    """
    solid, sure = (np.pad(cells, pad, constant_values=True) for cells in (solid, sure))
    rows, begins, ends = _strips(solid)
    seen = np.logical_or.reduceat(sure.ravel(), rows * sure.shape[1] + begins)  # between strips nothing is sure
    tree = shapely.STRtree(shapely.points((begins + ends)[seen] / 2, rows[seen] + 0.5))
    area = shapely.union_all(shapely.box(begins, rows, ends, rows + 1))
    parts = [part for part in polygons_of(area) if len(tree.query(part, "intersects"))]
    rooms = [shapely.Polygon(hole) for part in parts for hole in part.interiors]
    narrow = [room for room in rooms if room.buffer(-BODY_M / cell).is_empty]
    area = shapely.union_all([*parts, *narrow])
    if straighten:
        area = _straightened(area, pad)
    return affinity.scale(affinity.translate(area, -pad, -pad), cell, cell, origin=(0, 0))


def straightened(area: BaseGeometry, cell: float) -> BaseGeometry:
    """An area that was traced along the edges of cells (metres), its outlines straight."""
    cells = affinity.scale(area, 1 / cell, 1 / cell, origin=(0, 0))
    return affinity.scale(_straightened(cells, 0), cell, cell, origin=(0, 0))


def _straightened(area: BaseGeometry, pad: int) -> BaseGeometry:
    axis = _axis(area, pad)
    return shapely.union_all([_straight(part, axis) for part in polygons_of(area)])


def _strips(solid: Bools) -> tuple[NDArray[np.int64], ...]:
    """Row, first column and the one after the last of each solid strip, (n,) each.

    Raises InputError for a picture whose outlines would take minutes.
    """
    around = np.pad(solid, 1)
    sides = around[:, 1:] != around[:, :-1]
    below, above = sides[:-1], sides[1:]
    touching = below & above & (around[1:, :-1] != around[:-1, :-1])  # two corners at one place
    if (corners := int((below != above).sum() + 2 * touching.sum())) > MAX_JAGS:
        raise InputError(f"its outlines have {corners} corners, as noise has; at most {MAX_JAGS} are taken")
    if (long := int(sides.sum())) > MAX_SIDES:
        raise InputError(f"its outlines run along {long} cells of columns; at most {MAX_SIDES} are taken")
    edges = np.diff(around[1:-1].astype(np.int8), axis=1)
    rows, begins = np.nonzero(edges == 1)
    _, ends = np.nonzero(edges == -1)
    return rows, begins, ends


def _axis(area: BaseGeometry, pad: int) -> float:
    """Direction, radians, of most wall: seen along it, the outlines fall on the fewest lines."""
    rings = [ring for part in polygons_of(area) for ring in _rings(part)]
    edges = [ring.segmentize(1.0) for ring in rings if not pad or ring.bounds[0] > 0]  # around the picture is no wall
    if not edges:
        return 0.0
    points = np.vstack([(line[1:] + line[:-1]) / 2 for line in (np.asarray(edge.coords) for edge in edges)])

    def sharpness(turn: float) -> float:
        counts = [np.bincount((c - c.min()).astype(np.int64)) for c in (points @ _turn(turn)).T]
        return float(sum((count.astype(np.float64) ** 2).sum() for count in counts))

    best = 0.0
    for reach, step in ((45.0, 0.5), (0.5, 0.05)):
        best = max((best + np.radians(np.arange(-reach, reach, step))).tolist(), key=sharpness)
    return best if abs(best) > ALIGNED_RAD else 0.0


def _turn(angle: float) -> Floats:
    """(2, 2) that takes rows into a frame turned by this angle."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _straight(area: Polygon, axis: float) -> BaseGeometry:
    """One area with straightened outlines."""
    outer, *holes = (_laid(_open(ring), axis) for ring in _rings(area))
    made = Polygon(outer, holes)
    return made if made.is_valid else area.simplify(WIDE)


class _Run(NamedTuple):
    """A part of a ring that keeps to the axis, or to the direction across it."""

    first: int  # point of the ring
    edges: int
    same: int  # the coordinate, in the axis' frame, that hardly changes
    value: float  # of that coordinate, so that the area stays

    def holds(self, point: Floats) -> Floats:
        """The point, moved onto the run's line."""
        moved = point.copy()
        moved[self.same] = self.value
        return moved


def _laid(ring: Floats, axis: float) -> Floats:
    """A ring (n, 2), its first point once: runs along the axis are straight, what lies between them is simplified."""
    turn = _turn(axis)
    points = ring @ turn  # in the axis' frame
    n, runs, made = len(points), _runs(points), list[Floats]()
    for run, after in zip(runs, [*runs[1:], *runs[:1]], strict=True):
        last = run.first + run.edges
        between = points[np.arange(last, last + (after.first - last) % n + 1) % n]
        begin, end = run.holds(between[0]), after.holds(between[-1])
        if run.same != after.same and np.ptp(between, axis=0).max() <= CORNER_CELLS:
            made.append(after.holds(begin))
        elif len(between) == 1:
            made += [begin, end]
        else:
            made += [begin, *np.asarray(LineString(between).simplify(WIDE).coords)[1:-1], end]
    if len(made) < 3:  # nothing runs along the axis, or two sides of what is thin
        return _open(Polygon(ring).simplify(WIDE).exterior)
    return np.asarray(np.array(made) @ turn.T, np.float64)


def _runs(points: Floats) -> list[_Run]:
    """The runs of a ring in the axis' frame, in its order; the longest are found first, and none overlap."""
    if np.ptp(points, axis=0).max() < LONG_CELLS:  # a speck: a picture may have thousands
        return []
    n = len(points)
    window = np.arange(min(n, MAX_RUN))
    found = []
    for firsts in np.array_split(np.arange(n), math.ceil(n / AT_ONCE)):
        parts = points[(firsts[:, None] + window) % n]
        for same in (0, 1):
            across, along = parts[..., same], parts[..., 1 - same]
            spread = np.maximum.accumulate(across, 1) - np.minimum.accumulate(across, 1)
            for way in (along - along[:, :1], along[:, :1] - along):
                stops = (spread > SPREAD_CELLS) | (np.maximum.accumulate(way, 1) - way > 1.0)
                counts = np.where(stops.any(1), stops.argmax(1), len(window)) - 1
                ends = way[np.arange(len(way)), counts]
                long = np.flatnonzero(ends >= LONG_CELLS)
                found += [(-float(ends[k]), int(firsts[k]), int(counts[k]), same) for k in long]
    taken, runs = np.zeros(n, np.bool_), []
    for _, first, count, same in sorted(found):
        edges = np.arange(first, first + count) % n
        edges = edges[: np.argmax(taken[edges])] if taken[edges].any() else edges
        part = points[np.append(edges, (first + len(edges)) % n)]
        across, along = part[:, same], part[:, 1 - same]
        if abs(along[-1] - along[0]) < LONG_CELLS:
            continue
        taken[edges] = True  # of an oblique wall, too, else pieces of it would be laid
        if abs(np.polyfit(along, across, 1)[0]) * np.ptp(along) <= SLANT_CELLS:
            middles, ways = (across[1:] + across[:-1]) / 2, np.diff(along)
            runs.append(_Run(first, len(edges), same, float((middles * ways).sum() / ways.sum())))
    return sorted(runs)


def _rings(area: Polygon) -> list[Any]:
    return [area.exterior, *area.interiors]


def _open(ring: Any) -> Floats:
    """(n, 2) points of a ring, the first one once."""
    return np.asarray(ring.coords, np.float64)[:-1]


def _number(about: Mapping[Any, Any], key: str, default: float | None, least: float, most: float) -> float:
    value = about.get(key, default)
    if not _finite(value) or not least <= value <= most:
        raise InputError(f"{key}: must be a number from {least:g} to {most:g}")
    return float(value)


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
