"""What comes to the world: robots' samples, changes of their liveliness tokens, and their questions."""

import zenoh

from protocol import keys
from protocol.inbox import Arrival, Inbox


class WorldInbox(Inbox):
    """Arrivals of all robots in one order, which one thread takes."""

    ALIVE, GONE, ENDED = "token", "no-token", "ended"

    def end(self, robot: str) -> None:
        """Take the launcher's word that a robot's process has ended for good."""
        self.put(Arrival(self.ENDED, robot))

    def watch(self, sample: zenoh.Sample) -> None:
        """Take a change of a robot's liveliness token."""
        what = self.ALIVE if sample.kind == zenoh.SampleKind.PUT else self.GONE
        self.put(Arrival(what, keys.robot_of(str(sample.key_expr))))

    def ask(self, query: zenoh.Query) -> None:
        """Take a question on robots/*/srv/**."""
        key = str(query.key_expr)
        payload = query.payload.to_bytes() if query.payload is not None else b""
        self.put(Arrival(keys.channel_of(key), keys.robot_of(key), payload, query))
