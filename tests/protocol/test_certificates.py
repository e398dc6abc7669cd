"""Identities over TLS: who is let in, who is not, and in what words."""

import json
import resource
import shutil
import socket
import ssl
import stat
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import zenoh

from agent.config import AgentConfig
from agent.shell.process import run_agent
from deploy.certs import issue, revoke
from protocol import keys, session
from protocol.access import VIEWER
from protocol.certificates import ROSTER, Certificates, fingerprint, read_roster
from protocol.credentials import of_all, of_robot
from protocol.errors import InputError, LinkError, RefusedError
from protocol.files import write_whole
from protocol.session import MAX_FILES, open_client, open_router
from tests.agent.shell.test_process import JOIN_S, World, events
from tests.protocol.test_access import Ear, wait_for
from tests.tiny import tiny_config
from tests.wanderer import endless

TRIES_S = 0.3
NO_MORE = "does not let r2 in: its certificate does not count: it was revoked, or made after the world began"


@pytest.fixture
def certs(tmp_path: Path) -> Path:
    issue(tmp_path / "certs", ["r1", "r2"], [])
    return tmp_path / "certs"


def refusal(endpoint: str, folder: Path, name: str = "r1") -> str:
    with pytest.raises(LinkError) as raised, open_client(endpoint, TRIES_S, name, Certificates(folder, [name])):
        pass
    return str(raised.value)


def test_identities_are_their_owners_alone_and_none_is_overwritten(certs: Path) -> None:
    files = {file.name: file.read_bytes() for file in certs.iterdir()}
    assert {stat.S_IMODE((certs / name).stat().st_mode) for name in files} == {0o600}
    roster = read_roster(certs)
    assert list(roster) == ["world", VIEWER, "r1", "r2"]
    assert roster["r1"].sha256 == fingerprint((certs / "r1.pem").read_text())
    with pytest.raises(InputError, match="has an identity of r2 already"):
        issue(certs, ["r3", "r2"], [])
    with pytest.raises(InputError, match="has the world's certificate already"):
        issue(certs, [], ["10.0.0.1"])
    with pytest.raises(InputError, match=r"has identities of world, viewer, r1, r2: name further robots by --robots"):
        issue(certs, [], [])
    for robot in ("ca", "world", "R1", "../r1", ""):
        with pytest.raises(InputError, match="no name for a robot"):
            issue(certs, [robot], [])
    assert files == {file.name: file.read_bytes() for file in certs.iterdir()}
    assert issue(certs, ["r3"], []) == ["r3"] and list(read_roster(certs))[-1] == "r3"


def test_no_key_comes_into_a_repository_nor_is_a_project_ignored(certs: Path, tmp_path: Path) -> None:
    assert (certs / ".gitignore").read_text() == "*\n"
    (tmp_path / "project").mkdir()
    (tmp_path / "project" / "README").touch()
    issue(tmp_path / "project", ["r1"], [])
    assert not (tmp_path / "project" / ".gitignore").exists()


def test_no_keys_are_written_to_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "certs").symlink_to("theirs")
    with pytest.raises(InputError, match=r"certs is a link to theirs: name the folder itself"):
        issue(tmp_path / "certs", ["r1"], [])
    assert not list((tmp_path / "theirs").iterdir())


def test_a_name_that_was_revoked_may_be_given_anew(certs: Path) -> None:
    before = read_roster(certs)
    revoke(certs, "r2")
    assert "r2" not in read_roster(certs) and not list(certs.glob("r2.*"))
    with (
        pytest.raises(InputError, match=r"r2 is not on its roster: .* --robots r2"),
        of_all(["r1", "r2"], None, certs, world=False),
    ):
        pass
    with pytest.raises(InputError, match="--revoke r2"):
        revoke(certs, "r2")
    issue(certs, ["r2"], [])
    after = read_roster(certs)["r2"]
    assert after.common_name != before["r2"].common_name and after.sha256 != before["r2"].sha256


@pytest.mark.parametrize("written", range(10))  # .gitignore, ca.key, ca.pem, world.key, ..., r1.pem, and not the roster
def test_what_was_broken_off_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: int) -> None:
    """`issue` asked for `revoke`, and that for `issue`."""
    folder, left = tmp_path / "certs", iter(range(written))

    def break_off(*arguments: Any, **how: bool) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt
        write_whole(*arguments, **how)

    with monkeypatch.context() as broken, pytest.raises(KeyboardInterrupt):
        broken.setattr("deploy.certs.write_whole", break_off)
        issue(folder, ["r1"], [])
    assert issue(folder, ["r1"], []) == ["world", VIEWER, "r1"]
    for name, identity in read_roster(folder).items():
        assert identity.sha256 == fingerprint((folder / f"{name}.pem").read_text())
        Certificates(folder, [name]).connecting(name)


def test_the_worlds_certificate_is_for_its_addresses(certs: Path) -> None:
    revoke(certs, "world")
    issue(certs, [], ["127.0.0.7", "robots.example"])
    with socket.create_server(("127.0.0.7", 0)) as probe:
        mine = f"tls/127.0.0.7:{probe.getsockname()[1]}"
    known = Certificates(certs, ["r1"])
    with open_router(mine, known) as (_, endpoint), open_client(endpoint, JOIN_S, "r1", known):
        pass
    with open_router(mine.replace("0.7", "0.8"), known) as (_, endpoint):
        assert "not valid for '127.0.0.8'" in refusal(endpoint, certs)
    with pytest.raises(InputError, match="neither an address"):
        issue(certs / "new", [], ["a b"])
    assert not (certs / "new").exists()


def test_a_certificate_of_another_authority_is_refused_on_either_side(
    certs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    foreign = tmp_path / "foreign"
    issue(foreign, ["r1"], [])
    with open_router(None, Certificates(certs, ["r1"])) as (_, endpoint):
        assert "it is of another authority" in refusal(endpoint, foreign)
        shutil.copy(certs / "ca.pem", foreign / "ca.pem")  # the rogue trusts the world, not the other way round
        assert "the certificate of r1 does not count there (tlsv1 alert unknown ca)" in refusal(endpoint, foreign)
    monkeypatch.setattr(session, "INTRODUCTION_MS", 300)  # so long a plain router waits for a word that it knows
    with open_router() as (_, endpoint):
        assert "no TLS is spoken there" in refusal(endpoint.replace("tcp", "tls"), certs)
        with pytest.raises(InputError, match=r"write it as tls/"):
            refusal(endpoint, certs)


def test_a_robot_cannot_pass_for_the_world(certs: Path, tmp_path: Path) -> None:
    rogue = tmp_path / "rogue"
    shutil.copytree(certs, rogue)
    for kind in ("pem", "key"):
        shutil.copy(certs / f"r2.{kind}", rogue / f"world.{kind}")
    with open_router(None, Certificates(rogue, ["r1"])) as (_, endpoint):
        assert "does not count: unsuitable certificate purpose" in refusal(endpoint, certs)


def test_a_revoked_certificate_is_told_so_and_its_successor_joins(certs: Path, tmp_path: Path) -> None:
    stolen = tmp_path / "stolen"
    shutil.copytree(certs, stolen)
    config = tiny_config(tmp_path, robots=2, until=2.0)
    with of_all(["r1", "r2"], None, certs, world=False) as known, ThreadPoolExecutor() as pool:
        revoke(certs, "r2")
        with World(config, tmp_path / "a", known) as world:
            with pytest.raises(RefusedError, match=NO_MORE):
                join(world, "r2", stolen)
            issue(certs, ["r2"], [])
            with pytest.raises(RefusedError, match=NO_MORE):
                join(world, "r2", certs)  # whose session the router's rules do not know
        with World(config, tmp_path / "b", known) as world:
            with pytest.raises(RefusedError, match=NO_MORE):
                join(world, "r2", stolen)
            with pytest.raises(RefusedError, match="no r3 takes part"):
                issue(certs, ["r3"], [])
                join(world, "r3", certs)
            both = [pool.submit(join, world, robot, certs) for robot in ("r1", "r2")]
            assert [one.result(JOIN_S) for one in both] == ["time", "time"]


def test_who_has_a_certificate_and_no_rights_may_ask_why_and_nothing_else(certs: Path, tmp_path: Path) -> None:
    """The thief of a revoked certificate, the viewer and another robot sent r1 away in its name."""
    stolen, asked = tmp_path / "stolen", list[str]()
    shutil.copytree(certs, stolen)
    revoke(certs, "r2")
    issue(certs, ["r3"], [])

    def reply(query: zenoh.Query) -> None:
        asked.append(str(query.key_expr))
        with query:
            query.reply_err(b"")

    questions = [f"robots/{robot}/srv/{name}" for robot in ("r1", "*") for name in ("join", "leave", "*", "**", "why")]
    with open_router(None, Certificates(certs, ["r1", "r3", VIEWER])) as (world, endpoint):
        world.declare_queryable(keys.ALL_SRV, reply)
        for name, folder in (("r2", stolen), (VIEWER, certs), ("r3", certs)):
            with open_client(endpoint, JOIN_S, name, Certificates(folder, [name])) as session:
                answered = [key for key in questions if list(session.get(key, timeout=JOIN_S))]
            assert answered == ["robots/r1/srv/why", "robots/*/srv/why"]
    assert asked == answered * 3


def test_robots_that_have_joined_go_on_while_strangers_keep_breaking_their_handshakes(certs: Path) -> None:
    known = Certificates(certs, ["r1", VIEWER])
    with open_router(None, known) as (_, endpoint):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        assert soft == min(hard, MAX_FILES)  # connections that have not shaken hands are counted by nobody
        with (
            open_client(endpoint, JOIN_S, "r1", known) as robot,
            open_client(endpoint, JOIN_S, VIEWER, known) as viewer,
        ):
            heard = Ear(viewer)
            address = "127.0.0.1", int(endpoint.rpartition(":")[2])
            for _ in range(100):  # Zenoh pauses for 0.1 s after each: nobody else gets in for 10 s
                socket.create_connection(address).close()
            began = time.monotonic()
            key = keys.from_robot("r1", keys.SCAN)
            while key not in heard.keys:
                robot.put(key, b"")
                assert time.monotonic() - began < 5.0
                time.sleep(0.02)


def test_a_robot_whose_certificate_is_revoked_is_given_up_and_the_others_go_on(certs: Path, tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2, until=7000.0)
    with of_all(["r1", "r2"], None, certs, world=False) as known, ThreadPoolExecutor() as pool:
        with World(config, tmp_path / "out", known) as world:
            r1, r2 = (pool.submit(join, world, robot, certs) for robot in ("r1", "r2"))
            with open_client(world.endpoint.result(JOIN_S), JOIN_S, VIEWER, Certificates(certs, [VIEWER])) as viewer:
                heard = Ear(viewer)
                wait_for(lambda: keys.from_robot("r2", keys.ACT) in heard.keys)
            revoke(certs, "r2")
            assert r2.result(JOIN_S) == "given up by the world: its certificate was revoked"
            assert not r1.done()
        assert r1.result(JOIN_S) == "interrupted"
    assert [event["robot"] for event in events(tmp_path / "out") if event["event"] == "dead"] == ["r2"]


def join(world: World, robot: str, folder: Path) -> str:
    own = of_robot(robot, None, folder)
    return run_agent(robot, world.endpoint.result(JOIN_S), AgentConfig(), credentials=own, make_mind=endless)


@pytest.mark.parametrize(
    ("file", "content", "words"),
    [
        ("r1.pem", "no certificate", "r1.key is not the key of a certificate r1.pem"),
        ("r1.key", "no key", "r1.key is not the key of a certificate r1.pem"),
        ("ca.pem", "no certificate", "ca.pem is no certificate"),
        ("r1.key", None, "r1.key: there is no such file"),
        (ROSTER, "[1]", "roster.json: "),
        (ROSTER, "{r1: {common_name: 'x y', sha256: ''}}", "roster.json: r1"),
        (ROSTER, "{a: *b}", "roster.json: the alias"),
        (ROSTER, json.dumps({"../r1": {"common_name": "r1", "sha256": "0" * 64}}), "no entry of `wireswarm certs`"),
    ],
)
def test_what_is_wrong_with_a_folder_is_one_sentence(certs: Path, file: str, content: str | None, words: str) -> None:
    (certs / file).unlink()
    if content is not None:
        (certs / file).write_text(content)
    with pytest.raises(InputError, match=words.replace(".", r"\.")):
        if file == ROSTER:
            read_roster(certs)
        else:
            Certificates(certs, ["r1"]).connecting("r1")


def test_a_certificate_may_have_text_around_it_but_needs_its_own_header(certs: Path) -> None:
    """A blank line before it was a traceback, and openssl writes more than that."""
    file, own = certs / "r1.pem", Certificates(certs, ["r1"])
    text, before = file.read_text(), own.connecting("r1")
    file.write_text(f"\nBag Attributes\n{text}\n{(certs / 'ca.pem').read_text()}")
    assert own.connecting("r1") == before
    file.write_text(text.replace("CERTIFICATE", "X509 CERTIFICATE"))
    with pytest.raises(InputError, match=r"r1\.pem does not hold a certificate"):
        own.connecting("r1")


def test_certificates_are_such_that_others_take_them(certs: Path) -> None:
    context = ssl.create_default_context(cafile=certs / "ca.pem")
    context.verify_flags |= ssl.VERIFY_X509_STRICT
    context.load_cert_chain(certs / "world.pem", certs / "world.key")
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(certs / "world.pem", certs / "world.key")
    ours, theirs = ssl.MemoryBIO(), ssl.MemoryBIO()
    client_side = context.wrap_bio(ours, theirs, server_hostname="localhost")
    server_side = server.wrap_bio(theirs, ours, server_side=True)
    for side in (client_side, server_side, client_side, server_side):
        try:
            side.do_handshake()
        except ssl.SSLWantReadError:
            continue
    assert client_side.version() == "TLSv1.3"
