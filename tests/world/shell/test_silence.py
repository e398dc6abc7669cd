"""Who says nothing for long is given up: for its own silence, and by a clock that the test turns."""

from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest

from protocol import keys
from protocol.codec import encode
from protocol.errors import LinkError
from protocol.inbox import Arrival
from protocol.messages import PROTOCOL_VERSION, Action, Join
from protocol.session import open_router
from tests.agent.shell.test_process import events
from tests.tiny import tiny_config
from world.config import ServerConfig
from world.episode import Episode
from world.shell import gathering, pace, shell, voice
from world.shell.inbox import WorldInbox

TICK_S = 0.2
AGAIN = range(100, 500, 100)
Timed = tuple[float, Arrival]


class Script(WorldInbox):
    """What arrives when, and the clock, which goes on while the world waits."""

    def __init__(self, arrivals: list[Timed]) -> None:
        super().__init__()
        self.left, self.now = arrivals, 0.0

    def monotonic(self) -> float:
        return self.now

    def take(self, deadline: float) -> Arrival | None:
        due = bool(self.left) and self.left[0][0] <= deadline
        self.now = max(self.now, self.left[0][0] if due else deadline)
        return self.left.pop(0)[1] if due else None


def joins(at: float, robot: str, process: str) -> list[Timed]:
    """Another process of a robot is let in, and is ready a moment later."""
    return [*asks(at, robot, process), (at, Arrival(WorldInbox.ALIVE, robot))]


def goes(at: float, robot: str) -> list[Timed]:
    return [(at, Arrival(WorldInbox.GONE, robot))]


def asks(at: float, robot: str, process: str) -> list[Timed]:
    """A process of a robot asks to be let in, first or again."""
    question = encode(Join(version=PROTOCOL_VERSION, robot=robot, session=process, process=process))
    query = MagicMock(key_expr=keys.service(robot, keys.JOIN))
    return [(at, Arrival(keys.JOIN, robot, question, query))]


def acts(at: float, robot: str, tick: int = 0) -> list[Timed]:
    return [(at, Arrival(keys.ACT, robot, encode(Action(tick=tick, speed_mps=0.0, turn_rps=0.0))))]


BOTH = [*joins(0.0, "r1", "01"), *joins(0.0, "r2", "02")]


def run(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ticks: int,
    arrivals: list[Timed],
    *,
    there: list[Timed] = BOTH,
    **more: Any,
) -> list[Any]:
    """Events of a run of two robots, which are there at 0 s: robot, event and reason."""
    inbox = Script([*there, *arrivals])
    for module in (gathering, pace, shell, voice):
        monkeypatch.setattr(module, "time", inbox)
    monkeypatch.setattr(voice, "wait_for_matching", lambda *_: None)
    episode = Episode(tiny_config(tmp_path, robots=2, until=ticks * TICK_S), tmp_path / "out")
    config = ServerConfig(connect="tcp/127.0.0.1:1", **more)
    with open_router() as (session, _), shell.Shell(episode, config, session, inbox, lambda _: None) as alone:
        alone.gather("")
        alone.run()
        alone.close()
    return [(told["robot"], told["event"], told["reason"]) for told in events(tmp_path / "out")]


def test_who_comes_back_is_not_given_up_for_the_silence_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that came a second before silence_s was over had that second for its answer."""
    arrivals = [*acts(0.1, "r2"), *goes(0.2, "r1"), *joins(299.0, "r1", "03"), *acts(302.0, "r1")]
    told = run(tmp_path, monkeypatch, 1, arrivals)
    assert [(robot, event) for robot, event, _ in told] == [("r1", "left"), ("r1", "rejoined")]


def test_in_lockstep_who_says_nothing_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arrivals = [*goes(0.1, "r2"), *acts(301.0, "r1")]
    told = run(tmp_path, monkeypatch, 1, arrivals)
    assert told == [
        ("r1", "dead", "it said nothing for 300 s"),
        ("r2", "dead", "its link was lost, and it said nothing for 300 s"),
    ]


@pytest.mark.parametrize(
    "arrivals",
    [
        [*goes(0.2, "r1"), *(one for at in AGAIN for one in (*joins(at, "r1", f"{at}"), *goes(at + 5, "r1")))],
        [one for at in AGAIN for one in asks(at, "r1", "01")],
    ],
    ids=["it dies and is started again", "it asks to be let in again"],
)
def test_in_lockstep_nobody_holds_a_tick_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arrivals: list[Timed]
) -> None:
    """Each return, and each question, began its silence anew."""
    stop = 599.0, Arrival(WorldInbox.STOP)
    told = run(tmp_path, monkeypatch, 1, [*acts(0.1, "r2"), *arrivals, stop])
    assert ("r1", "dead") in [(robot, event) for robot, event, _ in told]


def test_in_real_time_who_keeps_its_link_and_says_nothing_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It lived on until the run ended."""
    arrivals = [one for tick in range(10) for one in acts((tick + 0.5) * TICK_S, "r2", tick)]
    told = run(tmp_path, monkeypatch, 10, arrivals, real_time=1.0, silence_s=1.0)
    assert told == [("r1", "dead", "it said nothing for 1 s")]


def test_in_real_time_the_last_word_on_a_robot_that_is_away_is_that_it_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its link came back and was lost again within a tick: it rejoined for good."""
    arrivals = [
        *goes(0.1, "r1"),
        *joins(0.25, "r1", "01"),
        *goes(0.3, "r1"),
        *joins(0.31, "r1", "01"),
        *goes(0.32, "r1"),
    ]
    told = run(tmp_path, monkeypatch, 3, arrivals, real_time=1.0)
    assert [(robot, event) for robot, event, _ in told] == [("r1", event) for event in ("left", "rejoined", "left")]


@pytest.mark.parametrize(
    ("there", "begin_with", "words"),
    [
        (
            [*asks(0.0, "r1", "01"), *asks(0.0, "r2", "02")],
            2,
            "r1, r2 did not become ready within 360 s, though let in",
        ),
        (asks(0.0, "r1", "01"), 2, "r2 did not join within 60 s: start each by `wireswarm agent --id r2 "),
        (asks(0.0, "r1", "01"), 1, "r1 did not become ready within 360 s, though let in"),
    ],
    ids=["all compile", "one compiles", "it would be enough"],
)
def test_who_was_let_in_and_compiles_for_long_is_not_asked_to_join(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: list[Timed], begin_with: int, words: str
) -> None:
    with pytest.raises(LinkError, match=f"^{words}"):
        run(tmp_path, monkeypatch, 1, [], there=there, begin_with=begin_with)


def test_who_is_let_in_at_the_last_moment_may_still_compile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It had what was left of silence_s, which began with the world's."""
    there = [*joins(0.0, "r1", "01"), *asks(598.0, "r2", "02"), (700.0, Arrival(WorldInbox.ALIVE, "r2"))]
    arrivals = [*acts(700.1, "r1"), *acts(700.1, "r2")]
    assert run(tmp_path, monkeypatch, 1, arrivals, there=there, join_timeout_s=600.0) == []


def test_who_joins_late_and_is_replaced_in_the_same_tick_has_joined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It had `rejoined` alone, so nothing told when it came."""
    r2 = [*joins(0.1, "r2", "02"), *goes(0.2, "r2"), *joins(0.3, "r2", "03"), *acts(0.4, "r2")]
    arrivals = [*r2, *acts(0.5, "r1")]
    told = run(tmp_path, monkeypatch, 1, arrivals, there=joins(0.0, "r1", "01"), begin_with=1)
    assert told == [("r2", "joined", "its process is ready")]
