"""Attacks on a run that goes on, by a robot with credentials of its own: harmless to others, or the end of its part."""

import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh

from agent.config import AgentConfig
from agent.shell.process import run_agent
from deploy import inprocess
from deploy.certs import issue
from deploy.config import RunConfig
from protocol import keys
from protocol.access import Credentials
from protocol.certificates import Certificates
from protocol.codec import encode
from protocol.messages import PROTOCOL_VERSION, Action, End, Heard, Join, Observation, Send
from protocol.secrets import new_secrets
from tests.agent.shell.test_process import JOIN_S, World, events
from tests.protocol.intruder import Attack, Intruder
from tests.tiny import digests, tiny_config
from tests.wanderer import endless
from world.shell.answers import MAX_SENT_BYTES
from world.shell.questions import MOST_QUESTIONS

ATTACK_TICK = 7
OTHERS = ("robots/r1/out/act", "robots/r2/out/radio", "robots/r1/in/obs", "robots/r2/in/radio", "robots/r1/in/end",
          "robots/*/out/act", "robots/r$*/out/act", "robots/**", "**", "world/pub/clock", "world/truth/progress",
          "robots/r3/out/*", "robots/r3/out/**/none", "robots/r3/in/obs")  # fmt: skip


def forged(intruder: Intruder, tick: int) -> None:
    """What others, the world and recorded messages said, on their keys, with whatever else Zenoh carries."""
    session = intruder.session
    said = (Action(tick=tick, speed_mps=1.0, turn_rps=1.0, sent=9), End(reason="time"),
            Heard(tick=tick, sender="r1", kind="map", payload=b"x"),
            Observation(tick=tick, ranges=b"\0\0\x80\x3f" * 360, odometry=(0.0, 0.0, 0.0)))  # fmt: skip
    for key in OTHERS:
        for message in said:
            session.put(
                key,
                encode(message),
                encoding=zenoh.Encoding("robots/r1/" * 20),
                attachment=b"robots/r1" + bytes(100_000),
                timestamp=session.new_timestamp(),
                allowed_destination=zenoh.Locality.REMOTE,  # else it forges its own inputs
            )
        session.delete(key, allowed_destination=zenoh.Locality.REMOTE)


def tokens(intruder: Intruder, tick: int) -> None:
    """Tokens of others, and its own taken away and given back."""
    forged = [intruder.session.liveliness().declare_token(key) for key in (*OTHERS, "robots/r1/alive", "robots/*/alive",
                                                                         keys.WORLD_ALIVE)]  # fmt: skip
    for token in forged:
        token.undeclare()
    for _ in range(200):
        intruder.token.undeclare()
        intruder.take_token()


def questions(intruder: Intruder, tick: int) -> None:
    """To the world in others' names, for what it does not offer, and to be let in again and again."""
    for robot, key in (("r1", "robots/r1/srv/join"), ("r1", "robots/r1/srv/leave"), ("r1", "robots/*/srv/leave"),
                       ("r1", "robots/r1/srv/why"), ("r1", "robots/r1/srv/**"), ("r1", "robots/r3/srv/join"),
                       ("r1", "robots/r3/srv/leave"), ("r3", "robots/r3/srv/**"), ("r3", "robots/r3/srv/stop"),
                       ("r3", "**"), ("r3", "world/pub/alive")):  # fmt: skip
        join = encode(Join(version=PROTOCOL_VERSION, robot=robot, session=str(intruder.session.info.zid())))
        with suppress(zenoh.ZError):
            assert not any(reply.ok for reply in intruder.session.get(key, payload=join, timeout=0.2))
    asked = [intruder.session.get(keys.service("r3", keys.JOIN), payload=intruder.question) for _ in range(200)]
    assert sum(reply.ok is not None for replies in asked for reply in replies) <= 2 * MOST_QUESTIONS
    asked = [intruder.session.get(keys.service(f"x{number}", keys.WHY)) for number in range(200)]
    assert sum(reply.err is not None for replies in asked for reply in replies) <= 2 * MOST_QUESTIONS


def sessions(intruder: Intruder, tick: int) -> None:
    """Its session closed and opened again."""
    for _ in range(10):
        intruder.reconnect()


def declarations(intruder: Intruder, tick: int) -> None:
    """Subscribers, key expressions and answers with much in them, which nobody asked it for."""
    session = intruder.session
    declared: list[object] = []
    for number in range(200):
        declared.append(session.declare_subscriber(f"robots/r3/in/{number}", lambda sample: None))
        session.declare_keyexpr(f"{'long' * 50}/{number}")
    for key in ("robots/r1/srv/**", "robots/*/srv/join", "world/**"):
        huge = session.declare_queryable(key, lambda query: query.reply(query.key_expr, bytes(1_000_000)))
        declared.append(huge)


def late(intruder: Intruder, tick: int) -> bool:
    """The answer to an earlier tick."""
    return act(intruder, tick - 1)


def early(intruder: Intruder, tick: int) -> bool:
    """The answer to a later tick."""
    return act(intruder, tick + 1)


def double(intruder: Intruder, tick: int) -> None:
    """A first answer, before the honest one: it is of no account, or comes to a tick that is over."""
    act(intruder, tick)


def much(intruder: Intruder, tick: int) -> None:
    """More for the radio than a tick takes."""
    send = encode(Send(tick=tick, to="*", kind="x", payload=bytes(MAX_SENT_BYTES // 2)))
    for _ in range(3):
        intruder.publishers[keys.RADIO].put(send)


def for_nobody(intruder: Intruder, tick: int) -> bool:
    """A message to a robot that there is not, in front of an action that knows of it."""
    intruder.publishers[keys.RADIO].put(encode(Send(tick=tick, to="r99", kind="x", payload=b"")))
    return act(intruder, tick, sent=1)


def merges(intruder: Intruder, tick: int) -> bool:
    """A map of a robot that there is not, as part of its own."""
    return act(intruder, tick, merged={"r99": 1})


def deletes(intruder: Intruder, tick: int) -> bool:
    """A key is deleted that is none of a store."""
    intruder.publishers[keys.ACT].delete()
    return True


def leaves(intruder: Intruder, tick: int) -> None:
    """Leave is taken, and back again, many times."""
    for _ in range(200):
        intruder.ask(keys.LEAVE)
        assert not any(reply.ok for reply in intruder.ask(keys.JOIN))


def act(intruder: Intruder, tick: int, **more: Any) -> bool:
    intruder.publishers[keys.ACT].put(encode(Action(tick=tick, speed_mps=0.0, turn_rps=0.0, **more)))
    return True


def run(
    config: RunConfig, out: Path, attacks: Mapping[str, Attack], credentials: Credentials | None = None
) -> dict[str, str]:
    """How the run ended for those that attack; for the world and the others it ends by its time."""
    credentials = credentials or new_secrets(config.robot_ids)
    with World(config, out, credentials) as world, ThreadPoolExecutor(16) as pool:
        endpoint = world.endpoint.result(JOIN_S)
        more = {"credentials": credentials, "make_mind": endless}
        others = [robot for robot in config.robot_ids if robot not in attacks]
        honest = [pool.submit(run_agent, robot, endpoint, AgentConfig(), **more) for robot in others]
        intruders = {robot: pool.submit(intrude, robot, endpoint, credentials, attacks[robot]) for robot in attacks}
        try:
            ended = {robot: intruder.result(JOIN_S) for robot, intruder in intruders.items()}
            assert [robot.result(JOIN_S) for robot in honest] == ["time"] * len(honest)
        finally:
            world.inbox.stop()  # else those that live go on for ever
        assert world.ended.result(JOIN_S) == "time"
    return ended


def intrude(robot: str, endpoint: str, credentials: Credentials, attack: Attack) -> str:
    return Intruder(robot, endpoint, credentials).live(attack)


@pytest.mark.parametrize("certified", [False, True])
def test_what_is_no_answer_leaves_all_files_of_a_run_as_they_are(tmp_path: Path, certified: bool) -> None:
    config = tiny_config(tmp_path, until=4.0)
    certs = None
    if certified:
        issue(tmp_path / "certs", config.robot_ids, [])
        certs = Certificates(tmp_path / "certs", config.robot_ids)
    inprocess.run(config, config.agent, tmp_path / "undisturbed", make_mind=endless)
    at = dict(enumerate((forged, tokens, questions, sessions, declarations), ATTACK_TICK))

    def attack(intruder: Intruder, tick: int) -> None:
        at.get(tick, nothing)(intruder, tick)

    assert run(config, tmp_path / "out", {"r3": attack}, certs) == {"r3": "time"}
    assert digests(tmp_path / "out") == digests(tmp_path / "undisturbed")


def nothing(intruder: Intruder, tick: int) -> None:
    """An honest tick."""


IMPOSSIBLE: dict[Attack, str] = {
    late: "an action of tick 6 ",
    early: "an action of tick 8 ",
    much: "messages of more than",
    for_nobody: "who is no other robot",
    merges: "cannot have merged",
    deletes: "no msgpack",
    leaves: "it took its leave",
}
"""Why the world gives up who does so."""


def test_an_impossible_answer_ends_the_part_of_one_robot_and_nothing_else(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2 + len(IMPOSSIBLE), until=4.0)
    rogues = dict(zip(config.robot_ids[2:], IMPOSSIBLE, strict=True))
    ended = run(config, tmp_path / "out", {robot: partial(once, attack) for robot, attack in rogues.items()})
    dead = {event["robot"]: event for event in events(tmp_path / "out") if event["event"] == "dead"}
    assert dead.keys() == rogues.keys()
    for robot, attack in rogues.items():
        assert IMPOSSIBLE[attack] in dead[robot]["reason"] and dead[robot]["reason"] in ended[robot]
        assert dead[robot]["tick"] in (ATTACK_TICK, ATTACK_TICK + 1)


def once(attack: Attack, intruder: Intruder, tick: int) -> bool | None:
    return attack(intruder, tick) if tick == ATTACK_TICK else None


def test_two_answers_to_a_tick_cost_nobody_else_anything(tmp_path: Path) -> None:
    (ended,) = run(tiny_config(tmp_path, until=4.0), tmp_path / "out", {"r3": partial(once, double)}).values()
    assert ended == "time" or "an action of tick 7 " in ended


def test_in_real_time_nobody_holds_a_tick_by_coming_and_going(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, until=8.0, server={"real_time": 8.0})

    def attack(intruder: Intruder, tick: int) -> None:
        if tick == ATTACK_TICK:
            end = time.monotonic() + 0.5
            while time.monotonic() < end:
                intruder.token.undeclare()
                intruder.take_token()
                time.sleep(0.001)  # thousands are a flood, for which it is given up

    assert run(config, tmp_path / "out", {"r3": attack}) == {"r3": "time"}
    left = Counter(event["tick"] for event in events(tmp_path / "out") if event["event"] == "left")
    assert len(left) > 2 and left.total() == len(left)  # once in each of some ticks
    assert (tmp_path / "out/events.jsonl").stat().st_size < 64_000
