"""The maps that are exported: of a run directory, or of one file of it, in the robot's own frame or the world's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agent.geometry.chains import chains_of
from agent.geometry.visibility import VIEW_RAYS, VIEW_STEP_M, visible_ring
from deploy import manifest
from deploy.report.rundir import Map, Run, parse_map, read_run
from protocol.arrays import Floats
from protocol.document import read_text
from protocol.errors import InputError, ProtocolError
from protocol.files import check_own, make_folder, write_whole
from protocol.geometry import seen_from
from protocol.walls import neighbours
from protocol.wireframe import Label, Wireframe
from world.worldfile import check_crossings, whole

Frame = Literal["own", "world"]


@dataclass(frozen=True)
class NamedMap:
    """One robot's map in the frame in which it is exported. Metres."""

    name: str  # of its files, without suffix: that of the robot, or of the file that it is from
    robot: str
    frame: str  # in words
    map: Map
    viewpoints: Floats  # (k, 2) where the robot has looked from; empty where that is not on record
    range_m: float
    """Of its lidar. Of recorded logs the default's: their maps have gaps, and of a view of 80 m through these 98 %
    would be places that no beam has crossed (two public logs)."""

    @property
    def chains(self) -> list[tuple[Floats, bool]]:
        """Its walls as lines (k, 2), free space on the left, and whether each is a ring, with its first point once."""
        chains = chains_of(*neighbours(self.map.edges, len(self.map.vertices)))
        rings = [len(chain) > 1 and chain[0] == chain[-1] for chain in chains]
        lines = [self.map.vertices[chain[:-1] if ring else chain] for chain, ring in zip(chains, rings, strict=True)]
        return [(line, ring) for line, ring in zip(lines, rings, strict=True) if len(line) > 1]

    def marks(self, label: Label) -> Floats:
        """Its vertices (k, 2) of one label."""
        return np.asarray(self.map.vertices[self.map.labels == label], np.float64)

    @property
    def walls(self) -> Floats:
        """(m, 4) x1, y1, x2, y2, free space on the left."""
        return self.map.vertices[self.map.edges].reshape(-1, 4)

    @cached_property
    def free(self) -> BaseGeometry:
        """What is known to be free: within closed outlines, and in view of the robot's path.

        Raises InputError where too many walls cross.
        """
        rings = [shapely.LinearRing(line) for line, ring in self.chains if ring and len(line) > 2]
        check_crossings([], rings)
        rooms = shapely.union_all([whole(shapely.Polygon(ring)) for ring in rings if ring.is_ccw])
        solids = shapely.union_all([whole(shapely.Polygon(ring)) for ring in rings if not ring.is_ccw])
        views = [visible_ring(x, y, self.walls, self.range_m, VIEW_RAYS) for x, y in self.viewpoints.tolist()]
        seen = shapely.union_all([shapely.Polygon(view).buffer(0) for view in views])
        return shapely.union(rooms, seen).difference(solids)


Form = Callable[[NamedMap], str | bytes]
BEGINS: Mapping[str, bytes] = {
    "pgm": b"P5\n# unit: m a cell ",
    "yaml": b"# unit: m, rad; frame: ",
    "geojson": b'{\n "type": "FeatureCollection",\n "name": ',
    "dxf": b"  0\nSECTION\n",
    "svg": b'<svg xmlns="http://www.w3.org/2000/svg" data-unit="m" ',
}
"""What our files of a suffix begin with. Others are not written over."""


def read_maps(path: Path, frame: Frame) -> list[NamedMap]:
    """The final maps of a run directory, or the one in a map file. Raises InputError where there is none."""
    if path.is_dir():
        run = read_run(path)
        maps = run.maps
    else:  # its robot is the first word of its name, r1 of r1.own.json
        folder = path.absolute().parent
        run = read_run(folder.parent) if folder.name == "maps" else Run(folder)
        try:
            maps = {path.name.split(".")[0]: parse_map(read_text(path))}
        except InputError as error:
            raise InputError(f"{path}: neither a run directory nor a map file: {error}") from None
        except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
            raise InputError(f"{path}: no map: {(str(error) or repr(error)).splitlines()[0]:.200}") from None
    if not maps:
        broken = [note for note in run.notes if note.startswith("maps/")]
        why = manifest.unfinished(path) or "a mind of your own publishes one by `self.show(Wireframe(...))`"
        raise InputError(f"{path} has no maps: {'; '.join([*broken, why])}")
    return [_named(run, robot, drawn, frame, path) for robot, drawn in maps.items()]


def _named(run: Run, robot: str, drawn: Map, frame: Frame, path: Path) -> NamedMap:
    m = len(drawn.edges)
    try:
        ones = np.ones(m, np.float32), np.ones(m, np.bool_)
        Wireframe(drawn.vertices, drawn.labels, drawn.edges.astype(np.int32), *ones).check()
    except ProtocolError as error:
        raise InputError(f"{path}: the map of {robot}: {error}") from None
    pose = None if run.of_logs else run.frames.get(robot)  # of recorded logs, paths are in the own frame
    if frame == "world" and pose is None:
        raise InputError(f"{path}: the frame of {robot} in the world is not known; leave out --frame world")
    track = run.paths[robot][:, 1:] if robot in run.paths and (pose is not None or run.of_logs) else np.zeros((0, 2))
    if frame == "own" and pose is not None:
        track = seen_from(pose, track)
    return NamedMap(
        robot if path.is_dir() else path.stem,
        robot,
        f"own frame of {robot}" if frame == "own" else "world",
        drawn.moved(pose if frame == "world" else None),
        _apart(track),
        run.lidar.range_max_m,
    )


def _apart(track: Floats) -> Floats:
    """Points of a path (n, 2), each VIEW_STEP_M from the one before."""
    kept: list[Floats] = []
    for point in track:
        if not kept or np.hypot(*(point - kept[-1])) >= VIEW_STEP_M:
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def export_maps(path: Path, out: Path, frame: Frame, forms: Mapping[str, Form]) -> list[Path]:
    """Write each map of `read_maps` as NAME.SUFFIX for each suffix of `forms`, and return the files.

    Raises InputError, also where a file of another kind has the name of one, and UnwritableError.
    """
    files = {out / f"{named.name}.{suffix}": (named, suffix) for named in read_maps(path, frame) for suffix in forms}
    for file, (_, suffix) in files.items():
        check_own(BEGINS[suffix], file)
    make_folder(out)
    for file, (named, suffix) in files.items():
        write_whole(file, forms[suffix](named))
    return list(files)
