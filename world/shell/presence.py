"""Who comes into a run, goes, comes back, and is given up."""

from collections import Counter
from collections.abc import Callable, Collection

from protocol import keys
from protocol.codec import encode
from protocol.messages import End, clipped
from world.config import ServerConfig
from world.episode import Episode
from world.recorder import REPLACED
from world.shell.answers import Answers
from world.shell.participants import Participants
from world.shell.voice import Voice

ENDED, LEFT, LOST = "its process ended", "it took its leave", "its link was lost"
"""Why a robot left."""


class Presence:
    """The robots of a run, from its first tick on: those that are here, and what the log tells of them."""

    def __init__(
        self,
        episode: Episode,
        config: ServerConfig,
        participants: Participants,
        answers: Answers,
        voice: Voice,
        known: Callable[[str], str | None] | None,
    ) -> None:
        """known: the Zenoh ID that a robot must have, as in `Participants`."""
        self._episode, self._participants, self._answers, self._voice = episode, participants, answers, voice
        self._known, self._lockstep, self._silence_s = known, config.real_time is None, config.silence_s
        self.began = False
        """Whether the run is between its first tick and its last."""
        self.silent: Counter[str] = Counter()
        """How often each robot was waited for in vain: in lockstep for SAY_AGAIN_S of this tick, since it came back for
        the first time in it; in real time for a tick, since it was heard, or its link came or went."""
        self._away: set[str] = set()
        """Robots that were here and whose link is lost."""
        self._returned: set[str] = set()
        """Robots that came back in this tick; who comes and goes is not waited for without end."""
        self._newcomers: dict[str, str] = {}
        """Robots whose process came in this tick, `joined` or `rejoined`."""
        self._losers: set[str] = set()
        """Robots whose link was lost in this tick."""

    @property
    def here(self) -> Collection[str]:
        """Robots that have joined the run; in lockstep their answers are waited for, even while they are away."""
        return self._episode.processes

    @property
    def live(self) -> list[str]:
        """Robots that are here and not dead."""
        return [robot for robot in self._episode.live if robot in self.here]

    @property
    def still_away(self) -> list[str]:
        """Robots that have joined the run, live, and are not ready now."""
        live = self.live
        return [robot for robot in self._participants.missing if robot in live]

    @property
    def on_time(self) -> list[str]:
        """Robots that were told all of this tick in real time: who came back in it was not, who is away misses none."""
        return [robot for robot in self._participants.ready if robot in self.here and robot not in self._newcomers]

    def begin(self, ready: Collection[str]) -> None:
        """Begin, or go on, with these robots."""
        self.began = True
        self._away = set(self.still_away)
        if not self._lockstep and self._episode.ended is None:
            # in a run that goes on, all links were lost with its world, also of those that are back
            for robot in self.live:
                self._episode.happened(robot, "left", LOST)
            self._newcomers |= {robot: "rejoined" for robot in ready if robot in self.here}
        for robot in ready:
            if robot not in self._newcomers:
                self._arrive(robot)

    def end_tick(self) -> None:
        """Forget who came and went in this tick, once those who are late in it are counted."""
        self._losers.clear()
        self._returned.clear()

    def let_in(self, robot: str, *, replaced: bool) -> None:
        """A robot was let in. replaced: by another process than before."""
        # in real time it has `left`, and has `rejoined` once it is ready
        if self._lockstep and robot in self.here and replaced:
            self._newcomers.setdefault(robot, "rejoined")  # one that `joined` in this tick still has
        self.welcome_back(robot)

    def welcome_back(self, robot: str) -> None:
        """A robot that was away, or is late, may be ready now."""
        if not self.began or not self._participants.is_ready(robot):
            return
        self._voice.follow()
        if robot not in self.here:
            self._arrive(robot)
            self._newcomers[robot] = "joined"
        elif robot in self._away:
            self._away.remove(robot)
            if not self._lockstep:
                self._newcomers[robot] = "rejoined"
            if robot not in self._returned:
                self._returned.add(robot)
                self.silent.pop(robot, None)
        self.say_again(robot)

    def say_again(self, robot: str) -> None:
        """Say the tick again to a robot whose link was lost in lockstep; in real time the next one will do."""
        if self._lockstep and robot in self.here:
            self._answers.again(robot)
            self._voice.say_tick(robot, self._episode.inputs()[robot])

    def lose(self, robot: str) -> None:
        """A link is lost: the process behind it may have ended, or stand still and come back.

        That is told once a tick, as a robot may take its token away and give it back as often as it likes.
        """
        if not self.began or robot not in self.live:
            return
        self._episode.links_lost += 1
        self._away.add(robot)
        if robot in self._losers:
            if not self._lockstep:  # it has `left` in this tick, and has not come back
                self._newcomers.pop(robot, None)
            return
        self._losers.add(robot)
        if not self._lockstep:
            self.silent.pop(robot, None)
            self._note_newcomer(robot)
            self._episode.happened(robot, "left", LOST)
        self._voice.tell()

    def note_newcomers(self) -> None:
        """Log who came in this tick. In lockstep a process that was away and is the same one has missed nothing."""
        for robot in self._episode.live:
            self._note_newcomer(robot)
        self._newcomers.clear()

    def _note_newcomer(self, robot: str) -> None:
        event = self._newcomers.pop(robot, None)
        if event is None:
            return
        replaced = self._arrive(robot) and event == "rejoined"  # who joined took nobody's place, though it was replaced
        if event == "rejoined" and self._lockstep:
            self._episode.came_back(robot)
        else:
            self._episode.happened(robot, event, REPLACED if replaced else "its process is ready")

    def _arrive(self, robot: str) -> bool:
        """Keep in mind which process is the robot's; whether it is another than before."""
        if new := self._episode.processes.get(robot) != self._participants.processes[robot]:
            self._episode.arrive(robot, self._participants.processes[robot])
        return new

    def gave_up(self, robot: str, wait_s: float) -> bool:
        """Whether a robot has said nothing for silence_s, in waits of wait_s, and is given up for it."""
        if silent := self.silent[robot] * wait_s >= self._silence_s:
            who = f"{LOST}, and it" if robot in self._away else "it"
            self.give_up(robot, f"{who} said nothing for {self._silence_s:g} s")
        return silent

    def expel(self) -> None:
        """Give up robots whose credentials count no longer."""
        for robot, session in self._participants.sessions.items():
            if self._known is not None and robot in self._episode.live and self._known(robot) != session:
                self.give_up(robot, "its certificate was revoked")

    def part_with(self, robot: str, reason: str) -> None:
        """Go on without a robot that will not come back; before the first tick it may be started again."""
        if self.began:
            self.give_up(robot, reason)

    def give_up(self, robot: str, reason: str) -> None:
        """Go on without a robot, and tell it why."""
        self._away.discard(robot)
        self._voice.say(robot, keys.END, encode(End(reason=clipped(f"given up by the world: {reason}"))))
        self._episode.kill(robot, reason)
