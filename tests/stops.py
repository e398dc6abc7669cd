"""`python -m tests.stops signals|kills [TIMES] [BUSY]`: runs that are stopped at random moments, from start to report.

signals: Ctrl-C and SIGTERM, to the command alone or to all its processes. kills: kill -9 of the launcher, or of the
server that world and robots are forked from. BUSY: endless loops beside them. A line for each tells how it ended; the
status is 1 where one took longer than 5 s, left a process or an unreadable file, or did not say `interrupted`.
"""

import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from subprocess import TimeoutExpired

import psutil

from protocol.status import Status
from tests.disturbed import BEGUN_S, Command, handles, loops

WITHIN_S = 5.0
PATIENCE_S = 60.0  # until what has not ended is killed
OPTIONS = ("--until", "10")
PHASES = ("report.html", "report.png", "summary.json", "checkpoint.msgpack", "truth.json", "manifest.json")
"""Files of a run directory, the last to be written first."""
NOTHING = "nothing yet"


def start(folder: Path) -> tuple[Command, float]:
    """A run that has begun to handle signals, and when: time.monotonic()."""
    folder.mkdir()
    run, end = Command(folder, *OPTIONS), time.monotonic() + BEGUN_S
    while not handles(run.popen.pid, signal.SIGTERM) and time.monotonic() < end:
        time.sleep(0.001)
    return run, time.monotonic()


def strike(run: Command, what: str, rng: random.Random) -> str:
    """Do to a run what is to be done; returns it in words."""
    if what == "signals":
        number, group = rng.choice((signal.SIGINT, signal.SIGTERM)), rng.random() < 0.5
        (os.killpg if group else os.kill)(run.popen.pid, number)
        return f"{number.name}{' to all' if group else ''}"
    run.note()
    server = run.server()
    if server is None or rng.random() < 0.5:
        run.popen.kill()
        return "launcher killed"
    server.kill()
    return "server killed"


def left(session: int) -> list[int]:
    """Processes of a session, but for those that have ended and are not waited for."""
    found = []
    for process in psutil.process_iter(["pid", "status"]):
        try:
            if os.getsid(process.pid) == session and process.info["status"] != psutil.STATUS_ZOMBIE:
                found.append(process.pid)
        except ProcessLookupError:
            continue
    return found


def wait(session: int) -> None:
    """Wait until a session has no process. Raises TimeoutExpired."""
    end = time.monotonic() + PATIENCE_S
    while left(session):
        if time.monotonic() > end:
            raise TimeoutExpired("wireswarm run", PATIENCE_S)
        time.sleep(0.02)


def unreadable(out: Path) -> list[str]:
    """What no reader of a run directory can take."""
    bad = [str(file.relative_to(out)) for file in out.rglob(".*")]
    for file in (*out.rglob("*.json"), *out.rglob("*.jsonl")):
        text = file.read_text()
        try:
            for line in text.splitlines() if file.suffix == ".jsonl" else [text]:
                json.loads(line)
        except ValueError:
            bad.append(str(file.relative_to(out)))
    return bad


def faults(run: Command, did: str, phase: str, taken_s: float, errors: str) -> list[str]:
    """What is wrong with how a run ended. One that was over already says how it ended itself."""
    status, by_launcher = run.popen.returncode, "launcher" not in did
    found = ["traceback"] if "Traceback" in errors else []
    late = [f"took {taken_s:.1f} s"] if taken_s > WITHIN_S else []
    if not run.out.exists():
        return found + late + ([f"status {status}"] if by_launcher and status != Status.INTERRUPTED else [])
    found += [f"{name} is no good" for name in unreadable(run.out)]
    try:
        manifest = run.manifest()
    except (OSError, ValueError):
        return [*found, *late, "no manifest"]
    needless = did == "server killed" and manifest["ended"] == "time"  # it was not needed any more, or another began
    found += [] if needless else late
    if by_launcher and not needless and not status == manifest.get("exit_status") == Status.INTERRUPTED:
        found.append(f"status {status}, {manifest.get('exit_status')} in the manifest")
    if manifest["ended"] not in ("interrupted", "time") and not (phase == "manifest.json" and not by_launcher):
        found.append(f"ended: {manifest['ended']}")
    return found


def one(folder: Path, what: str, after_s: float, rng: random.Random) -> bool:
    """Stop a run so long after its start; print how it ended, and return whether that was as it should be."""
    run, began = start(folder)
    try:
        time.sleep(max(0.0, began + after_s - time.monotonic()))
        if run.popen.poll() is not None or handles(run.popen.pid, signal.SIGTERM, "SigIgn"):
            print(f"{after_s:6.2f} s: it was over", flush=True)
            return True
        phase = next((name for name in PHASES if (run.out / name).exists()), NOTHING)
        did, since = strike(run, what, rng), time.monotonic()
        errors = run.popen.communicate(timeout=PATIENCE_S)[1]
        wait(run.popen.pid)
        taken_s = time.monotonic() - since
        found = faults(run, did, phase, taken_s, errors)
        print(f"{after_s:6.2f} s, {phase}: {did}: {taken_s:.2f} s  {'; '.join(found) or 'fine'}", flush=True)
        return not found
    except TimeoutExpired:
        print(f"{after_s:6.2f} s, {phase}: {did}: HANGS, {left(run.popen.pid)}", flush=True)
        return False
    finally:
        for number in left(run.popen.pid):
            os.kill(number, signal.SIGKILL)
        run.end()


def main(what: str, times: int, busy: int) -> int:
    """Stop them one after the other, at moments that are spread over a run's time."""
    rng, bad = random.Random(0), 0
    with loops(busy), tempfile.TemporaryDirectory(prefix="wireswarm-stops-") as place:
        run, began = start(Path(place, "undisturbed"))
        run.popen.communicate(timeout=10 * BEGUN_S)
        lasts_s = time.monotonic() - began
        print(f"undisturbed it takes {lasts_s:.1f} s", flush=True)
        for k in range(times):
            bad += not one(Path(place, str(k)), what, lasts_s * (k + rng.random()) / times, rng)
    print(f"{times - bad} of {times} are fine")
    return 1 if bad else 0


if __name__ == "__main__":
    given = sys.argv[1:]
    sys.exit(main(given[0], int(given[1]) if len(given) > 1 else 40, int(given[2]) if len(given) > 2 else 0))
