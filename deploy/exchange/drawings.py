"""Worlds from outlines: HouseExpo's floor plans, maps of ours, and drawings in GeoJSON, DXF and SVG."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
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


def read_dxf(file: Path) -> Shapes:
    """Lines and curves of a DXF drawing, of the layer `walls` where there is one. Raises InputError."""
    from ezdxf.enums import InsertUnits
    from ezdxf.filemanagement import readfile
    from ezdxf.math import Matrix44
    from ezdxf.path import make_path
    from ezdxf.units import conversion_factor

    logging.getLogger("ezdxf").addHandler(logging.NullHandler())  # what it ignores is no error
    shapes = Shapes(walls=(walls := []))
    left = MAX_POINTS
    try:
        drawing = readfile(file)
        scale = conversion_factor(InsertUnits(drawing.units), InsertUnits.Meters) if drawing.units else 1.0
        entities = list(drawing.modelspace())
        on_layer = [entity for entity in entities if entity.dxf.layer.lower() == LAYER]  # case tells no layers apart
        for entity in on_layer or entities:
            kind = entity.dxftype()
            if kind in ("POINT", "TEXT", "MTEXT"):
                continue
            if kind not in ("LINE", "LWPOLYLINE", "POLYLINE", "CIRCLE", "ARC", "ELLIPSE", "SPLINE"):
                shapes.left_out[f"{kind} on layer {entity.dxf.layer}"] += 1
                continue
            path = make_path(entity).transform(Matrix44.scale(scale, scale, 0))  # metres, seen from above
            if not len(path):  # a polyline of one vertex
                continue
            _points([(point.x, point.y) for point in path.control_vertices()], kind)  # a huge curve has endless chords
            flat = [(point.x, point.y) for point in islice(path.flattening(SAGITTA_M), left + 1)]
            left -= len(flat)
            if left < 0:
                raise InputError(f"more than {MAX_POINTS} points of lines and curves")
            walls.append(_points(flat, kind))
    except InputError:
        raise
    except Exception as error:  # of a damaged drawing, ezdxf raises what its parts raise
        raise InputError(f"no DXF drawing that can be read: {error!s:.100}") from None
    if not drawing.units:
        shapes.left_out["a unit: metres are assumed"] += 1
    return shapes


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
