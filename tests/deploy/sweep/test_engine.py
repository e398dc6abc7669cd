"""A sweep's runs: made once, kept at once, and complete whatever is killed."""

import os
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pyarrow as pa
import pytest
import yaml
from pyarrow import parquet

from deploy.certs import issue
from deploy.revision import ROOT, revision, sources
from deploy.sweep import engine
from deploy.sweep.command import MOST_DOUBTS, fill, sweep
from deploy.sweep.engine import PATIENCE_S, SETTINGS, run_all
from deploy.sweep.measure import task_of
from deploy.sweep.plan import Job, read_jobs
from deploy.sweep.store import Store, read_rows
from deploy.sweep.work import FAILED, OK, OtherSourcesError, Row, WorkerTask, work
from protocol.errors import InputError, LinkError
from protocol.files import UnwritableError
from tests.deploy.sweep.sweeps import (
    RUNS,
    SWEEP,
    a_worker,
    comparable,
    results,
    scheduler_of,
    started,
    undisturbed,
    wait_until,
    worker_of,
    write_sweep,
)


@pytest.mark.system
def test_a_killed_worker_loses_nothing_and_a_second_start_runs_nothing(tmp_path: Path) -> None:
    file, out = write_sweep(tmp_path), tmp_path / "out"
    with started(*SWEEP, file, "--out", out, "--workers", 2) as client:
        wait_until(lambda: results(out))
        os.kill(a_worker(client).pid, signal.SIGKILL)
        told = client.communicate(timeout=100)[0]
    assert client.returncode == 0, told
    assert comparable(out) == undisturbed(tmp_path) and len(comparable(out)) == RUNS
    before = {path: path.stat().st_mtime_ns for path in results(out)}
    began = time.process_time()
    assert sweep(file, out, quiet=True)[:2] == (RUNS, 0)
    assert time.process_time() - began < 5
    assert before == {path: path.stat().st_mtime_ns for path in results(out)}


@pytest.mark.slow
def test_an_interrupted_client_leaves_no_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, out, temporary = write_sweep(tmp_path), tmp_path / "out", tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    with started(*SWEEP, file, "--out", out, "--workers", 1) as client:
        wait_until(lambda: results(out))
        client.terminate()
        told = client.communicate(timeout=20)[0]
    assert client.returncode == 130 and "Traceback" not in told
    assert list(temporary.iterdir()) == []


@pytest.mark.slow
def test_a_killed_client_loses_nothing_and_leaves_no_process(tmp_path: Path) -> None:
    file, out = write_sweep(tmp_path), tmp_path / "out"
    with started(*SWEEP, file, "--out", out, "--workers", 1) as client:
        wait_until(lambda: len(results(out)) >= 2)
        children = client.children(recursive=True)
        client.kill()
        psutil.wait_procs(children, timeout=20)
        assert not [child for child in children if child.is_running()]
    before = {path: path.stat().st_mtime_ns for path in results(out)}
    assert 2 <= len(before) < RUNS
    assert sweep(file, out, workers=1, quiet=True)[:2] == (RUNS, 0)
    assert before.items() <= {path: path.stat().st_mtime_ns for path in results(out)}.items()
    assert comparable(out) == undisturbed(tmp_path)


@pytest.mark.slow
def test_a_killed_scheduler_loses_nothing_where_it_comes_back(tmp_path: Path) -> None:
    file, out, port = write_sweep(tmp_path), tmp_path / "out", 18786
    scheduler, worker = scheduler_of(port), worker_of(port, tmp_path)
    with started(*SWEEP, file, "--out", out, "--scheduler", f"tcp://127.0.0.1:{port}") as client:
        with started(*scheduler) as first, started(*worker):
            wait_until(lambda: results(out))
            first.kill()
        assert len(results(out)) < RUNS
        with started(*scheduler), started(*worker):
            told = client.communicate(timeout=100)[0]
    assert client.returncode == 0, told
    assert comparable(out) == undisturbed(tmp_path)


@pytest.mark.slow
def test_the_commands_of_compose_make_a_cluster_that_strangers_cannot_ask(tmp_path: Path) -> None:
    issue(tmp_path / "certs", [], ["scheduler"])
    port, worker_port = free_port(), free_port()
    services = yaml.safe_load((ROOT / "deploy" / "compose.yaml").read_text())["services"]

    here = {"scheduler:8786": f"127.0.0.1:{port}", "=8786": f"={port}", "=8788": f"={worker_port}"}
    here |= {"=/tmp": f"={tmp_path}", "=/certs": f"={tmp_path}/certs", "=/results": f"={tmp_path}/out"}

    def command(name: str) -> list[str]:
        text = "\n".join(services[name]["entrypoint"])
        for there, instead in here.items():
            text = text.replace(there, instead)
        program, *words = text.split("\n")
        return [str(Path(sys.executable).with_name(program)), *words]

    file = write_sweep(tmp_path)
    with started(*command("scheduler")) as scheduler, started(*command("worker")) as worker:
        with started(*command("sweep"), file) as client:
            told = client.communicate(timeout=100)[0]
        ears = [one.laddr for process in (scheduler, worker) for one in process.net_connections()]
    assert client.returncode == 0, told
    assert comparable(tmp_path / "out") == undisturbed(tmp_path)
    assert {ear.port for ear in ears if ear.ip in ("0.0.0.0", "::")} == {port, worker_port}


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_results_go_into_a_folder(tmp_path: Path) -> None:
    (tmp_path / "out").touch()
    with pytest.raises(InputError, match=r"--out .*out: Not a directory; name a directory that can be written"):
        sweep(write_sweep(tmp_path), tmp_path / "out", workers=1, quiet=True)


def test_robots_are_doubted_before_they_are_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").touch()
    beams = [360, *range(90, 101)]
    file = write_sweep(tmp_path, f"worlds: [tiny.yaml]\nseeds: 2\ngrid: {{spec.lidar.beams: {beams}}}")
    with pytest.raises(InputError, match="Not a directory"):
        sweep(file, tmp_path / "out")
    *doubts, last = capsys.readouterr().err.splitlines()
    assert len(doubts) == len(set(doubts)) == MOST_DOUBTS
    assert doubts[0].startswith(
        "wireswarm: a complete map is not to be expected of 2 runs of 24: the lidar has 90 beams"
    )
    assert last == "wireswarm: doubts of this kind that are not listed: 1"


def die(deaths: str, times: int) -> Row:
    """Kill this worker, but for the first so many times only."""
    with Path(deaths).open("a") as file:
        file.write("x")
    if Path(deaths).stat().st_size <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return {}


@pytest.mark.slow
def test_a_task_fails_only_where_its_worker_dies_again_when_it_is_asked_for_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SETTINGS, "distributed.scheduler.allowed-failures", 0)
    times = {"unlucky": 1, "deadly": 1000}
    tasks = [WorkerTask(key, {"settings": "{}"}, die, (str(tmp_path / key), most)) for key, most in times.items()]
    store = Store(tmp_path, "")
    fill(store, tasks, 1, quiet=True)
    assert store.row("unlucky")["status"] == OK
    assert store.row("deadly")["reason"] == "its worker died 2 times"


class Scheduler:
    """Stands for Dask's client, once for each connection."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def __enter__(self) -> "Scheduler":
        return self

    def __exit__(self, *_: object) -> None: ...

    def wait_for_workers(self, *_: object, **__: object) -> None: ...


class Unreachable(Scheduler):
    """Its port is closed."""

    def __enter__(self) -> Scheduler:
        raise OSError("Connection refused")


def test_a_result_that_cannot_be_kept_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "Client", Scheduler)
    monkeypatch.setattr(engine, "_results", lambda *_: iter([{"key": "a"}]))
    told, full = [], UnwritableError((Path("a.parquet"), "No space left on device"))

    def keep(row: Row) -> None:
        raise full

    with pytest.raises(UnwritableError):
        run_all([WorkerTask("a", {}, os.getpid, ())], "", None, keep, told.append)
    assert not told


def test_a_scheduler_lost_in_a_long_run_is_waited_for_from_then_on(monkeypatch: pytest.MonkeyPatch) -> None:
    connections, told, kept = iter([Scheduler, Unreachable, Scheduler]), list[str](), list[Row]()
    clock, rows = [0.0], iter([[], [{"key": "a"}]])

    def results(*_: object) -> Iterator[Row]:
        clock[0] += 2 * PATIENCE_S
        return iter(next(rows))

    monkeypatch.setattr(engine, "Client", lambda *_, **__: next(connections)())
    monkeypatch.setattr(engine, "_results", results)
    monkeypatch.setattr(engine, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda _: None))
    run_all([WorkerTask("a", {}, os.getpid, ())], "", None, kept.append, told.append)
    assert kept == [{"key": "a"}] and len(told) == 1


def test_a_scheduler_that_stays_away_is_not_waited_for_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = count(0.0, PATIENCE_S / 3)
    monkeypatch.setattr(engine, "Client", Unreachable)
    monkeypatch.setattr(engine, "time", SimpleNamespace(monotonic=lambda: next(clock), sleep=lambda _: None))
    with pytest.raises(LinkError, match="no scheduler with a worker"):
        run_all([WorkerTask("a", {}, os.getpid, ())], "", None, print, print)


@pytest.mark.system
def test_a_failed_run_is_a_row_with_its_reason_and_is_made_again_where_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    file = write_sweep(tmp_path, "worlds: [tiny.yaml]\nsettings: {until: 2, robots: 400}")
    assert sweep(file, tmp_path / "out", workers=1, quiet=True)[:2] == (1, 1)
    (row,) = read_rows(tmp_path / "out")
    assert row["status"] == FAILED
    assert row["reason"] == "WorldFileError: tiny.yaml: spawns: no room for 400 robots"
    (path,) = results(tmp_path / "out")
    before = path.stat().st_mtime_ns
    sweep(file, tmp_path / "out", workers=1, quiet=True)
    assert path.stat().st_mtime_ns == before
    sweep(file, tmp_path / "out", workers=1, quiet=True, retry_failed=True)
    assert path.stat().st_mtime_ns > before
    assert list((tmp_path / "tmp").iterdir()) == []


def test_only_one_process_fills_a_folder(tmp_path: Path) -> None:
    file, out = write_sweep(tmp_path), tmp_path / "out"
    with Store(out / revision(), revision()).alone(), pytest.raises(InputError, match="another process fills it"):
        sweep(file, out, workers=1, quiet=True)
    assert not results(out)


def test_many_processes_may_find_a_folder_full_at_a_time(tmp_path: Path) -> None:
    """Cases of `bench alignment` that ran beside each other failed, as each asked for the recordings of all."""
    store = Store(tmp_path, "0123")
    store.keep({"key": "done", "status": OK, "reason": "", "settings": "{}"})
    with store.alone():
        fill(store, [WorkerTask("done", {}, os.getpid, ())], 1, quiet=True)
        with pytest.raises(InputError, match="another process fills it"):
            fill(store, [WorkerTask("missing", {}, os.getpid, ())], 1, quiet=True)


def test_a_worker_with_other_sources_refuses() -> None:
    with pytest.raises(RuntimeError, match="another version"):
        work(task_of(Job("key", {}, {})), "0123")


STANDS = """from agent.shell.mind import OwnMind

class {}(OwnMind):
    def drive(self, observation, heard):
        return 0.0, 0.0
"""
OF_MIND = 'worlds: [tiny.yaml]\nsettings: {{until: 0.4, mind: {{"*": "{}"}}}}'


def test_a_worker_that_loaded_a_mind_before_it_was_changed_refuses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ran the old one, and its result was kept as the new one's."""
    monkeypatch.syspath_prepend(str(tmp_path))
    (mind := tmp_path / "loaded_mind.py").write_text(STANDS.format("Loaded"))
    plan = write_sweep(tmp_path, OF_MIND.format("loaded_mind:Loaded"))
    (before,) = read_jobs(plan)
    assert work(task_of(before), sources())["status"] == OK
    mind.write_text(mind.read_text() + "    speed = 1\n")
    (after,) = read_jobs(plan)
    with pytest.raises(OtherSourcesError, match="another version of loaded_mind:Loaded"):
        work(task_of(after), sources())


def test_a_worker_that_loaded_a_mind_with_another_one_before_it_was_changed_refuses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first question for it came after the change, and its hash was that of the new file."""
    monkeypatch.syspath_prepend(str(tmp_path))
    (base := tmp_path / "base_mind.py").write_text(STANDS.format("Base"))
    (tmp_path / "derived_mind.py").write_text("from base_mind import Base\n\nclass Derived(Base): ...\n")
    (derived,) = read_jobs(write_sweep(tmp_path, OF_MIND.format("derived_mind:Derived")))
    assert work(task_of(derived), sources())["status"] == OK
    base.write_text(base.read_text() + "    speed = 1\n")
    (after,) = read_jobs(write_sweep(tmp_path, OF_MIND.format("base_mind:Base")))
    with pytest.raises(OtherSourcesError, match="another version of base_mind:Base"):
        work(task_of(after), sources())


def test_a_worker_that_lacks_a_mind_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each run was kept as failed."""
    monkeypatch.syspath_prepend(str(tmp_path))
    (mind := tmp_path / "lacking_mind.py").write_text(STANDS.format("Lacking"))
    (job,) = read_jobs(write_sweep(tmp_path, OF_MIND.format("lacking_mind:Lacking")))
    mind.unlink()
    monkeypatch.delitem(sys.modules, "lacking_mind")
    with pytest.raises(OtherSourcesError, match="--mind lacking_mind:Lacking: No module named"):
        work(task_of(job), sources())


class Shared:
    """Stands for a scheduler that does what has one name once, whoever asks."""

    loop = None

    def __init__(self) -> None:
        self.futures: dict[str, SimpleNamespace] = {}

    def map(
        self, call: Callable[..., Row], tasks: Sequence[WorkerTask], *, key: list[str], code: str, **_: object
    ) -> Any:
        for name, task in zip(key, tasks, strict=True):
            row = task.row(OK) | {"code": code}
            future = SimpleNamespace(key=name, status="finished", result=lambda row=row: row, release=lambda: None)
            self.futures.setdefault(name, future)
        return [self.futures[name] for name in key]


def test_two_versions_on_one_cluster_get_each_its_own_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """The later one got what the other had asked for."""
    cluster, task = Shared(), WorkerTask("a", {}, os.getpid, ())
    monkeypatch.setattr(engine, "as_completed", lambda futures, **_: iter(futures))
    for code in ("old", "new"):
        monkeypatch.setattr(engine, "sources", lambda code=code: code)
        (row,) = engine._results(cluster, [task], set())
        assert row["key"] == "a" and row["code"] == code


def lacks_a_file() -> Row:
    raise FileNotFoundError(os.fsdecode(b"a\xe9.npy"))


def test_a_reason_that_is_no_utf_8_is_kept(tmp_path: Path) -> None:
    """It ended the sweep at each start."""
    (store := Store(tmp_path, "")).keep(work(WorkerTask("a", {"settings": "{}"}, lacks_a_file, ()), sources()))
    assert store.row("a")["reason"] == r"FileNotFoundError: a\udce9.npy"


@pytest.mark.parametrize("address", ["tls://10.0.0.1:8786", "tcp://10.0.0.1:8786", "10.0.0.1"])
def test_a_scheduler_that_anybody_could_reach_is_refused(tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match="--certs DIR"):
        sweep(write_sweep(tmp_path), tmp_path / "out", scheduler=address)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"certs": Path("certs")}, "--certs certs: .*name its --scheduler"),
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:8786"}, "--workers 2: .*leave out this or --scheduler"),
    ],
)
def test_options_that_can_do_nothing_are_refused(tmp_path: Path, options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        sweep(write_sweep(tmp_path), out := tmp_path / "out", quiet=True, **options)
    assert not out.exists()


def test_a_file_that_is_no_result_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"bad\.parquet: no result of a sweep"):
        list(read_rows(tmp_path))


RESULT = {"key": "a", "status": "ok", "reason": "", "settings": '{"seed": 1}', "revision": "abc"}


@pytest.mark.parametrize(
    "wrong",
    [
        {"settings": 1.5},
        {"settings": "[1]"},
        {"settings": "{"},
        {"config": "[1]"},
        {"config": 1.5},
        {"revision": None},
        {"status": ["ok"]},
    ],
)
def test_a_result_whose_words_are_none_is_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    parquet.write_table(pa.Table.from_pylist([RESULT]), tmp_path / "a.parquet")
    assert list(read_rows(tmp_path)) == [RESULT]
    parquet.write_table(pa.Table.from_pylist([RESULT | wrong]), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"a\.parquet: no result of a sweep"):
        list(read_rows(tmp_path))


def test_a_pipe_among_the_results_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"a\.parquet: no result of a sweep: this is no file"):
        list(read_rows(tmp_path))


def test_a_file_of_many_rows_is_no_result(tmp_path: Path) -> None:
    """30 million equal rows are half a megabyte, and took all memory."""
    parquet.write_table(pa.Table.from_pylist([RESULT] * 3), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"a\.parquet: no result of a sweep: it has 3 rows of 5 columns"):
        list(read_rows(tmp_path))
