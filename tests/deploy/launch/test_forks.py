"""The server from which a run's processes are forked."""

import subprocess
import sys

from tests.disturbed import REPO

FORKED = """
import sys
import deploy.launch.preload
loaded = set(sys.modules)
import agent.shell.process
print(*sorted(set(sys.modules) - loaded))
"""


def test_a_robot_imports_nothing_of_its_own() -> None:
    """What each of thirty forks imports, 8 ms once, is a quarter of a second until all are up."""
    said = subprocess.run(
        [sys.executable, "-c", FORKED], capture_output=True, text=True, timeout=60, check=True, cwd=REPO
    )
    assert said.stdout.split() == []
