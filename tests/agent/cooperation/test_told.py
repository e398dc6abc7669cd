"""Who has merged a map tells its owner the transform, who judges it by its own evidence: a liar gains nothing."""

import numpy as np
import pytest

from agent.cooperation.peer import Proposed
from agent.robot import Robot, Step
from deploy.bench.errors import errors, right
from deploy.bench.explored import Explored, explore
from protocol.geometry import Pose, compose, relative
from protocol.messages import Observation

pytestmark = pytest.mark.system

MEET = {"world": "apartment", "robots": 2, "seed": 1, "starts": "random", "max_time_s": 100.0}
OFF = {"nothing": (0.0, 0.0, 0.0), "a metre": (1.0, 0.3, 0.0), "a half turn": (3.0, 1.0, 3.14159)}


@pytest.mark.parametrize("off", OFF)
def test_a_told_transform_is_merged_if_own_evidence_says_so_and_only_then(off: str) -> None:
    said: list[tuple[str, Pose]] = []
    runs: list[Explored] = []

    def keep(run: Explored) -> bool:
        runs[:] = [run]
        return False

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        said.extend((event.event, event.data["transform"]) for event in step.action.events if "transform" in event.data)
        if observation.tick > 0:
            return
        team, talk = robot.team, robot.exchange.talk
        align = team._align
        if robot.robot == "r1":  # knows of no other way to align
            team._align = lambda tick, peer, own: (  # type: ignore[method-assign]
                align(tick, peer, own)
                if isinstance(peer, Proposed)
                else peer.log.first_encounter is not None and team._align_as_told(peer, own)
            )
            return
        team._align = lambda *_: False  # type: ignore[method-assign]

        def lie(tick, pose, wireframe, state, looked, frames, in_sight, asks):
            true = (np.array(runs[0].frame(name)) for name in ("r2", "r1")) if runs else ()
            told = {"r1": compose(OFF[off], relative(*map(tuple, true)))} if runs else {}
            return talk(tick, pose, wireframe, state, looked, told, in_sight, asks)

        robot.exchange.talk = lie  # type: ignore[method-assign]

    run = explore(MEET, {}, watch, enough=keep)
    truth = run.frame("r1"), run.frame("r2"), run.robots["r2"].own.points.mean(0)
    accepted = [transform for event, transform in said if event == "accepted"]
    assert all(right(*errors(transform, *truth)) for transform in accepted)
    assert bool(accepted) == (off == "nothing")
