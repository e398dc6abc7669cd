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


FORKED_BESIDE_ANOTHER_AGENT = """
import os
from agent.shell.mind import minds_of
from deploy.launch import forks
def told():
    minds_of({})
    print(os.environ.get("PYTHONSAFEPATH"), os.environ["PYTHONPATH"])
if __name__ == "__main__":
    forks.begin()
    process = forks.CONTEXT.Process(target=told)
    process.start()
    process.join()
    told()
"""
VIEWED_BESIDE_ANOTHER_AGENT = """
from pathlib import Path
from deploy.view.beside import beside
with beside(Path("run")):
    pass
"""


def beside_another_agent(program: str, folder: Path, environment: dict[str, str]) -> tuple[int, str, str]:
    """Status, stdout and stderr of a script in a working folder with packages of our names, as of who writes minds."""
    for name in ("agent", "world"):
        (folder / f"{name}.py").write_text("raise SystemExit('not ours')")
    (script := folder / "bin" / "wireswarm").parent.mkdir()
    script.write_text(program)
    command, environment = [sys.executable, script], os.environ | {"PYTHONPATH": str(REPO)} | environment
    said = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
    return said.returncode, said.stdout, said.stderr


@pytest.mark.parametrize("safe", [None, "1"])
def test_packages_of_our_names_in_the_working_folder_are_not_taken_for_ours(safe: str | None, tmp_path: Path) -> None:
    """A run ended with a traceback. What a mind starts finds modules as whoever started the run had it."""
    own = {} if safe is None else {"PYTHONSAFEPATH": safe}
    said = beside_another_agent(FORKED_BESIDE_ANOTHER_AGENT, tmp_path, own)
    assert said == (0, f"{safe} {REPO}\n" * 2, "")


def test_a_view_beside_a_run_does_not_take_packages_of_our_names_for_ours(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    assert beside_another_agent(VIEWED_BESIDE_ANOTHER_AGENT, tmp_path, {}) == (0, "", "")


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
