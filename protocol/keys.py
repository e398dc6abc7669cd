"""Every key expression, and who writes it; docs/protocol.md gives the reasons.

A robot writes robots/ID/out/** and its token, reads robots/ID/in/** and world/pub/**, and asks
robots/ID/srv/**; so one rule set per robot, with its own ID, is its whole access control. Who has no rights of a robot
may ask robots/*/srv/why, and nothing else.
"""

# World to robot: the last part of robots/ID/in/...
OBS = "obs"
RADIO = "radio"
END = "end"
INPUTS = (OBS, RADIO, END)

# Robot to world: the last part of robots/ID/out/...; RADIO is both.
ACT = "act"
SCAN = "scan"
MAP = "map"
POSE = "pose"
PLACE = "place"  # where a robot of ROS 2 is, for those that hear it directly
NEEDED = (RADIO, MAP, ACT)
"""Outputs that the world reads. The others leave a robot only while somebody subscribes to them."""
OUTPUTS = (*NEEDED, SCAN, POSE)

# Robot asks world: the last part of robots/ID/srv/...
JOIN, LEAVE = "join", "leave"
WHY = "why"  # may I not join? Answered only where something is against it, and whatever ID is in the key

ALL_PUBLIC = "world/pub/**"
ALL_TRUTH = "world/truth/**"

WORLD_ALIVE = "world/pub/alive"  # liveliness token of the world, by which robots tell a dead world from a slow one
CLOCK = "world/pub/clock"  # tick and status of the robots, for anybody
LINKS = "world/pub/links"  # who hears whom, for anybody; positions are not in it
PROGRESS = "world/truth/progress"  # coverage. It is judged against the truth, so no robot may read it
SITE = "world/truth/site"  # the walls, the robots' bodies and frames, for viewers
WHEREABOUTS = "world/truth/whereabouts"  # where the robots are and what their lidars read, for viewers


def to_robot(robot: str, channel: str = "**") -> str:
    """World to robot: one of INPUTS, or all, for the robot's only subscriber, which keeps the order of a tick."""
    return f"robots/{robot}/in/{channel}"


def from_robot(robot: str, channel: str = "**") -> str:
    """Robot to world: one of OUTPUTS, or all; of any robot where its ID is *."""
    return f"robots/{robot}/out/{channel}"


def alive(robot: str) -> str:
    """Liveliness token of a robot, declared when the robot is ready for its first observation."""
    return f"robots/{robot}/alive"


def service(robot: str, name: str = "**") -> str:
    """Robot asks, world answers: JOIN, LEAVE or WHY, or all."""
    return f"robots/{robot}/srv/{name}"


ALL_OUT, ALL_ALIVE, ALL_SRV, ALL_WHY = from_robot("*"), alive("*"), service("*"), service("*", WHY)


def robot_of(key: str) -> str:
    """ID in a key under robots/ID/; the empty string where the key is none of these."""
    parts = key.split("/", 2)
    return parts[1] if len(parts) == 3 and parts[0] == "robots" else ""


def channel_of(key: str) -> str:
    """Last part of a key: one of INPUTS, OUTPUTS or a service's name."""
    return key.rsplit("/", 1)[-1]
