"""A robot with credentials of its own that attacks a run, between answers that are honest."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import zenoh

from agent.config import AgentConfig
from agent.shell.process import answer, publishers_of
from protocol import keys
from protocol.access import Credentials
from protocol.codec import decode, encode
from protocol.inbox import Inbox
from protocol.messages import PROTOCOL_VERSION, End, Heard, Join, Observation, Welcome
from protocol.session import at_once, open_client, wait_for_matching
from tests.wanderer import endless

PATIENCE_S = 20.0
Attack = Callable[["Intruder", int], bool | None]
"""What to do before the answer to a tick; true where that was an answer."""


class Intruder:
    """A robot's process over Zenoh, as in agent.shell.process, with its session at hand."""

    def __init__(self, robot: str, endpoint: str, credentials: Credentials) -> None:
        self.robot, self.endpoint, self.credentials = robot, endpoint, credentials
        self.inbox = Inbox()
        self._open = ExitStack()
        self.connect()

    def connect(self) -> None:
        """Open a session, ask to be let in, and say that all is ready."""
        declare = self._open.enter_context
        self.session = declare(open_client(self.endpoint, PATIENCE_S, self.robot, self.credentials))
        self.question = encode(
            Join(version=PROTOCOL_VERSION, robot=self.robot, session=str(self.session.info.zid()), process="0a")
        )
        while not (replies := self.ask(keys.JOIN)) or replies[0].ok is None:
            pass  # the world is not there yet
        self.welcome = decode(Welcome, replies[0].ok.payload.to_bytes())
        declare(self.session.declare_subscriber(keys.to_robot(self.robot), at_once(self.inbox.hear)))
        self.publishers = {
            channel: declare(one) for channel, one in publishers_of(self.session, self.robot, True).items()
        }
        wait_for_matching([self.publishers[channel] for channel in keys.NEEDED], PATIENCE_S, lambda: False)
        self.take_token()

    def reconnect(self) -> None:
        """Close the session, and open another one."""
        self._open.close()
        self.connect()

    def ask(self, service: str) -> list[zenoh.Reply]:
        """Replies to a question of this robot."""
        return list(self.session.get(keys.service(self.robot, service), payload=self.question, timeout=5.0))

    def take_token(self) -> None:
        """Say that the robot is there."""
        self.token = self.session.liveliness().declare_token(keys.alive(self.robot))

    def live(self, attack: Attack) -> str:
        """Answer each tick once as a wanderer does, and attack before; returns why the run ended."""
        mind = endless(self.robot, self.welcome.spec, AgentConfig(), self.welcome.seed)
        heard: list[Heard] = []
        said: dict[int, Any] = {}
        with self._open:
            while True:
                arrival = self.inbox.next()
                match arrival.what:
                    case keys.RADIO:
                        heard.append(decode(Heard, arrival.payload))
                    case keys.OBS:
                        observation = decode(Observation, arrival.payload)
                        tick = observation.tick
                        if tick not in said:
                            now = [message for message in heard if message.tick == tick]
                            said[tick] = mind.step(observation, now[len(now) - observation.heard :])
                            if attack(self, tick):
                                continue
                        answer(self.publishers, said[tick])
                    case keys.END:
                        return decode(End, arrival.payload).reason
