"""Gazebo's SDF: what of its collision shapes a lidar sees that turns level at one height.

Poses are x y z roll pitch yaw of a frame in that of its parent (sdformat.org, "Specifying pose"), or x y z and a
quaternion x y z w (SDFormat 1.9, pose.sdf). In a world that Gazebo saved, the poses of models in `state` are those that
count.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import shapely

from deploy.exchange.shapes import Shapes
from protocol.arrays import Floats
from protocol.document import read_text
from protocol.errors import InputError
from protocol.geometry import rotations
from world.worldfile import check_crossings

HEIGHT_M = 0.182
"""Of the lidar above the ground: the TurtleBot3 Burger's (turtlebot3_description)."""
SIDES = 32  # of a cylinder's cut
MAX_DEPTH = 16  # models within each other, included ones too
MAX_INCLUDES = 200
MAX_SHAPES = 20_000  # collision shapes, the included ones too: a world has at most half as many corners
SDF_END = "</sdf>"
ELSEWHERE = "placed relative to another"  # what is said of it: chains of frames are not followed
UNSEEN = frozenset({"plane", "empty"})  # shapes that no level beam meets
Matrix = Floats  # (4, 4)
Frames = Mapping[str, Matrix | None]
"""What poses may be given in, by name, "" the parent; None where that is not known."""


@dataclass
class _Reading:
    """What is read so far."""

    height_m: float
    models: Sequence[Path]
    cuts: list[shapely.Geometry] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    includes: int = 0
    files: dict[Path, Element] = field(default_factory=dict)  # those of included models
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
    origin = {"": np.eye(4), "world": np.eye(4)}
    for world in root.iter("world"):
        moved = {state.get("name"): _pose(state) for state in world.findall("state/model")}
        _models(world, origin, reading, moved, 0)
    _models(root, origin, reading, {}, 0)
    check_crossings(reading.cuts)
    return Shapes(reading.cuts, left_out=reading.left_out)


def _models(parent: Element, frames: Frames, reading: _Reading, moved: Mapping[str | None, Matrix], depth: int) -> None:
    """All models that are children of an element. moved: poses that count in place of the models' own."""
    if depth > MAX_DEPTH:
        raise InputError(f"models within models, deeper than {MAX_DEPTH}")
    for model in parent.findall("model"):
        place = moved.get(model.get("name"))
        _model(model, _place(model, frames) if place is None else place, reading, depth)
    for include in parent.findall("include"):
        uri = (include.findtext("uri") or "").strip()
        found = None if include.find("plugin") is not None else _included(uri, reading)
        if found is None:
            reading.left_out[f"<include> {uri or 'without a uri'}"] += 1
            continue
        reading.includes += 1
        if reading.includes > MAX_INCLUDES:
            raise InputError(f"more than {MAX_INCLUDES} models are included")
        place = moved.get(include.findtext("name"))
        for model in found.findall("model"):
            told = model if include.find("pose") is None else include
            _model(model, _place(told, frames) if place is None else place, reading, depth + 1)


def _included(uri: str, reading: _Reading) -> Element | None:
    """The SDF of a model in one of the folders; None where there is none."""
    name = uri.removeprefix("model://")
    if name == uri or ".." in name.split("/") or name.startswith("/") or "\0" in name:
        return None
    files = (folder / name / "model.sdf" for folder in reading.models)
    file = next((file for file in files if file.is_file()), None)
    if file is not None and file not in reading.files:
        reading.files[file] = parse_xml(read_text(file))
    return None if file is None else reading.files[file]


def _model(model: Element, here: Matrix | None, reading: _Reading, depth: int) -> None:
    """Its links and the models in it. here: where it is; None where that is not known."""
    name = f"model {model.get('name', '')}"
    if model.find("plugin") is not None:
        reading.left_out[f"{name}, which a plugin moves"] += 1
        return
    if here is None:
        reading.left_out[f"{name}, {ELSEWHERE}"] += 1
        return
    frames: Frames = {"": here, "__model__": here}
    for link in model.findall("link"):
        around = {**frames, "": _place(link, frames)}
        for collision in link.findall("collision"):
            if (place := _place(collision, around)) is None:
                reading.left_out[f"a part of {name}, {ELSEWHERE}"] += 1
            else:
                _shape(collision.find("geometry"), place, name, reading)
    _models(model, frames, reading, {}, depth + 1)


def _place(element: Element, frames: Frames) -> Matrix | None:
    """An element's pose in the world; None where it is given in a frame that is not among these."""
    pose = element.find("pose")
    frame = frames.get("" if pose is None else pose.get("relative_to") or pose.get("frame") or "")
    return None if frame is None else frame @ _pose(element)


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
    """Where a level plane cuts a prism over a convex base (k, 2), which stands in the frame as it likes.

    What begins at the plane is cut, and what ends there is not.
    """
    ends = [np.column_stack([base, np.full(len(base), z), np.ones(len(base))]) @ frame.T for z in (low, high)]
    below, above = (end[:, :3] for end in ends)
    edges = [(below, above), *((end, np.roll(end, -1, 0)) for end in (below, above))]
    starts, stops = (np.vstack([edge[k] for edge in edges]) for k in (0, 1))
    a, b = starts[:, 2] - height_m, stops[:, 2] - height_m
    across = (a <= 0) != (b <= 0)
    share = (a[across] / (a[across] - b[across]))[:, None]
    points = starts[across, :2] + share * (stops[across, :2] - starts[across, :2])
    return shapely.MultiPoint(points).convex_hull


def _pose(element: Element) -> Matrix:
    """(4, 4) of an element's pose; the identity where it has none."""
    pose, made = element.find("pose"), np.eye(4)
    if pose is None or not (text := (pose.text or "").strip()):
        return made
    if pose.get("rotation_format") == "quat_xyzw":
        x, y, z, *quaternion = _numbers(text, 7)
        made[:3, :3] = rotations(np.array([quaternion]))[0]
        if np.isnan(made).any():
            raise InputError(f"the quaternion of the pose {text!r:.60} is 0")
    else:
        x, y, z, *angles = _numbers(text, 6)
        degrees = pose.get("degrees", "").lower() in ("true", "1")
        made[:3, :3] = _rotation(*(map(math.radians, angles) if degrees else angles))
    made[:3, 3] = x, y, z
    return made


def _rotation(roll: float, pitch: float, yaw: float) -> Floats:
    """(3, 3) of angles in radians."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
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
