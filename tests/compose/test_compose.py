"""Containers, really run: `python -m pytest -m slow tests/compose`; skipped where no container engine is.

Where no registry is to be had, BASE names a base image (one made by debootstrap with python3 and python3-venv will do)
and BUILD_NETWORK=host lets the build reach a package index.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from agent.config import AgentConfig
from deploy.inprocess import run
from tests.compose.engine import BASE, build_images, call, wait_for, works
from tests.deploy.sweep.sweeps import RUNS, comparable, undisturbed, write_sweep
from world.config import WorldConfig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

MAX_AGENT_BYTES = 250e6
"""Above the base (issue 14): 149 MB are LLVM, by which kernels are loaded."""
MAX_AGENT_MEMORY = 200 * 2**20
MAX_JOIN_S = 3.0
"""Of CPU: as long as it takes on an idle machine, however busy this one is."""
MAX_STOP_S = 2


@pytest.fixture(scope="module")
def compose() -> Iterator[list[str]]:
    """The command of compose, with the images built."""
    build_images("agent", "world", "sweep")
    plugin = works("docker", "compose", "version")
    if not plugin and not works("docker-compose", "version"):
        pytest.skip("there is neither docker compose nor docker-compose")
    command = [*(["docker", "compose"] if plugin else ["docker-compose"]), "--file", "deploy/compose.yaml"]
    yield command
    call(*command, "down", "--volumes", "--timeout", "5")


def ended(compose: list[str], service: str) -> list[int]:
    """Exit statuses of the containers of a service."""
    ids = call(*compose, "ps", "--quiet", "--all", service).split()
    return [int(call("docker", "inspect", "--format", "{{.State.ExitCode}}", one)) for one in ids]


@pytest.mark.parametrize(
    ("robots", "how", "env"),
    [
        (3, [], {}),
        (3, [], {}),  # twice in a row, as written
        (5, ["--scale", "agent=5"], {}),
        (5, [], {"ROBOTS": "5", "SETTLE": "120"}),
    ],
)
def test_containers_leave_the_same_maps_as_one_process(
    compose: list[str], robots: int, how: list[str], env: dict[str, str], tmp_path: Path
) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    runs.chmod(0o777)
    env = {"RUNS": str(runs), "WORLD": "apartment", "SEED": "1"} | env
    try:
        said = call(*compose, "up", "--no-build", *how, **env)
        assert ended(compose, "world") == [0] and ended(compose, "agent") == [0] * robots, said[-2000:]
    finally:
        call(*compose, "down", "--volumes", "--timeout", "5", **env)
    assert all(f"r{number + 1}: complete" in said for number in range(robots)) and "report.html" in said
    made = runs / "apartment-1"
    run(WorldConfig(world="apartment", robots=robots, seed=1), AgentConfig(), tmp_path / "here")
    summary, manifest = (json.loads((made / f"{name}.json").read_text()) for name in ("summary", "manifest"))
    assert [robot["ended"] for robot in summary["robots"].values()] == ["complete"] * robots
    assert (manifest["config"]["robots"], manifest["exit_status"]) == (robots, 0)
    assert (made / "report.html").read_text().startswith("<!doctype html>")
    for file in sorted((tmp_path / "here" / "maps").iterdir()):
        assert (made / "maps" / file.name).read_bytes() == file.read_bytes(), file.name


def test_an_agent_is_light_and_quickly_ready(compose: list[str], tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    env = {"ROBOTS": "1", "SETTLE": "120", "RUNS": str(tmp_path)}
    try:
        call(*compose, "up", "--no-build", "--detach", "--scale", "agent=1", **env)
        (agent,) = call(*compose, "ps", "--quiet", "agent", **env).split()
        wait_for(lambda: any(file.stat().st_size for file in tmp_path.rglob("snapshots/r1.jsonl")))  # it maps
        memory, cpu_s = used(agent)
        print(f"an agent's container maps after {cpu_s:.1f} CPU s, with {memory / 2**20:.0f} MiB at its peak")
        assert memory <= MAX_AGENT_MEMORY and cpu_s <= MAX_JOIN_S
    finally:
        call(*compose, "down", "--volumes", "--timeout", "5", **env)


def test_containers_that_wait_for_others_leave_when_they_are_asked(compose: list[str]) -> None:
    env = {"ROBOTS": "2", "SETTLE": "120"}
    try:
        call(*compose, "up", "--no-build", "--detach", "--scale", "agent=1", **env)  # r2 never comes
        agent, world = (call(*compose, "ps", "--quiet", service, **env).strip() for service in ("agent", "world"))
        wait_for(lambda: "takes part" in call("docker", "logs", agent))
        wait_for(lambda: state(agent)["Health"]["Status"] == "healthy")
        for container in (agent, world):
            call("docker", "stop", "--time", str(MAX_STOP_S), container)  # after that it is killed
            assert state(container)["ExitCode"] == 130
    finally:
        call(*compose, "down", "--volumes", "--timeout", "5", **env)


def test_a_sweep_on_workers_in_containers_has_the_results_of_one_process(compose: list[str], tmp_path: Path) -> None:
    write_sweep(tmp_path)
    out = tmp_path / "results"
    out.mkdir()
    for folder in (tmp_path, *tmp_path.iterdir()):
        folder.chmod(0o777)
    compose = [*compose, "--profile", "sweep"]
    env = {"SWEEPS": str(tmp_path), "SWEEP": "sweep.yaml", "RESULTS": str(out), "WORKERS": "2"}
    try:
        said = call(*compose, "run", "--rm", "-T", "sweep", **env)
        assert f"{RUNS} runs, 0 of them failed" in said
        workers = call(*compose, "ps", "--quiet", "worker", **env).split()
        assert len(workers) == 2 and all(state(one)["Running"] for one in workers)
    finally:
        call(*compose, "down", "--volumes", "--timeout", "5", **env)
    made, due = (
        {key: {name: value for name, value in row.items() if name != "revision"} for key, row in rows.items()}
        for rows in (comparable(out), undisturbed(tmp_path))
    )  # an image has no checkout, so its revision is a hash
    assert made == due


def state(container: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(call("docker", "inspect", container))[0]["State"]
    return found


def used(container: str) -> tuple[int, float]:
    """Bytes of a container's cgroup at its peak so far, and its CPU seconds."""
    lines = Path(f"/proc/{state(container)['Pid']}/cgroup").read_text().splitlines()
    places = dict(line.split(":")[1:] for line in lines)
    root = Path("/sys/fs/cgroup")
    if "memory" in places:  # of the first version
        (cpu,) = (name for name in places if "cpuacct" in name.split(","))
        usage = root / "cpuacct" / places[cpu][1:] / "cpuacct.usage"
        peak = root / "memory" / places["memory"][1:] / "memory.max_usage_in_bytes"
        return int(peak.read_text()), int(usage.read_text()) / 1e9
    group = root / places[""][1:]
    return int((group / "memory.peak").read_text()), int((group / "cpu.stat").read_text().split()[1]) / 1e6


def inside(image: str, script: str) -> list[str]:
    """Words that a shell script says in an image."""
    return call("docker", "run", "--rm", "--entrypoint", "sh", image, "-c", script).split()


@pytest.mark.usefixtures("compose")
@pytest.mark.parametrize("image", ["wireswarm-agent", "wireswarm-world", "wireswarm-sweep"])
def test_an_image_runs_as_nobody_in_particular_and_holds_no_tools_and_no_secrets(image: str) -> None:
    tools = ["gcc", "cc", "g++", "make", "ld", "strip", "eu-strip", "git", "curl", "*.key", "robots", "roster.json"]
    look = f"find / -xdev {' -o '.join(f'-name {tool!r}' for tool in tools)} 2>/dev/null || true"
    assert set(inside(image, look)) <= set(inside(BASE, look))
    assert inside(image, "id -u") == ["10001"]
    packages = set(inside(image, "ls /opt/venv/lib/*/site-packages /opt/venv/bin"))
    assert {"agent", "protocol"} <= packages and not {"pip", "setuptools", "hatchling", "pytest"} & packages


@pytest.mark.usefixtures("compose")
def test_the_image_of_an_agent_is_lean_and_knows_nothing_of_the_world() -> None:
    packages = set(inside("wireswarm-agent", "ls /opt/venv/lib/*/site-packages"))
    assert not {"world", "deploy", "wireswarm", "pymunk", "matplotlib", "PIL", "rich"} & packages
    sizes = [int(call("docker", "image", "inspect", "--format", "{{.Size}}", one)) for one in ("wireswarm-agent", BASE)]
    assert sizes[0] - sizes[1] <= MAX_AGENT_BYTES
