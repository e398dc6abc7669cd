"""What robots, worlds and files say reaches terminal and report as text: no markup, no control characters."""

import json
from pathlib import Path

import pytest

from deploy.report import write_report
from deploy.report.rundir import read_run
from deploy.terminal.live import Display, print_summary
from protocol.messages import Clock, Progress
from protocol.text import printable

EVIL = "[/b]\x1b[2J\x07\r\n\x9b31m\u202e\u2066<script>$x$"
SHOWN = r"[/b]\x1b[2J\x07\r\n\x9b31m\u202e\u2066<script>$x$"

EVENTS = [
    {"event": "accepted", "peer": ["x"], "reason": "r", "transform": [1, 2, 3]},
    {"event": "accepted", "peer": "r2", "reason": {}, "transform": [1, 2, 3]},
    {"event": "accepted", "peer": "r2", "reason": EVIL, "transform": "far away"},
    {"event": "accepted", "peer": "r2", "reason": EVIL, "transform": ["[/b]", None, 10**400]},
    {"event": "proposed"},
    {"event": "contact", "peer": "r2"},
    {"event": "contact", "peer": EVIL},
    {"event": EVIL, EVIL: [EVIL, {EVIL: None}]},
    {"event": ["list"]},
    {"event": "dead", "t": "late"},
    {"event": "dead", "t": 1e308},
]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    lines = [json.dumps({"t": float(k), "tick": 5 * k, "robot": "r1", **event}) for k, event in enumerate(EVENTS)]
    (tmp_path / "events.jsonl").write_text("\n".join([*lines, "[]", "7", "{}", "[" * 99_999]) + "\n")
    robots = {"r1": {"coverage": EVIL, "t_90": 10**400, "path_m": [1], "ended": EVIL}, "r2": None, EVIL: {"t_99": {}}}
    (tmp_path / "summary.json").write_text(json.dumps({"robots": robots, "team": 3, "real_time_factor": EVIL}))
    (tmp_path / "manifest.json").write_text(json.dumps({"seed": EVIL, "ended": EVIL, EVIL: EVIL}))
    (tmp_path / "metrics.csv").write_text(f't,robot,coverage\n1,"{EVIL[:6]}",0.5\n')
    (tmp_path / "world.yaml").write_text(f"name: {json.dumps(EVIL)}\nboxes: [[0, 0, 0, 1, 1]]\n")
    return tmp_path


def test_control_characters_are_shown_as_escapes_and_other_letters_as_they_are() -> None:
    assert printable(EVIL) == SHOWN
    assert printable("Zürich 東京 [x] \udcff") == "Zürich 東京 [x] \\udcff"


def test_the_summary_takes_events_and_figures_of_any_shape(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    print_summary(run)
    out, err = capsys.readouterr()
    assert err == "" and SHOWN in out and f"accepted: {SHOWN}" in out
    assert all(line.isprintable() for line in out.splitlines())
    for text in ("", "[]", "{}", '{"robots": 3}', "[" * 99_999):
        (run / "summary.json").write_text(text)
        print_summary(run)


def test_the_report_takes_events_and_figures_of_any_shape(run: Path) -> None:
    page = write_report(run).read_text()
    assert "<script>$x$" not in page and r"[/b]\x1b[2J" in page
    assert all(character.isprintable() or character == "\n" for character in page)
    notes = read_run(run).notes
    assert any(note.startswith("events.jsonl: 4 of 12 events have no time") for note in notes)


def test_a_worlds_name_is_no_markup_in_the_progress(capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock(tick=5, t=1.0, status={"r1": "exploring"})
    with Display(EVIL, "radio [/b]", quiet=False) as display:
        display.show(Progress(clock=clock, coverage={"r1": 0.5}, team=0.5))
    err = capsys.readouterr().err
    assert SHOWN in err and "radio [/b]" in err and "\x1b" not in err
