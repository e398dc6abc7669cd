"""The pods of the kustomize base, run as containers with their commands, certificates and rights."""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from agent.config import AgentConfig
from deploy.inprocess import run
from tests.compose.engine import REPO, build_images, call, wait_for
from world.config import WorldConfig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

RIGHTS = ["--read-only", "--cap-drop=ALL", "--user=10001:10001", "--tmpfs=/tmp", "--security-opt=no-new-privileges"]
NETWORK = "wireswarm-pods"
ROBOTS = 3


@pytest.fixture
def start() -> Iterator[Callable[..., str]]:
    """Starts a container of a manifest, with folders in place of its volumes; returns its ID."""
    build_images("agent", "world")
    call("docker", "network", "create", "--internal", NETWORK)
    started: list[str] = []

    def start(container: dict[str, Any], folders: dict[str, Path], *options: str, **env: str) -> str:
        mounts = [
            f"--volume={folders[mount['name']]}:{mount['mountPath']}{':ro' if mount.get('readOnly') else ''}"
            for mount in container["volumeMounts"]
            if mount["name"] != "tmp"
        ]
        entry, *words = [*container.get("command", []), *container.get("args", [])]
        entrypoint = [f"--entrypoint={entry}"] if "command" in container else []
        words = words if entrypoint else [entry, *words]
        told = [f"--env={name}={value}" for name, value in env.items()]
        command = ["docker", "run", "--detach", f"--network={NETWORK}", *RIGHTS, *mounts, *told, *options, *entrypoint]
        started.append(call(*command, container["image"], *words).strip())
        return started[-1]

    yield start
    call("docker", "rm", "--force", "--volumes", *started)
    call("docker", "network", "rm", NETWORK)


def test_a_world_that_is_killed_goes_on_and_all_maps_are_those_of_one_process(
    start: Callable[..., str], tmp_path: Path
) -> None:
    world, agents = template("world.yaml", "StatefulSet"), template("agents.yaml", "Job")
    (pod,) = world["containers"]
    pod["args"] = [word.replace("maze-15", "apartment") for word in pod["args"]]
    (identity,), (agent,) = agents["initContainers"], agents["containers"]
    certs = tmp_path / "certs"
    call(sys.executable, "-m", "wireswarm", "certs", str(certs), "--robots", str(ROBOTS))
    for file in (certs, *certs.iterdir()):
        file.chmod(0o755)  # a pod's fsGroup may read them
    folders = {"certs": certs, "identities": certs, "runs": tmp_path / "runs"}
    folders["runs"].mkdir()
    folders["runs"].chmod(0o777)
    here = start(pod, folders, "--network-alias=world")
    robots = []
    for index in range(ROBOTS):
        own = {name: tmp_path / f"{name}-{index}" for name in ("certs", "checkpoints")}
        for folder in own.values():
            folder.mkdir()
            folder.chmod(0o777)
        given = start(identity, folders | own, JOB_COMPLETION_INDEX=str(index))
        assert call("docker", "wait", given).strip() == "0"
        robots.append(start(agent, own))
    checkpoint = folders["runs"] / "run" / "checkpoint.msgpack"
    wait_for(checkpoint.exists)
    time.sleep(1.0)
    call("docker", "kill", here)
    assert checkpoint.exists()
    start(pod, folders, "--network-alias=world")
    assert [call("docker", "wait", robot).strip() for robot in robots] == ["0"] * ROBOTS
    wait_for((folders["runs"] / "run" / "report.html").exists)
    run(WorldConfig(world="apartment", robots=ROBOTS, seed=0), AgentConfig(), tmp_path / "here")
    for file in sorted((tmp_path / "here" / "maps").iterdir()):
        assert (folders["runs"] / "run" / "maps" / file.name).read_bytes() == file.read_bytes(), file.name


def template(file: str, kind: str) -> dict[str, Any]:
    """What the pods of a resource of the base are made from."""
    resources = yaml.safe_load_all((REPO / "deploy" / "kubernetes" / file).read_text())
    found: dict[str, Any] = next(one for one in resources if one["kind"] == kind)["spec"]["template"]["spec"]
    return found
