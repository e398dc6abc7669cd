"""A map as GeoJSON, DXF and SVG: its walls as lines with free space on the left, its vertices as points by label.

Unit and frame stand in each file. Coordinates have a tenth of a millimetre.
"""

from __future__ import annotations

import io
import json
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from deploy.exchange.maps import NamedMap
from deploy.exchange.shapes import DIGITS
from deploy.report import style
from protocol.arrays import Floats
from protocol.wireframe import Label

MARGIN_M = 0.3  # of a drawing, around the map
SCALE_MM = 10  # of a drawing on paper, a metre: 1 : 100
COLOURS = {Label.NOMINAL: (7, style.INK), Label.OCCLUSION: (30, "#d55e00"), Label.FRONTIER: (5, "#0072b2")}
"""Of each label in a DXF (colour index of AutoCAD) and in an SVG."""


def geojson(named: NamedMap) -> str:
    """GeoJSON in metres: a line for each chain of walls, points for each label.

    GeoJSON is in degrees (RFC 7946) unless the older member `crs` says otherwise, which GDAL and QGIS honour.
    """
    features = [
        _feature("LineString", [*_rounded(line), *(_rounded(line[:1]) if ring else [])], kind="walls", closed=ring)
        for line, ring in named.chains
    ]
    features += [
        _feature("MultiPoint", _rounded(points), kind=label.word)
        for label in Label
        if len(points := named.marks(label))
    ]
    name = named.frame.replace('"', '""')  # as WKT has it within quotes
    local = f'LOCAL_CS["{name}",UNIT["metre",1]]'
    head: dict[str, Any] = {"type": "FeatureCollection", "name": named.robot, "unit": "m", "frame": named.frame}
    head["crs"] = {"type": "name", "properties": {"name": local}}
    return json.dumps(head | {"features": features}, indent=1) + "\n"


def _feature(shape: str, coordinates: list[Any], **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": shape, "coordinates": coordinates}}


def _rounded(points: Floats) -> list[list[float]]:
    return [[x + 0.0, y + 0.0] for x, y in np.round(points, DIGITS).tolist()]  # no -0.0


def _written(points: Floats) -> list[list[str]]:
    """The same as texts without zeros at their end."""
    return [[f"{value:.12g}" for value in point] for point in _rounded(points)]


def dxf(named: NamedMap) -> str:
    """DXF R2010 in metres: walls on the layer `walls`, vertices on a layer for each label."""
    from ezdxf import options, units  # type: ignore[attr-defined]
    from ezdxf.filemanagement import new

    options.write_fixed_meta_data_for_testing = True  # no clock and no random identifiers in the file
    drawing = new("R2010", units=units.M)
    drawing.header.custom_vars.append("frame", named.frame)
    drawing.header.custom_vars.append("unit", "m")
    space = drawing.modelspace()
    drawing.layers.add("walls", color=7)
    for line, ring in named.chains:
        space.add_lwpolyline(_rounded(line), close=ring, dxfattribs={"layer": "walls"})
    for label, (colour, _) in COLOURS.items():
        drawing.layers.add(label.word, color=colour)
        for point in _rounded(named.marks(label)):
            space.add_point(point, dxfattribs={"layer": label.word})
    text = io.StringIO()
    drawing.write(text)
    return text.getvalue()


def svg(named: NamedMap) -> str:
    """SVG whose coordinates are metres, y up; on paper it is 1 : 100."""
    points = named.map.vertices if len(named.map.vertices) else np.zeros((1, 2))
    (x0, y0), (x1, y1) = points.min(0) - MARGIN_M, points.max(0) + MARGIN_M
    width, height = x1 - x0, y1 - y0
    lines = [
        f'<poly{"gon" if ring else "line"} points="{" ".join(f"{x},{y}" for x, y in _written(line))}"/>'
        for line, ring in named.chains
    ]
    marks = [
        f'<g id="{label.word}" fill="{colour}">'
        + "".join(f'<circle cx="{x}" cy="{y}" r="0.04"/>' for x, y in _written(named.marks(label)))
        + "</g>"
        for label, (_, colour) in COLOURS.items()
    ]
    size = f'width="{width * SCALE_MM:.1f}mm" height="{height * SCALE_MM:.1f}mm"'
    inner = "\n".join([f'<g id="walls" fill="none" stroke="{style.INK}" stroke-width="0.03">', *lines, "</g>", *marks])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" data-unit="m" {size} '
        f'viewBox="{x0:.4f} {-y1:.4f} {width:.4f} {height:.4f}" data-frame={quoteattr(named.frame)}>\n'
        f"<title>{escape(named.robot)}</title>\n"
        f"<desc>Coordinates in metres, y up: {escape(named.frame)}. 1 : 100.</desc>\n"
        f'<g transform="scale(1,-1)">\n{inner}\n</g>\n</svg>\n'
    )
