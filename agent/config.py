"""All settings of a robot's mind, and those of its process, with units and reasons."""

from typing import Annotated

from agent.alignment.config import AlignmentConfig
from agent.communication.config import TalkConfig
from agent.cooperation.config import CooperationConfig
from agent.exploration.config import DrivingConfig, ExplorationConfig
from agent.mapping.config import FilterConfig
from agent.perception.config import PerceptionConfig
from protocol.settings import Config, NotNegative, Positive, shaped

MindName = Annotated[
    str, shaped(r"[A-Za-z_][A-Za-z0-9_.]*:[A-Za-z_][A-Za-z0-9_]*", "MODULE:CLASS, such as my_robot:Mapper")
]


class JoinConfig(Config):
    """How long a robot looks for its world."""

    join_timeout_s: Positive = 10.0
    """Seconds that a robot tries to reach a world at its start. A world that starts with it is up after 1 to 5 s. One
    that is there and still counts its robots (`--settle`) is waited for without limit."""
    reconnect_s: NotNegative = 60.0
    """Seconds that a robot waits for a world that is gone: a minute, as a laptop or a busy machine may stand still for
    so long. A world that restarts is found 0.5 s after it is up. Robots of `wireswarm run` wait without limit, as it
    knows when their world has ended, and tells them."""


class AgentConfig(Config):
    """One robot's mind."""

    perception: PerceptionConfig = PerceptionConfig()
    filter: FilterConfig = FilterConfig()
    exploration: ExplorationConfig = ExplorationConfig()
    driving: DrivingConfig = DrivingConfig()
    radio: TalkConfig = TalkConfig()
    """What the robot says by radio, and how often. What of it arrives is the world's `radio`."""
    alignment: AlignmentConfig = AlignmentConfig()
    cooperation: CooperationConfig = CooperationConfig()


class ProcessConfig(JoinConfig):
    """One robot's process."""

    agent: AgentConfig = AgentConfig()
    """Every robot's mind."""
    mind: dict[str, MindName] = {}  # noqa: RUF012  (pydantic copies it)
    """Minds in place of ours, as package:Class by robot, `*` for all others (agent.shell.mind)."""
