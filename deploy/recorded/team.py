"""Several logs as a team: played at once, with a radio that carries as far as reference poses of the robots allow.

Each log is a robot of its own, in its own frame. Nobody's mind learns a reference pose: they only gate the radio.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import numpy as np

from agent.config import AgentConfig
from agent.passenger import Passenger
from deploy.recorded.lidar_log import LidarLog, Scan
from protocol.arrays import Floats
from protocol.document import read_text
from protocol.errors import InputError
from protocol.geometry import Pose, pose_of, relative
from protocol.messages import EVERYONE, Event, Heard, Observation, OdometrySpec, RobotSpec, Send

RATES_HZ = 0.01, 100.0  # of a lidar, as a LidarSpec may have them
AS_TOLD = OdometrySpec(noisy=False)
"""Odometry for whose errors nothing is made ready: how far a log's is off is in `agent.passenger`."""
MAX_REFERENCE_BYTES = 100_000_000  # a million poses


def _read_reference(file: Path) -> dict[int, tuple[float, float]]:
    """Places by the number of their scan, from `NUMBER x y z qx qy qz qw` lines. Raises InputError."""
    try:
        lines = read_text(file, MAX_REFERENCE_BYTES).splitlines()
        with catch_warnings(action="ignore"):  # of a file without lines
            rows = np.loadtxt(lines, ndmin=2)
        if rows.shape[1] != 8 or not np.isfinite(rows).all() or not len(rows):
            raise ValueError("lines of eight finite numbers are wanted")
        if (strange := rows[(rows[:, 0] < 0) | (rows[:, 0] % 1 != 0), 0]).size:
            raise ValueError(f"a line begins with the number of a scan, counted from 0, and not with {strange[0]:.12g}")
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: no reference poses: {error}") from None
    return {int(row[0]): (float(row[1]), float(row[2])) for row in rows}


def refer(logs: Sequence[LidarLog], files: Sequence[Path]) -> None:
    """Tell logs where they were, by one file each. Raises InputError."""
    if files and len(files) != len(logs):
        raise InputError(f"--reference: one file a log is wanted; there are {len(logs)} logs and {len(files)} files")
    for log, file in zip(logs, files, strict=False):
        log.reference = _read_reference(file)
        if log.reference.keys().isdisjoint(scan.number for scan in log.scans):
            first, last = log.scans[0].number, log.scans[-1].number
            told = f"{min(log.reference)} to {max(log.reference)}"
            raise InputError(
                f"{file}: no reference poses: its lines are of scans {told}, and the log has {first} to {last}"
            )


def cut(logs: Sequence[LidarLog], parts: int) -> list[LidarLog]:
    """Each log in so many parts of as many scans. Raises InputError where a part would have none."""
    out = []
    for log in logs:
        cuts = [round(k * len(log.scans) / parts) for k in range(parts + 1)]
        for k, (begin, end) in enumerate(pairwise(cuts)):
            if begin == end:
                raise InputError(f"{log.source}: it has {len(log.scans)} scans, too few for {parts} parts")
            out.append(log.part(begin, end, f"part {k + 1} of {parts}") if parts > 1 else log)
    return out


@dataclass
class Player:
    """One log on its way through a mind."""

    name: str
    log: LidarLog
    mind: Passenger
    ticks: list[int]
    """Of each scan."""
    places: Floats
    """(scans, 2) by the reference, metres; NaN where that tells none."""
    gap: float
    """Ticks from scan to scan up to which the log does not pause."""
    inbox: list[Heard] = field(default_factory=list)
    done: int = 0
    """Scans."""
    sent_bytes: int = 0
    received_bytes: int = 0
    events: list[dict[str, Any]] = field(default_factory=list)
    """Lines of events.jsonl."""
    step_ms: list[float] = field(default_factory=list)

    def step(self, tick: int, period_s: float) -> list[Send]:
        """Take the next scan and all that was heard since the last; what it sends."""
        begin = time.perf_counter()
        scan = self.log.scans[self.done]
        sends, events = self.mind.step(_observation(tick, scan, self.log.scans[0].odometry), self.inbox)
        self.inbox, self.done = [], self.done + 1
        if self.done == len(self.log.scans):
            events = [*events, *self.mind.finish(tick)]
        self.step_ms.append(1e3 * (time.perf_counter() - begin))
        self.sent_bytes += sum(len(send.payload) for send in sends)
        self._note(tick, period_s, events)
        return sends

    def _note(self, tick: int, period_s: float, events: Sequence[Event]) -> None:
        when = {"t": round(tick * period_s, 3), "tick": tick, "robot": self.name}
        self.events += [when | {"event": event.event} | event.data for event in events]

    def hears(self, tick: int, sender: "Player", range_m: float) -> bool:
        """Whether a message sent now gets to the next scan: one that comes soon, and not out of range by the reference.

        Who pauses is deaf: what was said meanwhile would count as heard where the log goes on.
        """
        if self.done == len(self.ticks) or self.ticks[self.done] - tick > self.gap:
            return False
        return not math.dist(self.places[self.done], sender.places[sender.done - 1]) > range_m

    def hear(self, heard: Heard) -> None:
        """Take a message."""
        self.inbox.append(heard)
        self.received_bytes += len(heard.payload)


def play(
    logs: Sequence[LidarLog], config: AgentConfig, range_m: float, progress: Callable[[str, int], None]
) -> list[Player]:
    """Let a mind map each log, r1 the first, while all hear each other within the range.

    progress is told how many scans a robot has done. Logs that were recorded at the same time are played so, and others
    from their begins on.
    """
    times = [np.array([scan.time_s for scan in log.scans]) for log in logs]
    at_once = max(one[0] for one in times) < min(one[-1] for one in times)
    begins = [min(one[0] for one in times) if at_once else one[0] for one in times]
    steps = [step[step > 0] for step in map(np.diff, times)]
    usual_s = min((float(np.median(own)) for own in steps if len(own)), default=1.0)  # of the fastest
    period_s = min(max(usual_s, 1 / RATES_HZ[1]), 1 / RATES_HZ[0])
    places = [log.places() for log in logs]
    gated = all(np.isfinite(one).all() for one in places)
    players = []
    for k, log in enumerate(logs):
        lidar = log.lidar.model_copy(update={"rate_hz": 1 / period_s})
        spec = RobotSpec(lidar=lidar, odometry=AS_TOLD, radio_range_m=range_m if gated else None)
        ticks = _ticks((times[k] - begins[k]) / period_s)
        gap = max(log.gap_s() / period_s, 1.0)
        players.append(Player(f"r{k + 1}", log, Passenger(spec, config), ticks, places[k], gap))
    order = sorted((tick, k) for k, player in enumerate(players) for tick in player.ticks)
    for tick, turns in groupby(order, key=lambda turn: turn[0]):
        said = [(k, players[k].step(tick, period_s)) for _, k in turns]
        for k, sends in said:
            _deliver(tick, players, players[k], sends, range_m)
            progress(players[k].name, players[k].done)
    return players


def _ticks(moments: Floats) -> list[int]:
    """Whole numbers near to moments (n,), each greater than the one before."""
    out: list[int] = []
    for moment in np.rint(moments).astype(np.int64).tolist():
        out.append(max(moment, out[-1] + 1) if out else max(moment, 0))
    return out


def _deliver(tick: int, players: Sequence[Player], sender: Player, sends: Sequence[Send], range_m: float) -> None:
    for receiver in players:
        if receiver is not sender and sends and receiver.hears(tick, sender, range_m):
            for send in sends:
                if send.to in (EVERYONE, receiver.name):
                    receiver.hear(Heard(tick=tick, sender=sender.name, kind=send.kind, payload=send.payload))


def _observation(tick: int, scan: Scan, origin: Pose) -> Observation:
    """A scan as a mind takes it, the odometry from where the log began."""
    ranges, odometry = scan.ranges.astype("<f4").tobytes(), relative(origin, scan.odometry)
    if scan.way is None:
        return Observation(tick=tick, ranges=ranges, odometry=odometry)
    way = np.array([*(relative(origin, pose_of(pose)) for pose in scan.way[:-1]), odometry], "<f8")
    return Observation(tick=tick, ranges=ranges, odometry=odometry, way=way.tobytes())
