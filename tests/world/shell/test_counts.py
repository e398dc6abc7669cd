"""What the shell counts of robots' links and of their answers."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from agent.config import AgentConfig
from agent.shell.process import run_agent
from deploy.config import RunConfig
from protocol import keys
from protocol.codec import encode
from protocol.messages import Action
from tests.agent.shell.test_process import events
from tests.tiny import tiny_config
from tests.wanderer import Wanderer
from tests.world.shell.test_roll_call import world
from world.episode import CHECKPOINT_S, Episode
from world.recorder import REPLACED
from world.shell.answers import Answers, LockstepAnswers, RealTimeAnswers
from world.tick import Outputs


def summary_of(config: RunConfig, out: Path, robots: tuple[str, ...], **more: object) -> dict[str, Any]:
    """Of a run of Wanderers."""
    with world(config, out, [], settle_s=None, **more) as (endpoint, ended), ThreadPoolExecutor() as pool:
        for robot in robots:
            pool.submit(run_agent, robot, endpoint, AgentConfig(), make_mind=Wanderer)
        assert ended.result(20) == "time"
    return json.loads((out / "summary.json").read_text())  # type: ignore[no-any-return]


def test_a_world_that_goes_on_counts_on(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=1, until=CHECKPOINT_S + 1.0)
    killed = Episode(config, tmp_path / "out")
    mind = Wanderer("r1", killed.welcome("r1").spec, AgentConfig(), 0)
    killed.late_ticks, killed.links_lost = 7, 3
    while killed.t < CHECKPOINT_S:
        step = mind.step(killed.inputs()["r1"].observation, [])
        killed.advance({"r1": Outputs(step.sends, step.action, step.map)})
    del killed  # it holds the directory
    summary = summary_of(config, tmp_path / "out", ("r1",), resume=True)
    assert (summary["late_ticks"], summary["links_lost"]) == (7, 3)


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_time_of_a_step_is_that_of_steps_that_were_made(tmp_path: Path, lockstep: bool) -> None:
    """Before a robot joined it counted as 0, and in real time a missed tick counted the step before again."""
    episode = Episode(tiny_config(tmp_path, robots=1), None)
    answers: Answers = LockstepAnswers(episode.robots) if lockstep else RealTimeAnswers(episode.robots, episode.actions)
    while episode.tick < 9:
        for step_ms in {2: [40.0], 8: [10.0]}.get(episode.tick, []):
            action = Action(tick=episode.tick, speed_mps=0.0, turn_rps=0.0, step_ms=step_ms)
            answers.hear("r1", keys.ACT, encode(action), episode.tick)
        episode.advance({"r1": answers.take("r1", episode.tick)})
    assert episode.summary()["robots"]["r1"]["step_ms_median"] == 25.0


@pytest.mark.parametrize("ticks", [3, round(5 * CHECKPOINT_S)], ids=["from-the-log", "from-the-checkpoint"])
def test_in_real_time_a_world_that_goes_on_knows_what_robots_said_last(tmp_path: Path, ticks: int) -> None:
    """Until they were back they had merged nothing, were not complete and had no map: for good, if they never were."""
    config = tiny_config(tmp_path, robots=2)
    episode = Episode(config, tmp_path / "out")
    answers = RealTimeAnswers(episode.robots, episode.actions)
    for tick in range(ticks):
        said = Action(tick=tick, speed_mps=0, turn_rps=0, complete=True, map_bytes=7, merged={"r2": tick})
        answers.hear("r1", keys.ACT, encode(said), tick)
        episode.advance({robot: answers.take(robot, tick) for robot in episode.live})
    before = episode.coverage
    del episode, answers  # it holds the directory
    episode = Episode.resume(config, tmp_path / "out")
    answers = RealTimeAnswers(episode.robots, episode.actions)
    episode.advance({robot: answers.take(robot, ticks) for robot in episode.live})
    told = episode.summary()["robots"]["r1"]
    assert (told["map_bytes"], told["ended"]) == (7, "complete")
    assert episode.coverage["r1"] >= before["r1"] > before["r2"]


def test_in_real_time_robots_leave_with_a_killed_world_and_rejoin(tmp_path: Path) -> None:
    """They rejoined, and had not left."""
    config = tiny_config(tmp_path, robots=1, until=10.0, server={"real_time": 4.0})
    killed = Episode(config, tmp_path / "out")
    killed.arrive("r1", "its process")
    del killed  # it holds the directory
    summary_of(config, tmp_path / "out", ("r1",), resume=True)
    left, rejoined = events(tmp_path / "out")
    assert (left["event"], rejoined["event"], rejoined["reason"]) == ("left", "rejoined", REPLACED)


def test_a_robot_that_has_not_come_is_not_late(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=2, until=8.0, server={"begin_with": 1, "real_time": 8.0})
    summary = summary_of(config, tmp_path / "out", ("r1",))
    assert summary["late_ticks"] < 20  # of 40; r1 is late where this machine is
