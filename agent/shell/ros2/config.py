"""Settings of a robot of ROS 2, with units and reasons."""

import re
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from agent.config import ProcessConfig
from protocol.messages import RobotSpec
from protocol.settings import Config, Positive, shaped

NAME = r"[A-Za-z_][A-Za-z0-9_]*"
MAX_NAMESPACE = 100  # characters (ours)
Topic = Annotated[str, Field(max_length=200), shaped(rf"/?{NAME}(/{NAME})*", "a topic, such as scan or /r1/scan")]
Frame = Annotated[str, shaped(r"[A-Za-z0-9_./-]{1,100}", "a name of 1 to 100 of A-Z a-z 0-9 _ . / -, such as r1/map")]


def is_namespace(name: str) -> bool:
    """Whether a name is a namespace of ROS 2, such as /r1, or / for none."""
    return name == "/" or (re.fullmatch(rf"(/{NAME})+", name) is not None and len(name) <= MAX_NAMESPACE)


class Ros2Config(Config):
    """How a robot of ROS 2 is reached. Topics lie within its namespace, unless they begin with a slash."""

    router: str = "tcp/127.0.0.1:7447"
    """Endpoint of the Zenoh router to which ROS 2 nodes connect; rmw_zenohd's own, where nobody changed it."""
    domain: Annotated[int, Field(ge=0, le=232)] = 0
    """The robot's ROS_DOMAIN_ID."""
    scan_topic: Topic = "scan"
    """Topic of sensor_msgs/LaserScan."""
    odometry_topic: Topic = "odom"
    """Topic of nav_msgs/Odometry."""
    command_topic: Topic = "cmd_vel"
    """Topic of Twist or TwistStamped, whichever the robot subscribes to."""
    tf_topic: Topic = "tf"
    """Topic of tf: /tf where all robots share one tree."""
    map_frame: Frame = "map"
    """Frame of the map, which is where the robot's odometry was at the first scan that it took. Robots of one tf tree
    need names of their own, such as r1/map."""
    upside_down: bool = False
    """Whether the lidar is mounted upside down, so that its readings go clockwise."""
    revolution_s: Annotated[float, Field(ge=-5, le=5)] | None = None
    """Seconds that a revolution of the lidar takes, where its driver tells it wrongly or not at all; negative where the
    first reading of a scan was taken last, as drivers do that count a clockwise lidar's readings the other way round; 0
    for scans of one moment; null: as `time_increment` tells."""
    stamp: Literal["begin", "end"] = "begin"
    """Which reading is taken at a scan's stamp: the first, as ROS wants it, or the last, as of drivers that stamp scans
    once they are there."""
    silence_s: Positive = 0.5
    """Seconds without a scan after which the robot is told to stop: two and a half revolutions of an LDS-01, in which
    it drives 0.11 m."""
    dead_man_s: Positive | None = None
    """The robot drives only while somebody says true on the topic `dead_man` (std_msgs/Bool) at least every so many
    seconds; null: without anybody."""
    radio: Literal["direct", "gated"] = "direct"
    """`direct`: robots hear each other over the router. `gated`: what they say passes the radio of `wireswarm run
    --ros2`."""
    range_m: Positive | None = None
    """Metres up to which robots hear each other directly; needs `position_topic`. null: without a limit."""
    position_topic: Topic | None = None
    """Topic of geometry_msgs/PoseStamped with the robot's place in a frame that all robots share, such as that of a
    motion capture. It decides who hears whom and reaches no map."""
    stamped: bool = False
    """Whether the robots of `wireswarm run --ros2` take TwistStamped instead of Twist."""
    grid_s: Positive = 2.0
    """Seconds between two OccupancyGrids."""

    @model_validator(mode="after")
    def _range_needs_places(self) -> Self:
        if (self.range_m is None) != (self.position_topic is None) or (self.range_m and self.radio == "gated"):
            raise ValueError("range_m and position_topic go together, with the radio `direct`")
        return self


class Ros2ProcessConfig(ProcessConfig):
    """One robot's process on a ROS 2 robot, which nobody tells what body it has."""

    spec: RobotSpec = RobotSpec()
    """The body. What each scan tells of the lidar itself (its beams, field of view, range and period) is taken from
    there; ticks are counted at `lidar.rate_hz` if the lidar is within 5 % of it."""
    ros2: Ros2Config = Ros2Config()
    """How the robot is reached."""
