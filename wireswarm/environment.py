"""The world as an environment of PettingZoo, and many of them as one of Gymnasium, for minds that learn (extra `env`).

An agent is a robot. It sees its scan, its odometry and what it hears, and gives velocities and a message; the world is
the one of all other runs, tick by tick.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from pettingzoo import ParallelEnv

from deploy.config import check_heeded
from protocol.configuration import ConfigError
from protocol.messages import EVERYONE, Action, Send
from wireswarm.settings import settings_of
from world.config import WorldConfig
from world.episode import Episode
from world.tick import Inputs, Outputs

Array = np.ndarray[Any, Any]
Seen = dict[str, Array]
"""An observation, or an action: arrays by name, see `Environment.observation_space` and `action_space`."""
KIND = "message"
"""Under which the bytes of messages are counted."""
ALL = 1.0 - 1e-9
EPISODE_S = 600.0
"""Simulated seconds of an episode. One robot of ours alone sees 99 % of any bundled world's walls in less."""
OF_OUR_ROBOTS = ("agent", "mind", "faults")
"""Settings of minds, ours and others, and of their processes: whoever learns drives the robots of an environment."""


def parallel_env(
    world: str | Path | None = None,
    robots: int | None = None,
    seed: int | None = None,
    *,
    until: float | None = None,
    message_bytes: int = 0,
    settings: Mapping[str, Any] | None = None,
) -> Environment:
    """A world as an environment of PettingZoo: `env.reset(seed=1)`, then `env.step({"r1": ..., "r2": ...})`.

    world, robots, settings: as of `wireswarm.run`. seed: of the first episode, where `reset` gets none; each further
    one takes the next. until: simulated seconds of an episode, EPISODE_S where nothing says it. message_bytes: of what
    a robot can say in a tick; 0: robots are mute.

    Raises protocol.configuration.ConfigError and world.worldfile.WorldFileError.
    """
    if until is None and "until" not in (settings or {}):
        until = EPISODE_S
    given = {"world": world, "robots": robots, "seed": seed, "until": until}
    config = settings_of(given, settings)
    check_heeded(config, OF_OUR_ROBOTS, "an environment")
    return Environment(config, message_bytes)


def vector_env(worlds: int, *args: Any, **named: Any) -> WorldVector:
    """So many worlds in this process, each with seeds of its own, as one environment of Gymnasium.

    The further arguments, and what it raises, are those of `parallel_env`.
    """
    if worlds < 1:
        raise ConfigError(f"worlds: at least 1, not {worlds}")
    return WorldVector([parallel_env(*args, **named) for _ in range(worlds)])


class Environment(ParallelEnv[str, Seen, Seen]):
    """One world. An episode is terminated when the team has seen all walls, and truncated when its time is over.

    The reward of each robot is what the team has seen newly of the visible wall, as a share of it.
    """

    metadata = {"name": "wireswarm", "render_modes": []}  # noqa: RUF012, as PettingZoo has it
    render_mode = None

    def __init__(self, config: WorldConfig, message_bytes: int) -> None:
        """message_bytes: of what a robot can say in a tick."""
        if not 0 <= message_bytes <= config.radio.mtu_bytes:
            raise ConfigError(f"message_bytes: 0 to radio.mtu_bytes, {config.radio.mtu_bytes}, not {message_bytes}")
        self.config, self.message_bytes = config, message_bytes
        self.possible_agents = config.robot_ids
        self.agents: list[str] = []
        self._seed = config.seed - 1
        spec, lidar, robots = config.spec, config.spec.lidar, config.robots
        limits = np.array([spec.max_speed_mps, spec.max_turn_rps], np.float32)
        seen: dict[str, spaces.Space[Any]] = {
            "scan": spaces.Box(0.0, lidar.range_max_m, (lidar.beams,), np.float32),
            "odometry": spaces.Box(-np.inf, np.inf, (3,), np.float64),
        }
        done: dict[str, spaces.Space[Any]] = {"drive": spaces.Box(-limits, limits)}
        if message_bytes:
            said = spaces.Box(0, 255, (message_bytes,), np.uint8)
            seen |= {"heard": spaces.MultiBinary(robots), "messages": batch_space(said, robots)}
            done |= {"say": spaces.Discrete(2), "message": said}
        self._sees = {robot: spaces.Dict(seen) for robot in self.possible_agents}
        self._does = {robot: spaces.Dict(done) for robot in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Dict:
        """What a robot sees in a tick.

        scan: (beams,) metres, range_max_m where nothing came back and 0 where nothing was measured. odometry: (3,) x, y
        in metres and theta in radians in the robot's own frame, which is its start. heard: (robots,) of whom it has
        heard a message. messages: (robots, message_bytes) what they said.
        """
        return self._sees[agent]

    def action_space(self, agent: str) -> spaces.Dict:
        """What a robot does in a tick.

        drive: (2,) speed in m/s, and turn rate in rad/s, counter-clockwise. say: 1 to broadcast its message. message:
        (message_bytes,) for whom the radio lets hear it.
        """
        return self._does[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Seen], dict[str, dict[str, Any]]]:
        """Begin an episode, from this seed or the one after the last; options: none."""
        self._seed = self._seed + 1 if seed is None else seed
        self.episode = Episode(self.config.model_copy(update={"seed": self._seed}), None)
        self.agents = list(self.possible_agents)
        return self._look(), self._infos()

    def step(
        self, actions: dict[str, Seen]
    ) -> tuple[dict[str, Seen], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """One tick. A robot without an action stands still. Raises ValueError for an action that is none."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        before = self.episode.team_coverage
        self.episode.advance({robot: self._outputs(robot, actions.get(robot)) for robot in self.agents})
        seen, robots = self._look(), self.agents
        now = self.episode.team_coverage
        terminated, truncated = now >= ALL, self.episode.ended is not None
        self.agents = [] if terminated or truncated else robots
        ends = dict.fromkeys(robots, terminated), dict.fromkeys(robots, truncated)
        return seen, dict.fromkeys(robots, now - before), *ends, self._infos(robots)

    def close(self) -> None:
        """Nothing is open."""

    def _outputs(self, robot: str, action: Seen | None) -> Outputs:
        tick = self.episode.tick
        speed, turn = (0.0, 0.0) if action is None else map(float, action["drive"])
        sends = []
        if self.message_bytes and action is not None and action["say"]:
            data = np.asarray(action["message"], np.uint8).tobytes()
            sends = [Send(tick=tick, to=EVERYONE, kind=KIND, payload=data)]
            if len(data) != self.message_bytes:
                raise ValueError(f"{robot}: a message of {len(data)} bytes instead of {self.message_bytes}")
        if not np.isfinite([speed, turn]).all():
            raise ValueError(f"{robot}: a speed or turn rate is no number")
        return Outputs(sends, Action(tick=tick, speed_mps=speed, turn_rps=turn, sent=len(sends)), None)

    def _look(self) -> dict[str, Seen]:
        seen = {robot: self._seen(inputs) for robot, inputs in self.episode.inputs().items()}
        self.episode.book()
        return seen

    def _seen(self, inputs: Inputs) -> Seen:
        lidar, observation = self.config.spec.lidar, inputs.observation
        scan = np.frombuffer(observation.ranges, "<f4")
        seen: Seen = {
            "scan": np.nan_to_num(scan, nan=0.0, posinf=lidar.range_max_m),
            "odometry": np.array(observation.odometry),
        }
        if self.message_bytes:
            seen["heard"] = np.zeros(self.config.robots, np.int8)
            seen["messages"] = np.zeros((self.config.robots, self.message_bytes), np.uint8)
            for message in inputs.heard:
                row = self.possible_agents.index(message.sender)
                seen["heard"][row], seen["messages"][row] = 1, np.frombuffer(message.payload, np.uint8)
        return seen

    def _infos(self, robots: list[str] | None = None) -> dict[str, dict[str, Any]]:
        """The share of the visible wall that each robot's own beams have hit."""
        return {robot: {"coverage": self.episode.coverage[robot]} for robot in robots or self.agents}


class WorldVector(VectorEnv[Seen, Seen, Array]):
    """Many worlds as one environment, in which each robot of each world is one of `num_envs`, world by world.

    A world whose episode is over begins the next one in the following step, which heeds no action and gives no reward
    (Gymnasium's AutoresetMode.NEXT_STEP).
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012, as Gymnasium has it

    def __init__(self, worlds: list[Environment]) -> None:
        """Of n worlds that are alike, the one at k begins with the seed and k, and each next episode adds n."""
        self.worlds, first = worlds, worlds[0]
        self.robots = first.possible_agents
        self.num_envs = len(worlds) * len(self.robots)
        self.single_observation_space = first.observation_space(self.robots[0])
        self.single_action_space = first.action_space(self.robots[0])
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._begin(first.config.seed)

    def _begin(self, seed: int) -> None:
        self._seeds = [seed + k for k in range(len(self.worlds))]

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode in all worlds."""
        if seed is not None:
            self._begin(int(seed))
        return self._stacked([self._again(k) for k in range(len(self.worlds))]), {}

    def _again(self, number: int) -> dict[str, Seen]:
        seen, _ = self.worlds[number].reset(seed=self._seeds[number])
        self._seeds[number] += len(self.worlds)
        return seen

    def step(self, actions: Seen) -> tuple[Seen, Array, Array, Array, dict[str, Any]]:
        """One tick in all worlds; arrays have num_envs rows."""
        seen: list[dict[str, Seen]] = []
        rewards, terminated, truncated = np.zeros(self.num_envs), *np.zeros((2, self.num_envs), np.bool_)
        for number, world in enumerate(self.worlds):
            if not world.agents:
                seen.append(self._again(number))
                continue
            rows = slice(number * len(self.robots), (number + 1) * len(self.robots))
            mine = {
                robot: {name: array[rows.start + k] for name, array in actions.items()}
                for k, robot in enumerate(self.robots)
            }
            here, gained, ended, stopped, _ = world.step(mine)
            seen.append(here)
            rewards[rows], terminated[rows], truncated[rows] = (list(one.values()) for one in (gained, ended, stopped))
        return self._stacked(seen), rewards, terminated, truncated, {}

    def _stacked(self, seen: list[dict[str, Seen]]) -> Seen:
        rows = [one[robot] for one in seen for robot in self.robots]
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}
