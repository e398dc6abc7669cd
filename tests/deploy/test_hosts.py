"""World and robots on hosts of their own, each a network namespace with its own address; skipped without root."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from deploy import inprocess
from deploy.certs import issue, revoke
from deploy.launch.launcher import launch
from tests.agent.shell.test_process import events
from tests.deploy.sweep.sweeps import RUNS, comparable, results, undisturbed, write_sweep
from tests.tiny import digests, tiny_config
from world.checkpoint import CHECKPOINT_FILE

pytestmark = pytest.mark.system

REPO = Path(__file__).parents[2]
ROBOTS = ["r1", "r2"]
WAIT_S = 60.0


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, timeout=WAIT_S)


class Hosts:
    """A world's host with a cable to each robot's."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.prefix = folder, f"ws{os.getpid()}"
        self.world = {robot: f"10.77.{number}.1" for number, robot in enumerate(ROBOTS)}
        """The world's address at the end of each robot's cable."""

    def namespace(self, name: str) -> str:
        return f"{self.prefix}-{name}"

    def lay(self) -> None:
        for name in ("world", *ROBOTS):
            ip("netns", "add", self.namespace(name))
            ip("-n", self.namespace(name), "link", "set", "lo", "up")
        for robot, address in self.world.items():
            world, far = self.namespace("world"), self.namespace(robot)
            ip("-n", world, "link", "add", robot, "type", "veth", "peer", "name", "world", "netns", far)
            for host, end, own in ((world, robot, address), (far, "world", address[:-1] + "2")):
                ip("-n", host, "address", "add", f"{own}/24", "dev", end)
                ip("-n", host, "link", "set", end, "up")

    def remove(self) -> None:
        for name in ("world", *ROBOTS):
            subprocess.run(["ip", "netns", "del", self.namespace(name)], capture_output=True, check=False)

    def plug(self, robot: str, state: str) -> None:
        ip("-n", self.namespace("world"), "link", "set", robot, state)

    def start(self, host: str, *words: str, module: str = "wireswarm") -> subprocess.Popen[str]:
        """A command of wireswarm, or of another module, on one of the hosts."""
        inside = ["ip", "netns", "exec", self.namespace(host), sys.executable, "-m", module]
        return subprocess.Popen(
            [*inside, *words], cwd=self.folder, env={**os.environ, "PYTHONPATH": str(REPO)}, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def agent(self, robot: str, certs: str, *words: str) -> subprocess.Popen[str]:
        endpoint = f"tls/{self.world[robot]}:7447"
        return self.start(robot, "agent", "--id", robot, "--connect", endpoint, "--certs", certs, *words)


@pytest.fixture
def hosts(tmp_path: Path) -> Iterator[Hosts]:
    if os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces need root and ip (iproute2)")
    hosts = Hosts(tmp_path)
    try:
        hosts.lay()
    except subprocess.CalledProcessError as error:
        hosts.remove()
        pytest.skip(f"no network namespaces here: {error.stderr.decode().strip()}")
    tiny_config(tmp_path)
    issue(tmp_path / "certs", ROBOTS, list(hosts.world.values()))
    yield hosts
    hosts.remove()


def last_words(process: subprocess.Popen[str], wait_s: float = WAIT_S) -> tuple[int, str]:
    out, errors = process.communicate(timeout=wait_s)
    return process.returncode, out + errors


def begin(hosts: Hosts, until: float) -> tuple[subprocess.Popen[str], Path]:
    """A world that listens, and its run directory."""
    settings = ["--world", "tiny.yaml", "--robots", "2", "--until", str(until), "--seed", "7", "--out", "hosts"]
    world = hosts.start("world", "world", *settings, "--listen", "tls/0.0.0.0:7447", "--certs", "certs")
    assert world.stdout is not None and world.stdout.readline() == "listening on tls/0.0.0.0:7447\n"
    return world, hosts.folder / "hosts"


def assert_same_bytes(one: Path, run: Path) -> None:
    alone, apart = digests(one), digests(run)
    books = "bandwidth.json"
    assert {file: apart.get(file) for file in alone if file != books} == {f: d for f, d in alone.items() if f != books}
    ours, theirs = (json.loads((folder / books).read_text()) for folder in (one, run))
    assert {key: theirs.get(key) for key in ours if key != "wire"} == {k: v for k, v in ours.items() if k != "wire"}


def test_across_hosts_a_run_has_the_same_bytes_and_strangers_are_refused(hosts: Hosts) -> None:
    issue(hosts.folder / "foreign", ROBOTS, [])
    certs = hosts.folder / "certs"
    shutil.copytree(certs, hosts.folder / "stolen")
    revoke(certs, "r2")
    issue(certs, ["r2"], [])
    with ExitStack() as stack:
        world, run = begin(hosts, until=4.0)
        stack.callback(world.kill)
        patience = ["--set", "join_timeout_s=2"]
        strangers = [hosts.agent("r2", folder, *patience) for folder in ("foreign", "stolen")]
        (foreign_status, foreign_words), (stolen_status, stolen_words) = map(last_words, strangers)
        assert (foreign_status, stolen_status) == (1, 2)
        assert "no world answers at tls/10.77.1.1:7447" in foreign_words and "of another authority" in foreign_words
        assert "the world does not let r2 in: its certificate does not count" in stolen_words
        said = [*map(last_words, [hosts.agent(robot, "certs") for robot in ROBOTS]), last_words(world)]
    assert [status for status, _ in said] == [0, 0, 0], said
    config = tiny_config(hosts.folder, robots=2, until=4.0, seed=7)
    inprocess.run(config, config.agent, hosts.folder / "one")  # as `wireswarm run`, which other tests show
    assert_same_bytes(hosts.folder / "one", run)
    files = [path.read_text(errors="replace") for path in run.rglob("*") if path.is_file()]
    key = (certs / "r1.key").read_text().splitlines()[1]
    assert not any(key in text for text in [*files, *(words for _, words in said)])


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_cable_that_is_cut_for_ten_seconds_costs_time_and_no_byte(hosts: Hosts) -> None:
    with ExitStack() as stack:
        world, run = begin(hosts, until=120.0)
        agents = [hosts.agent(robot, "certs") for robot in ROBOTS]
        for process in (world, *agents):
            stack.callback(process.kill)
        end, sizes = time.monotonic() + WAIT_S, set[int]()
        while len(sizes) < 10:  # the log of its checkpoint grows with each tick
            assert time.monotonic() < end and world.poll() is None
            sizes |= {file.stat().st_size for file in run.glob(CHECKPOINT_FILE)}
        hosts.plug("r2", "down")
        time.sleep(10.0)
        assert world.poll() is None and all(agent.poll() is None for agent in agents)
        hosts.plug("r2", "up")
        said = [last_words(process) for process in (*agents, world)]
    assert [status for status, _ in said] == [0, 0, 0], said
    assert json.loads((run / "summary.json").read_text())["links_lost"] >= 1
    assert not [event for event in events(run) if event["event"] == "dead"]
    result = launch(tiny_config(hosts.folder, robots=2, until=120.0, seed=7), hosts.folder / "one")
    assert (result.status, result.errors) == (0, [])
    assert_same_bytes(hosts.folder / "one", run)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_sweep_on_three_hosts_has_the_results_of_one_process(hosts: Hosts) -> None:
    write_sweep(hosts.folder)
    certs = (
        "--dashboard-address=127.0.0.1:0",
        "--tls-ca-file=certs/ca.pem",
        "--tls-cert=certs/world.pem",
        "--tls-key=certs/world.key",
    )
    scheduler = ["--protocol", "tls", "--host", "0.0.0.0", "--port", "8786", *certs]
    worker = ["--nthreads", "1", "--local-directory", str(hosts.folder), *certs]
    far = [hosts.start("world", *scheduler, module="distributed.cli.dask_scheduler")]
    try:
        for robot, address in hosts.world.items():
            far.append(hosts.start(robot, f"tls://{address}:8786", *worker, module="distributed.cli.dask_worker"))
        near = ["--scheduler", f"tls://{hosts.world['r1']}:8786", "--certs", "certs", "--quiet"]
        far.append(client := hosts.start("world", "sweep", "sweep.yaml", "--out", "out", *near))
        done = last_words(client, 4 * WAIT_S)
        assert done[0] == 0, done
    finally:
        for process in far:
            process.kill()
            process.communicate()
    assert comparable(hosts.folder / "out") == undisturbed(hosts.folder) and len(results(hosts.folder / "out")) == RUNS
