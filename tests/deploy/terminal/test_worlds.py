"""`wireswarm worlds`: sizes that follow from the geometry, and a drawing of the solids."""

from dataclasses import astuple

from deploy.terminal.worlds import drawing, size_of, to_text
from world.worldfile import bundled, from_document

RINGS = [[[-0.1, -0.1], [4.1, -0.1], [4.1, 2.1], [-0.1, 2.1]], [[0.1, 0.1], [3.9, 0.1], [3.9, 1.9], [0.1, 1.9]]]
BOX = from_document({"name": "box", "polygons": [RINGS]})


def test_the_sizes_of_a_box() -> None:
    assert astuple(size_of(BOX)) == ("box", 4.2, 2.2, 8, 24.0, 6.84, 0)


def test_a_world_that_nothing_encloses_has_the_area_around_it() -> None:
    post = from_document({"name": "post", "boxes": [[0, 0, 0, 1, 1]]})
    assert size_of(post).free_m2 == 8.0


def test_the_drawing_shows_the_walls_and_nothing_else() -> None:
    rows = drawing(BOX, columns=10).splitlines()
    assert len(rows) <= 10 and max(map(len, rows)) == 10
    assert rows[0][0] != "\u2800" and set(rows[1][1:-2]) == {"\u2800"}


def test_every_bundled_world_is_listed() -> None:
    text = to_text()
    assert all(f"{name}: " in text for name in bundled())
