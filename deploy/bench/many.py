"""Many robots as processes: how fast, in how much memory, with how many false merges, and as one process has it."""

import hashlib
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil

from deploy import inprocess
from deploy.bench.cases import Case, Figures
from deploy.bench.errors import false_of
from deploy.bench.explored import launched, read_json
from deploy.bench.tables import Table, whole
from deploy.config import RunConfig
from deploy.sensing import of_benchmark
from protocol.geometry import pose_of
from protocol.temporary import temporary_folder

LOOK_S = 15.0
"""Memory is looked at so often: a look at 100 processes takes half a second (measured)."""
MADE = ("maps/*.json", "events.jsonl", "trajectories/*.tum")
"""What robots make of a run."""


def cases(quick: bool) -> list[Case]:
    """30 robots until they are complete, and 100 for 120 s, alone each: their figures are times."""
    asked: dict[int, tuple[str, str | float]] = {30: ("40x40", "complete"), 100: ("80x80", 120.0)}
    return [
        Case(f"many/{robots}", measure, {"robots": robots, "side": side, "until": until}, alone=True)
        for robots, (side, until) in ({5: ("13x12", 10.0)} if quick else asked).items()
    ]


def measure(robots: int, side: str, until: str | float) -> Figures:
    """Both runs of a team in a maze from seed 0."""
    settings = {"world": f"generated-{side}-0", "robots": robots, "until": until, "server": {"join_timeout_s": 600}}
    with _memory() as taken, launched(settings) as (run, ended):
        summary = read_json(run / "summary.json")
        frames = {robot: pose_of(np.array(frame)) for robot, frame in read_json(run / "truth.json")["frames"].items()}
        events = map(json.loads, (run / "events.jsonl").read_text(encoding="utf-8").splitlines())
        accepted = [(event["robot"], event) for event in events if event["event"] == "accepted"]
        made = _digest(run)
    with temporary_folder() as folder:
        config = RunConfig.model_validate(of_benchmark(settings))
        inprocess.run(config, config.agent, folder)
        same = made == _digest(folder)
    return {
        "robots": robots,
        "side": side,
        "ended": ended,
        "complete": sum(robot["ended"] == "complete" for robot in summary["robots"].values()),
        "real_time_factor": summary["real_time_factor"],
        "gib": round(max(taken) / 2**30, 2),
        "accepted": len(accepted),
        "false": false_of(accepted, frames),
        "same": same,
    }


def _digest(run: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(file for pattern in MADE for file in run.glob(pattern)):
        digest.update(file.read_bytes())
    return digest.hexdigest()


@contextmanager
def _memory() -> Iterator[list[int]]:
    """Bytes (PSS) of this process and its children, from time to time."""
    taken, over = list[int](), threading.Event()

    def look() -> None:
        while not over.wait(LOOK_S if taken else 1.0):
            me = psutil.Process()
            taken.append(sum(map(_pss, (me, *me.children(recursive=True)))))

    watcher = threading.Thread(target=look)
    watcher.start()
    try:
        yield taken
    finally:
        over.set()
        watcher.join()


def _pss(process: psutil.Process) -> int:
    """As the kernel sums it up; psutil reads every mapping."""
    with suppress(OSError):  # it has ended
        for line in Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) << 10
    return 0


def _table(robots: int, title: str, ended: str, factor: str) -> Table:
    heads = (
        f"robots; side; ended; complete{ended}; real_time_factor{factor}: times real time; gib <= 6: GiB; accepted; "
        "false <= 0; same >= 1: bytes of one process"
    )
    return Table(f"many-{robots}", title, whole(f"many/{robots}"), heads)


TABLES = [
    _table(5, "Five robots as processes", "", ""),
    _table(30, "30 robots as processes, until all are complete", " >= 30", " >= 3"),
    _table(100, "100 robots as processes, 120 s", "", " >= 0.5"),
]
