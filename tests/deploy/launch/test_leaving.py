"""What ends at once leaves no temporary folder: neither its own, nor one of multiprocessing or of its children."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.disturbed import AS_TERMINAL, REPO

IN_FOLDER = """
import sys
sys.argv[0] = "wireswarm"
import wireswarm
from deploy.launch import forks
from protocol.temporary import temporary_folder
forks.begin()
with temporary_folder() as folder:
    (folder / "something").touch()
    print(len(list(folder.parent.iterdir())), flush=True)
    {}
"""


def test_a_job_in_the_background_heeds_sigterm() -> None:
    """It ignores Ctrl-C; with that, SIGTERM was left to the system, and what the job had started lived on."""
    heeds = """
import signal, sys
sys.argv[0] = "wireswarm"
import wireswarm
assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
signal.raise_signal(signal.SIGTERM)
"""
    command = ["env", "--ignore-signal=INT", sys.executable, "-c", heeds]
    done = subprocess.run(command, cwd=REPO, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (130, "")


@pytest.mark.parametrize(
    ("how", "status"),
    [("import time; time.sleep(60)", 130), ("forks.leave(130)", 130), ("raise SystemExit(3)", 3)],
    ids=["by a signal", "by a signal of which it knows", "of itself"],
)
def test_no_temporary_folder_stays(tmp_path: Path, how: str, status: int) -> None:
    process = subprocess.Popen(
        [*AS_TERMINAL, sys.executable, "-c", IN_FOLDER.format(how)],
        env={**os.environ, "PYTHONPATH": str(REPO), "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and int(process.stdout.readline()) == 2
    if "sleep" in how:
        process.send_signal(signal.SIGTERM)
    assert process.communicate(timeout=60)[1] == ""
    assert process.returncode == status
    assert list(tmp_path.iterdir()) == []
