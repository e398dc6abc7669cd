"""What robots ask the world: to be let in, why they are not, and to be let go."""

from collections import Counter

import zenoh

from protocol import keys
from protocol.codec import encode
from protocol.inbox import Arrival
from world.episode import Episode
from world.shell.inbox import refuse
from world.shell.participants import Participants
from world.shell.presence import LEFT, Presence

MOST_QUESTIONS = 16
"""Of a robot in a tick, or in SAY_AGAIN_S of a longer one (ours). One whose link is lost asks once when it is back."""


class Questions:
    """Answers them, so many of each robot in a tick."""

    def __init__(self, episode: Episode, participants: Participants, presence: Presence, *, lockstep: bool) -> None:
        """lockstep: as robots are told."""
        self._episode, self._participants, self._presence = episode, participants, presence
        self._lockstep = lockstep
        self._asked: Counter[str] = Counter()
        """Questions of each robot in this tick."""

    def end_tick(self) -> None:
        """Let everybody ask anew."""
        self._asked.clear()

    def reply(self, arrival: Arrival, query: zenoh.Query) -> None:
        """Answer a question. One too many gets no answer; who asks it honestly asks again."""
        self._asked[arrival.robot] += self._presence.began
        if self._asked[arrival.robot] > MOST_QUESTIONS:
            query.drop()  # type: ignore[no-untyped-call]
        elif arrival.what == keys.WHY:
            with query:
                refuse(query, self._participants.why_not(arrival.payload))
        elif arrival.what == keys.LEAVE:
            self._let_go(arrival, query)
        else:
            self._let_in(arrival, query)

    def _let_in(self, arrival: Arrival, query: zenoh.Query) -> None:
        robot, processes = arrival.robot, self._participants.processes
        before = processes.get(robot)
        with query:
            refusal = self._participants.admit(robot, arrival.what, arrival.payload)
            if refusal is not None:
                refuse(query, refusal)
                return
            query.reply(query.key_expr, encode(self._episode.welcome(robot, lockstep=self._lockstep)))
        self._presence.let_in(robot, replaced=processes[robot] != before)

    def _let_go(self, arrival: Arrival, query: zenoh.Query) -> None:
        with query:
            refusal = self._participants.dismiss(arrival.robot, arrival.payload)
            if refusal is not None:
                refuse(query, refusal)
                return
            query.reply(query.key_expr, b"")
        self._presence.part_with(arrival.robot, LEFT)
