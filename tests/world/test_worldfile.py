"""World files: what loads, what is refused and how it says so; bundled worlds and mazes."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given
from hypothesis import strategies as st

from protocol.document import parse_document
from world import maze, worldfile
from world.worldfile import WorldFileError

RADIUS = 0.105
ROOM = {
    "units": "m",
    "boxes": [[0, 0, 0, 4.2, 0.2], [0, 3, 0, 4.2, 0.2], [-2, 1.5, 1.5708, 3.2, 0.2], [2, 1.5, 1.5708, 3.2, 0.2]],
}


def parse(**changes: object) -> worldfile.World:
    return worldfile.from_document({**ROOM, **changes}, "room.yaml")


def test_a_room_has_an_inside_and_an_outside_of_four_walls_each() -> None:
    world = parse()
    assert len(world.rings) == 2
    assert len(world.segments) == 8
    assert sorted(region.area for region in world.regions(RADIUS))[0] == pytest.approx(3.59 * 2.59, abs=0.01)


def test_free_space_lies_on_the_left_of_every_segment() -> None:
    for name in worldfile.bundled():
        world = worldfile.load(name)
        along = world.segments[:, 2:] - world.segments[:, :2]
        normal = np.stack([-along[:, 1], along[:, 0]], 1) / np.hypot(*along.T)[:, None]
        middle = (world.segments[:, :2] + world.segments[:, 2:]) / 2
        assert not shapely.intersects_xy(world.solid, *(middle + 1e-3 * normal).T).any()
        assert shapely.intersects_xy(world.solid, *(middle - 1e-3 * normal).T).all()


def test_slits_are_closed_and_gaps_are_not() -> None:
    for gap, regions in ((0.0039, 1), (0.0041, 2)):
        walls = [[0, 0, 0, 2, 0.1], [2 + gap, 0, 0, 2, 0.1]]
        world = worldfile.from_document({"boxes": walls})
        assert len(worldfile.polygons_of(world.solid)) == regions


def test_walls_without_thickness_and_polygons_with_holes() -> None:
    world = worldfile.from_document(
        {"walls": [[0, 0, 1, 0]], "polygons": [[[[2, 0], [6, 0], [6, 4], [2, 4]], [[3, 1], [5, 1], [5, 3], [3, 3]]]]}
    )
    assert len(world.segments) == 4 + 4 + 4
    assert any(region.contains(shapely.Point(4, 2)) for region in world.regions(RADIUS))


def test_a_raster_contour_becomes_a_few_walls() -> None:
    side = np.arange(0, 4, 0.05).round(3).tolist()
    ring = (
        [[x, 0.0] for x in side]
        + [[4.0, y] for y in side]
        + [[4 - x, 4.0] for x in side]
        + [[0.0, 4 - y] for y in side]
    )
    assert len(worldfile.from_document({"polygons": [[ring]]}).segments) == 4


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"units": "ft"}, "units: 'ft' is unknown"),
        ({"boxes": [[0, 0, 0, math.nan, 1]]}, "boxes[0][3]: not finite"),
        ({"boxes": [[0, 0, 0, 1, 1], [0, math.inf, 0, 1, 1]]}, "boxes[1][1]: not finite"),
        ({"boxes": [[0, 0, 0, 0, 1]]}, "boxes[0]: length and thickness must be at least 0.0002 m"),
        ({"boxes": [[0, 0, 0, 1, -1]]}, "boxes[0]: length and thickness"),
        ({"boxes": [[0, 0, 0, 1]]}, "boxes[0]: must be a list of 5 numbers"),
        ({"boxes": {"a": 1}}, "boxes: must be a list"),
        ({"boxes": [[0, 0, 0, "wide", 1]]}, "boxes[0][3]: must be a number"),
        ({"boxes": [[0, 0, 0, True, 1]]}, "boxes[0][3]: must be a number"),
        ({"boxes": [[0, 0, 0, 10**400, 1]]}, "boxes[0][3]: must be a number"),
        ({"boxes": [[0, 0, 0, 5000, 1]]}, "is the file in metres?"),
        ({"walls": [[1, 1, 1, 1]]}, "walls[0]: zero length"),
        ({"polygons": [[[[0, 0], [1, 1]]]]}, "polygons[0][0]: a ring must be a list of at least 3 points"),
        ({"polygons": [[[[0, 0], [1, 1], [2, 2]]]]}, "polygons[0]: has no area"),
        ({"polygons": [[[[0, 0], [1], [2, 2]]]]}, "polygons[0][0][1]: a point must be a list of 2 numbers"),
        ({"polygons": [5]}, "polygons[0]: must be a list of rings"),
        ({"spawns": [[0, 1, 0], [0, 0.05, 0]]}, "spawns[1]: no free space"),
        ({"spawns": [[0, 1]]}, "spawns[0]: must be a list of 3 numbers"),
        ({"spawns": 3}, "spawns: must be a list"),
        ({"boxes": []}, "has no boxes, walls or polygons"),
        ({"name": 7}, "name: must be a text"),
    ],
)
def test_a_bad_file_is_refused_with_file_and_field(change: dict[str, object], words: str) -> None:
    with pytest.raises(WorldFileError) as error:
        parse(**change)
    assert str(error.value).startswith("room.yaml: ")
    assert words in str(error.value)


RING = [[[-3, -2], [3, -2], [3, 2], [-3, 2]], [[-2.9, -1.9], [2.9, -1.9], [2.9, 1.9], [-2.9, 1.9]]]


@pytest.mark.parametrize("x", [-3.9, 3.5, 50.0])
def test_a_spawn_outside_of_closed_walls_is_refused(x: float) -> None:
    """Also within the metre of free space that is kept around a world."""
    with pytest.raises(WorldFileError, match=r"^world: spawns\[1\]: \(.*, 0\) lies outside of all walls$"):
        worldfile.from_document({"polygons": [RING], "spawns": [[0, 0, 0], [x, 0, 0]]})


def test_around_walls_that_close_nothing_robots_start_where_they_are_put() -> None:
    """Also in a house whose door is open, and before it where its walls end in a porch."""
    wall = {"walls": [[0, 0, 0, 2]], "spawns": [[0.5, 1, 0], [-0.5, 1, 0]]}
    porch = {"boxes": [[-2, 0, 0, 0.1, 4], [1, 2, 0, 6, 0.1], [1, -2, 0, 6, 0.1]], "spawns": [[0, 0, 0], [3.9, 0, 0]]}
    for document in (wall, porch):
        assert len(worldfile.from_document(document).starts(2, RADIUS, np.random.default_rng(0))) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("boxes: [[0, 0", "no YAML"),
        ("- 1\n- 2", "must be a map of fields, not list"),
        ("", "must be a map of fields, not NoneType"),
        ("boxes: [[.nan, 0, 0, 1, 1]]", "boxes[0][0]: not finite"),
        (
            "a: !!python/object/apply:os.system [ls]",
            "the tag 'tag:yaml.org,2002:python/object/apply:os.system' is not known",
        ),
    ],
)
def test_a_bad_text_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(WorldFileError) as error:
        worldfile.load(path)
    assert "bad.yaml" in str(error.value) and words in str(error.value)


def test_other_bad_files(tmp_path: Path) -> None:
    with pytest.raises(WorldFileError, match=r"neither a file nor a bundled world .*maze-15"):
        worldfile.load("atlantis")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x9f")
    with pytest.raises(WorldFileError, match="binary"):
        worldfile.load(binary)
    with pytest.raises(WorldFileError):
        worldfile.load(tmp_path)


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=3), st.lists, max_leaves=8))
def test_no_shape_of_a_field_crashes(value: object) -> None:
    for field in ("boxes", "walls", "polygons", "spawns"):
        try:
            worldfile.from_document({field: value}, "any.yaml")
        except WorldFileError as error:
            assert str(error).startswith("any.yaml: ")


def test_json_is_yaml_and_the_world_as_run_says_the_same(tmp_path: Path) -> None:
    path = tmp_path / "room.json"
    path.write_text('{"name": "j", "source": "mine", "walls": [[0, 0, 1e-5, 2], [1E0, 0, 1, 2]]}')
    world = worldfile.load(path)
    again = yaml.safe_load(worldfile.to_yaml(world.document))
    assert again["source"] == "mine"
    assert again["walls"] == [[0.0, 0.0, 1e-5, 2.0], [1.0, 0.0, 1.0, 2.0]]
    assert worldfile.from_document(again).hash == world.hash
    assert worldfile.from_document({**again, "walls": again["walls"][:1]}).hash != world.hash


@pytest.mark.parametrize("name", worldfile.bundled())
def test_bundled_worlds_take_robots_of_any_number(name: str) -> None:
    world = worldfile.load(name)
    assert world.name == name
    assert len(world.spawns) >= 5
    home = world.region_of(float(world.spawns[0, 0]), float(world.spawns[0, 1]), RADIUS)
    assert home is not None and home.area > 40
    starts = world.starts(20, RADIUS, np.random.default_rng(0))
    assert np.array_equal(starts[:5], world.spawns[:5])
    assert shapely.covers(home.buffer(1e-3), shapely.points(starts[:, :2])).all()
    apart = np.hypot(*(starts[:, None, :2] - starts[None, :, :2]).transpose(2, 0, 1)) + 9 * np.eye(20)
    assert apart.min() > 0.8


def test_a_file_whose_name_is_no_text_gives_its_world_a_name_that_is_one(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"a\xff\x1b.yaml")
    path.write_text("walls: [[0, 0, 1, 0]]")
    world = worldfile.load(path)
    assert world.name == r"a\udcff\x1b"
    assert parse_document(worldfile.to_yaml(world.document))["name"] == world.name


def test_drawn_starts_come_from_the_generator_and_adding_one_moves_none() -> None:
    world = worldfile.load("maze-15")
    three = world.starts(3, RADIUS, np.random.default_rng(4), drawn=True)
    four = world.starts(4, RADIUS, np.random.default_rng(4), drawn=True)
    assert np.array_equal(four[:3], three)
    assert not np.array_equal(three, world.spawns[:3])
    assert not np.array_equal(three, world.starts(3, RADIUS, np.random.default_rng(5), drawn=True))
    distance = shapely.distance(world.solid, shapely.points(four[:, :2]))
    assert distance.min() >= RADIUS + worldfile.SPAWN_CLEARANCE_M - 1e-3


def test_no_room_for_robots() -> None:
    with pytest.raises(WorldFileError, match=r"spawns\[0\]: no free space for a robot of radius"):
        parse(spawns=[[0, 0.15, 0]]).starts(1, RADIUS, np.random.default_rng(0))
    with pytest.raises(WorldFileError, match=r"spawns\[0\]: it is outside, farther than 1 m from the walls"):
        parse(boxes=[[5, 0, 0, 0.1, 0.1]], spawns=[[0, 0, 0]]).starts(1, RADIUS, np.random.default_rng(0))
    with pytest.raises(WorldFileError, match=r"spawns\[1\]: overlaps spawns\[0\]"):
        parse(spawns=[[0, 1, 0], [0.1, 1, 0]]).starts(2, RADIUS, np.random.default_rng(0))
    with pytest.raises(WorldFileError, match="no room for 500 robots"):
        parse().starts(500, RADIUS, np.random.default_rng(0))


@pytest.mark.parametrize("size", [(8, 8), (15, 15), (20, 11.3), (9.7, 20)])
def test_mazes_hang_together_and_follow_the_seed(size: tuple[float, float]) -> None:
    for seed in range(8):
        document = maze.generate(*size, np.random.default_rng(seed))
        world = worldfile.from_document(document)
        x0, y0, x1, y1 = world.solid.bounds
        assert (x1 - x0, y1 - y0) == pytest.approx(size, abs=0.01)
        inside = [r for r in world.regions(RADIUS) if r.within(shapely.box(x0, y0, x1, y1))]
        assert len(inside) == 1
        assert inside[0].area > 0.7 * size[0] * size[1]
        assert shapely.covers(inside[0], shapely.points(world.spawns[:, :2])).all()
        lengths = np.hypot(*(world.segments[:, 2:] - world.segments[:, :2]).T)
        assert lengths.min() >= 0.149  # no steps: walls are flush
        assert document == maze.generate(*size, np.random.default_rng(seed))
        assert document != maze.generate(*size, np.random.default_rng(seed + 100))


def test_loops_are_opened() -> None:
    def rings(loops: float) -> int:
        world = worldfile.from_document(maze.generate(15, 15, np.random.default_rng(2), loops=loops))
        return len(world.rings)

    assert rings(0.0) == 2  # the outside, and one wall that hangs together
    assert rings(0.3) > 3


@pytest.mark.parametrize("size", [(7, 10), (10, 101), (math.nan, 10)])
def test_mazes_have_bounds(size: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="8 to 100 m"):
        maze.generate(*size, np.random.default_rng(0))


def test_generated_worlds_have_a_name() -> None:
    world = worldfile.load("generated-40x30-5")
    x0, y0, x1, y1 = world.solid.bounds
    assert (x1 - x0, y1 - y0) == pytest.approx((40, 30), abs=0.01)
    assert world.name == "generated-40x30-5"
    assert world.hash != worldfile.load("generated-40x30-6").hash
    assert worldfile.load("generated-100x100-0").starts(500, RADIUS, np.random.default_rng(0)).shape == (500, 3)
    with pytest.raises(WorldFileError, match="generated-400x40-0: a maze has sides of 8 to 100 m, not 400 m"):
        worldfile.load("generated-400x40-0")


@pytest.mark.parametrize("name", ["1e5", "2e3", "-3E46", "1.e+9", "0.5", "12", "1_0", "true", "~", "2026-11-28"])
def test_a_name_that_looks_like_something_else_is_read_as_it_was_written(name: str) -> None:
    document = {"name": name, "walls": [[0.0, 0.0, 1e-5, 1e20]], "source": [name, {name: name}]}
    assert parse_document(worldfile.to_yaml(document)) == document
