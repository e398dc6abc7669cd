"""What tests with a container engine share: calls, and the images."""

import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

REPO = Path(__file__).parents[2]
BASE = os.environ.get("BASE", "python:3.11-slim")


def call(*command: str, **env: str) -> str:
    """Output of a command that succeeds."""
    done = subprocess.run(
        command, cwd=REPO, env={**os.environ, **env}, capture_output=True, text=True, timeout=1200, check=False
    )
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


def works(*command: str) -> bool:
    """Whether a command is there and succeeds."""
    return shutil.which(command[0]) is not None and subprocess.run(command, capture_output=True).returncode == 0


def wait_for(there: Callable[[], bool]) -> None:
    """Wait until it is so, for two minutes at most."""
    deadline = time.monotonic() + 120
    while not there():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def build_images(*targets: str) -> None:
    """Build them, or skip the test where no engine is."""
    if not works("docker", "info"):
        pytest.skip("no container engine runs here: start dockerd")
    network = os.environ.get("BUILD_NETWORK", "default")
    for target in targets:
        image = ["--target", target, "--tag", f"wireswarm-{target}", "--build-arg", f"BASE={BASE}"]
        call("docker", "build", "--file", "deploy/Dockerfile", "--network", network, *image, ".", DOCKER_BUILDKIT="0")
