"""A view beside a run that is under way."""

import json
import os
import re
import signal
import socket
import stat
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import shapely

pytest.importorskip("rerun", reason="the extra view is not installed")

from deploy import manifest
from deploy.launch.launcher import launch
from deploy.view import command, invitation, live
from deploy.view.command import newest
from deploy.view.serving import Tape
from protocol import keys
from protocol.codec import encode
from protocol.errors import InputError, LinkError
from protocol.inbox import Arrival, Inbox
from protocol.messages import MAX_TICK, Action, Clock, Event, MapReport, Progress, RobotSpec, Site
from protocol.secrets import Secrets
from protocol.session import open_router, wait_for_matching
from protocol.status import Status
from protocol.wireframe import certain, encode_wireframe
from tests.deploy.view.read_back import Rows, read_back
from tests.disturbed import REPO
from tests.tiny import digests, tiny_config
from world.checkpoint import Checkpoint
from world.ledger import ALLOWED

pytestmark = pytest.mark.system

LIMIT_S = 60


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 20 s that nobody views."""
    folder = tmp_path_factory.mktemp("unseen")
    assert launch(tiny_config(folder, until=20.0), folder / "out").status == Status.OK
    return folder / "out"


@pytest.fixture(scope="module")
def viewed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """The same run with a viewer, and what that recorded."""
    folder = tmp_path_factory.mktemp("viewed")
    out, tape = folder / "out", Tape(folder / "live.rrd")

    def view() -> None:
        deadline = time.monotonic() + LIMIT_S
        while not (out / invitation.FILE).exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert stat.S_IMODE((out / invitation.FILE).stat().st_mode) == 0o600
        live.follow(*invitation.invited(out), tape, Inbox())

    with ThreadPoolExecutor(1) as pool:
        viewing = pool.submit(view)
        assert launch(tiny_config(folder, until=20.0), out).status == Status.OK
        viewing.result(LIMIT_S)
    yield out, tape.file


@pytest.fixture(scope="module")
def found(viewed: tuple[Path, Path]) -> dict[str, Rows]:
    return read_back(viewed[1])


def test_a_run_writes_the_same_bytes_with_a_viewer(run: Path, viewed: tuple[Path, Path]) -> None:
    assert digests(viewed[0]) == digests(run)  # and no invitation is left


def test_a_viewer_sees_robots_where_they_truly_are(viewed: tuple[Path, Path], found: dict[str, Rows]) -> None:
    for robot in ("r1", "r2", "r3"):
        true = np.loadtxt(viewed[0] / "trajectories" / f"{robot}.tum")
        places = found[f"world/{robot}"]["Transform3D:translation"]
        assert len(places) > 1
        for tick, value in places.items():
            assert tick is not None and value[0][0][:2] == pytest.approx(true[tick, 1:3], abs=1e-6)
        assert len(found[f"world/{robot}/beams"]["LineStrips3D:strips"]) == len(places)


def test_a_viewer_sees_maps_coverage_and_all_events(viewed: tuple[Path, Path], found: dict[str, Rows]) -> None:
    events = [json.loads(line) for line in (viewed[0] / "events.jsonl").read_text().splitlines()]
    shown = [tick for tick, values in found["events"]["TextLog:text"].items() for _ in values]
    assert sorted(shown) == sorted(event["tick"] for event in events)
    last = max(tick for tick in found["world/maps/r1/own"]["LineStrips3D:strips"] if tick is not None)
    assert len(found["world/maps/r1/own"]["LineStrips3D:strips"][last][0]) >= 4
    shown_coverage = {tick or 0: value for tick, value in found["coverage/team"]["Scalars:scalars"].items()}
    (at_the_end,) = shown_coverage[max(shown_coverage)]
    told = json.loads((viewed[0] / "summary.json").read_text())["team"]["coverage"]
    assert at_the_end[0] == pytest.approx(told, abs=1e-6)  # of what came before, a quick run shows nothing


def view_of(*robots: str, file: Path) -> live._Live:
    room = shapely.to_wkb(shapely.box(0, 0, 1, 1))
    return live._Live(Site(world="room", solid=room, spec=RobotSpec(), frames=dict.fromkeys(robots, (0, 0, 0))), file)


def test_an_answer_that_is_said_again_tells_nothing_twice(tmp_path: Path) -> None:
    """A robot says its answer again where the world says the tick again, as after a lost link."""
    view = view_of("r1", file=tmp_path / "run.rrd")
    for tick in (7, 7, 8):
        action = Action(tick=tick, speed_mps=0, turn_rps=0, events=[Event(event="complete")])
        view.take([Arrival(keys.ACT, "r1", encode(action))])
    view.recording.close()
    told = read_back(tmp_path / "run.rrd")["events"]["TextLog:text"]
    assert told == {tick: [["r1 is complete"]] for tick in (7, 8)}


def test_robots_fill_a_view_no_more_than_the_run(tmp_path: Path) -> None:
    """One that was given up, too, wrote what it liked, at any tick: the time line ended 25 years ahead."""
    view, file = view_of("r1", "r2", file=tmp_path / "run.rrd"), tmp_path / "run.rrd"
    said = [Event(event="complete", data={"reason": "y" * 900})] * 1000
    report = MapReport(tick=MAX_TICK, wireframe=encode_wireframe(certain(np.eye(2), np.array([[0, 1]]))))
    for tick in (7, 8, 9, MAX_TICK):
        action = Action(tick=tick, speed_mps=0, turn_rps=0, events=said)
        view.take([Arrival(keys.ACT, "r1", encode(action)), Arrival(keys.MAP, "r1", encode(report))])
    clock = Clock(tick=9, t=1.8, status={"r2": "dead"})
    view.take([Arrival(live._PROGRESS, "", encode(Progress(clock=clock, coverage={}, team=0.0)))])
    view.take([Arrival(keys.ACT, "r2", encode(Action(tick=10, speed_mps=0, turn_rps=0, events=said[:1])))])
    view.recording.close()
    told = read_back(file)
    texts = [text for rows in told["events"]["TextLog:text"].values() for row in rows for text in row]
    assert 0 < sum(map(len, texts)) <= ALLOWED["events"].at_once  # not the file's size, which each flush adds to
    assert set(told["events"]["TextLog:text"]) == {7, 9} and told["events"]["TextLog:text"][9] == [["r2 dead"]]
    assert "world/maps/r1/own" not in told


def test_a_short_event_draws_no_long_map_again_and_again(tmp_path: Path) -> None:
    view, file = view_of("r1", file=tmp_path / "run.rrd"), tmp_path / "run.rrd"
    corners, rows = np.random.default_rng(0).uniform(-9, 9, (20_000, 2)), np.arange(0, 20_000, 2)
    whole = MapReport(tick=0, wireframe=encode_wireframe(certain(corners, np.column_stack([rows, rows + 1]))))
    view._map("r1", whole)
    tried = Event(event="proposed", data={"peer": "r1", "transform": [0.0, 0.0, 0.0]})
    view._act("r1", Action(tick=1, speed_mps=0, turn_rps=0, events=[tried] * 100))
    view.recording.close()
    assert file.stat().st_size < 2 * ALLOWED["maps"].at_once


def test_a_run_that_is_not_there_any_more_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "REACH_S", 0.1)
    invitation.invite(tmp_path, "tcp/127.0.0.1:9", Secrets({"viewer": "0123456789abcdef"}))
    with pytest.raises(LinkError, match=r"no world answers at tcp/127\.0\.0\.1:9"):
        live.follow(*invitation.invited(tmp_path), Tape(tmp_path / "run.rrd"), Inbox())


def test_a_killed_run_is_replayed_and_what_ends_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It waited ten seconds for its world, and blamed the network."""
    recorded, run = list[Path](), tmp_path / "my run"
    run.mkdir()
    monkeypatch.setattr(command, "_show", lambda play, browser, over: play(Tape(tmp_path / "run.rrd"), Inbox()))
    monkeypatch.setattr(command, "record", lambda run, file: recorded.append(run))
    invitation.invite(run, "tcp/127.0.0.1:9", Secrets({"viewer": "0123456789abcdef"}))
    Checkpoint(run).begin({})
    command.view(run, browser=False, beside=False)
    assert recorded == [run]
    assert f"its world was killed; this is what there is of it, and `wireswarm finish '{run}'` ends it" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize("summary", [True, False])
def test_a_run_that_ends_before_it_is_seen_is_replayed_or_said_to_be_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, summary: bool
) -> None:
    """The view waited for its walls for ever."""
    recorded: list[Path] = []

    def play(tape: Tape) -> None:
        with ThreadPoolExecutor(1) as pool, open_router() as (session, endpoint):
            invitation.invite(tmp_path, endpoint, None)
            told = session.declare_publisher(keys.PROGRESS)
            viewing = pool.submit(plays[0], tape, Inbox())
            wait_for_matching([told], LIMIT_S, lambda: False)
            if summary:
                (tmp_path / command.SUMMARY).touch()
            clock = Clock(tick=0, t=0.0, status={"r1": "away"}, ended="interrupted")
            told.put(encode(Progress(clock=clock, coverage={"r1": 0.0}, team=0.0, late_ticks=0)))
            viewing.result(LIMIT_S)

    plays: list[Callable[[Tape, Inbox], None]] = []
    monkeypatch.setattr(command, "_show", lambda play, browser, over: plays.append(play))
    monkeypatch.setattr(command, "record", lambda run, file: recorded.append(run))
    command.view(tmp_path, browser=False, beside=False)
    with nullcontext() if summary else pytest.raises(LinkError, match="the run ended before anything of it was seen"):
        play(Tape(tmp_path / "run.rrd"))
    assert recorded == [tmp_path] * summary


def test_a_view_that_looks_for_a_world_stops_at_once(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent, ThreadPoolExecutor(1) as pool:
        address, inbox = f"tcp/127.0.0.1:{silent.getsockname()[1]}", Inbox()
        viewing = pool.submit(live.follow, address, None, Tape(tmp_path / "run.rrd"), inbox)
        silent.accept()[0].close()
        inbox.stop()
        viewing.result(live.REACH_S / 2)


RECORDS = """
import os, time
from deploy.view import command
parent = os.getppid()
def play(tape, inbox):
    tape.file.write_bytes(b"")
    print("records", flush=True)
    time.sleep(60)
command._show(play, False, lambda: os.getppid() != parent)
"""
BESIDE = f"""
import subprocess, sys
from deploy.launch import forks
view = subprocess.Popen([sys.executable, "-c", {RECORDS!r}], stdout=subprocess.PIPE, start_new_session=True)
print(view.stdout.readline().decode().strip(), flush=True)
sys.stdin.read()
forks.leave(130)
"""


@pytest.mark.parametrize(
    ("program", "status"), [(RECORDS, 0), (BESIDE, 130)], ids=["by a signal", "with the command beside which it is"]
)
def test_a_view_that_is_ended_while_it_records_leaves_nothing(tmp_path: Path, program: str, status: int) -> None:
    """It was waited for, and killed at a second Ctrl-C or with its run it left its recording."""
    process = subprocess.Popen(
        [sys.executable, "-c", program], cwd=REPO, env={**os.environ, "TMPDIR": str(tmp_path)}, stdin=-1, stdout=-1
    )
    assert process.stdin is not None and process.stdout is not None
    assert process.stdout.readline() == b"records\n" and len(list(tmp_path.iterdir())) == 1
    if program is RECORDS:
        process.send_signal(signal.SIGINT)
    process.stdin.close()
    assert process.wait(LIMIT_S / 2) == status
    deadline = time.monotonic() + LIMIT_S / 2
    while list(tmp_path.iterdir()):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.stdout.close()


STARTS = """
import os, signal, sys, time
sys.argv = ["wireswarm", "run", "--world", "tiny.yaml", "--out", "out", "--view"]
import wireswarm
from contextlib import contextmanager
from deploy.view import beside
@contextmanager
def starting(run):
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(60)
    yield
beside.beside = starting
from deploy.cli import main
main()
"""


def test_a_run_that_is_interrupted_while_its_view_starts_leaves_no_directory(tmp_path: Path) -> None:
    tiny_config(tmp_path)
    command = ["env", "--default-signal=INT", sys.executable, "-c", STARTS]
    done = subprocess.run(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(REPO)}, timeout=LIMIT_S)
    assert done.returncode == Status.INTERRUPTED
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"endpoint": 1, "secret": null}', '{"endpoint": "a", "secret": []}'])
def test_a_broken_invitation_is_a_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / invitation.FILE).write_text(text)
    with pytest.raises(InputError, match="no invitation of a run"):
        invitation.invited(tmp_path)


def test_without_a_directory_the_newest_run_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="has no run: name a run directory"):
        newest()
    for age, name in enumerate(("new", "old")):
        (folder := tmp_path / "runs" / name).mkdir(parents=True)
        manifest.begin(folder, {"start": f"2026-01-0{2 - age}T00:00:00+00:00"})
        (folder / "world.yaml").touch()
        os.utime(folder / "world.yaml", (1e9 + age, 1e9 + age))  # a world that goes on writes it anew
    (tmp_path / "runs" / "empty").mkdir()
    assert newest() == Path("runs/new")
    (folder := tmp_path / "runs" / "damaged").mkdir()
    manifest.begin(folder, {})
    (folder / "world.yaml").touch()
    assert newest() == Path("runs/new")
    for name in ("new", "old"):
        manifest.begin(tmp_path / "runs" / name, {})
    with pytest.raises(InputError, match="has no run whose manifest can be read: name a run directory"):
        newest()


def test_a_page_that_cannot_be_shown_ends_what_plays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command said nothing then until the run that it followed ended."""

    def play(tape: Tape, inbox: Inbox) -> None:
        tape.file.write_bytes(command.RECORDING)
        deadline = time.monotonic() + 5
        while not inbox.stopped:
            assert time.monotonic() < deadline, "nobody stops it"
            time.sleep(0.01)

    def show(*_: object) -> None:
        raise LinkError("no port is free")

    monkeypatch.setattr(command, "show", show)
    began = time.monotonic()
    with pytest.raises(LinkError, match="no port is free"):
        command._show(play, False)
    assert time.monotonic() - began < 5


@pytest.mark.slow
def test_run_with_a_view_stays_until_it_is_interrupted(tmp_path: Path) -> None:
    tiny_config(tmp_path)
    words = [sys.executable, "-m", "wireswarm", "run", "--world", str(tmp_path / "tiny.yaml"), "--robots", "2"]
    words += ["--until", "3", "--out", str(tmp_path / "out"), "--quiet", "--view"]
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=bare)
    try:
        assert process.stderr is not None
        said = ""
        while "stays until Ctrl-C" not in said or "http://" not in said:
            line = process.stderr.readline()
            assert line, said
            said += line
        address = re.search(r"http://\S+/", said)
        assert address is not None
        with urllib.request.urlopen(f"{address[0]}run.rrd", timeout=LIMIT_S) as reply:
            (tmp_path / "seen.rrd").write_bytes(reply.read())
        assert len(read_back(tmp_path / "seen.rrd")["world/r2"]["Transform3D:translation"]) > 0
        process.send_signal(signal.SIGTERM)
        assert process.wait(LIMIT_S) == Status.OK
        assert (
            process.stdout is not None and process.stdout.read().splitlines()[-1] == f"{tmp_path / 'out'}/report.html"
        )
    finally:
        process.kill()
