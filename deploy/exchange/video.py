"""A run as a moving picture (GIF) for slides: the true world, the robots, and what each of them has mapped.

All frames have one palette and are drawn without smoothing, so that frames differ by few pixels and files stay small.
"""

from __future__ import annotations

import io
from bisect import bisect_right
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont
from shapely import Polygon

from deploy.report import style
from deploy.report.rundir import Run, read_drawable
from deploy.report.words import headline
from protocol.arrays import Floats
from protocol.files import check_own, make_folder, write_whole
from world.worldfile import World, polygons_of

SIZE_PX = 880  # of the plan's longer side
HEAD_PX = 44  # for title and time
MARGIN_PX = 16
FRAMES = 150
FRAME_MS = 100
LAST_MS = 3000  # the end stays
ROBOT_PX = 7  # least radius of a robot
WALL_PX = 3
PALETTE = ("#ffffff", style.INK, style.SOLID, *style.ROBOTS)
WHITE, INK, SOLID, FIRST = range(4)  # places in it; FIRST is the first robot's


def write_video(path: Path, out: Path) -> list[Path]:
    """Write run.gif into a folder, and return it. Raises InputError where the run's world or paths are lacking.

    Also where a file of another kind has that name.
    """
    run, world = read_drawable(path)
    check_own(b"GIF8", out / "run.gif")
    film = _Film(run, world)
    first, *rest = [film.frame(t) for t in np.linspace(0, run.duration, FRAMES).tolist()]
    data = io.BytesIO()
    durations = [FRAME_MS] * len(rest) + [LAST_MS]
    first.save(data, "GIF", save_all=True, append_images=rest, duration=durations, loop=0, optimize=False)
    make_folder(out)
    write_whole(out / "run.gif", data.getvalue())
    return [out / "run.gif"]


class _Film:
    """What all frames share."""

    def __init__(self, run: Run, world: World) -> None:
        x0, y0, x1, y1 = world.solid.bounds
        self._run, self._low, self._high = run, x0, y1
        self._scale = SIZE_PX / max(x1 - x0, y1 - y0)
        width, height = (round(self._scale * side) + 2 * MARGIN_PX for side in (x1 - x0, y1 - y0))
        self._font, self._small = ImageFont.load_default(22), ImageFont.load_default(16)
        self._ground = Image.new("P", (width, height + HEAD_PX), WHITE)
        self._ground.putpalette([part for colour in PALETTE for part in ImageColor.getrgb(colour)])
        pen = ImageDraw.Draw(self._ground)
        pen.fontmode = "1"
        pen.text((MARGIN_PX, 12), headline(run), INK, self._font)
        parts = polygons_of(world.solid)
        for part in sorted(parts, key=lambda part: -Polygon(part.exterior).area):  # islands in holes last
            pen.polygon(self._places(np.asarray(part.exterior.coords)), SOLID)
            for hole in part.interiors:
                pen.polygon(self._places(np.asarray(hole.coords)), WHITE)

    def frame(self, t: float) -> Image.Image:
        """The picture at a simulated time."""
        image = self._ground.copy()
        pen = ImageDraw.Draw(image)
        pen.fontmode = "1"
        pen.text((image.width - MARGIN_PX, 12), f"{t:.0f} s", INK, self._font, anchor="ra")
        placed = [(k, robot) for k, robot in enumerate(self._run.robots) if robot in self._run.frames]
        for k, robot in placed:
            snapshots = self._run.snapshots.get(robot, [])
            now = bisect_right(snapshots, t, key=lambda snapshot: snapshot[0]) - 1
            if now >= 0:
                beside = k * min(WALL_PX, style.BAND_PX / len(placed)) / self._scale  # maps that agree lie side by side
                drawn = snapshots[now][1].moved(self._run.frames[robot]).inset(beside)
                for wall in drawn.vertices[drawn.edges]:
                    pen.line(self._places(wall), _colour(k), WALL_PX)
        for k, robot in placed:
            path = self._run.paths.get(robot)
            if path is not None:
                row = max(int(np.searchsorted(path[:, 0], t, "right")) - 1, 0)
                ((x, y),) = self._places(path[row : row + 1, 1:])
                pen.circle((x, y), max(ROBOT_PX, self._scale * self._run.radius), _colour(k))
                pen.text((x + ROBOT_PX + 2, y - ROBOT_PX - 2), robot, INK, self._small, anchor="ls")
        return image

    def _places(self, points: Floats) -> list[tuple[float, float]]:
        """Pixels of points in the world (n, 2)."""
        x = MARGIN_PX + self._scale * (points[:, 0] - self._low)
        y = HEAD_PX + MARGIN_PX + self._scale * (self._high - points[:, 1])
        return list(zip(x.tolist(), y.tolist(), strict=True))


def _colour(robot: int) -> int:
    """Place in the palette of the robot of that number."""
    return FIRST + robot % len(style.ROBOTS)
