"""All settings of a robot's mind, with units and reasons."""

from agent.alignment.config import AlignmentConfig
from agent.communication.config import TalkConfig
from agent.cooperation.config import CooperationConfig
from agent.exploration.config import DrivingConfig, ExplorationConfig
from agent.mapping.config import FilterConfig
from agent.perception.config import PerceptionConfig
from protocol.settings import Config


class AgentConfig(Config):
    """One robot's mind."""

    perception: PerceptionConfig = PerceptionConfig()
    filter: FilterConfig = FilterConfig()
    exploration: ExplorationConfig = ExplorationConfig()
    driving: DrivingConfig = DrivingConfig()
    radio: TalkConfig = TalkConfig()
    alignment: AlignmentConfig = AlignmentConfig()
    cooperation: CooperationConfig = CooperationConfig()
