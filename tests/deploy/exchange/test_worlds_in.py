"""Worlds from files of other programs: what is solid there is solid here, and what cannot be read is said."""

import json
import math
import random
import sys
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import ezdxf
import numpy as np
import pytest
import shapely
import shapely.affinity
from PIL import Image, ImageDraw

from deploy import cli
from deploy.exchange import FORMS, drawings
from deploy.exchange.maps import export_maps
from deploy.exchange.raster import read_bitmap, read_darkness
from deploy.exchange.sdf import parse_xml, read_sdf
from deploy.exchange.worlds import Options, import_world
from protocol.errors import InputError
from tests.deploy.test_report import RING, write_run
from world.worldfile import World, from_document, load, polygons_of

ROOM = shapely.Polygon(RING)
AS_DRAWN = Options(robots=1)
CELL = 0.05

SDF = """<?xml version='1.0'?>
<sdf version='1.6'><world name='w'>
<include><uri>model://sun</uri></include><include><uri>model://posts</uri><pose>1 0 0 0 0 0</pose></include>
<model name='walls'><pose>9 9 9 0 0 0</pose>{walls}</model>
<model name='sofa'><link name='l'><collision name='c'><geometry><mesh><uri>x.dae</uri></mesh></geometry>
</collision></link></model>
<model name='low'><pose>1 1 0 0 0 0</pose><link name='l'><collision name='c'><geometry><box><size>1 1 0.2</size></box>
</geometry></collision></link></model>
<model name='ground'><link name='l'><collision name='c'><geometry><plane/></geometry></collision></link></model>
<model name='r'><plugin/><link name='l'><collision name='c'><geometry><sphere><radius>1</radius></sphere></geometry>
</collision></link></model>
<state world_name='w'><model name='walls'><pose frame=''>1 2 0 0 0 0.5</pose></model></state>
</world></sdf>
143"""
WALL = """<link name='{}'><pose>{} {} 0 0 0 {}</pose><collision name='c'><pose>0 0 1.25 0 0 0</pose>
<geometry><box><size>{} 0.15 2.5</size></box></geometry></collision></link>"""
BOX = """<link name='l'><collision name='c'>{}<geometry><box><size>{}</size></box></geometry></collision></link>"""
POSTS = """<sdf version='1.6'><model name='posts'><pose>5 5 0 0 0 0</pose><model name='inner'><pose>0 1 0 0 0 0</pose>
<link name='l'><pose>0 0.5 0.5 0 0 0</pose>
<collision name='up'><geometry><cylinder><radius>0.2</radius><length>1</length></cylinder></geometry></collision>
<collision name='lying'><pose>0 1 -0.318 0 1.5707963 0</pose>
<geometry><cylinder><radius>0.1</radius><length>1</length></cylinder></geometry></collision>
</link></model></model></sdf>"""


DXF = "0\nSECTION\n2\nENTITIES\n{}0\nENDSEC\n0\nEOF\n"
METRES = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n6\n0\nENDSEC\n"
CIRCLE = "0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n{}\n"


def sdf() -> str:
    sides = [(0, -2, 0, 6.15), (0, 2, 0, 6.15), (-3, 0, math.pi / 2, 4), (3, 0, math.pi / 2, 4)]
    return SDF.format(walls="".join(WALL.format(k, *side) for k, side in enumerate(sides)))


def picture(file: Path, draw: Callable[[ImageDraw.ImageDraw], None], size: tuple[int, int] = (200, 160)) -> Path:
    image = Image.new("L", size, 205)
    draw(ImageDraw.Draw(image))
    image.save(file)
    return file


def imported(file: Path, options: Options = AS_DRAWN) -> tuple[World, list[str]]:
    out = file.with_name("made.yaml")
    told = import_world(file, out, options)
    assert out.with_suffix(".png").stat().st_size > 5000
    return load(out), told


def room_of(world: World, x: float, y: float) -> shapely.Polygon:
    return next(part for part in world.free if part.contains(shapely.Point(x, y)))


def test_sdf_is_cut_at_the_height_of_the_lidar(tmp_path: Path) -> None:
    (tmp_path / "posts").mkdir()
    (tmp_path / "posts" / "model.sdf").write_text(POSTS)
    (tmp_path / "hall.sdf").write_text(sdf())
    world, told = imported(tmp_path / "hall.sdf", Options(models=(tmp_path,)))
    outer = shapely.affinity.rotate(shapely.box(-3.075, -2.075, 3.075, 2.075), 0.5, origin=(0, 0), use_radians=True)
    inner = shapely.affinity.rotate(shapely.box(-2.925, -1.925, 2.925, 1.925), 0.5, origin=(0, 0), use_radians=True)
    walls, up, lying = outer.difference(inner), shapely.Point(1, 1.5).buffer(0.2), shapely.box(0.5, 2.4, 1.5, 2.6)
    expected = shapely.union_all([shapely.affinity.translate(walls, 1, 2), up, lying])
    assert world.solid.symmetric_difference(expected).area < 0.01  # the circle has 32 sides
    left_out = [line.removeprefix("left out: ") for line in told if line.startswith("left out")]
    assert left_out == ["mesh of model sofa", "model r, which a plugin moves", "<include> model://sun"]
    assert "3 robots can start" in told[0] and "hall" in told[0]


@pytest.mark.parametrize(
    ("body", "left_out"),
    [
        ("<include><uri>model://box</uri><pose relative_to='x'>1 0 0 0 0 0</pose></include>", "model box"),
        ("<model name='m'><pose relative_to='x'/>{box}<model name='n'>{box}</model></model>", "model m"),
        ("<model name='m'><link name='l'><pose relative_to='x'/>{part}</link></model>", "a part of model m"),
    ],
)
def test_what_is_placed_relative_to_another_is_left_out_with_all_in_it(
    tmp_path: Path, body: str, left_out: str
) -> None:
    box = BOX.format("", "1 1 1")
    (tmp_path / "box").mkdir()
    (tmp_path / "box" / "model.sdf").write_text(f"<sdf><model name='box'>{box}</model></sdf>")
    body = body.format(box=box, part=box.removeprefix("<link name='l'>").removesuffix("</link>"))
    shapes = read_sdf(parse_xml(f"<sdf><world>{body}</world></sdf>"), 0.2, [tmp_path])
    assert not shapes.areas and shapes.left_out == {f"{left_out}, placed relative to another": 1}


def test_a_collision_shape_may_be_placed_in_its_model() -> None:
    link = BOX.format("<pose relative_to='__model__'>1 0 0 0 0 0</pose>", "1 1 1")
    link = link.replace("<link name='l'>", "<link name='l'><pose>5 0 0 0 0 0</pose>")
    (area,) = read_sdf(parse_xml(f"<sdf><model>{link}</model></sdf>")).areas
    assert area.equals(shapely.box(0.5, -0.5, 1.5, 0.5))


@pytest.mark.parametrize(("pose", "area"), [("0 0 0.5 45 0 0", 2**0.5), ("0 0 1 0 0 0", 1), ("0 0 0 0 0 0", 0)])
def test_a_shape_with_corners_at_the_height_is_cut(pose: str, area: float) -> None:
    """A box on its edge was lost, and so was one that stands on the plane; one that ends there is none."""
    link = BOX.format(f"<pose degrees='true'>{pose}</pose>", "1 1 1")
    root = parse_xml(f"<sdf><model>{link}</model></sdf>")
    assert sum(cut.area for cut in read_sdf(root, 0.5).areas) == pytest.approx(area)


@pytest.mark.parametrize("word", ["true", "True", "1", "false", "0"])
def test_angles_are_degrees_by_any_word_of_sdf(word: str) -> None:
    link = BOX.format(f"<pose degrees='{word}'>0 0 0 0 0 90</pose>", "4 1 1")
    (area,) = read_sdf(parse_xml(f"<sdf><model>{link}</model></sdf>")).areas
    degrees = word in ("true", "True", "1")
    assert (area.bounds == pytest.approx((-0.5, -2, 0.5, 2))) == degrees


def test_a_pose_may_have_a_quaternion() -> None:
    """One refused the whole world. Gazebo takes those of any length, too."""
    link = BOX.format("<pose rotation_format='quat_xyzw'>{}</pose>", "4 2 1")
    for numbers, bounds in (("1 2 0 0 0 3 3", (0, 0, 2, 4)), ("1 2 0 .5 .5 .5 .5", (0.5, 0, 1.5, 4))):
        (area,) = read_sdf(parse_xml(f"<sdf><model>{link.format(numbers)}</model></sdf>")).areas
        assert area.bounds == pytest.approx(bounds)
    for wrong in ("1 2 0 0 0 0", "1 2 0 0 0 0 0", "1 2 0 0 0 0 nan"):
        with pytest.raises(InputError, match=wrong):
            read_sdf(parse_xml(f"<sdf><model>{link.format(wrong)}</model></sdf>"))


def test_an_included_file_is_read_once_and_not_for_a_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of 10 MB could name another one 100,000 times."""
    (tmp_path / "box").mkdir()
    (tmp_path / "box" / "model.sdf").write_text(f"<sdf><model>{BOX.format('', '1 1 1')}</model></sdf>")
    once, moved = (f"<include><uri>model://box</uri>{more}</include>" for more in ("", "<plugin/>"))
    root = parse_xml(f"<sdf><world>{moved * 9}{once * 2}</world></sdf>")
    monkeypatch.setattr("deploy.exchange.sdf.read_text", read := Mock(side_effect=Path.read_text))
    shapes = read_sdf(root, 0.2, [tmp_path])
    assert read.call_count == 1 and len(shapes.areas) == 2 and shapes.left_out == {"<include> model://box": 9}


@pytest.mark.parametrize(("name", "text"), [("made.yaml", "a note: mine"), ("made.yaml", "- [:"), ("made.png", "mine")])
def test_what_is_there_and_no_world_is_not_written_over(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / "hall.sdf").write_text(sdf())
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=f"hall.sdf: .*{name} is there already and of another kind"):
        imported(tmp_path / "hall.sdf")
    assert (tmp_path / name).read_text() == text and len(list(tmp_path.iterdir())) == 2


def test_a_world_that_was_imported_before_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "hall.sdf").write_text(sdf())
    for _ in range(2):
        imported(tmp_path / "hall.sdf")


def test_a_map_of_map_server_is_solid_where_it_is_not_free(tmp_path: Path) -> None:
    def draw(image: ImageDraw.ImageDraw) -> None:
        image.rectangle((19, 19, 180, 120), fill=0)
        image.rectangle((20, 20, 179, 119), fill=254)
        image.rectangle((90, 60, 109, 79), fill=0)
        image.rectangle((40, 40, 42, 42), fill=205)  # never looked at, and nothing was seen there

    picture(tmp_path / "map.pgm", draw)
    about = "image: map.pgm\nresolution: 0.05\norigin: [-1, -2, 0.3]\nnegate: 0\nfree_thresh: 0.196"
    (tmp_path / "map.yaml").write_text(about)
    world, told = imported(tmp_path / "map.yaml")
    free = shapely.box(1, 2, 9, 7).difference(shapely.box(4.5, 4, 5.5, 5))
    free = shapely.affinity.translate(shapely.affinity.rotate(free, 0.3, origin=(0, 0), use_radians=True), -1, -2)
    assert room_of(world, *free.representative_point().coords[0]).symmetric_difference(free).area < 1e-3
    assert "39.0 m2 free" in told[0]


@pytest.mark.parametrize(("white", "touched", "unknown"), [(254, 0, True), (255, 0, True), (254, 230, False)])
def test_what_map_saver_left_unknown_is_not_free(tmp_path: Path, white: int, touched: int, unknown: bool) -> None:
    """Nav2's wrote thresholds by which it is. A picture with other greys is no work of map_saver."""

    def draw(image: ImageDraw.ImageDraw) -> None:
        image.rectangle((19, 19, 180, 120), fill=0)
        image.rectangle((20, 20, 179, 119), fill=white)
        image.rectangle((90, 60, 109, 79), fill=0)
        image.rectangle((91, 61, 108, 78), fill=205)
        image.point((19, 19), fill=touched)

    picture(tmp_path / "map.pgm", draw)
    (tmp_path / "map.yaml").write_text("image: map.pgm\nresolution: 0.05\nfree_thresh: 0.25\n")
    world, told = imported(tmp_path / "map.yaml")
    assert world.solid.contains(shapely.Point(5, 4.5)) == unknown
    assert ("assumed: grey 205 is unknown, as map_saver has it, though free_thresh is 0.25" in told) == unknown


@pytest.mark.parametrize("line", ['negate: "1"', "negate: 2", "mode: raw", "mode: 7", "mode: []"])
def test_what_a_map_of_map_server_wants_and_is_not_done_is_refused(tmp_path: Path, line: str) -> None:
    picture(tmp_path / "map.png", lambda image: image.rectangle((20, 20, 179, 119), fill=254))
    (tmp_path / "map.yaml").write_text(f"image: map.png\nresolution: 0.05\n{line}\n")
    with pytest.raises(InputError, match=f"{line.partition(':')[0]}: must be "):
        imported(tmp_path / "map.yaml")


def test_thresholds_of_map_server_that_overlap_are_refused(tmp_path: Path) -> None:
    picture(tmp_path / "map.png", lambda image: image.rectangle((20, 20, 179, 119), fill=254))
    (tmp_path / "map.yaml").write_text("image: map.png\nresolution: 0.05\nfree_thresh: 0.7\n")
    with pytest.raises(InputError, match=r"occupied_thresh: 0.65 is below free_thresh, 0.7"):
        imported(tmp_path / "map.yaml")


@pytest.mark.parametrize("name", ["map.png", "map.pgm", "map.tiff"])
def test_a_picture_of_16_bits_is_as_dark_as_that_of_8(tmp_path: Path, name: str) -> None:
    """Walls that are not black were free, as all from 255 of 65,535 on was white."""
    cells = np.array([[0, 40, 205], [254, 255, 130]], np.uint16)
    Image.fromarray(cells * 257).save(tmp_path / name)
    darkness = read_darkness(tmp_path / name, negate=False)
    assert darkness[::-1] == pytest.approx(1 - cells / 255, abs=1e-6)
    assert read_darkness(tmp_path / name, negate=True) == pytest.approx(1 - darkness, abs=1e-6)


def test_what_is_transparent_is_as_nav2_has_it(tmp_path: Path) -> None:
    """It was free whatever the mode."""
    white, black, clear, veiled = (255,) * 4, (0, 0, 0, 255), (127, 127, 127, 0), (255, 255, 255, 127)
    Image.fromarray(np.array([[white, black, clear, veiled]], np.uint8)).save(tmp_path / "map.png")
    read = partial(read_darkness, tmp_path / "map.png", negate=False)
    assert read(mode="scale")[0] == pytest.approx([0, 1, math.nan, math.nan], nan_ok=True)
    assert read(mode="trinary")[0] == pytest.approx([0, 0.75, 1 - 381 / 1020, 1 - 892 / 1020])
    assert read()[0] == pytest.approx([0, 1, 0, 0])


def test_no_other_program_is_asked_for_a_picture(tmp_path: Path) -> None:
    """Pillow hands PostScript to Ghostscript, whatever the file's name."""
    Image.new("L", (8, 8)).save(tmp_path / "map.png", "EPS")
    with pytest.raises(InputError, match=r"map\.png: no picture that can be read: UnidentifiedImageError"):
        read_darkness(tmp_path / "map.png", negate=False)


def test_a_dark_picture_costs_no_more_than_its_cells(tmp_path: Path) -> None:
    """A point for each dark cell took 330 bytes."""
    picture(tmp_path / "dark.png", lambda image: image.rectangle((90, 90, 109, 109), fill=255), (400, 400))
    tracemalloc.start()
    read_bitmap(tmp_path / "dark.png", width_m=20, straighten=True, boundary=False)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 40 * 400 * 400


@pytest.mark.parametrize(("kind", "said"), [(np.int32, "16 bits"), (np.float32, "fractions")])
def test_a_picture_whose_white_is_not_known_is_refused(tmp_path: Path, kind: type, said: str) -> None:
    Image.fromarray(np.array([[0, 70_000]], kind)).save(tmp_path / "map.tiff")
    with pytest.raises(InputError, match=f"map.tiff: its pixels .*{said}"):
        read_darkness(tmp_path / "map.tiff", negate=False)


@pytest.mark.parametrize("degrees", [0, 3, 20, 45])
def test_walls_of_a_turned_map_are_straightened_along_their_axis(tmp_path: Path, degrees: int) -> None:
    room = shapely.box(-3, -2, 3, 2).difference(shapely.box(-0.1, -2, 0.1, 0.5))
    turned = shapely.affinity.rotate(room, degrees, origin=(0, 0))
    x, y = np.meshgrid(CELL * (np.arange(200) - 99.5), CELL * (79.5 - np.arange(160)))
    near = shapely.distance(turned.exterior, shapely.points(x, y)) < CELL
    cells = np.where(shapely.contains_xy(turned, x, y), 254, np.where(near, 0, 205))
    Image.fromarray(cells.astype(np.uint8)).save(tmp_path / "map.pgm")
    about = f"image: map.pgm\nresolution: {CELL}\norigin: [-5, -4, 0]\nfree_thresh: 0.196\n"
    (tmp_path / "map.yaml").write_text(about)
    raw, _ = imported(tmp_path / "map.yaml", Options(robots=1, straighten=False))
    world, _ = imported(tmp_path / "map.yaml")
    before, after = (room_of(one, 1.0, 0.0) for one in (raw, world))
    assert after.area == pytest.approx(before.area, rel=0.01)
    assert after.hausdorff_distance(before) < 1.5 * CELL
    corners = np.asarray(after.exterior.coords)
    assert len(corners) - 1 <= 12 < len(before.exterior.coords) or degrees == 0
    runs = np.diff(corners, axis=0)
    long = runs[np.hypot(*runs.T) > 0.4]
    off = np.degrees(np.arctan2(long[:, 1], long[:, 0])) - degrees
    assert abs((off + 45) % 90 - 45).max() < 0.5


def test_a_picture_needs_its_width_and_may_have_a_boundary(tmp_path: Path) -> None:
    def draw(image: ImageDraw.ImageDraw) -> None:
        image.rectangle((0, 0, 199, 159), fill=255)
        image.rectangle((50, 40, 149, 119), fill=0)

    file = picture(tmp_path / "block.png", draw)
    with pytest.raises(InputError, match=r"block.png: --width"):
        imported(file)
    world, told = imported(file, Options(width_m=10, robots=1))
    assert world.solid.symmetric_difference(shapely.box(-2.5, -2, 2.5, 2)).area < 1e-6
    assert told[1].startswith("its walls do not close") and "--boundary puts it there" in told[2]
    world, told = imported(file, Options(width_m=10, boundary=True))
    assert room_of(world, -4, 0).area == pytest.approx(10 * 8 - 5 * 4) and len(told) == 3


def test_a_floor_plan_of_house_expo_is_what_lies_within_its_outline(tmp_path: Path) -> None:
    about = {"id": "0a1b", "room_num": 2, "verts": RING.tolist(), "bbox": {"min": [0, 0], "max": [6, 4]}}
    (tmp_path / "0a1b.json").write_text(json.dumps(about))
    world, _ = imported(tmp_path / "0a1b.json")
    assert room_of(world, 1, 1).symmetric_difference(ROOM).area < 1e-3


def test_oblique_walls_of_a_floor_plan_lose_their_steps(tmp_path: Path) -> None:
    steps = np.arange(0, 2.005, 0.01)
    stairs = np.column_stack((6 - np.repeat(steps, 2)[1:], 2 + np.repeat(steps, 2)[:-1]))
    ring = [[0, 0], [6, 0], *stairs.round(2).tolist(), [0, 4]]
    (tmp_path / "plan.json").write_text(json.dumps({"verts": ring}))
    world, _ = imported(tmp_path / "plan.json")
    room, traced = room_of(world, 1, 1), shapely.Polygon(ring)
    assert len(room.exterior.coords) < 12 and room.symmetric_difference(traced).area < 0.004 * traced.area
    as_traced, _ = imported(tmp_path / "plan.json", Options(robots=1, straighten=False))
    assert room_of(as_traced, 1, 1).symmetric_difference(traced).area < 1e-3


@pytest.mark.parametrize("form", [*FORMS, "map"])
def test_our_own_exports_come_back(tmp_path: Path, form: str) -> None:
    run = write_run(tmp_path / "run")
    if form == "map":
        files = [run / "maps" / "r1.json"]
    else:
        files = [file for file in export_maps(run, tmp_path / "out", "world", FORMS[form]) if "r1" in file.name]
    world, _ = imported(files[-1])
    (room,) = [part for part in world.free if part.within(shapely.box(*world.solid.bounds))]
    if form != "map":  # which is in the robot's own frame
        cells = CELL * ROOM.length if form == "map_server" else 0.01
        assert room.symmetric_difference(ROOM).area < cells
    assert room.area == pytest.approx(ROOM.area, rel=0.06 if form == "map_server" else 1e-3)


def test_an_opening_of_the_outer_walls_is_closed(tmp_path: Path) -> None:
    walls = [[[0, 0], [0, 4], [6, 4], [6, 0], [2.9, 0]], [[2, 0], [0, 0]]]
    features = [{"type": "Feature", "geometry": {"type": "LineString", "coordinates": line}} for line in walls]
    (tmp_path / "open.geojson").write_text(json.dumps({"type": "FeatureCollection", "unit": "m", "features": features}))
    assert "do not close" in imported(tmp_path / "open.geojson")[1][1]
    world, told = imported(tmp_path / "open.geojson", Options(close_m=1, robots=2))
    assert len(told) == 3 and room_of(world, 1, 1).area == pytest.approx(24, abs=0.15)


def test_a_closet_in_a_house_that_is_open_is_told(tmp_path: Path) -> None:
    house = [[2.9, 0], [6, 0], [6, 4], [0, 4], [0, 0], [2, 0]]
    closet = [[5, 3], [5.8, 3], [5.8, 3.8], [5, 3.8], [5, 3]]
    lines = [{"type": "Feature", "geometry": {"type": "LineString", "coordinates": line}} for line in (house, closet)]
    (tmp_path / "open.geojson").write_text(json.dumps({"type": "FeatureCollection", "unit": "m", "features": lines}))
    assert "robots start in closed 0 m2, but 2" in imported(tmp_path / "open.geojson")[1][1]
    with pytest.raises(InputError, match=r"no room for 30 robots; where its walls do not close, --close 2 closes"):
        imported(tmp_path / "open.geojson", Options(robots=30))
    assert len(imported(tmp_path / "open.geojson", Options(close_m=1, robots=3))[1]) == 3
    told = imported(tmp_path / "open.geojson", Options(close_m=0.5))[1]
    assert told[1].endswith("are open; --close 0.5 is too little")


BAD = {
    "a.sdf": sdf().replace("6.15 0.15 2.5", "6.15 x 2.5"),
    "less.sdf": sdf().replace("6.15 0.15 2.5", "6.15 -0.15 2.5"),
    "b.sdf": "<!DOCTYPE x [<!ENTITY a 'aaaa'>]><sdf>&a;</sdf>",
    "c.sdf": "<sdf>" + "<model name='m'>" * 40 + "</model>" * 40 + "</sdf>",
    "d.sdf": "<a>" * 100_000,
    "many.sdf": "<sdf><model><link>"
    + "<collision><geometry><plane/></geometry></collision>" * 20_001
    + "</link></model></sdf>",
    "e.world": "<sdf/>",
    "f.xml": "<html/>",
    "g.svg": "<svg xmlns='http://www.w3.org/2000/svg'><polyline points='0,0 1,1'/></svg>",
    "h.json": '{"verts": [[0, 0], [1, 1]]}',
    "i.json": '{"verts": [[0, 0], [1, 1e9], [0, 1]]}',
    "j.geojson": '{"type": "FeatureCollection", "features": []}',
    "k.geojson": '{"type": "FeatureCollection", "unit": "m", "features": [{"type": "Feature", "geometry": 3}]}',
    "l.yaml": "image: none.pgm\nresolution: 0.05",
    "m.yaml": "image: m.yaml\nresolution: 0.05",
    "n.yaml": "image: m.yaml\nresolution: .nan",
    "o.yaml": "image: [1]\nresolution: 1",
    "nul.yaml": 'image: "a\\0b.pgm"\nresolution: 0.05',
    "long.yaml": f"image: {'a' * 300}\nresolution: 0.05",
    "p.dxf": "0\nSECTION\n2\n",
    "huge.dxf": METRES + DXF.format(CIRCLE.format(1e9)),  # of a gigabyte of chords
    "many.dxf": METRES + DXF.format(CIRCLE.format(9e4) * 7),
    "q.txt": "7",
    "r.pgm": "P5 4 4 255\n",
    "s.png": "\x89PNG",
}


BAR = """<collision name='c'><pose>{} {} 0 0 0 {}</pose><geometry><box><size>12 0.01 2</size></box></geometry>
</collision>"""


def tangled() -> list[list[float]]:
    """A ring whose edges cross each other a hundred thousand times."""
    return np.random.default_rng(0).uniform(0, 10, (800, 2)).round(2).tolist()


TANGLED = {
    "verts.json": json.dumps({"verts": tangled()}),
    "area.geojson": json.dumps(
        {
            "type": "FeatureCollection",
            "unit": "m",
            "features": [
                {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [[*tangled(), tangled()[0]]]}}
            ],
        }
    ),
    "lines.geojson": json.dumps(
        {
            "type": "FeatureCollection",
            "unit": "m",
            "features": [{"type": "Feature", "geometry": {"type": "LineString", "coordinates": tangled()}}],
        }
    ),
    "bars.sdf": "<sdf><model name='m'><link name='l'>"
    + "".join(BAR.format(0, y / 10, 0) + BAR.format(y / 10, 0, 1.5708) for y in range(-50, 50))
    + "</link></model></sdf>",
}


@pytest.mark.parametrize("name", TANGLED)
def test_what_would_take_minutes_to_join_is_refused_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(TANGLED[name])
    assert "shapes lie over each other" in (message(tmp_path / name, Options(close_m=1)) or "")


def test_a_picture_of_noise_is_refused_at_once(tmp_path: Path) -> None:
    Image.fromarray(np.indices((400, 400)).sum(0) % 2 == 0).save(tmp_path / "noise.png")
    assert "corners, as noise has" in (message(tmp_path / "noise.png", Options(width_m=20)) or "")


def message(file: Path, options: Options) -> str | None:
    """The sentence by which a file is refused; None where it is taken."""
    try:
        import_world(file, file.with_name("out.yaml"), options)
    except InputError as error:
        text = str(error)
        assert text.startswith(f"{file}: ") and 10 < len(text) - len(str(file)) < 500, text
        return text
    return None


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(BAD[name].encode("latin-1"))
    assert message(tmp_path / name, Options(width_m=5))
    assert not (tmp_path / "out.yaml").exists()


def test_the_command_says_so_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "evil.sdf").write_text("<sdf \x1b[2J>")
    words = ["wireswarm", "import", str(tmp_path / "evil.sdf"), "--out", str(tmp_path / "out.yaml")]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, err = capsys.readouterr()
    assert (end.value.code, out, err.count("\n")) == (2, "", 1) and err[:-1].isprintable()


def samples(folder: Path) -> dict[str, Path]:
    """One good file of each format; of a map_server map both."""
    run = write_run(folder / "run")
    made = {file.suffix: file for form in FORMS for file in export_maps(run, folder, "own", FORMS[form])}
    made[".sdf"] = folder / "hall.sdf"
    made[".sdf"].write_text(sdf())
    made[".json"] = folder / "plan.json"
    made[".json"].write_text(json.dumps({"verts": RING.tolist()}))
    made[".map"] = run / "maps" / "r1.json"
    made[".png"] = picture(folder / "map.png", partial(ImageDraw.ImageDraw.rectangle, xy=(20, 20, 90, 90), fill=0))
    return made


def mutated(content: bytes, rng: random.Random) -> bytes:
    """Some bytes changed, cut out, doubled or the end missing."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, length = rng.randrange(len(data)), rng.choice((1, 1, 4, 40))
        match rng.randrange(5):
            case 0:
                data[at : at + length] = rng.randbytes(length)
            case 1:
                del data[at : at + length]
            case 2:
                data[at:at] = data[at : at + length]
            case 3:
                data[at : at + 1] = rng.choice((b"9" * 30, b"-", b"nan", b"<", b"[", b"}", b"1e400", b"\x00"))
            case _:
                del data[max(at, 1) :]
        if not data:
            return b"0"
    return bytes(data)


def check_mutations(folder: Path, count: int) -> None:
    for kind, good in samples(folder).items():
        assert message(good, Options(width_m=10, robots=1)) is None or kind == ".pgm"
        rng, refused, suffix = random.Random(kind), 0, {".map": ".json"}.get(kind, kind)
        for k in range(count):
            file = folder / f"bad{suffix}"
            file.write_bytes(mutated(good.read_bytes(), rng))
            if kind == ".pgm":
                file = folder / "bad.yaml"
                file.write_text(f"image: bad.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n# {k}\n")
            refused += message(file, Options(width_m=10, robots=1)) is not None
        assert refused or count < 20, kind


def test_mutated_files_are_refused_in_a_sentence_or_read(tmp_path: Path) -> None:
    check_mutations(tmp_path, 3)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_three_hundred_mutated_files_of_each_format(tmp_path: Path) -> None:
    check_mutations(tmp_path, 300)


def test_nothing_that_is_read_is_written_over(tmp_path: Path) -> None:
    """A world beside the picture that it was made from had a preview of the same name."""
    plan = picture(tmp_path / "plan.png", lambda draw: draw.rectangle((20, 20, 180, 140), outline=0, width=3))
    before = plan.read_bytes()
    with pytest.raises(InputError, match=r"plan\.png would be written over"):
        import_world(plan, tmp_path / "plan.yaml", Options(width_m=8))
    (tmp_path / "map.yaml").write_text("image: plan.png\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(InputError, match=r"plan\.png would be written over"):
        import_world(tmp_path / "map.yaml", tmp_path / "plan.yaml", Options())
    with pytest.raises(InputError, match=r"its picture goes there"):
        import_world(plan, tmp_path / "world.png", Options(width_m=8))
    with pytest.raises(InputError, match=r"--out \.: this is a folder"):
        import_world(plan, Path(), Options(width_m=8))
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(InputError, match=r"folder\.png is there already and of another kind"):
        import_world(plan, tmp_path / "folder.yaml", Options(width_m=8))
    assert plan.read_bytes() == before and not (tmp_path / "world.png").exists()


def test_an_outline_that_crosses_itself_encloses_both_halves(tmp_path: Path) -> None:
    bow = [[0, 0], [4, 4], [4, 0], [0, 4]]
    assert from_document({"name": "bow", "polygons": [[bow]]}, "bow").solid.area == pytest.approx(8.0, abs=0.05)
    (tmp_path / "plan.json").write_text(json.dumps({"verts": [[0, 0], [8, 8], [8, 0], [0, 8]]}))
    world, _ = imported(tmp_path / "plan.json", Options(robots=1, straighten=False))
    rooms = [shapely.Polygon(ring) for part in polygons_of(world.solid) for ring in part.interiors]
    assert sum(room.area for room in rooms) == pytest.approx(32, abs=0.2)


def test_a_drawing_has_an_encoding_of_its_own(tmp_path: Path) -> None:
    drawing = ezdxf.new("R2000", units=6)
    drawing.header["$DWGCODEPAGE"] = "ANSI_1252"
    for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
        drawing.modelspace().add_line(RING[a], RING[b], {"layer": "W\xe4nde"})
    drawing.saveas(tmp_path / "room.dxf", encoding="cp1252")
    assert b"W\xe4nde" in (tmp_path / "room.dxf").read_bytes()
    assert imported(tmp_path / "room.dxf")[1][0].startswith("room: 3.0 m x 2.4 m")


def test_a_polyline_of_one_vertex_is_no_wall(tmp_path: Path) -> None:
    """It ended `--close` in a traceback, and a whole drawing was refused for it."""
    drawing = ezdxf.new(units=6)
    drawing.modelspace().add_lwpolyline([(9, 9)])
    drawing.modelspace().add_lwpolyline(RING, close=True)
    drawing.saveas(tmp_path / "room.dxf")
    ring = " ".join(f"{x},{y}" for x, y in RING)
    lines = f'<polyline points="9,9"/><polygon points="{ring}"/>'
    (tmp_path / "room.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" data-unit="m">{lines}</svg>')
    for suffix in ("dxf", "svg"):
        world, _ = imported(tmp_path / f"room.{suffix}", Options(robots=1, close_m=1))
        assert room_of(world, 1, 1).symmetric_difference(ROOM).area < 0.01


def test_the_case_of_a_layer_tells_nothing(tmp_path: Path) -> None:
    drawing = ezdxf.new(units=6)
    drawing.modelspace().add_lwpolyline(RING, close=True, dxfattribs={"layer": "WALLS"})
    drawing.modelspace().add_line((1, 1), (2, 2), dxfattribs={"layer": "furniture"})
    drawing.saveas(tmp_path / "room.dxf")
    (wall,) = drawings.read_dxf(tmp_path / "room.dxf").walls
    assert len(wall) == len(RING) + 1


@pytest.mark.parametrize("header", ["", METRES.replace("6", "0")], ids=["no header", "unitless"])
def test_a_drawing_without_a_unit_is_as_wide_as_is_said(tmp_path: Path, header: str) -> None:
    """One in millimetres could not be imported, and nothing said why."""
    file, assumed = tmp_path / "room.dxf", "assumed: metres, as it has no unit; --width M"
    for side in (8e3, 2e5):
        file.write_text(header + square(side))
        assert f"({assumed}" in (message(file, AS_DRAWN) or "")
    assert imported(file, Options(width_m=8))[1][0].startswith("room: 8.0 m x 8.0 m")
    file.write_text(header + DXF.format(""))
    assert "--width: nothing in it is wide" in (message(file, Options(width_m=8)) or "")
    file.write_text(header + square(8))
    assert imported(file)[1][1].startswith(assumed)


@pytest.mark.parametrize("version", ["AC1015", "AC1009"])
def test_a_drawing_with_a_unit_keeps_it(tmp_path: Path, version: str) -> None:
    (tmp_path / "room.dxf").write_text(METRES.replace("AC1015", version) + square(8))
    size, left_out, *_ = imported(tmp_path / "room.dxf", Options(width_m=5))[1]
    assert size.startswith("room: 8.0 m x 8.0 m") and left_out == "left out: --width, as the drawing has a unit"


def square(side: float) -> str:
    """A drawing, without a header."""
    ends = ((0, 0, 0, side), (0, side, side, side), (side, side, side, 0), (side, 0, 0, 0))
    return DXF.format("".join("0\nLINE\n8\n0\n10\n{}\n20\n{}\n11\n{}\n21\n{}\n".format(*end) for end in ends))


def test_what_is_jagged_beyond_what_a_world_may_have_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """60,000 corners took 8 GB."""
    monkeypatch.setattr(drawings, "MAX_CORNERS", 100)
    star = [[(3 + k % 2) * math.cos(0.04 * k), (3 + k % 2) * math.sin(0.04 * k)] for k in range(157)]
    (tmp_path / "star.json").write_text(json.dumps({"verts": star}))
    with pytest.raises(InputError, match="more than 100 corners are left"):
        import_world(tmp_path / "star.json", tmp_path / "made.yaml", AS_DRAWN)
