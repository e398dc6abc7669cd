"""A run that is under way, as a recording that grows: the newest of each thing ten times a second, and robots' events.

Of what the world itself logs it publishes only who is dead.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from deploy.report.rundir import MAX_M, Map
from deploy.view.recording import ViewRecording, followed
from deploy.view.serving import Tape
from protocol import keys
from protocol.access import VIEWER, Credentials
from protocol.codec import decode
from protocol.errors import Interrupted, LinkError, ProtocolError
from protocol.inbox import Arrival, Inbox
from protocol.messages import Action, LinkReport, LinkTable, MapReport, Progress, Site, Whereabouts, scan_of
from protocol.session import at_once, open_client
from protocol.text import all_printable
from protocol.wireframe import decode_wireframe
from world.ledger import ALLOWED
from world.recorder import TEAM

SHOW_S = 0.1  # between two looks at what came: a screen needs no more
STILL = 5  # looks from one drawing of maps and coverage to the next: browsers without a GPU take few things a second
REACH_S = 10.0  # to reach the world
AHEAD_TICKS = 1000  # by which a robot may be ahead of where the world last said it is: seconds of the fastest run
_SITE, _WHEREABOUTS, _LINKS, _PROGRESS = map(keys.channel_of, (keys.SITE, keys.WHEREABOUTS, keys.LINKS, keys.PROGRESS))


def follow(endpoint: str, credentials: Credentials | None, tape: Tape, inbox: Inbox) -> None:
    """Record what a world and its robots publish until the run ends or the inbox is stopped.

    It reads and writes nothing; robots send it no more than they send the world. Raises LinkError where no world
    answers or a run ends before anything of it was seen, ProtocolError where the world says what cannot be read.
    """
    view, arrivals = None, list[Arrival]()
    with suppress(Interrupted), open_client(endpoint, REACH_S, VIEWER, credentials, lambda: inbox.stopped) as session:
        for key in (keys.ALL_TRUTH, keys.LINKS, keys.from_robot("*", keys.ACT), keys.from_robot("*", keys.MAP)):
            session.declare_subscriber(key, at_once(inbox.hear))
        while not inbox.stopped and (view is None or not view.ended):
            arrivals += _arrivals(inbox)
            view = view or _begun(arrivals, tape.file)
            if view is not None:
                view.take(arrivals)
                arrivals.clear()
                tape.grown()
            elif any(one.what == _PROGRESS and decode(Progress, one.payload).clock.ended for one in arrivals):
                raise LinkError("the run ended before anything of it was seen")
    if view is not None:
        view.recording.close()


def _arrivals(inbox: Inbox) -> Iterator[Arrival]:
    """What comes within SHOW_S."""
    deadline = time.monotonic() + SHOW_S
    while (arrival := inbox.take(deadline)) is not None:
        yield arrival


def _begun(arrivals: Iterable[Arrival], file: Path) -> _Live | None:
    """The view of a run, once its site and tick have come. Raises ProtocolError for a site that cannot be read."""
    came = {arrival.what: arrival.payload for arrival in arrivals}
    return _Live(decode(Site, came[_SITE]), file) if _SITE in came and _WHEREABOUTS in came else None


class _Live:
    """What is known of a run from what came."""

    def __init__(self, site: Site, file: Path) -> None:
        self.ended = False
        self._robots, frames = set(site.frames), {robot: np.array(pose) for robot, pose in site.frames.items()}
        self._period_s = 1 / site.spec.lidar.rate_hz
        self.recording = ViewRecording(file, list(frames), frames, self._period_s)
        self._lidar = site.spec.lidar
        self._maps: dict[str, Map] = {}
        self._links: list[LinkReport] = []
        self._tick = 0
        """The newest that the world told."""
        self._dead: set[str] = set()
        self._told: Counter[tuple[str, str]] = Counter()
        """Bytes of each robot's events, and of maps that they had drawn."""
        self._answered: dict[str, int] = {}
        """The last tick that each robot has answered: where the world says a tick again, so does a robot its answer."""
        self._newest: dict[tuple[str, str], bytes] = {}
        """By what it is and whose, what came and is not drawn yet."""
        self._looks = 0
        try:
            solid = shapely.from_wkb(site.solid)
        except shapely.errors.ShapelyError as error:
            raise ProtocolError(f"the world's walls cannot be read: {error}") from None
        if not (np.abs(shapely.get_coordinates(solid)) <= MAX_M).all():  # NaN is not
            raise ProtocolError("the world's walls cannot be read: they lie farther out than any wall")
        self.recording.scene(solid, site.spec.radius_m, followed())

    def take(self, arrivals: Iterable[Arrival]) -> None:
        """Draw what came: of robots' answers all events that the world writes down, of the rest the newest."""
        answers = []
        for arrival in arrivals:
            if arrival.what == keys.ACT:
                answers.append(arrival)
            else:
                self._newest[arrival.what, arrival.robot] = arrival.payload
        self._draw_newest(_WHEREABOUTS)
        for answer in answers:
            with suppress(ProtocolError):  # the world gives such a robot up
                self._act(answer.robot, decode(Action, answer.payload))
        self._looks += 1
        if self._looks % STILL == 0:
            self._draw_newest(_LINKS, keys.MAP, _PROGRESS)  # who is dead by the last one may have told a map before
        self.recording.flush()

    def _draw_newest(self, *kinds: str) -> None:
        for kind in kinds:
            for what, robot in [one for one in self._newest if one[0] == kind]:
                with suppress(ProtocolError):
                    self._draw(what, robot, self._newest.pop((what, robot)))

    def _may_say(self, robot: str, tick: int) -> bool:
        """Whether a robot may say something of a tick: one that was given up, or knows the future, is not heard."""
        return robot in self._robots - self._dead and tick <= self._tick + AHEAD_TICKS

    def _act(self, robot: str, action: Action) -> None:
        if action.tick <= self._answered.get(robot, -1) or not self._may_say(robot, action.tick):
            return
        self._answered[robot] = action.tick
        for event in action.events:
            if self._has_room("events", robot, action.tick, len(event.model_dump_json())):
                self._happened(action.tick, robot, event.event, event.data)

    def _has_room(self, what: str, robot: str, tick: int, size: int) -> bool:
        """Take so many bytes of a robot, or none where that is more than its run writes of it by then."""
        taken = self._told[what, robot] + size <= ALLOWED[what].until(tick * self._period_s)
        self._told[what, robot] += size * taken
        return taken

    def _draw(self, what: str, robot: str, payload: bytes) -> None:
        if what == _WHEREABOUTS:
            self._see(decode(Whereabouts, payload))
        elif what == _LINKS:
            self._links = decode(LinkTable, payload).links
        elif what == _PROGRESS:
            self._progress(decode(Progress, payload))
        elif what == keys.MAP:
            self._map(robot, decode(MapReport, payload))

    def _see(self, seen: Whereabouts) -> None:
        self._tick = max(self._tick, seen.tick)
        poses = {robot: pose for robot, pose in seen.poses.items() if robot in self._robots}
        for robot, pose in poses.items():
            self.recording.drive(robot, [seen.tick], np.array([pose]))
        for robot, ranges in seen.ranges.items():
            if robot in self._robots and len(scan := scan_of(ranges)) == self._lidar.beams:
                self.recording.beams(robot, [seen.tick], [scan], self._lidar)
        linked = [(link.sender, link.receiver) for link in self._links]
        ends = [(poses[one][:2], poses[other][:2]) for one, other in linked if one in poses and other in poses]
        self.recording.radio([seen.tick], [np.array(ends).reshape(-1, 2, 2)])

    def _progress(self, progress: Progress) -> None:
        clock = progress.clock
        self._tick = max(self._tick, clock.tick)
        for name, share in (*progress.coverage.items(), (TEAM, progress.team)):
            if name in self._robots or name == TEAM:
                self.recording.coverage(name, [clock.tick], np.array([share]))
        for robot, status in clock.status.items():
            if status == "dead" and robot in self._robots and robot not in self._dead:
                self._dead.add(robot)
                self._happened(clock.tick, robot, status, {})
        self.ended = clock.ended is not None

    def _map(self, robot: str, report: MapReport) -> None:
        if not self._may_say(robot, report.tick):
            return
        wireframe = decode_wireframe(report.wireframe)
        heard = frozenset(np.flatnonzero(~wireframe.own).tolist())
        drawn = Map(wireframe.points, wireframe.labels, wireframe.edges.astype(np.int64), heard)
        self._maps[robot] = drawn
        self.recording.maps(robot, [report.tick], [drawn])

    def _happened(self, tick: int, robot: str, name: str, data: dict[str, Any]) -> None:
        event = all_printable(data) | {"tick": tick, "robot": robot, "event": name}
        self.recording.events([tick], [event])
        peer = event.get("peer")
        tried = self._maps.get(peer) if isinstance(peer, str) and name == "proposed" else None
        if tried is not None and not self._has_room("maps", robot, tick, tried.vertices.nbytes + tried.edges.nbytes):
            tried = None  # a short event draws a long map
        self.recording.trust(tick, event, tried)
