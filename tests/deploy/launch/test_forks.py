"""The server from which a run's processes are forked."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from deploy.launch.forks import LAUNCHER
from tests.disturbed import REPO

pytestmark = pytest.mark.system

FORKED = """
import sys
import deploy.launch.preload
loaded = set(sys.modules)
import agent.shell.process
print(*sorted(set(sys.modules) - loaded))
"""


def run(program: str, launcher: int) -> subprocess.CompletedProcess[str]:
    command, environment = [sys.executable, "-c", program], os.environ | {LAUNCHER: str(launcher)}
    return subprocess.run(command, cwd=REPO, env=environment, capture_output=True, text=True, timeout=60)


SPARES = """
import os, subprocess, sys
from deploy.launch import forks
ours, theirs = (subprocess.Popen(["sleep", "1"], start_new_session=alone) for alone in (False, True))
forks.kill()
print(ours.wait(), theirs.wait())
"""


BESIDE_ANOTHER_AGENT = """
import sys
from agent.shell.mind import minds_of
from deploy.launch import forks
from deploy.view.beside import beside
from pathlib import Path
if __name__ == "__main__":
    forks.begin()
    process = forks.CONTEXT.Process(target=minds_of, args=({},))
    process.start()
    process.join()
    with beside(Path("run")):
        print(process.exitcode, forks.os.environ.get("PYTHONSAFEPATH"))
"""


def test_packages_of_our_names_in_the_working_folder_are_not_taken_for_ours(tmp_path: Path) -> None:
    """As somebody has who writes minds: a run ended with a traceback."""
    for name in ("agent", "world"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not ours')")
    (script := tmp_path / "bin" / "wireswarm").parent.mkdir()
    script.write_text(BESIDE_ANOTHER_AGENT)
    environment = os.environ | {"PYTHONPATH": str(REPO)}
    said = subprocess.run(
        [sys.executable, script], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60
    )
    assert (said.returncode, said.stdout, said.stderr) == (0, "0 None\n", "")


def test_a_robot_imports_nothing_of_its_own() -> None:
    """What each of thirty forks imports, 8 ms once, is a quarter of a second until all are up."""
    said = run(FORKED, os.getpid())
    assert (said.returncode, said.stdout.split()) == (0, [])


def test_a_server_whose_launcher_was_killed_before_it_looked_loads_no_further() -> None:
    said = run(
        "import deploy.launch.leash, time\nfor _ in range(50): time.sleep(0.1)\nprint('loaded')", os.getpid() + 1
    )
    assert (said.returncode, said.stdout) == (0, "")


def test_a_view_and_the_browser_are_not_killed_with_a_run() -> None:
    """They were, and the view's recording stayed."""
    said = run(SPARES, os.getpid())
    assert (said.returncode, said.stdout, said.stderr) == (0, "-9 0\n", "")
