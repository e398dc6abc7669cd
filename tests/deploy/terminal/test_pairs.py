"""The table of pairs at the end of a run tells what the events say."""

import json
from itertools import permutations
from pathlib import Path

import pytest

from deploy.recorded.words import print_mapped
from deploy.terminal.live import print_summary
from deploy.terminal.pairs import fates
from world.recorder import REPLACED

DOCS = Path(__file__).parents[3] / "docs"


def test_the_fate_of_each_pair_is_its_last_word(tmp_path: Path) -> None:
    said = [
        (1.0, "r1", "contact", {"peer": "r2"}),
        (1.0, "r1", "attempt", {"peer": "r2", "reason": "small"}),
        (5.0, "r1", "proposed", {"peer": "r2", "reason": "aligned", "transform": [1.0, 2.0, 3.0]}),
        (6.0, "r2", "contact", {"peer": "r1"}),
        (7.0, "r1", "stuck", {"reason": "no progress"}),
        (9.0, "r1", "accepted", {"peer": "r2", "reason": "the evidence decides", "transform": [1.0, 2.0, 3.1]}),
        (11.0, "r3", "accepted", {"peer": "r2", "reason": "the evidence decides", "transform": [0.0, 0.0, 0.0]}),
        (12.0, "r3", "unmerged", {"peer": "r2", "reason": "own scans contradict it", "transform": [0.0, 0.0, 0.0]}),
    ]
    lines = [json.dumps({"t": t, "tick": 0, "robot": robot, "event": event, **data}) for t, robot, event, data in said]
    (tmp_path / "events.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    first, second, third = fates(tmp_path)
    assert (first.robot, first.peer, first.contacts, first.attempts, first.proposed) == ("r1", "r2", 1, 1, 1)
    assert first.merged_at == 9.0 and first.transform == [1.0, 2.0, 3.1]
    assert first.last == "accepted: the evidence decides"
    assert second.last == "contact" and second.merged_at is None
    assert third.merged_at is None and third.transform is None and third.last.startswith("unmerged")


def test_a_merge_is_gone_with_the_process_that_made_it(tmp_path: Path) -> None:
    """It stood in the table to the end, though the robot's map was its own alone."""
    done = {"event": "accepted", "peer": "r1", "reason": "evidence", "transform": [1, 2, 0.5]}
    came = {"event": "rejoined", "reason": REPLACED}
    said = [("r2", done), ("r3", done), ("r2", {**came, "reason": "its process is ready"}), ("r3", came)]
    lines = [json.dumps({"t": 10.0 + k, "tick": 0, "robot": robot, **event}) for k, (robot, event) in enumerate(said)]
    (tmp_path / "events.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    kept, gone = fates(tmp_path)
    assert (kept.merged_at, kept.last) == (10.0, "accepted: evidence")
    assert (gone.merged_at, gone.transform, gone.last) == (None, None, f"rejoined: {REPLACED}")


def write(run: Path, robots: int) -> None:
    """A run in which each robot met the one before it and merged its map."""
    names = [f"r{k + 1}" for k in range(robots)]
    done = {"reason": "the evidence decides", "transform": [-10.64, -11.99, -2.93]}
    events = [
        {"t": 1234.5, "tick": 1, "robot": one, "event": event, "peer": other} | (done if event == "accepted" else {})
        for one, other in zip(names[1:], names, strict=False)
        for event in ("contact", "accepted")
    ]
    (run / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    ended = {"coverage": 1.0, "ended": "complete"}
    summary = {"robots": dict.fromkeys(names, ended), "team": {"coverage": 1.0, "t_99": 9}}
    (run / "summary.json").write_text(json.dumps(summary | {"real_time_factor": 18.27}))


def test_the_result_comes_first_and_each_pair_is_a_line_of_80_columns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    write(tmp_path, 6)
    print_summary(tmp_path)
    first, *rest = capsys.readouterr().out.splitlines()
    assert first == "6 complete; 100.0% of the wall seen; 99 % after 9 s; 18.3 times real time"
    assert len(rest) == 1 + 6 + 1 + 1 + 5 and all(len(line) <= 80 for line in rest)
    heads = (DOCS / "formats.md").read_text().partition("**The tables on the terminal**")[2].partition("\n\n")[0]
    robots, pairs = rest[0].split(), rest[1 + 6 + 1].split()
    assert all(f"`{head}" in heads for head in {*robots, *pairs} - {"robot", "peer", "s", "m", "B", "frame"})
    assert rest[-1].split()[:8] == ["r6", "r5", "1", "0", "0", "1234.5", "-10.64", "-11.99"]
    assert "accepted: " in rest[-1]


def test_figures_are_whole_in_a_narrow_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were cut off."""
    monkeypatch.setenv("COLUMNS", "40")
    figures = {"coverage": 1.0, "t_90": 1234.5, "t_99": 2345.6, "path_m": 123.4, "bytes_sent": 98765}
    (tmp_path / "summary.json").write_text(json.dumps({"robots": {"r1": {"ended": "interrupted", **figures}}}))
    print_summary(tmp_path)
    assert {"100.0%", "1234.5", "2345.6", "123.4", "98765"} <= set(capsys.readouterr().out.split())
    counts = {"scans": 12345, "path_m": 123.4, "loops": 17, "map_bytes": 2345, "step_ms_median": 1.5, "step_ms_99": 9.5}
    print_mapped(tmp_path, {"robots": {"r1": {"log": "logs/intel.log.gz", "skipped": {}, "notes": [], **counts}}})
    assert {"12345", "123.4", "17", "2345", "1.5", "9.5"} <= set(capsys.readouterr().out.split())


def test_pairs_of_many_robots_are_listed_when_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run := tmp_path / "my run").mkdir()
    write(run, 7)
    print_summary(run)
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"6 pairs met, 6 are merged: wireswarm report '{run}' --pairs"
    print_summary(run, pairs=True)
    assert capsys.readouterr().out.splitlines()[-1].startswith("r7     r6")


def test_a_pair_that_met_is_one_whoever_tells_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, 7)
    names = [f"r{k + 1}" for k in range(7)]
    events = [{"t": 1.0, "robot": one, "event": "contact", "peer": peer} for one, peer in permutations(names, 2)]
    with (tmp_path / "events.jsonl").open("a") as file:
        file.writelines(json.dumps(event) + "\n" for event in events)
    print_summary(tmp_path)
    assert capsys.readouterr().out.splitlines()[-1].startswith("21 pairs met, 6 are merged: wireswarm report")


def test_a_figure_that_a_mapped_log_lacks_is_a_dash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "summary.json").write_text(json.dumps({"robots": {"r1": {"ended": "complete", "path_m": 0.9}}}))
    print_summary(tmp_path)
    result, _, row = capsys.readouterr().out.splitlines()
    assert result == "1 complete" and row.split() == ["r1", "complete", *"---", "0.9", *"--"]


def test_pairs_of_many_logs_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A log that was cut into a hundred robots had ten thousand lines."""
    write(tmp_path, 7)
    counts = dict.fromkeys(("scans", "path_m", "loops", "map_bytes", "step_ms_median", "step_ms_99"), 0)
    figures = {"log": "a.log", "skipped": {}, "notes": [], **counts}
    print_mapped(tmp_path, {"robots": {f"r{number}": figures for number in range(1, 8)}})
    *_, last = capsys.readouterr().out.splitlines()
    assert last.startswith("6 pairs met, 6 are merged: wireswarm report")
