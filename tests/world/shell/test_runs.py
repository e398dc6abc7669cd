"""By what robots tell a run from others with the same settings."""

from pathlib import Path

from deploy.config import RunConfig
from protocol import keys
from protocol.codec import decode, encode
from protocol.messages import PROTOCOL_VERSION, Join, Welcome
from protocol.session import open_client
from tests.tiny import tiny_config
from tests.world.shell.test_roll_call import world
from world.episode import Episode


def run_of(config: RunConfig, out: Path, *, resume: bool = False) -> str:
    """What a world tells r1 that its run is."""
    with world(config, out, [], settle_s=None, resume=resume) as (endpoint, _), open_client(endpoint, 10.0) as session:
        question = encode(Join(version=PROTOCOL_VERSION, robot="r1"))
        (reply,) = session.get(keys.service("r1", keys.JOIN), payload=question, timeout=10.0)
        assert reply.ok is not None
        return decode(Welcome, reply.ok.payload.to_bytes()).run


def test_each_world_is_another_run(tmp_path: Path) -> None:
    """A robot that came late took up the mind of the run before, whose settings were the same, and mapped wrongly."""
    config = tiny_config(tmp_path)
    assert run_of(config, tmp_path / "one") != run_of(config, tmp_path / "other")


def test_a_world_that_goes_on_is_the_same_run(tmp_path: Path) -> None:
    config = tiny_config(tmp_path)
    killed = Episode(config, tmp_path / "out", run="0a" * 8)
    del killed  # it holds the directory
    assert run_of(config, tmp_path / "out", resume=True) == "0a" * 8
