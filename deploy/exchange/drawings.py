"""Worlds from outlines: HouseExpo's floor plans, maps of ours, and drawings in GeoJSON, DXF and SVG."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from deploy.exchange.raster import straightened
from deploy.exchange.shapes import Shapes
from deploy.report.rundir import parse_map
from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.walls import lengths
from world.worldfile import MAX_CORNERS, check_crossings, whole

THICK_M = 0.1  # of the wall around an outline that has none of its own
STEP_M = 0.02  # in HouseExpo's outlines, which were traced from pictures with cells of a centimetre
MAX_OUTLINE_M = 1000.0  # of a plan that is straightened: time grows with it, and a house has a tenth
LAYER = "walls"  # of a drawing, where it has one of that name: that alone is taken
SAGITTA_M = 0.001  # by which a curve's chords may be off
MAX_POINTS = 100_000  # of an outline, and of all curves of a DXF drawing
MAX_M = 1e5  # of a coordinate


def read_house_expo(about: Mapping[Any, Any], straighten: bool) -> Shapes:
    """A floor plan of HouseExpo (JSON): `verts` is the outline of what is free, in metres. Raises InputError.

    It was traced from a picture: oblique walls have steps of a centimetre, corners are cut off.
    """
    ring = _points(about.get("verts"), "verts")
    traced = shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon()
    check_crossings([traced])
    inside = whole(traced)
    if inside.is_empty:
        raise InputError("verts: encloses nothing")
    if straighten and len(ring) <= MAX_CORNERS and inside.length <= MAX_OUTLINE_M:
        inside = straightened(inside, STEP_M)
    if len(shapely.get_coordinates(inside)) > MAX_CORNERS:
        raise InputError(f"verts: more than {MAX_CORNERS} corners are left, which no world may have")
    around = inside.buffer(THICK_M, join_style="mitre")
    return Shapes([around.difference(inside)])


def read_own_map(text: str) -> Shapes:
    """A robot's map, as in maps/ of a run directory. Raises InputError."""
    try:
        drawn = parse_map(text)
    except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        raise InputError(f"no map: {error!s:.100}") from None
    walls = drawn.vertices[drawn.edges]
    return Shapes(walls=list(walls[lengths(walls.reshape(-1, 4)) > 0]))


def read_geojson(about: Mapping[Any, Any]) -> Shapes:
    """Areas and lines of a GeoJSON file in metres. Raises InputError."""
    if about.get("unit") != "m":
        raise InputError('it is in degrees; a file in metres has the field "unit": "m"')
    try:
        shapes = shapely.get_parts(shapely.from_geojson(json.dumps(about)))
    except (shapely.GEOSException, ValueError, TypeError) as error:
        raise InputError(f"no GeoJSON: {error!s:.100}") from None
    areas, walls = list[shapely.Geometry](), []
    for shape in shapely.get_parts(shapes[~shapely.is_missing(shapes)]):
        _points(shapely.get_coordinates(shape).tolist(), shape.geom_type)
        if shape.geom_type == "Polygon":
            areas.append(shape)
        elif shape.geom_type == "LineString":
            walls.append(shapely.get_coordinates(shape))
    check_crossings(areas)
    return Shapes([whole(area) for area in areas], walls)


def read_dxf(file: Path, width_m: float | None = None) -> Shapes:
    """Lines and curves of a DXF drawing, of the layer `walls` where there is one. Raises InputError.

    width_m: how wide they are, for a drawing without a unit. Where that is not known either, metres are assumed.
    """
    from ezdxf.filemanagement import readfile
    from ezdxf.math import Matrix44

    logging.getLogger("ezdxf").addHandler(logging.NullHandler())  # what it ignores is no error
    shapes = Shapes(walls=(walls := []))
    left = MAX_POINTS
    try:
        drawing = readfile(file)
        paths = _paths(drawing.modelspace(), shapes)
        scale = _scale(drawing, width_m, paths, shapes)
        for kind, drawn in paths:
            path = drawn.transform(Matrix44.scale(scale, scale, 0))  # metres, seen from above
            _points([(point.x, point.y) for point in path.control_vertices()], kind)  # a huge curve has endless chords
            flat = [(point.x, point.y) for point in islice(path.flattening(SAGITTA_M), left + 1)]
            left -= len(flat)
            if left < 0:
                raise InputError(f"more than {MAX_POINTS} points of lines and curves")
            walls.append(_points(flat, kind))
    except InputError as error:
        raise InputError(shapes.refusal(error)) from None
    except Exception as error:  # of a damaged drawing, ezdxf raises what its parts raise
        raise InputError(f"no DXF drawing that can be read: {error!s:.100}") from None
    return shapes


def _paths(entities: Iterable[Any], shapes: Shapes) -> list[tuple[str, Any]]:
    """Kind and path, in the drawing's unit, of each line and curve that is taken; what is not is noted."""
    from ezdxf.path import make_path

    entities, paths = list(entities), []
    on_layer = [entity for entity in entities if entity.dxf.layer.lower() == LAYER]  # case tells no layers apart
    for entity in on_layer or entities:
        kind = entity.dxftype()
        if kind in ("POINT", "TEXT", "MTEXT"):
            continue
        if kind not in ("LINE", "LWPOLYLINE", "POLYLINE", "CIRCLE", "ARC", "ELLIPSE", "SPLINE"):
            shapes.left_out[f"{kind} on layer {entity.dxf.layer}"] += 1
        elif len(path := make_path(entity)):  # else a polyline of one vertex
            paths.append((kind, path))
    return paths


def _scale(drawing: Any, width_m: float | None, paths: list[tuple[str, Any]], shapes: Shapes) -> float:
    """Metres of a drawing's unit; what is assumed, or not asked for, is noted. Raises InputError."""
    from ezdxf.enums import InsertUnits
    from ezdxf.path import bbox
    from ezdxf.units import conversion_factor

    told = b"$INSUNITS" in Path(drawing.filename).read_bytes()  # ezdxf has metres where there is no header
    unit = InsertUnits(drawing.units if told else 0)
    if unit:
        if width_m is not None:
            shapes.left_out["--width, as the drawing has a unit"] += 1
        return float(conversion_factor(unit, InsertUnits.Meters))
    if width_m is None:
        shapes.assumed.append("metres, as it has no unit; --width M says how wide it is")
        return 1.0
    drawn = bbox(path for _, path in paths)
    if not drawn.has_data or not drawn.size.x > 0:
        raise InputError("--width: nothing in it is wide")
    return width_m / float(drawn.size.x)


def read_svg(root: Element) -> Shapes:
    """A drawing that `wireswarm export --to svg` made. Raises InputError."""
    if root.get("data-unit") != "m":
        raise InputError("of SVG, only what `wireswarm export` made is read: others tell no scale")
    walls = []
    for element in root.iter():
        kind = element.tag.rpartition("}")[2]
        if kind in ("polyline", "polygon"):
            line = _points([pair.split(",") for pair in element.get("points", "").split()], kind)
            walls.append(np.vstack([line, line[:1]]) if kind == "polygon" else line)
    return Shapes(walls=walls)


def _points(value: Any, where: str) -> Floats:
    """(n, 2) points of a file in metres."""
    try:
        points = np.array(value, np.float64)
    except (ValueError, TypeError):
        points = np.full(1, np.nan)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) > MAX_POINTS or not (np.abs(points) <= MAX_M).all():
        raise InputError(f"{where}: must be a list of points, two finite numbers each, of at most {MAX_M:g} m")
    return points
