"""The radio of robots without a world: each hears what others say on their keys, and judges by itself who is in range.

Keys and messages are those of `protocol.keys` and `protocol.messages`. With a gate (`wireswarm run --ros2`) a robot
hears what that lets through instead.
"""

import math
import re
from collections import Counter

import zenoh

from agent.shell.ros2.config import Ros2Config
from protocol import keys
from protocol.codec import decode
from protocol.errors import ProtocolError
from protocol.inbox import Inbox
from protocol.messages import EVERYONE, ID, Heard, Send, SharedPlace
from protocol.session import at_once
from protocol.talk import MAX_SENDS

HEARD_FOR_S = 3.0  # a place that was told longer ago is none: at 0.2 m/s a robot is 0.6 m away by then
MAX_ROBOTS = 500  # whose places are kept at a time
MOST_HEARD = 5000  # messages of all robots between two steps: 6 MB


class Air:
    """What one robot hears."""

    def __init__(self, robot: str, config: Ros2Config, mtu_bytes: int) -> None:
        self._robot, self._range_m, self._mtu_bytes = robot, config.range_m, mtu_bytes
        self._gated = config.radio == "gated"
        self._places: dict[str, tuple[SharedPlace, float]] = {}
        """Where robots are, this one, too, and when they said so."""
        self._said = Counter[str]()
        """Messages of each robot since the last `take`."""
        self._heard: list[Heard] = []

    def declare(self, session: zenoh.Session, inbox: Inbox) -> list[zenoh.Subscriber[None]]:
        """Subscribe to the others, or to the gate."""
        if self._gated:
            wanted = [keys.to_robot(self._robot, keys.RADIO)]
        else:
            wanted = [keys.from_robot("*", channel) for channel in (keys.RADIO, keys.PLACE)]
        return [session.declare_subscriber(key, at_once(inbox.hear)) for key in wanted]

    def take_own_place(self, x_m: float, y_m: float, now: float) -> SharedPlace:
        """Take where this robot is, of which the others are to be told."""
        place = SharedPlace(x_m=x_m, y_m=y_m)
        self._places[self._robot] = place, now
        return place

    def hear(self, robot: str, channel: str, payload: bytes, now: float) -> None:
        """Take a message from another robot's key, or from the gate. Raises ProtocolError for bytes that are none."""
        if not re.fullmatch(ID, robot):
            raise ProtocolError("a message of no possible robot")
        if self._gated:
            heard = decode(Heard, payload)
            self._take(heard.sender, heard.kind, heard.payload)
        elif robot == self._robot:
            return
        elif channel == keys.PLACE:
            place = decode(SharedPlace, payload)
            if len(self._places) >= MAX_ROBOTS:
                self._places = {one: told for one, told in self._places.items() if now - told[1] <= HEARD_FOR_S}
            if robot in self._places or len(self._places) < MAX_ROBOTS:
                self._places[robot] = place, now
        else:
            send = decode(Send, payload)
            if send.to in (EVERYONE, self._robot) and self._in_range(robot, now):
                self._take(robot, send.kind, send.payload)

    def _take(self, sender: str, kind: str, payload: bytes) -> None:
        self._said[sender] += 1
        if self._said[sender] > MAX_SENDS or len(self._heard) >= MOST_HEARD or len(payload) > self._mtu_bytes:
            raise ProtocolError("messages on the radio that are too many or too long")
        self._heard.append(Heard(tick=0, sender=sender, kind=kind, payload=payload))

    def _in_range(self, robot: str, now: float) -> bool:
        """Whether both told lately where they are, and that is in range."""
        if self._range_m is None:
            return True
        known = [self._places[one] for one in (self._robot, robot) if one in self._places]
        if len(known) < 2 or any(now - since > HEARD_FOR_S for _, since in known):
            return False
        (here, _), (there, _) = known
        return math.hypot(here.x_m - there.x_m, here.y_m - there.y_m) <= self._range_m

    def take(self, tick: int) -> list[Heard]:
        """What was heard since the last time, for the step of a tick."""
        heard = [one.model_copy(update={"tick": tick}) for one in self._heard]
        self.forget()
        return heard

    def forget(self) -> None:
        """Leave out what was heard since the last step."""
        self._heard = []
        self._said.clear()
