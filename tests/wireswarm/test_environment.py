"""The world as an environment: PettingZoo's own tests, the same world as in runs, and many worlds at once."""

from pathlib import Path

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import wireswarm
from agent.shell.mind import OwnMind
from protocol.configuration import ConfigError
from wireswarm.environment import Environment

DRIVE = np.array([0.2, 0.3], np.float32)
RANDOM = {"starts": "random"}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("message_bytes", [0, 8])
def test_it_passes_the_tests_of_pettingzoo(message_bytes: int) -> None:
    def make() -> Environment:
        return wireswarm.parallel_env("apartment", 3, until=10.0, message_bytes=message_bytes, settings=RANDOM)

    parallel_api_test(make(), 60)
    parallel_seed_test(make, 30)


def test_an_episode_is_that_of_a_run() -> None:
    environment = wireswarm.parallel_env("apartment", 2, until=4.0)
    seen, _ = environment.reset(seed=5)
    gains, told = [environment.episode.team_coverage], []
    while environment.agents:
        assert all(environment.observation_space(robot).contains(seen[robot]) for robot in seen)
        seen, gained, ended, stopped, infos = environment.step({key: {"drive": DRIVE} for key in environment.agents})
        gains.append(gained["r1"])
        told.append(infos)
    assert not any(ended.values()) and all(stopped.values()) and len(told) == 20
    mind = {"*": "tests.wireswarm.test_environment:Driver"}
    summary = wireswarm.run("apartment", 2, 5, until=4.0, settings={"mind": mind}).summary  # without a look at the end
    for robot, figures in summary["robots"].items():
        assert told[-2][robot]["coverage"] == pytest.approx(figures["coverage"], abs=1e-6)
    assert sum(gains[:-1]) == pytest.approx(summary["team"]["coverage"], abs=1e-6)


class Driver(OwnMind):
    """Drives as the test above."""

    def drive(self, observation: object, heard: object) -> tuple[float, float]:
        return float(DRIVE[0]), float(DRIVE[1])


def test_messages_go_through_the_radio() -> None:
    said = {"drive": np.zeros(2, np.float32), "say": 1, "message": np.arange(4, dtype=np.uint8)}
    for range_m, heard in ((50.0, [1, 0]), (0.01, [0, 0])):
        environment = wireswarm.parallel_env("apartment", 2, message_bytes=4, settings={"radio.range_m": range_m})
        environment.reset()
        seen = environment.step({"r1": said})[0]
        assert seen["r2"]["heard"].tolist() == heard and seen["r1"]["heard"].tolist() == [0, 0]
        assert seen["r2"]["messages"].tolist() == [[0, 1, 2, 3] if heard[0] else [0] * 4, [0] * 4]


def test_an_episode_ends_when_all_is_seen(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("name: cell\nwalls: [[0, 0, 1, 0], [1, 0, 1, 1], [1, 1, 0, 1], [0, 1, 0, 0]]")
    environment = wireswarm.parallel_env(tmp_path / "cell.yaml", 1)
    environment.reset()
    _, _, ended, stopped, infos = environment.step({})
    assert (ended, stopped, environment.agents) == ({"r1": True}, {"r1": False}, [])
    assert infos["r1"]["coverage"] == pytest.approx(1)


def test_many_worlds_in_one_process_are_those_one_by_one() -> None:
    vector = wireswarm.vector_env(3, "apartment", 2, seed=4, until=2.0, message_bytes=2, settings=RANDOM)
    actions = {"drive": np.tile(DRIVE, (6, 1)), "say": np.ones(6, int), "message": np.zeros((6, 2), np.uint8)}
    seen, _ = vector.reset()
    single = wireswarm.parallel_env("apartment", 2, until=2.0, message_bytes=2, settings=RANDOM)
    for tick in range(25):
        assert vector.observation_space.contains(seen)
        if tick in (0, 11, 22):
            alone, _ = single.reset(seed=5 + 3 * (tick // 11))  # the world at 1: its first, second and third episode
        else:
            alone = single.step(
                {robot: {name: array[0] for name, array in actions.items()} for robot in single.agents}
            )[0]
        for row, robot in ((2, "r1"), (3, "r2")):
            assert all(np.array_equal(seen[name][row], alone[robot][name]) for name in seen)
        seen, rewards, ended, stopped, _ = vector.step(actions)
        assert stopped.tolist() == [tick % 11 == 9] * 6 and not ended.any() and (rewards >= 0).all()


def test_settings_say_what_no_argument_does() -> None:
    settings = {"world": "apartment", "robots": 2, "seed": 4, "until": 2.0}
    config = wireswarm.parallel_env(settings=settings).config
    assert (config.world, config.robots, config.seed, config.until) == ("apartment", 2, 4, 2.0)
    assert wireswarm.parallel_env("apartment").config.until == 600.0
    with pytest.raises(ConfigError, match="until: given twice"):
        wireswarm.parallel_env(until=2.0, settings=settings)


def test_settings_that_an_environment_cannot_heed_are_refused() -> None:
    ours = ("agent", {"exploration": {"default_state": "least-likely"}})
    for key, value in (ours, ("mind", {"*": "a:A"}), ("faults", ["r1@3"]), ("server.real_time", 1.0)):
        with pytest.raises(ConfigError, match=rf"^{key}: .* has no use for it, so leave it out$"):
            wireswarm.parallel_env("apartment", settings={key: value})
    with pytest.raises(ConfigError, match=r"^worlds: at least 1, not 0$"):
        wireswarm.vector_env(0, "apartment")


def test_what_is_no_action_is_a_sentence() -> None:
    with pytest.raises(ConfigError, match=r"message_bytes: 0 to radio\.mtu_bytes, 1200, not 1201"):
        wireswarm.parallel_env("apartment", 1, message_bytes=1201)
    environment = wireswarm.parallel_env("apartment", 1, message_bytes=2)
    environment.reset()
    for drive, message, sentence in (([np.nan, 0], [0, 0], "no number"), ([0, 0], [0], "1 bytes instead of 2")):
        with pytest.raises(ValueError, match=f"r1: .*{sentence}"):
            environment.step({"r1": {"drive": np.array(drive), "say": 1, "message": np.array(message, np.uint8)}})
