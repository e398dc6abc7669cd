"""What a robot gets and answers in one tick, and which answers are refused."""

import math
from collections.abc import Collection
from typing import Any, NamedTuple, Self

from protocol.errors import ProtocolError
from protocol.messages import Action, Heard, MapReport, Observation, Send
from protocol.wireframe import Wireframe, decode_wireframe
from world.radio.gate import Radio


class Inputs(NamedTuple):
    """What a live robot gets."""

    heard: list[Heard]
    observation: Observation


class Outputs(NamedTuple):
    """What a live robot answers."""

    sends: list[Send]
    action: Action
    map: MapReport | None

    def state(self) -> list[Any]:
        """For the log of a checkpoint."""
        sends = [send.model_dump() for send in self.sends]
        return [sends, self.action.model_dump(), self.map and self.map.model_dump()]

    @classmethod
    def restored(cls, sends: list[Any], action: Any, map_: Any) -> Self:
        """The answer that `state` gave."""
        said = [Send.model_validate(send) for send in sends]
        return cls(said, Action.model_validate(action), map_ and MapReport.model_validate(map_))


class BadOutputsError(ProtocolError):
    """A robot's answer is impossible; the run can go on without that robot."""

    def __init__(self, robot: str, reason: str) -> None:
        super().__init__(f"{robot}: {reason}")
        self.robot = robot


def checked_map(robot: str, outputs: Outputs, tick: int, robots: Collection[str], radio: Radio) -> Wireframe | None:
    """The new map in a robot's answer to a tick, if any; raises BadOutputsError where the answer is impossible."""
    action = outputs.action
    ticks = {action.tick, *(send.tick for send in outputs.sends)}
    ticks |= {outputs.map.tick} if outputs.map is not None else set()
    if ticks != {tick}:
        raise BadOutputsError(robot, f"answered for tick {min(ticks - {tick})} at tick {tick}")
    if action.sent != len(outputs.sends):
        raise BadOutputsError(robot, f"says it sent {action.sent} messages, but {len(outputs.sends)} came")
    if not (math.isfinite(action.speed_mps) and math.isfinite(action.turn_rps)):
        raise BadOutputsError(robot, "a drive command is not finite")
    for peer, merged_tick in action.merged.items():
        if peer == robot or peer not in robots or merged_tick > tick:
            raise BadOutputsError(robot, f"cannot have merged a map of {peer} at tick {merged_tick}")
    try:
        radio.check(robot, outputs.sends)
        return decode_wireframe(outputs.map.wireframe) if outputs.map is not None else None
    except ProtocolError as error:
        raise BadOutputsError(robot, str(error)) from None
