"""A router between a world and its robots: another process, with the rules of the roster."""

import json
import os
import stat
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import zenoh

from deploy import inprocess
from deploy.certs import issue
from deploy.config import RunConfig
from deploy.router import write_config
from protocol import keys
from protocol.access import VIEWER, WORLD, Credentials
from protocol.certificates import Certificates
from protocol.errors import InputError, LinkError
from protocol.secrets import new_secrets, write_secrets
from protocol.session import open_client, open_router
from tests.agent.shell.test_process import JOIN_S, World, agent, events
from tests.protocol.test_access import Ear, wait_for
from tests.tiny import digests, tiny_config
from tests.wanderer import Wanderer
from world.shell.inbox import WorldInbox
from world.shell.server import serve

pytestmark = pytest.mark.system

ROBOTS = ["r1", "r2", "r3"]


@pytest.fixture(params=["secrets", "certificates"])
def credentials(tmp_path: Path, request: pytest.FixtureRequest) -> Credentials:
    if request.param == "secrets":
        return new_secrets(ROBOTS)
    issue(tmp_path / "certs", ROBOTS, [])
    return Certificates(tmp_path / "certs", [*ROBOTS, VIEWER, WORLD])


def behind(endpoint: str, folder: Path, **settings: object) -> RunConfig:
    return tiny_config(folder, **settings, server={"connect": endpoint})


@pytest.mark.slow
@pytest.mark.parametrize("credentials", ["certificates"], indirect=True)
def test_a_run_over_a_router_writes_the_same_bytes_even_if_the_router_is_gone_for_a_while(
    tmp_path: Path, credentials: Credentials
) -> None:
    inprocess.run(alone := tiny_config(tmp_path, until=120.0), alone.agent, tmp_path / "one", make_mind=Wanderer)
    with ThreadPoolExecutor() as pool:
        with open_router(None, credentials) as (_, endpoint):
            world = World(behind(endpoint, tmp_path, until=120.0), tmp_path / "many", credentials)
            assert world.endpoint.result(JOIN_S) == endpoint
            minds = [pool.submit(agent, world, robot, Wanderer, credentials=credentials) for robot in ROBOTS]
            with open_client(endpoint, JOIN_S, VIEWER, credentials) as viewer:
                heard = Ear(viewer)
                wait_for(lambda: keys.from_robot("r1", keys.ACT) in heard.keys)
            assert not world.ended.done()
        time.sleep(0.5)
        with world, open_router(endpoint, credentials):
            assert [mind.result(60) for mind in minds] == ["time"] * 3
            assert world.ended.result(JOIN_S) == "time"
    summary = json.loads((tmp_path / "many" / "summary.json").read_text())
    assert summary["links_lost"] >= 3
    assert digests(tmp_path / "one") == digests(tmp_path / "many")
    assert not [event for event in events(tmp_path / "many") if event["event"] == "dead"]


def test_behind_a_router_a_rogue_reads_its_own_and_speaks_for_nobody(tmp_path: Path, credentials: Credentials) -> None:
    with open_router(None, credentials) as (_, endpoint), ThreadPoolExecutor() as pool:
        config = behind(endpoint, tmp_path, until=7000.0, robots=2, radio={"range_m": 0.2})
        with World(config, tmp_path / "out", credentials) as world:
            minds = [pool.submit(agent, world, robot, credentials=credentials) for robot in ("r1", "r2")]
            with (
                open_client(endpoint, 5.0, "r3", credentials) as rogue,
                open_client(endpoint, 5.0, VIEWER, credentials) as viewer,
            ):
                theirs, all_of_it = Ear(rogue), Ear(viewer)
                said = {keys.from_robot(robot, keys.RADIO) for robot in ("r1", "r2")}
                wait_for(lambda: {*said, keys.PROGRESS, keys.CLOCK, keys.LINKS} <= all_of_it.keys)
                assert theirs.keys <= {keys.CLOCK, keys.LINKS, keys.WORLD_ALIVE}
                for key in ("robots/r1/in/end", "robots/r1/out/act", keys.PROGRESS, "world/truth/forged", keys.CLOCK):
                    rogue.put(key, b"forged")
                time.sleep(0.5)
                assert "world/truth/forged" not in all_of_it.keys
            hasty = tiny_config(tmp_path, server={"connect": endpoint, "join_timeout_s": 0.3})
            other = World(hasty, tmp_path / "other", credentials)
            with other, pytest.raises(LinkError, match="another session is world"):
                other.ended.result(JOIN_S)
            assert not any(mind.done() for mind in minds)
    assert not [event for event in events(tmp_path / "out") if event["event"] == "dead"]


def test_a_router_serves_one_world(tmp_path: Path) -> None:
    with open_router() as (_, endpoint):
        config = behind(endpoint, tmp_path)
        with World(config, tmp_path / "a") as first:
            assert first.endpoint.result(JOIN_S) == endpoint
            with World(config, tmp_path / "b") as second, pytest.raises(InputError, match=r"a world is at .* already"):
                second.ended.result(JOIN_S)


def test_a_router_serves_one_world_also_while_that_still_loads(tmp_path: Path) -> None:
    """The second one saw no token, and the two gave up every robot."""
    inbox = WorldInbox()
    with open_router() as (_, endpoint):
        config = tiny_config(tmp_path, server={"connect": endpoint, "join_timeout_s": 0.3})

        def loads(_: str) -> None:
            with pytest.raises(InputError, match=r"a world is at .* already"):
                serve(config, config.server, tmp_path / "b")
            inbox.stop()

        assert serve(config, config.server, tmp_path / "a", inbox=inbox, opened=loads) == "interrupted"


def test_the_written_configuration_makes_a_router_of_others(tmp_path: Path) -> None:
    issue(tmp_path / "certs", ROBOTS, [])
    write_secrets(tmp_path / "secrets", secrets := new_secrets(ROBOTS))
    file = tmp_path / "router.json5"
    certificates = Certificates(tmp_path / "certs", ROBOTS)
    given: list[tuple[str, Path | None, Path | None, Credentials]] = [
        ("tls", None, tmp_path / "certs", certificates),
        ("tcp", tmp_path / "secrets", None, secrets),
    ]
    for protocol, by_secrets, by_certs, credentials in given:
        with open_router() as (_, free):
            plain, endpoint = free, free.replace("tcp", protocol)
        write_config(file, endpoint, by_secrets, by_certs, insecure=False)
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        assert not any(secret in file.read_text() for secret in secrets.values())
        assert "PRIVATE" not in file.read_text()
        with zenoh.open(zenoh.Config.from_file(str(file))), open_client(endpoint, JOIN_S, "r1", credentials):
            pass
        with zenoh.open(zenoh.Config.from_file(str(file))), pytest.raises(LinkError), open_client(plain, 0.3):
            pass
    with pytest.raises(InputError, match="whoever reaches this address"):
        write_config(file, "tcp/0.0.0.0:7447", None, None, insecure=False)


def test_the_commands_make_identities_and_a_router_and_print_no_key(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "wireswarm"]
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    made = subprocess.run(
        [*command, "certs", "certs", "--robots", "2"], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=60
    )
    assert (made.returncode, made.stderr) == (0, "") and "made world, viewer, r1, r2 in certs" in made.stdout
    words = made.stdout
    with subprocess.Popen(
        [*command, "router", "--certs", "certs"], cwd=tmp_path, env=env, stdout=subprocess.PIPE, text=True
    ) as router:
        assert router.stdout is not None
        words += (line := router.stdout.readline())
        with open_client(line.split()[-1], JOIN_S, "r2", Certificates(tmp_path / "certs", ["r2"])):
            router.terminate()
        assert router.wait(JOIN_S) == 0
    secret = [line for file in (tmp_path / "certs").glob("*.key") for line in file.read_text().splitlines()[1:-1]]
    assert len(secret) >= 10 and not any(line in words for line in secret)
