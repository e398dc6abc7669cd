"""A rogue with a robot's own secret or certificate: what it reads, says and fakes, by the rules of the router."""

import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from agent.config import AgentConfig
from agent.shell.process import run_agent
from deploy.certs import issue
from protocol import keys, session
from protocol.access import VIEWER, Credentials
from protocol.certificates import Certificates
from protocol.codec import encode
from protocol.credentials import of_robot
from protocol.errors import InputError, LinkError
from protocol.files import UnwritableError
from protocol.messages import Action
from protocol.secrets import Secrets, new_secrets, read_secrets, write_secrets
from protocol.session import open_as_first, open_client, open_router
from tests.agent.shell.test_process import World, events
from tests.tiny import tiny_config
from tests.wanderer import endless

JOIN_S = 20.0
Guarded = tuple[World, Credentials, Path]
FORGED = "world/truth/forged"


@pytest.fixture(params=["secrets", "certificates"])
def guarded(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Guarded]:
    """A world with two robots far apart by radio; the third, r3, is the rogue, which never joins as a robot."""
    robots = ["r1", "r2", "r3"]
    credentials: Credentials = new_secrets(robots)
    if request.param == "certificates":
        issue(tmp_path / "certs", robots, [])
        credentials = Certificates(tmp_path / "certs", [*robots, VIEWER])
    config = tiny_config(tmp_path, robots=2, until=400.0, radio={"range_m": 0.2}, server={"real_time": 20.0})
    out = tmp_path / "run"
    with World(config, out, credentials) as world, ThreadPoolExecutor(2) as pool:
        endpoint = world.endpoint.result(JOIN_S)
        for robot in ("r1", "r2"):
            pool.submit(run_agent, robot, endpoint, AgentConfig(), credentials=credentials, make_mind=endless)
        yield world, credentials, out
        world.inbox.stop()


class Ear:
    """Hears all that a session is allowed to."""

    def __init__(self, session: zenoh.Session) -> None:
        self.keys: set[str] = set()
        self._lock = threading.Lock()
        everything = ("**", "robots/**", "robots/*/in/**", "robots/*/out/**", "robots/r1/in/obs", "robots/r1/in/radio",
                      "robots/r1/out/radio", "world/**", "world/truth/**", "world/pub/**", keys.PROGRESS)  # fmt: skip
        self._declared = [session.declare_subscriber(key, self._hear) for key in everything]
        self._declared += [session.liveliness().declare_subscriber("**", self._hear, history=True)]

    def _hear(self, sample: zenoh.Sample) -> None:
        with self._lock:
            self.keys.add(str(sample.key_expr))


def wait_for(condition: object, seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_rogue_reads_what_is_public_or_its_own_and_nothing_else(guarded: Guarded) -> None:
    world, credentials, _ = guarded
    endpoint = world.endpoint.result(JOIN_S)
    with (
        open_client(endpoint, 5.0, "r3", credentials) as rogue,
        open_client(endpoint, 5.0, VIEWER, credentials) as viewer,
    ):
        theirs, all_of_it = Ear(rogue), Ear(viewer)
        said = {keys.from_robot(robot, keys.RADIO) for robot in ("r1", "r2")}
        seen = said | {"robots/r1/out/act", "robots/r2/out/pose", keys.CLOCK, keys.LINKS}
        seen |= {keys.PROGRESS, keys.SITE, keys.WHEREABOUTS}
        wait_for(lambda: seen <= all_of_it.keys)  # what there is to be heard
        wait_for(lambda: {keys.CLOCK, keys.LINKS} <= theirs.keys)
        time.sleep(0.5)
        public = {keys.CLOCK, keys.LINKS, keys.WORLD_ALIVE}
        own = {keys.to_robot("r3", channel) for channel in keys.INPUTS}
        assert theirs.keys <= public | own
        assert keys.to_robot("r3", keys.RADIO) not in theirs.keys  # all that was said came from out of range
        assert not any(key.startswith(("robots/r1/in", "robots/r2/in")) for key in all_of_it.keys)


def test_robots_without_a_name_take_those_that_nobody_has_yet(guarded: Guarded) -> None:
    world, credentials, _ = guarded
    endpoint = world.endpoint.result(JOIN_S)
    with open_client(endpoint, 5.0, VIEWER, credentials) as viewer:
        heard = Ear(viewer)
        wait_for(lambda: {keys.from_robot(robot, keys.ACT) for robot in ("r1", "r2")} <= heard.keys)
    with open_as_first(endpoint, 5.0, credentials) as (name, _):
        assert name == "r3"
        with pytest.raises(LinkError, match="each of its 3 robots is there"), open_as_first(endpoint, 0.3, credentials):
            pass


def test_a_second_session_of_a_robot_is_refused_and_told(guarded: Guarded) -> None:
    world, credentials, out = guarded
    endpoint = world.endpoint.result(JOIN_S)
    with open_client(endpoint, 5.0, VIEWER, credentials) as viewer:
        heard = Ear(viewer)
        wait_for(lambda: keys.from_robot("r1", keys.ACT) in heard.keys)  # r1 is there
    with pytest.raises(LinkError, match="another session is r1 at"), open_client(endpoint, 0.6, "r1", credentials):
        pass
    world.inbox.stop()
    assert world.ended.result(10) == "interrupted"
    assert not [event for event in events(out) if event["event"] == "dead"]


def test_a_robot_in_a_session_of_another_id_reads_and_says_nothing(
    guarded: Guarded, monkeypatch: pytest.MonkeyPatch
) -> None:
    world, credentials, out = guarded
    endpoint = world.endpoint.result(JOIN_S)
    act = keys.from_robot("r1", keys.ACT)
    with open_client(endpoint, 5.0, VIEWER, credentials) as viewer:
        all_of_it = Ear(viewer)
        wait_for(lambda: {act, keys.CLOCK} <= all_of_it.keys)  # the robots are there, with their own IDs
    own = credentials.connecting("r1")
    monkeypatch.setattr(credentials, "connecting", lambda name: {**own, "id": "f00d"})
    with open_client(endpoint, 5.0, "r1", credentials) as rogue:
        theirs = Ear(rogue)
        for _ in range(20):
            rogue.put(act, encode(Action(tick=0, speed_mps=0.0, turn_rps=0.0, sent=77)))
            time.sleep(0.02)
        assert theirs.keys <= {act}  # its own words
    world.inbox.stop()
    assert world.ended.result(10) == "interrupted"
    assert not [event for event in events(out) if event["event"] == "dead"]


@pytest.mark.parametrize("said", [b"", b"\x05\x00\x01\x09\x00"])
def test_a_robot_gets_in_beside_a_thousand_connections_that_do_not_say_who_they_are(said: bytes) -> None:
    secrets = new_secrets(["r1"])
    with open_router(None, secrets) as (_, endpoint), ExitStack() as idle:
        address = "127.0.0.1", int(endpoint.rpartition(":")[2])
        for _ in range(1000):
            idle.enter_context(socket.create_connection(address)).sendall(said)
        began = time.monotonic()
        with open_client(endpoint, JOIN_S, "r1", secrets):
            assert time.monotonic() - began < 5.0  # where 100 fill the door, it takes 10 s


def test_a_connection_that_trickles_bytes_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "INTRODUCTION_MS", 300)
    with (
        open_router(None, new_secrets(["r1"])) as (_, endpoint),
        socket.create_connection(("127.0.0.1", int(endpoint.rpartition(":")[2]))) as slow,
    ):
        slow.settimeout(0.05)
        end = time.monotonic() + JOIN_S
        while time.monotonic() < end:
            try:
                slow.sendall(b"\x01")  # the first two announce a message of 257 bytes
                if not slow.recv(100):
                    return
            except TimeoutError:
                continue
            except OSError:
                return
        raise AssertionError("it is still open")


def test_a_rogue_cannot_speak_for_another_or_for_the_world(guarded: Guarded) -> None:
    world, credentials, out = guarded
    endpoint = world.endpoint.result(JOIN_S)
    with (
        open_client(endpoint, 5.0, "r3", credentials) as rogue,
        open_client(endpoint, 5.0, VIEWER, credentials) as viewer,
    ):
        heard = Ear(viewer)
        wait_for(lambda: keys.from_robot("r1", keys.ACT) in heard.keys)
        forged = encode(Action(tick=0, speed_mps=0.0, turn_rps=0.0, sent=77))
        answered = rogue.declare_queryable("robots/*/srv/**", lambda query: query.reply(query.key_expr, b"forged"))
        token = rogue.liveliness().declare_token("robots/r9/alive")
        for _ in range(20):
            for key in (
                "robots/r1/out/act",
                "robots/r2/in/end",
                "robots/r1/in/radio",
                keys.CLOCK,
                "world/truth/forged",
            ):
                rogue.put(key, forged)
            time.sleep(0.01)
        replies = [reply.ok for reply in viewer.get("robots/r1/srv/join", payload=b"", timeout=0.5)]
        time.sleep(0.5)
        assert "robots/r9/alive" not in heard.keys and FORGED not in heard.keys
        assert not any(reply is not None for reply in replies)
        del answered, token
    assert not [event for event in events(out) if event["event"] == "dead"]  # r1's answers still make sense
    world.inbox.stop()
    assert world.ended.result(10) == "interrupted"
    assert not [event for event in events(out) if event["event"] == "dead"]


@pytest.mark.parametrize("guarded", ["secrets"], indirect=True)
@pytest.mark.parametrize(("name", "secret"), [("r1", "wrong"), ("nobody", "r1"), ("r2", "r1"), ("r1", None)])
def test_without_the_right_secret_nobody_gets_in(guarded: Guarded, name: str, secret: str | None) -> None:
    world, secrets, _ = guarded
    assert isinstance(secrets, Secrets)
    mine = Secrets({name: secrets.get(secret, secret)} if secret else {})
    with (
        pytest.raises(LinkError, match="the secret is the world's"),
        open_client(world.endpoint.result(JOIN_S), 0.6, name, mine),
    ):
        pass


def test_secrets_are_their_owners_alone(tmp_path: Path) -> None:
    file = tmp_path / "secrets"
    secrets = new_secrets(["r1", "r2"])
    assert len(set(secrets.values())) == 4 and min(map(len, secrets.values())) >= 32
    write_secrets(file, secrets)
    assert file.stat().st_mode & 0o777 == 0o600
    assert read_secrets(file, ["r2"]) == {"r2": secrets["r2"]}
    for names, words in ((["r3"], "no line r3"), (["r1"], "no such file")):
        with pytest.raises(InputError, match=words):
            read_secrets(file if words.endswith("r3") else tmp_path / "none", names)
    with pytest.raises(UnwritableError, match=r"cannot write .*: No such file"):
        write_secrets(tmp_path / "none/secrets", secrets)
    assert new_secrets(["r1"])["r1"] != secrets["r1"]


def test_a_file_of_secrets_without_a_robots_is_refused_at_once(tmp_path: Path) -> None:
    """The agent looked for a world with none of its names, and ended in a traceback."""
    write_secrets(file := tmp_path / "secrets", new_secrets([]))
    with pytest.raises(InputError, match="it has no line of a robot, such as r1:SECRET"):
        of_robot(None, file, None)


def test_a_router_that_is_killed_as_it_opens_leaves_no_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its file of all secrets stayed in the temporary folder for good."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    secrets = new_secrets(["r1"])
    with secrets.listening() as settings:
        file = Path(str(settings["transport/auth/usrpwd/dictionary_file"]))
        assert read_secrets(file, list(secrets)) == secrets
        assert not list(tmp_path.iterdir())
    assert not file.exists()


def test_no_secret_is_written_by_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from deploy.launch import launcher
    from tests.wanderer import Wanderer

    known = new_secrets(["r1", "r2", "r3"])
    monkeypatch.setattr(launcher, "new_secrets", lambda robots: known)
    result = launcher.launch(tiny_config(tmp_path, until=5.0), tmp_path / "run", make_mind=Wanderer)
    assert (result.ended, result.errors) == ("time", [])
    files = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert files and not any(secret.encode() in data for data in files for secret in known.values())
