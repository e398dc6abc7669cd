"""Maps for other programs, read back by readers that are not ours."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from PIL import Image

from deploy.exchange import FORMS, map_server
from deploy.exchange.maps import NamedMap, export_maps, read_maps
from deploy.exchange.mcap import write_mcap
from deploy.report.rundir import Map
from protocol.arrays import Floats
from protocol.errors import InputError
from tests.deploy.test_report import RING, STARTS, seen, write_run
from world.checkpoint import Checkpoint

EVERY = {suffix: form for forms in FORMS.values() for suffix, form in forms.items()}
ROOM = shapely.Polygon(RING)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose r1 has closed its map, and whose r2 has seen five corners."""
    folder = write_run(tmp_path_factory.mktemp("runs") / "run")
    (folder / "maps" / "r2.json").write_text(json.dumps(seen(5, STARTS["r2"])))
    return folder


def named(run: Path) -> dict[str, NamedMap]:
    return {one.robot: one for one in read_maps(run, "world")}


def grid_of(run: Path, robot: str) -> tuple[Floats, Floats, Floats]:
    """Middles of occupied, free and unknown cells by nav2's rules, (n, 2) each: a reader of the two files alone."""
    about = yaml.safe_load((run / f"{robot}.yaml").read_text())
    assert (about["mode"], about["negate"]) == ("trinary", 0)
    darkness = 1 - np.asarray(Image.open(run / about["image"]))[::-1] / 255
    kinds = np.where(darkness > about["occupied_thresh"], 2, np.where(darkness < about["free_thresh"], 0, 1))
    places = [np.argwhere(kinds == kind)[:, ::-1] for kind in (2, 0, 1)]
    occupied, free, unknown = ((cells + 0.5) * about["resolution"] + about["origin"][:2] for cells in places)
    return occupied, free, unknown


def test_a_grid_by_the_rules_of_nav2(run: Path, tmp_path: Path) -> None:
    files = export_maps(run, tmp_path / "out", "world", FORMS["map_server"])
    assert [file.name for file in files] == ["r1.pgm", "r1.yaml", "r2.pgm", "r2.yaml"]
    occupied, free, _ = grid_of(tmp_path / "out", "r1")
    half = map_server.CELL_M / 2**0.5 + 1e-6
    assert shapely.distance(ROOM.exterior, shapely.points(occupied)).max() < half
    assert shapely.contains_xy(ROOM, *free.T).all()
    assert len(free) * map_server.CELL_M**2 == pytest.approx(ROOM.area, rel=0.05)
    along = [ROOM.exterior.interpolate(d).coords[0] for d in np.arange(0, ROOM.length, 0.05)]
    away = np.hypot(*(np.array(along)[:, None] - occupied).transpose(2, 0, 1)).min(1)
    assert away.max() < 2 * half


def test_an_open_map_is_free_only_where_its_robot_has_looked(run: Path, tmp_path: Path) -> None:
    export_maps(run, tmp_path, "world", FORMS["map_server"])
    _, free, unknown = grid_of(tmp_path, "r2")
    viewpoints = shapely.MultiPoint(named(run)["r2"].viewpoints)
    assert len(free) > 1000 and len(unknown) > 1000
    assert shapely.distance(viewpoints, shapely.points(free)).max() < 3.5
    behind = unknown[(unknown[:, 0] < 2.9) & (unknown[:, 1] < 1.0)]
    assert len(behind) > 1000  # the other room, hidden by the wall that was seen
    lone = tmp_path / "lone.json"
    lone.write_bytes((run / "maps" / "r2.json").read_bytes())
    export_maps(lone, tmp_path / "alone", "own", FORMS["map_server"])
    assert not len(grid_of(tmp_path / "alone", "lone")[1])  # whose path is on no record


def test_geojson_as_gdal_reads_it(run: Path, tmp_path: Path) -> None:
    from pyogrio import raw

    export_maps(run, tmp_path, "world", FORMS["geojson"])
    about, _, shapes, (kinds, closed) = raw.read(tmp_path / "r1.geojson")
    assert about["crs"].startswith('LOCAL_CS["world",UNIT["metre",1]')
    assert kinds.tolist() == ["walls", "nominal"] and closed[0] == 1
    walls, points = shapely.from_wkb(shapes)
    assert walls.is_ring and shapely.is_ccw(walls)  # free space on the left
    assert walls.hausdorff_distance(ROOM.exterior) < 1e-3
    assert len(points.geoms) == len(RING)
    head = json.loads((tmp_path / "r1.geojson").read_text())
    assert (head["unit"], head["frame"]) == ("m", "world")


def test_dxf_passes_the_audit_of_ezdxf(run: Path, tmp_path: Path) -> None:
    import ezdxf

    export_maps(run, tmp_path, "world", FORMS["dxf"])
    drawing = ezdxf.readfile(tmp_path / "r1.dxf")  # type: ignore[attr-defined]
    assert not drawing.audit().errors and drawing.units == 6  # metres
    assert dict(drawing.header.custom_vars.properties) == {"frame": "world", "unit": "m"}
    (wall,) = drawing.modelspace().query("LWPOLYLINE[layer=='walls']")
    assert wall.closed and shapely.LinearRing(wall.get_points("xy")).hausdorff_distance(ROOM.exterior) < 1e-3
    partial = ezdxf.readfile(tmp_path / "r2.dxf").modelspace()  # type: ignore[attr-defined]
    assert not partial.query("LWPOLYLINE")[0].closed
    assert [len(partial.query(f"POINT[layer=='{kind}']")) for kind in ("nominal", "occlusion", "frontier")] == [3, 1, 1]


def test_svg_as_svgelements_reads_it(run: Path, tmp_path: Path) -> None:
    from svgelements import SVG, Polygon

    export_maps(run, tmp_path, "own", FORMS["svg"])
    text = (tmp_path / "r1.svg").read_text()
    assert 'data-frame="own frame of r1"' in text and "Coordinates in metres" in text
    (drawn,) = [shape for shape in SVG.parse(io.StringIO(text), reify=False).elements() if isinstance(shape, Polygon)]
    own = np.array([(point.x, point.y) for point in drawn])[: len(RING)]
    (expected,) = [one.map.vertices for one in read_maps(run, "own") if one.robot == "r1"]
    assert abs(own - expected).max() < 1e-3


def test_the_same_map_gives_the_same_bytes(run: Path, tmp_path: Path) -> None:
    one, other = (export_maps(run, tmp_path / name, "own", EVERY) for name in ("a", "b"))
    assert [file.read_bytes() for file in one] == [file.read_bytes() for file in other]


def test_one_map_file_is_exported_alone_and_placed_by_its_run(run: Path, tmp_path: Path) -> None:
    (made,) = export_maps(run / "maps" / "r2.json", tmp_path / "one", "world", FORMS["svg"])
    (_, both) = export_maps(run, tmp_path / "all", "world", FORMS["svg"])
    assert made.read_bytes() == both.read_bytes()


def test_a_map_file_in_the_current_folder_is_placed_by_its_run(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (there,) = read_maps(run / "maps" / "r2.json", "world")
    monkeypatch.chdir(run / "maps")
    (here,) = read_maps(Path("r2.json"), "world")
    assert len(here.viewpoints) == len(there.viewpoints) > 0


def test_what_was_seen_beyond_all_walls_is_in_the_grid() -> None:
    wall = Map(np.array([[-1.0, 1.0], [1.0, 1.0]]), np.zeros(2, np.uint8), np.array([[1, 0]]))
    looked = NamedMap("r1", "r1", "world", wall, np.zeros((1, 2)), 3.5)
    free = (map_server.cells(looked) == map_server.FREE).sum() * map_server.CELL_M**2
    assert free == pytest.approx(looked.free.area, rel=0.02)


def test_the_two_maps_of_a_robot_are_exported_beside_each_other(run: Path, tmp_path: Path) -> None:
    (run / "maps" / "r2.own.json").write_bytes((run / "maps" / "r1.json").read_bytes())
    for name in ("r2.json", "r2.own.json"):
        files = export_maps(run / "maps" / name, tmp_path, "own", FORMS["map_server"])
        assert f"image: {files[0].name}\n" in files[1].read_text()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["r2.own.pgm", "r2.own.yaml", "r2.pgm", "r2.yaml"]
    (own,) = read_maps(run / "maps" / "r2.own.json", "world")
    assert own.robot == "r2"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("7", "no map"),
        (
            '{"vertices": [[0, 0], [1, 0]], "labels": ["nominal", "nominal"], "edges": [[0, 1], [0, 1]]}',
            "two edges lead",
        ),
        ('{"vertices": [[0, 0], [9e5, 0]], "labels": ["nominal", "nominal"], "edges": [[0, 1]]}', "out of bounds"),
        (
            '{"vertices": [[0, 0], [9e3, 9e3]], "labels": ["nominal", "nominal"], "edges": [[0, 1]]}',
            "what map has seen is 9000 m x 9000 m: too large for a grid",
        ),
    ],
)
def test_what_is_no_map_is_refused_in_a_sentence(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "map.json").write_text(text)
    with pytest.raises(InputError, match=words):
        export_maps(tmp_path / "map.json", tmp_path / "out", "own", FORMS["map_server"])


def test_without_a_run_the_frame_of_the_world_is_not_known(tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text(json.dumps(seen(8, STARTS["r1"])))
    with pytest.raises(InputError, match="leave out --frame world"):
        export_maps(tmp_path / "map.json", tmp_path / "out", "world", EVERY)
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match=r"has no maps: .*self\.show\(Wireframe"):
        export_maps(tmp_path, tmp_path / "out", "own", EVERY)


def test_of_a_run_that_has_not_ended_it_is_said_how_to_end_it(tmp_path: Path) -> None:
    """It blamed the mind."""
    (out := tmp_path / "my run").mkdir()
    (out / "manifest.json").write_text('{"ended": null}')
    with pytest.raises(InputError, match=r"has no maps: .*; its run has not ended$"):
        read_maps(out, "own")
    Checkpoint(out).begin({})
    with pytest.raises(InputError, match=r"; its world was killed; `wireswarm finish '.*/my run'` ends it$"):
        read_maps(out, "own")


@pytest.mark.parametrize("write", [lambda run, out: export_maps(run, out, "own", FORMS["svg"]), write_mcap])
def test_a_file_in_the_place_of_the_folder_is_a_sentence(
    run: Path, tmp_path: Path, write: Callable[[Path, Path], object]
) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"^--out .*file: File exists; name a directory that can be written$"):
        write(run, tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_a_tangle_of_walls_is_refused_at_once(tmp_path: Path) -> None:
    """6,000 walls that cross at random took 6 GB and more."""
    places = np.random.default_rng(0).uniform(-25, 25, (6000, 2)).round(3).tolist()
    ring = [[k, (k + 1) % 6000] for k in range(6000)]
    (tmp_path / "map.json").write_text(json.dumps({"vertices": places, "labels": ["nominal"] * 6000, "edges": ring}))
    with pytest.raises(InputError, match="lie over each other"):
        export_maps(tmp_path / "map.json", tmp_path / "out", "own", FORMS["map_server"])


def test_coordinates_far_away_have_a_tenth_of_a_millimetre(tmp_path: Path) -> None:
    corners = [[1234.5678, -0.0001], [1236.4321, 2.5]]
    told = {"vertices": corners, "labels": ["nominal", "nominal"], "edges": [[0, 1]]}
    (tmp_path / "map.json").write_text(json.dumps(told))
    (made,) = export_maps(tmp_path / "map.json", tmp_path / "out", "own", FORMS["svg"])
    assert 'points="1234.5678,-0.0001 1236.4321,2.5"' in made.read_text()


@pytest.mark.parametrize("name", ["my #1 map", "a: b", 'the "old" one', "two\nlines", "- x", "Größe"])
def test_a_map_of_any_name_is_read_back(tmp_path: Path, name: str) -> None:
    from pyogrio import raw

    (tmp_path / f"{name}.json").write_text(json.dumps(seen(8, STARTS["r1"])))
    export_maps(tmp_path / f"{name}.json", tmp_path / "out", "own", {"pgm": EVERY["pgm"], "yaml": EVERY["yaml"]})
    occupied, _, _ = grid_of(tmp_path / "out", name)
    assert len(occupied) > 100
    (made,) = export_maps(tmp_path / f"{name}.json", tmp_path / "geo", "own", FORMS["geojson"])
    frame = json.loads(made.read_text())["frame"]
    assert frame in raw.read(made.rename(tmp_path / "some.geojson"))[0]["crs"].replace('""', '"')


@pytest.mark.parametrize("suffix", EVERY)
def test_files_of_others_are_not_written_over_and_own_ones_are(tmp_path: Path, suffix: str) -> None:
    """r1.yaml may be a robot's configuration."""
    (tmp_path / "r1.json").write_text(json.dumps(seen(8, STARTS["r1"])))
    made = tmp_path / "out" / f"r1.{suffix}"
    for _ in range(2):
        export_maps(tmp_path / "r1.json", tmp_path / "out", "own", EVERY)
    made.write_text("spec: {}\n")
    for file in tmp_path.glob("out/*"):
        if file != made:
            file.unlink()
    with pytest.raises(InputError, match=rf"r1\.{suffix} is there already and of another kind; name another folder by"):
        export_maps(tmp_path / "r1.json", tmp_path / "out", "own", EVERY)
    assert [file.name for file in tmp_path.glob("out/*")] == [made.name] and made.read_text() == "spec: {}\n"


def test_a_recording_of_others_is_not_written_over(run: Path, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_text("mine")
    with pytest.raises(InputError, match=r"run\.mcap is there already and of another kind"):
        write_mcap(run, tmp_path)
