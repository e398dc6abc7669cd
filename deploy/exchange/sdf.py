"""Gazebo's SDF: what of its collision shapes a lidar sees that turns level at one height.

Poses are x y z roll pitch yaw of a frame in that of its parent (sdformat.org, "Specifying pose"). In a world that
Gazebo saved, the poses of models in `state` are those that count.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import shapely

from deploy.exchange.shapes import Shapes
from protocol.arrays import Floats
from protocol.document import read_text
from protocol.errors import InputError
from world.worldfile import check_crossings

HEIGHT_M = 0.182
"""Of the lidar above the ground: the TurtleBot3 Burger's (turtlebot3_description)."""
SIDES = 32  # of a cylinder's cut
MAX_DEPTH = 16  # models within each other, included ones too
MAX_INCLUDES = 200
MAX_SHAPES = 20_000  # collision shapes, the included ones too: a world has at most half as many corners
SDF_END = "</sdf>"
UNSEEN = frozenset({"plane", "empty"})  # shapes that no level beam meets
Matrix = Floats  # (4, 4)


@dataclass
class _Reading:
    """What is read so far."""

    height_m: float
    models: Sequence[Path]
    cuts: list[shapely.Geometry] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    includes: int = 0
    shapes: int = 0


def parse_xml(text: str) -> Element:
    """The root of a text in XML. Raises InputError, also for any document type, by which texts grow or reach files."""
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        end = text.rfind(SDF_END)  # Gazebo reads files with rubbish behind it, and there are some
        root: Element = fromstring(text[: end + len(SDF_END)] if end >= 0 else text, forbid_dtd=True)
    except DefusedXmlException:
        raise InputError("it declares a document type or entities; they are not read") from None
    except (ParseError, ValueError) as error:
        raise InputError(f"no XML: {error}") from None
    return root


def read_sdf(root: Element, height_m: float = HEIGHT_M, models: Sequence[Path] = ()) -> Shapes:
    """Boxes, cylinders and spheres at this height. models: folders in which model://NAME is looked for.

    Raises InputError for a number that is none, for models that include each other without end, and for shapes that lie
    over each other by the thousand.
    """
    reading = _Reading(height_m, models)
    for world in root.iter("world"):
        moved = {state.get("name"): _pose(state) for state in world.findall("state/model")}
        _models(world, np.eye(4), reading, moved, 0)
    _models(root, np.eye(4), reading, {}, 0)
    check_crossings(reading.cuts)
    return Shapes(reading.cuts, left_out=reading.left_out)


def _models(parent: Element, frame: Matrix, reading: _Reading, moved: dict[str | None, Matrix], depth: int) -> None:
    """All models that are children of an element. moved: poses that count in place of the models' own."""
    if depth > MAX_DEPTH:
        raise InputError(f"models within models, deeper than {MAX_DEPTH}")
    for model in parent.findall("model"):
        _model(model, frame, reading, moved.get(model.get("name")), depth)
    for include in parent.findall("include"):
        uri = (include.findtext("uri") or "").strip()
        found = _included(uri, reading)
        if found is None or include.find("plugin") is not None:
            reading.left_out[f"<include> {uri or 'without a uri'}"] += 1
            continue
        reading.includes += 1
        if reading.includes > MAX_INCLUDES:
            raise InputError(f"more than {MAX_INCLUDES} models are included")
        place = moved.get(include.findtext("name"))
        if place is None and include.find("pose") is not None:
            place = _pose(include)
        for model in found.findall("model"):
            _model(model, frame, reading, place, depth + 1)


def _included(uri: str, reading: _Reading) -> Element | None:
    """The SDF of a model in one of the folders; None where there is none."""
    name = uri.removeprefix("model://")
    if name == uri or ".." in name.split("/") or name.startswith("/") or "\0" in name:
        return None
    files = (folder / name / "model.sdf" for folder in reading.models)
    file = next((file for file in files if file.is_file()), None)
    return None if file is None else parse_xml(read_text(file))


def _model(model: Element, frame: Matrix, reading: _Reading, place: Matrix | None, depth: int) -> None:
    name = f"model {model.get('name', '')}"
    if model.find("plugin") is not None:
        reading.left_out[f"{name}, which a plugin moves"] += 1
        return
    here = frame @ (_pose(model) if place is None else place)
    for link in model.findall("link"):
        at = here @ _pose(link)
        for collision in link.findall("collision"):
            if any(map(_relative, (model, link, collision))):
                reading.left_out[f"{name}, placed relative to another"] += 1
            else:
                _shape(collision.find("geometry"), at @ _pose(collision), name, reading)
    _models(model, here, reading, {}, depth + 1)


def _relative(element: Element) -> bool:
    """Whether an element's pose is given in a frame that is not its parent's."""
    pose = element.find("pose")
    return pose is not None and (pose.get("relative_to") or pose.get("frame") or "world") not in ("world", "__model__")


def _shape(geometry: Element | None, frame: Matrix, name: str, reading: _Reading) -> None:
    """Cut one collision shape at the height."""
    for shape in geometry if geometry is not None else ():
        reading.shapes += 1
        if reading.shapes > MAX_SHAPES:
            raise InputError(f"more than {MAX_SHAPES} collision shapes")
        match shape.tag:
            case "box":
                x, y, z = _sizes(shape.findtext("size"), 3)
                base, low, high = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2, -z / 2, z / 2
            case "cylinder":
                (radius,), (length,) = _sizes(shape.findtext("radius"), 1), _sizes(shape.findtext("length"), 1)
                base, low, high = _circle(radius), -length / 2, length / 2
            case "sphere":
                (radius,) = _sizes(shape.findtext("radius"), 1)
                off = reading.height_m - frame[2, 3]
                if abs(off) >= radius:
                    continue
                base = _circle(math.sqrt(radius**2 - off**2))
                reading.cuts.append(shapely.Polygon(base + frame[:2, 3]))
                continue
            case tag:
                if tag not in UNSEEN:
                    reading.left_out[f"{tag} of {name}"] += 1
                continue
        cut = _cut(base, low, high, frame, reading.height_m)
        if cut.area > 0:
            reading.cuts.append(cut)


def _circle(radius: float) -> Floats:
    """(SIDES, 2) a polygon of a circle's area."""
    step = 2 * math.pi / SIDES
    angles = step * np.arange(SIDES)
    return radius * math.sqrt(step / math.sin(step)) * np.stack([np.cos(angles), np.sin(angles)], 1)


def _cut(base: Floats, low: float, high: float, frame: Matrix, height_m: float) -> shapely.Geometry:
    """Where a level plane cuts a prism over a convex base (k, 2), which stands in the frame as it likes."""
    ends = [np.column_stack([base, np.full(len(base), z), np.ones(len(base))]) @ frame.T for z in (low, high)]
    below, above = (end[:, :3] for end in ends)
    edges = [(below, above), *((end, np.roll(end, -1, 0)) for end in (below, above))]
    starts, stops = (np.vstack([edge[k] for edge in edges]) for k in (0, 1))
    a, b = starts[:, 2] - height_m, stops[:, 2] - height_m
    across = np.sign(a) * np.sign(b) < 0
    share = (a[across] / (a[across] - b[across]))[:, None]
    points = starts[across, :2] + share * (stops[across, :2] - starts[across, :2])
    return shapely.MultiPoint(points).convex_hull


def _pose(element: Element) -> Matrix:
    """(4, 4) of an element's pose; the identity where it has none."""
    pose = element.find("pose")
    text = "" if pose is None else (pose.text or "").strip()
    x, y, z, roll, pitch, yaw = _numbers(text, 6) if text else [0.0] * 6
    if pose is not None and pose.get("degrees") == "true":
        roll, pitch, yaw = map(math.radians, (roll, pitch, yaw))
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y],
            [-sp, cp * sr, cp * cr, z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _sizes(text: str | None, count: int) -> list[float]:
    """So many finite numbers of at least 0: with less, a shape would be left out untold, or be turned around."""
    numbers = _numbers(text, count)
    if min(numbers) < 0:
        raise InputError(f"a shape has the size {(text or '').strip()!r:.60}: no size is below 0")
    return numbers


def _numbers(text: str | None, count: int) -> list[float]:
    """So many finite numbers."""
    words = (text or "").split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) < 1e6 for number in numbers):
        raise InputError(f"{count} numbers are wanted in place of {(text or '').strip()!r:.60}")
    return numbers
