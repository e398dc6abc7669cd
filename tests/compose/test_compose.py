"""Containers, really run: `python -m pytest -m slow tests/compose`; skipped where no container engine is.

Where no registry is to be had, BASE names a base image (one made by debootstrap with python3 and python3-venv will do)
and BUILD_NETWORK=host lets the build reach a package index.
"""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from agent.config import AgentConfig
from deploy.inprocess import run
from world.config import WorldConfig

REPO = Path(__file__).parents[2]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def call(*command: str, **env: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=REPO, env={**os.environ, **env}, capture_output=True, text=True, timeout=1200, check=False
    )


@pytest.fixture(scope="module")
def compose() -> Iterator[list[str]]:
    """The command of compose, with the image built."""
    if shutil.which("docker") is None or call("docker", "info").returncode:
        pytest.skip("no container engine runs here: start dockerd")
    plugin = call("docker", "compose", "version").returncode == 0
    if not plugin and shutil.which("docker-compose") is None:
        pytest.skip("there is neither docker compose nor docker-compose")
    command = [*(["docker", "compose"] if plugin else ["docker-compose"]), "--file", "deploy/compose.yaml"]
    build = ["--network", os.environ.get("BUILD_NETWORK", "default"), "--tag", "wireswarm"]
    base = os.environ.get("BASE", "python:3.11-slim")
    built = call("docker", "build", "--file", "deploy/Dockerfile", "--build-arg", f"BASE={base}", *build, ".")
    assert built.returncode == 0, built.stdout[-2000:] + built.stderr[-2000:]
    yield command
    call(*command, "down", "--volumes", "--timeout", "5")


@pytest.mark.parametrize("robots", [3, 5])
def test_containers_leave_the_same_maps_as_one_process(compose: list[str], robots: int, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    runs.chmod(0o777)
    env = {"RUNS": str(runs), "ROBOTS": str(robots), "WORLD": "apartment", "SEED": "1"}
    up = call(*compose, "up", "--no-build", "--exit-code-from", "world", **env)
    call(*compose, "down", "--volumes", "--timeout", "5", **env)
    assert up.returncode == 0, up.stdout[-2000:] + up.stderr[-2000:]
    made = runs / "apartment-1"
    run(WorldConfig(world="apartment", robots=robots, seed=1), AgentConfig(), tmp_path / "here")
    summary = json.loads((made / "summary.json").read_text())
    assert [robot["ended"] for robot in summary["robots"].values()] == ["complete"] * robots
    for file in sorted((tmp_path / "here" / "maps").iterdir()):
        assert (made / "maps" / file.name).read_bytes() == file.read_bytes(), file.name


@pytest.mark.usefixtures("compose")
def test_the_image_runs_as_nobody_in_particular_and_holds_no_build_tools() -> None:
    look = "id -u; command -v gcc pip make; find / -xdev -name 'pip' -path '*site-packages*'; ls /secrets /runs"
    assert call("docker", "run", "--rm", "--entrypoint", "sh", "wireswarm", "-c", look).stdout.split() == [
        "10001", "/runs:", "/secrets:",
    ]  # fmt: skip
