import csv
import json
import math
import re
import shutil
import subprocess
import warnings
from collections import Counter, defaultdict
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure

from deploy.report import write_report
from deploy.report.page import write_page
from deploy.report.picture import NAMED, draw_coverage
from deploy.report.plan import SMALLER, overview, slider
from deploy.report.rundir import Map, NoDirectoryError, Run, Series, read_run
from deploy.report.story import GLYPHS, MAX_BONDS, MAX_TOLD, MEANINGS, bonds, left_out, told
from deploy.report.words import factor, number, share, size, subtitle
from world.recorder import REPLACED, TEAM

WORLD = """
name: {name}
units: m
boxes:
  - [3.0, -0.05, 0.0, 6.2, 0.1]
  - [3.0, 4.05, 0.0, 6.2, 0.1]
  - [-0.05, 2.0, 1.5708, 4.0, 0.1]
  - [6.05, 2.0, 1.5708, 4.0, 0.1]
  - [3.0, 1.2, 1.5708, 2.4, 0.1]
spawns: [[1.0, 1.0, 0.5], [5.0, 1.0, 2.0]]
"""
STARTS = {"r1": [1.0, 1.0, 0.5], "r2": [5.0, 1.0, 2.0]}
RING = np.array([[0, 0], [2.95, 0], [2.95, 2.4], [3.05, 2.4], [3.05, 0], [6, 0], [6, 4], [0, 4]], float)
"""The outline of the free space, counter-clockwise."""


def seen(corners: int, start: list[float]) -> dict[str, Any]:
    """The map after so many corners of RING, in the frame that starts at `start`."""
    c, s = math.cos(start[2]), math.sin(start[2])
    points = (RING[:corners] - start[:2]) @ np.array([[c, -s], [s, c]])
    edges = [[k, k + 1] for k in range(corners - 1)]
    labels = ["nominal"] * corners
    if corners == len(RING):
        edges.append([corners - 1, 0])
    else:
        labels[0], labels[-1] = "occlusion", "frontier"
    return {"vertices": points.tolist(), "labels": labels, "edges": edges, "edge_likelihood": [0.9] * len(edges)}


def write_run(path: Path, name: str = "two-rooms") -> Path:
    """A small run directory as contracts.md has it, by a writer of the tests' own."""
    for folder in ("maps", "snapshots", "trajectories"):
        (path / folder).mkdir(parents=True)
    (path / "world.yaml").write_text(WORLD.format(name=json.dumps(name)))
    truth = {"frames": STARTS, "robot_radius": 0.105, "lidar_range": 3.5}
    (path / "truth.json").write_text(json.dumps(truth))
    manifest = {"version": "0.1.0", "seed": 7, "ended": "complete", "command": ["wireswarm", "run"]}
    (path / "manifest.json").write_text(json.dumps(manifest))
    robots = {
        r: {"coverage": 1.0, "t_90": 40.0, "t_99": None, "path_m": 12.5, "bytes_sent": 5300, "ended": "complete"}
        for r in STARTS
    }
    team = {"coverage": 1.0, "t_90": 31.0, "t_99": 47.0, "overlap": 0.8}
    (path / "summary.json").write_text(json.dumps({"robots": robots, "team": team, "real_time_factor": 0.5}))
    tally = {"messages": 60, "bytes": 5300}
    books = {"offered": {"map": tally}, "delivered": {"map": tally}, "dropped": {"map": {"range": tally}}}
    (path / "bandwidth.json").write_text(json.dumps({"robots": dict.fromkeys(STARTS, books)}))
    events = [
        {"t": 3.0, "tick": 15, "robot": "r1", "event": "contact", "peer": "r2"},
        {"t": 30.0, "tick": 150, "robot": "r1", "event": "accepted", "peer": "r2", "transform": [1.0, 2.0, 0.25]},
        {"t": 60.0, "tick": 300, "robot": "r2", "event": "complete"},
    ]
    (path / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    with (path / "metrics.csv").open("w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(["t", "robot", "coverage", "path_m", "vertices", "bytes_sent", "bytes_received"])
        for t in range(61):
            out.writerows([t, r, min(1.0, t / 45), 0.2 * t, 8, 90 * t, 80 * t] for r in STARTS)
            out.writerow([t, "team", min(1.0, t / 35), "", "", "", ""])
    for r, start in STARTS.items():
        (path / f"maps/{r}.json").write_text(json.dumps({"robot": r, **seen(len(RING), start)}))
        lines = [{"t": 10.0 * k, "map": seen(min(2 + k, len(RING)), start)} for k in range(7)]
        (path / f"snapshots/{r}.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
        t = np.arange(0, 60, 0.2)
        x, y = start[0] + 0.5 * np.sin(t / 9), start[1] + 1 - np.cos(t / 20)
        rows = (f"{a:.2f} {b:.4f} {c:.4f} 0 0 0 0 1\n" for a, b, c in zip(t, x, y, strict=True))
        (path / f"trajectories/{r}.tum").write_text("".join(rows))
    return path


needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="the page's script is tried with node")


class Page(HTMLParser):
    """Tags, visible text and what would be fetched; checks that elements close in order."""

    VOID = frozenset({"meta", "input", "br"})

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.fetched: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.source = file.read_text("utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)
        self.fetched += [
            v or "" for k, v in attributes if k in ("src", "srcset") or (k == "href" and v and v[0] != "#")
        ]

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("script", "style"):
            self.text += data


def embedded(page: Page) -> Any:
    found = re.search(r'<script id="frames" type="application/json">(.*?)</script>', page.source, re.S)
    assert found
    return json.loads(found[1])


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = write_run(tmp_path_factory.mktemp("runs") / "two-rooms-7")
    assert write_report(run) == run / "report.html"
    return run


def test_the_page_is_whole_and_fetches_nothing(whole: Path) -> None:
    page = Page(whole / "report.html")
    assert page.fetched == []
    assert "url(" not in page.source.replace("url(#", "") and "@import" not in page.source
    assert page.open == []
    assert "missing or broken" not in page.text
    for words in (
        "two-rooms: 2 robots",
        "seed 7",
        "100.0 %",
        "5.3 kB",
        "0.5 times real",
        "messages offered",
        "transform [1, 2, 0.25]",
        "1 accepted",
    ):
        assert words in page.text


def test_the_same_run_gives_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    again = write_run(tmp_path / "two-rooms-7")
    write_report(again)
    for name in ("report.html", "report.png"):
        assert (again / name).read_bytes() == (whole / name).read_bytes()


def test_the_picture_shows_every_robot(whole: Path) -> None:
    image = matplotlib.image.imread(whole / "report.png")[..., :3]
    assert min(image.shape[:2]) > 900
    for colour in ((0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)):
        near = np.abs(image - np.array(colour) / 255).max(axis=2) < 0.02
        assert near.sum() > 1000


def test_a_name_that_the_font_lacks_is_drawn_without_a_warning(tmp_path: Path) -> None:
    with warnings.catch_warnings(action="error"):
        write_report(write_run(tmp_path / "run", "迷路 🤖"))
    assert (tmp_path / "run" / "report.png").exists()


def test_legends_of_many_robots_leave_room_for_their_curves(tmp_path: Path) -> None:
    one = Series(np.array([0.0, 1.0]), {"coverage": np.zeros(2)})
    metrics = {f"r{k}": one for k in range(1, 101)} | {TEAM: one}
    run = Run(tmp_path, metrics=metrics)
    axes = Figure().subplots()
    draw_coverage(axes, run)
    legend = axes.get_legend()
    assert len(axes.get_lines()) >= 101
    assert legend is not None and legend.get_bbox_to_anchor().x0 >= axes.bbox.x1  # beside the curves, not over them
    assert [text.get_text() for text in legend.get_texts()][-2:] == [f"r{NAMED}", TEAM]


@pytest.mark.parametrize("robot", [None, "r1"])
def test_a_plan_has_a_bar_of_a_metre_and_tells_what_is_path_and_start(whole: Path, robot: str | None) -> None:
    axes = read_run(whole).plot(robot, Figure().subplots())
    (bar,) = (line for line in axes.get_lines() if line.get_linewidth() == 2.0)
    assert np.ptp(bar.get_xdata()) == pytest.approx(1.0) and "1 m" in [text.get_text() for text in axes.texts]
    if robot is None:
        legend = axes.get_legend()
        assert legend is not None and {"path", "start, heading"} <= {text.get_text() for text in legend.get_texts()}


def test_maps_are_placed_by_the_true_frames(whole: Path) -> None:
    run = read_run(whole)
    for robot in STARTS:
        np.testing.assert_allclose(run.maps[robot].moved(run.frames[robot]).vertices, RING, atol=1e-9)
    assert "M0.000 0.000L2.950 0.000" in overview(run)


def test_maps_side_by_side_keep_their_corners_closed() -> None:
    edges = np.array([[k, (k + 1) % len(RING)] for k in range(len(RING))])
    inset = Map(RING, np.zeros(len(RING), np.uint8), edges).inset(0.1)
    free = shapely.Polygon(RING).buffer(-0.1, join_style="mitre")
    assert shapely.Polygon(inset.vertices).symmetric_difference(free).area < 1e-9
    end = Map(RING[:2], np.zeros(2, np.uint8), edges[:1]).inset(0.1)
    np.testing.assert_allclose(end.vertices, [[0, 0.1], [2.95, 0.1]], atol=1e-12)


def test_the_replay_has_a_frame_a_second_and_the_maps_of_the_snapshots(whole: Path) -> None:
    shown = slider(read_run(whole))
    assert shown["times"] == [*range(60), 60]
    assert json.loads(json.dumps(shown)) == embedded(Page(whole / "report.html"))
    maps = shown["robots"]["r1"]["maps"]
    assert [number for number, _ in maps] == [0, 10, 20, 30, 40, 50, 60]
    assert [strings[0].count("M") for _, strings in maps] == [1, 2, 3, 4, 5, 6, 8]
    assert maps[0][1][3].count("z") == 1 and maps[0][1][4].count("M") == 1  # an occlusion, a frontier
    assert maps[-1][1][3:] == ["", ""]
    assert len(shown["robots"]["r1"]["at"]) == 2 * 61 and shown["robots"]["r1"]["at"][:2] == [100, 100]
    assert [shown["coverage"][name][10] for name in ("r1", "r2", "team")] == [222, 222, 286]


def test_walls_that_only_others_saw_are_drawn_apart(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    (run / "maps/r1.own.json").write_text(json.dumps({"robot": "r1", **seen(4, STARTS["r1"])}))
    snapshots = run / "snapshots/r1.jsonl"
    lines = [json.loads(line) for line in snapshots.read_text().splitlines()]
    snapshots.write_text("".join(json.dumps({**line, "heard": [0]}) + "\n" for line in lines))
    read = read_run(run)
    assert read.notes == [] and read.maps["r1"].heard == {3, 4, 5, 6, 7}
    maps = slider(read)["robots"]["r1"]["maps"]
    assert [(own.count("M"), heard.count("M")) for _, (own, heard, *_) in (maps[1], maps[-1])] == [(1, 1), (3, 5)]


def test_the_story_tells_who_merged_whom_when_and_why(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    about = {"peer": "r2", "reason": "the evidence decides", "weight": 5.0, "evidence": {"ground": 1.5, "discs": 3.5}}
    events = [
        {"event": "contact", "peer": "r2"},
        {"event": "proposed", "peer": "r2", "reason": "aligned", "inliers": 9},
        {"event": "accepted", **about},
        {"event": "unmerged", "peer": "r2", "reason": "own scans contradict it"},
        {"event": "rejected", **about, "reason": "unreachable"},
        {"event": "lost", "peer": "r2"},
        {"event": "accepted", "peer": ["r2"], "weight": "much", "evidence": [1]},
    ]
    lines = [json.dumps({"t": 5.0 + k, "tick": 25, "robot": "r1", **event}) for k, event in enumerate(events)]
    (run / "events.jsonl").write_text("\n".join(lines) + "\n")
    page = Page(write_report(run))
    story, bonds = embedded(page)["story"], embedded(page)["bonds"]
    assert [one["text"] for one in story[:5]] == [
        "r1 hears r2",
        "r1 proposes how r2's map fits: aligned; 9 corners fit",
        "r1 merges r2's map, evidence 5.0 nats (ground 1.5, discs 3.5)",
        "r1 takes r2's map out: own scans contradict it",
        "r1 refuses r2's map: unreachable, evidence 5.0 nats (ground 1.5, discs 3.5)",
    ]
    assert all(one["text"] in page.text for one in story)
    r1_r2 = {"robot": "r1", "peer": "r2"}
    assert bonds == [
        {**r1_r2, "trial": False, "since": 5.0, "until": 10.0},
        {**r1_r2, "trial": True, "since": 6.0, "until": 7.0},
    ]
    assert "".join(one["glyph"] for one in story) == "◌?✓↶✗✓"
    assert all(f"{glyph} {MEANINGS[event]}" in page.text for event, glyph in GLYPHS.items())


def test_without_an_event_to_list_there_is_no_empty_table(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    (run / "events.jsonl").write_text('{"t": 1.0, "tick": 5, "robot": "r1", "event": "frontier"}\n')
    text = Page(write_report(run)).text
    assert "1 frontier. Not listed: frontier." in text and "about" not in text.partition("Not listed")[2]


@pytest.mark.slow
def test_a_long_run_of_many_robots_makes_a_page_of_less_than_2_mb(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    rooms = np.array([(x + a, y + b) for x in range(0, 60, 2) for y in range(0, 60, 2) for a, b in RING / 4])
    edges = [(8 * k + i, 8 * k + (i + 1) % 8) for k in range(len(rooms) // 8) for i in range(8)]
    big = {"vertices": rooms.tolist(), "labels": ["nominal"] * len(rooms), "edges": edges}
    with (run / "snapshots/r1.jsonl").open("w") as stream:
        for k in range(20):
            big["vertices"][0][0] = k / 100
            stream.write(json.dumps({"t": 3.0 * k, "map": big}) + "\n")
    page = write_report(run)
    assert page.stat().st_size < 2_000_000
    maps = embedded(Page(page))["robots"]["r1"]["maps"]
    assert 2 <= len(maps) < 20 and maps[0][0] == 0 and maps[-1][0] == 60


FILES = (
    "manifest.json",
    "summary.json",
    "bandwidth.json",
    "world.yaml",
    "truth.json",
    "maps",
    "snapshots",
    "trajectories",
    "metrics.csv",
    "events.jsonl",
)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_said(tmp_path: Path, name: str) -> None:
    run = write_run(tmp_path / "run")
    for file in (run / name).glob("*") if (run / name).is_dir() else [run / name]:
        file.unlink()
    read = read_run(run)
    assert read.notes in ([f"{name} is missing"], [f"{name}/ is missing or empty"])
    assert read.robots == ["r1", "r2"]


@pytest.mark.parametrize("name", ["truth.json", "world.yaml", "maps", "metrics.csv"])
def test_without_a_part_the_rest_is_shown(tmp_path: Path, name: str) -> None:
    run = write_run(tmp_path / "run")
    for file in (run / name).glob("*") if (run / name).is_dir() else [run / name]:
        file.unlink()
    page = Page(write_report(run))
    assert page.open == [] and page.text.count("is missing") == 1
    assert page.text.count("in its own frame") == (2 if name == "truth.json" else 0)
    assert (run / "report.png").stat().st_size > 20_000


def test_one_file_of_a_run_is_enough_for_a_report(tmp_path: Path) -> None:
    (tmp_path / "events.jsonl").touch()
    page = Page(write_report(tmp_path))
    assert page.text.count("is missing") == len(FILES) - 1
    assert (tmp_path / "report.png").exists()


def test_a_directory_without_any_file_of_a_run_gets_no_report(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(NoDirectoryError, match="is no run directory"):
        write_report(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_no_directory_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(NotADirectoryError):
        write_report(tmp_path / "none")


BROKEN = [
    ("manifest.json", "[1]"),
    ("summary.json", "{"),
    ("world.yaml", "boxes: [[0, 0, 0]]"),
    ("truth.json", '{"frames": {"r1": [0, NaN, 0]}}'),
    ("truth.json", '{"frames": [1]}'),
    ("truth.json", '{"frames": {}, "robot_radius": NaN}'),
    ("truth.json", '{"frames": {}, "robot_radius": 0}'),
    ("maps/r1.json", '{"vertices": [[0, 0], [1e999, 1]], "labels": ["nominal", "nominal"], "edges": []}'),
    ("maps/r1.json", '{"vertices": [[0, 0], [1e300, 1]], "labels": ["nominal", "nominal"], "edges": []}'),
    ("maps/r1.json", '{"vertices": [[0, 0]], "labels": ["nominal"], "edges": [[0, 7]]}'),
    ("maps/r1.json", '{"vertices": [[0, 0]], "labels": ["nominal"], "edges": [[0, 0.5]]}'),
    ("maps/r1.json", '{"vertices": [[0, 0]], "labels": ["corner"], "edges": []}'),
    ("maps/r1.json", "[" * 100_000),
    ("snapshots/r1.jsonl", '{"t": 0}\n'),
    ("snapshots/r1.jsonl", '{"t": 10.0, "map": {"vert'),
    ("snapshots/r1.jsonl", '{"t": -1, "map": {"vertices": [], "labels": [], "edges": []}}\n'),
    ("trajectories/r1.tum", "0 1\n"),
    ("trajectories/r1.tum", "-1 0 0 0 0 0 0 1\n"),
    ("metrics.csv", "t,robot,coverage\n-1,r1,0.5\n"),
    ("metrics.csv", "t,robot,coverage\n1,r1\nx,r1,0.5\n"),
    ("metrics.csv", "t,robot,bytes_sent\n1,r1,-5\n"),
    ("events.jsonl", '{"t": "soon", "event": "contact"}\n'),
    ("events.jsonl", '{"t": 1, "event": "contact", "robot": "r1"}\n{"t": 2, "ev'),
    ("bandwidth.json", "\x00\xff"),
]


@pytest.mark.parametrize(("name", "text"), BROKEN)
def test_a_broken_file_is_said(tmp_path: Path, name: str, text: str) -> None:
    run = write_run(tmp_path / "run")
    (run / name).write_bytes(text.encode("latin-1"))
    read = read_run(run)
    assert [note.startswith(name) for note in read.notes] == [True]
    write_page(read, tmp_path / "report.html")
    page = Page(tmp_path / "report.html")
    assert page.open == [] and name in page.text


ODD_ROBOTS = '{"r1": 5, "r9": {"coverage": "x", "t_90": NaN, "path_m": 1e999}}'
ODD = [
    ("summary.json", f'{{"robots": {ODD_ROBOTS}, "team": {{"t_90": "<b>", "coverage": []}}}}'),
    ("metrics.csv", "t,robot,coverage,bytes_sent\n1,r1,0.5,5e-324\n"),
    (
        "events.jsonl",
        f'{{"t": 1, "event": "accepted", "evidence": {{"ground": {10**400}, "discs": 2, "heard": NaN}}}}\n',
    ),
]


@pytest.mark.parametrize("turn", range(6))
def test_broken_files_never_stop_the_report(tmp_path: Path, turn: int) -> None:
    """All at once. Each turn has others, as a picture takes half a second."""
    run, texts = write_run(tmp_path / "run"), defaultdict[str, list[str]](list)
    for name, text in [*BROKEN, *ODD]:
        texts[name].append(text)
    assert max(map(len, texts.values())) == 6
    for name, some in texts.items():
        (run / name).write_bytes(some[turn % len(some)].encode("latin-1"))
    page = Page(write_report(run))
    assert page.open == []
    assert ("r9" in page.text) == (turn % 2 == 1)


def test_a_name_of_a_mapped_log_moves_no_terminal(tmp_path: Path) -> None:
    (write_logs(tmp_path / "run", 1) / "maps" / "r\x1b[31m2.json").write_text("[]")
    (note,) = read_run(tmp_path / "run").notes
    assert note.startswith("maps/r") and "\x1b" not in note


def test_text_from_files_is_escaped(tmp_path: Path) -> None:
    evil = "</script><script>alert('$x$')</script>"
    run = write_run(tmp_path / "run", evil)
    (run / "events.jsonl").write_text(json.dumps({"t": 1, "robot": evil, "event": evil, "reason": evil}))
    (run / "manifest.json").write_text(json.dumps({"seed": evil, "ended": evil, evil: evil}))
    summary = json.loads((run / "summary.json").read_text())
    summary["robots"][evil] = {"coverage": 0.5, "ended": evil}
    (run / "summary.json").write_text(json.dumps(summary))
    truth = json.loads((run / "truth.json").read_text())
    truth["frames"][evil] = [0, 0, 0]
    (run / "truth.json").write_text(json.dumps(truth))
    books = {"offered": {evil: {"messages": 1}}, "dropped": {evil: {evil: 1}}}
    (run / "bandwidth.json").write_text(json.dumps({"robots": {evil: books}}))
    page = Page(write_report(run))
    assert page.tags.count("script") == 2
    assert evil in page.text
    assert evil in embedded(page)["robots"]


def test_numbers_read_well() -> None:
    assert (size(999), size(5300), size(2_500_000), size(None)) == ("999 B", "5.3 kB", "2.5 MB", "—")
    assert (number(0.55), number(1234.5, 0, "s"), number("1")) == ("0.6", "1,234 s", "—")
    assert [factor(value) for value in (0.5, 1.49, 61.53, 99.96)] == ["0.5", "1.49", "61.5", "100"]
    assert (factor(1234.5), factor(None)) == ("1,234", "—")
    assert (share(0.9876), share(None), share(math.nan)) == ("98.8 %", "—", "—")


@needs_node
def test_the_replay_ends_with_the_last_maps_where_the_last_step_is_shorter() -> None:
    """A run of 298.4 s was shown to its end with the maps of 290 s."""
    script = (files("deploy.report") / "page.js").read_text(encoding="utf-8")
    found = re.search(r"const frame = .*?\n  };\n", script, re.S)
    assert found is not None
    asked = "const times = [0, 1, 2, 2.4], end = 3; %s console.log(JSON.stringify([0, 1.5, 2.2, 2.4].map(frame)))"
    told = subprocess.run(["node", "-e", asked % found[0]], capture_output=True, text=True, check=True, timeout=30)
    assert [k for k, _ in json.loads(told.stdout)] == [0, 1, 2, 3]
    assert [part for _, part in json.loads(told.stdout)] == pytest.approx([0.0, 0.5, 0.5, 0.0])


def played(run: Run, folder: Path, *times: float) -> Any:
    """What the page's replay says and draws at these times, as page_player.js tells it."""
    (frames := folder / "frames.json").write_text(json.dumps(slider(run)))
    script, player = str(files("deploy.report") / "page.js"), str(Path(__file__).with_name("page_player.js"))
    words = ["node", player, script, str(frames), *map(str, times)]
    return json.loads(subprocess.run(words, capture_output=True, text=True, check=True, timeout=30).stdout)


@needs_node
def test_a_peer_of_any_name_leaves_the_replay_whole(tmp_path: Path) -> None:
    """Names that JavaScript's own objects have ended it."""
    run = read_run(write_run(tmp_path / "run"))
    strange = [{"t": 3.0, "robot": "r1", "event": "contact", "peer": peer} for peer in ("constructor", "__proto__")]
    run.events = [*strange, *run.events]
    (then,) = played(run, tmp_path, 5.0)
    assert then["said"] == "5 s" and [kind for kind, _ in then["links"]] == ["heard-by"]


@needs_node
@pytest.mark.parametrize("end", [{"event": "dead"}, {"event": "rejoined", "reason": REPLACED}])
def test_a_robot_that_died_or_begins_anew_hears_nobody_and_tries_nothing(tmp_path: Path, end: dict[str, str]) -> None:
    run = read_run(write_run(tmp_path / "run"))
    link = {"t": 8.0, "event": "rejoined", "reason": "its process is ready"}  # the mind is the same
    begins = [{"t": t, "event": event, "peer": "r2"} for t, event in ((5.0, "contact"), (6.0, "proposed"))]
    run.events = [{"robot": "r1", **event} for event in (*begins, link, {"t": 10.0, **end})]
    before, after = played(run, tmp_path, 9.0, 11.0)
    assert [kind for kind, _ in before["links"]] == ["heard-by", "trial"] and after["links"] == []


def write_logs(path: Path, robots: int) -> Path:
    """A directory of `wireswarm map`, of ten scans a robot; the log's first one was skipped."""
    for folder in ("maps", "estimate"):
        (path / folder).mkdir(parents=True)
    names = [f"r{k + 1}" for k in range(robots)]
    (path / "manifest.json").write_text(json.dumps({"logs": ["a.log"], "ended": "complete"}))
    (path / "summary.json").write_text(json.dumps({"robots": {r: {"ended": "complete", "path_m": 0.9} for r in names}}))
    for r in names:
        (path / f"maps/{r}.json").write_text(json.dumps({"robot": r, **seen(len(RING), STARTS["r1"])}))
        (path / f"estimate/{r}.tum").write_text("".join(f"{k} {k / 10} 0 0 0 0 0 1\n" for k in range(1, 11)))
    return path


@needs_node
def test_the_page_of_a_log_counts_scans(tmp_path: Path) -> None:
    run = read_run(write_logs(tmp_path / "run", 1))
    assert subtitle(run) == "ended: complete  ·  10 scans"
    assert [then["said"] for then in played(run, tmp_path, 4.0, 10.0)] == ["scan 4", "scan 10"]


def test_logs_without_a_common_frame_have_no_plan_and_nothing_to_play(tmp_path: Path) -> None:
    page = Page(write_report(write_logs(tmp_path / "run", 2)))
    assert embedded(page) == {} and 'class="plan"' not in page.source
    assert page.tags.count("input") == 1  # the hidden slider
    assert page.text.count("in its own frame") == 2 and "20 scans" in page.text
    (size,) = set(re.findall(r'class="single".*?--unit:([\d.]+)px', page.source))
    assert 900 * float(size) / SMALLER == pytest.approx(6.0, rel=0.5)  # the map's size, and not that of nothing
    height, width = matplotlib.image.imread(tmp_path / "run" / "report.png").shape[:2]
    assert height < width / 2  # maps alone


def test_a_robot_that_says_much_hides_no_others_and_what_is_not_told_is_counted() -> None:
    said = [("r3", "contact", 0.0)] * 700 + [(robot, "accepted", 50.0 + k) for k in range(20) for robot in ("r1", "r2")]
    events = [{"t": t, "robot": robot, "event": event, "peer": "r3"} for robot, event, t in said]
    run = Run(Path("some"), events=events)
    assert Counter(event["robot"] for event in told(run)) == {"r1": 20, "r2": 20, "r3": MAX_TOLD - 40}
    assert left_out(run) == 700 + 40 - MAX_TOLD
    run.events = [{"t": t, "robot": robot, "event": "contact", "peer": "r3"} for robot, _, t in said * 10]
    shown = Counter(bond["robot"] for bond in bonds(run))
    assert shown == {"r1": 200, "r2": 200, "r3": MAX_BONDS - 400}
