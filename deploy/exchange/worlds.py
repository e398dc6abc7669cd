"""A world file out of a file of another program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from deploy.exchange import drawings, raster, sdf
from deploy.exchange.shapes import Shapes
from deploy.png import write_figure
from deploy.terminal.worlds import size_of
from protocol.arrays import Floats
from protocol.document import check_size, parse_document, read_document, read_text
from protocol.errors import InputError
from protocol.files import check_has_folder, has_other_than, write_whole
from protocol.text import printable
from world.worldfile import World, WorldFileError, from_document, to_yaml

PICTURES = frozenset({".png", ".pgm", ".pbm", ".bmp", ".gif", ".jpg", ".jpeg", ".tif", ".tiff"})
PNG = b"\x89PNG"  # what a file of the kind begins with
SHAPES = frozenset({"boxes", "walls", "polygons"})  # of a world file, one at least
BODY_M = raster.BODY_M
CLOSE = "--close 2 closes doors of 2 m"
SEED = 0  # by which the starts of the preview are drawn


@dataclass(frozen=True)
class Options:
    """How a file is to be read."""

    width_m: float | None = None  # of a picture, and of a drawing without a unit
    height_m: float = sdf.HEIGHT_M  # of the lidar, for SDF
    models: tuple[Path, ...] = ()  # folders of SDF models
    close_m: float = 0.0  # openings of the outer walls up to so wide are closed
    boundary: bool = False  # a wall around a picture
    straighten: bool = True
    robots: int = 3  # that must have room to start


def import_world(file: Path, out: Path, options: Options) -> list[str]:
    """Write a world file and a picture of it, and return what there is to tell, a line each. Raises InputError."""
    check_has_folder(out)
    picture = out.with_suffix(".png")
    if out == picture:
        raise InputError(f"{out}: its picture goes there; name the world file {out.with_suffix('.yaml').name}")
    try:
        sources = _sources(file)
        for written in (out, picture):
            if written.resolve() in sources:
                raise InputError(f"{written} would be written over; give the world another name by --out")
        for written, other in ((out, _is_other_than_world(out)), (picture, has_other_than(PNG, picture))):
            if other:
                raise InputError(
                    f"{written} is there already and of another kind; give the world another name by --out"
                )
        shapes = read_shapes(file, options)
        world, starts = _checked(shapes, file, out, options)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    write_whole(out, to_yaml(world.document))
    _draw(world, starts, picture)
    size = size_of(world)
    told = [
        f"{size.name}: {size.width_m:.1f} m x {size.height_m:.1f} m, {size.walls} walls of {size.wall_m:.0f} m, "
        f"{size.free_m2:.1f} m2 free; {options.robots} robots can start",
        *_openings(world, starts[0], options),
    ]
    told += [f"assumed: {what}" for what in shapes.assumed]
    told += [
        f"left out: {printable(what)}{f' ({count} times)' if count > 1 else ''}"
        for what, count in shapes.left_out.items()
    ]
    return [*told, str(out), str(picture)]


def _is_other_than_world(file: Path) -> bool:
    """Whether a file is there that has something other than a world in it."""
    if not file.is_file() or not file.stat().st_size:
        return False
    try:
        document = read_document(file)
    except InputError:
        return True
    return not isinstance(document, dict) or SHAPES.isdisjoint(document)


def _sources(file: Path) -> set[Path]:
    """The file that is read, and the picture that it names."""
    found = {file.resolve()}
    if file.suffix.lower() in (".yaml", ".yml"):
        about = read_document(file)
        image = about.get("image") if isinstance(about, dict) else None
        if isinstance(image, str) and "\0" not in image:  # else it is no path
            found.add((file.parent / image).resolve())
    return found


def _checked(shapes: Shapes, file: Path, out: Path, options: Options) -> tuple[World, Floats]:
    """The world of a file's shapes, and (robots, 3) places where robots can start. Raises InputError."""
    try:
        if options.close_m:
            shapes = shapes.closed(options.close_m)
        world = from_document(shapes.document(file.stem, file.name), out.name)
        return world, _starts(world, options)
    except InputError as error:
        raise InputError(shapes.refusal(str(error).removeprefix(f"{out.name}: "))) from None


def _starts(world: World, options: Options) -> Floats:
    """(robots, 3) places where robots can start. Raises WorldFileError where there is no room."""
    try:
        return world.starts(options.robots, BODY_M, np.random.default_rng(SEED))
    except WorldFileError as error:
        hint = "" if options.close_m else f"; where its walls do not close, {CLOSE}"
        raise WorldFileError(f"{error}{hint}") from None


def _openings(world: World, start: Floats, options: Options) -> list[str]:
    """What there is to tell of outer walls that do not close."""
    advice = f"--close {options.close_m:g} is too little" if options.close_m else CLOSE
    around = shapely.box(*world.solid.bounds)
    home = world.region_of(float(start[0]), float(start[1]), BODY_M)
    if home is None or not home.within(around):
        return [f"its walls do not close: robots can leave; {advice}"]
    outside = [region for region in world.regions(BODY_M) if not region.within(around)]
    open_m2 = shapely.union_all(outside).intersection(world.solid.convex_hull).area
    if open_m2 <= home.area:
        return []
    return [f"robots start in closed {home.area:.0f} m2, but {open_m2:.0f} m2 amid its walls are open; {advice}"]


def read_shapes(file: Path, options: Options) -> Shapes:
    """What a file says, by its suffix and content. Raises InputError without the file's name."""
    suffix = file.suffix.lower()
    if suffix in PICTURES:
        if options.width_m is None:
            raise InputError("--width: say how many metres the picture is wide, or name its map_server YAML")
        return raster.read_bitmap(file, options.width_m, options.straighten, options.boundary)
    if suffix == ".dxf":  # in an encoding of its own
        check_size(file)
        return drawings.read_dxf(file, options.width_m)
    text = read_text(file)
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        root = sdf.parse_xml(text)
        if root.tag == "sdf":
            return sdf.read_sdf(root, options.height_m, options.models)
        if root.tag.rpartition("}")[2] == "svg":
            return drawings.read_svg(root)
        raise InputError(f"XML with the root <{root.tag:.40}> is not known; SDF and SVG are")
    return _of_document(parse_document(text), text, file, options)


def _of_document(about: Any, text: str, file: Path, options: Options) -> Shapes:
    match about:
        case {"image": _}:
            return raster.read_map_server(about, file.parent, options.straighten)
        case {"verts": _}:
            return drawings.read_house_expo(about, options.straighten)
        case {"type": "FeatureCollection"}:
            return drawings.read_geojson(about)
        case {"vertices": _, "edges": _}:
            return drawings.read_own_map(text)
    raise InputError("neither map_server, SDF, a picture, HouseExpo, GeoJSON, DXF nor a map of ours")


def _draw(world: World, starts: Any, file: Path) -> None:
    """The solids, and where robots could start."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from deploy.report import style
    from deploy.report.picture import draw_solids

    figure = Figure(figsize=(8, 8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    draw_solids(axes, world.solid)
    axes.plot(*starts[:, :2].T, "o", color=style.colour(0), ms=6)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set(title=f"{printable(world.name)} (dots: possible starts)", xlabel="x (m)", ylabel="y (m)")
    write_figure(figure, file, dpi=110, facecolor="white", metadata={"Software": None})
