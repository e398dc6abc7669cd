"""What is judged and recorded of a run: coverage, paths, maps and figures. Nothing here acts on the world."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Floats, Ints
from protocol.messages import EVERYONE
from protocol.talk import DELTA, MAP
from protocol.wireframe import Wireframe, decode_wireframe, encode_wireframe
from world.checkpoint import State, restore_array
from world.config import WorldConfig
from world.coverage import Coverage
from world.physics import Physics
from world.radio.gate import Books, Passage
from world.recorder import TEAM, MetricsRow, Recorder, seconds
from world.tick import Outputs
from world.way import interpolated
from world.worldfile import World

Fields = Mapping[str, Any]
"""Of a JSON file."""

METRICS_S = 1.0
"""Simulated time between the rows of metrics.csv."""
LEG_S = 0.2
"""Longest time between the places along which paths are measured: between them, a turning robot's way is taken for
straight."""


class Allowance(NamedTuple):
    """Bytes of a run directory that a robot may fill (ours)."""

    at_once: int
    """At any time."""
    a_second: int
    """So many more for each simulated second."""

    def until(self, t: float) -> float:
        """Bytes in the first t simulated seconds."""
        return self.at_once + self.a_second * t


ALLOWED = {"events": Allowance(256 * 1024, 1024), "maps": Allowance(2 << 20, 16 * 1024)}
"""`events`: events.jsonl, of which an honest robot fills 600 bytes in a tick and 40 a second. `maps`: updates.jsonl and
snapshots; of the former no robot of 94 filled more than 1,200 a second."""


class Look(NamedTuple):
    """What one tick showed of the truth."""

    rows: Ints
    """(r,) the live robots."""
    rays: Floats
    """(r, beams, 3) where their beams began and pointed."""
    ranges: Floats
    """(r, beams) m, true ranges."""
    met: Ints
    """(r, beams) the wall that each beam met; negative for beams that returned nothing or met no wall."""
    measured: NDArray[np.float32]
    """(r, beams) m, ranges as the lidars reported them."""
    odometry: Floats
    """(r, 3) what their wheels said."""
    passages: Sequence[Passage]
    """What became of messages."""


class Ledger:
    """The accounts of one run."""

    def __init__(
        self,
        config: WorldConfig,
        world: World,
        robots: Sequence[str],
        starts: Floats,
        books: Books,
        out: Path | None,
        state: State | None,
    ) -> None:
        """`starts` (k, 3): true poses at tick 0. `books`: the radio's. `out`: run directory, None records nothing.

        state: to go on from, None to begin.
        """
        spec = config.spec
        self.coverage = Coverage(world, starts, spec.radius_m, spec.lidar.range_max_m)
        self.path_m = np.zeros(len(robots))
        """(k,) metres that each robot has driven."""
        self._robots, self._books = list(robots), books
        self._row = {robot: row for row, robot in enumerate(robots)}
        self._period_s, self._snapshot_s = 1 / spec.lidar.rate_hz, config.snapshot_s
        self._maps: dict[str, Wireframe] = {}
        self._memory: dict[str, list[int]] = {robot: [0, 0] for robot in robots}
        """Bytes of each robot's map and filter, as it last said."""
        self._step_ms: dict[str, Counter[float]] = {robot: Counter() for robot in robots}
        """How often each robot's step took so many hundredths of a ms."""
        self._filled: Counter[str] = Counter()
        """Bytes by what they hold and the robot."""
        self._muted: set[str] = set()
        sizes = (spec.radius_m, spec.lidar.range_max_m)
        kept = state["files"] if state else {}
        self._recorder = Recorder(out, world, robots, starts, *sizes, kept, config.scans) if out else None
        if state is not None:
            self._restore(state)

    def state(self) -> State:
        """For a checkpoint. Files are written up to here."""
        return {
            "files": self._recorder.sizes() if self._recorder else {},
            "coverage": self.coverage.state(),
            "path_m": self.path_m.tobytes(),
            "maps": {robot: encode_wireframe(wireframe) for robot, wireframe in self._maps.items()},
            "memory": self._memory,
            "filled": self._filled,
            "muted": sorted(self._muted),
            "step_ms": {robot: list(counts.items()) for robot, counts in self._step_ms.items()},
        }

    def _restore(self, state: State) -> None:
        self.coverage.restore(state["coverage"])
        restore_array(self.path_m, state["path_m"])
        self._maps = {robot: decode_wireframe(data) for robot, data in state["maps"].items()}
        self._filled, self._muted = Counter(state["filled"]), set(state["muted"])
        for robot in self._robots:
            self._memory[robot] = [int(size) for size in state["memory"][robot]]
            self._step_ms[robot] = Counter({float(ms): int(count) for ms, count in state["step_ms"][robot]})

    def look(self, tick: int, look: Look, poses: Floats) -> None:
        """Account for what a tick showed; `poses` (k, 3) are those of all robots."""
        self.coverage.update(self._t(tick), tick, look.rows, look.rays, look.ranges, look.met)
        if self._recorder:
            self._recorder.radio(look.passages)
            self._recorder.trajectories(self._t(tick), poses)
            self._recorder.scans(self._t(tick), tick, look.rows, look.odometry, look.measured)
            if self._due(tick, METRICS_S):
                self._recorder.metrics(self._metrics(tick))

    def settle(self, tick: int) -> None:
        """Judge what the last answers merged: no look follows them."""
        self.coverage.judge(self._t(tick))

    def answer(self, tick: int, robot: str, outputs: Outputs, wireframe: Wireframe | None) -> None:
        """Account for a robot's answer to a tick; `wireframe` is its new map, if it sent one."""
        action = outputs.action
        merged = {self._row[peer]: merged_tick for peer, merged_tick in action.merged.items()}
        self.coverage.merge(tick, self._row[robot], merged)
        self._memory[robot] = [action.map_bytes, action.filter_bytes]
        if action.step_ms > 0:  # else nobody made a step, or nobody told its time
            self._step_ms[robot][round(action.step_ms, 2)] += 1
        if wireframe is not None:
            self._maps[robot] = wireframe
        if not self._recorder:
            return
        recorder, t, new = self._recorder, self._t(tick), self._maps.get(robot)
        for event in action.events:
            self._write("events", tick, robot, partial(recorder.event, t, tick, robot, event.event, event.data))
        if new is not None and self._due(tick, self._snapshot_s):
            self._write("maps", tick, robot, partial(recorder.snapshot, t, robot, new))
        # to whom something new of the map is told: what other forms of the map are charged for
        told = {send.to for send in outputs.sends if send.kind in (MAP, DELTA) and send.to != EVERYONE}
        if new is not None and told:
            names = sorted(told, key=self._row.__getitem__)
            self._write("maps", tick, robot, partial(recorder.update, t, tick, robot, names, new))

    def _write(self, what: str, tick: int, robot: str, write: Callable[..., int | None]) -> None:
        """Write what a robot says of itself; what is too much is left out, which is said once."""
        key, allowed = f"{what} {robot}", ALLOWED[what]
        size = write(most=allowed.until(self._t(tick)) - self._filled[key])
        self._filled[key] += size or 0
        if size is None and key not in self._muted:
            self._muted.add(key)
            reason = f"more than {allowed.at_once} bytes of {what} and {allowed.a_second} a second are left out"
            self.happened(tick, robot, "muted", reason)

    def drive(self, way: Floats) -> None:
        """Account for the way (s, k, 3) that ends a tick. Raises UnwritableError where it cannot be kept."""
        legs = math.ceil(self._period_s / LEG_S - 1e-9)
        moves = np.diff(interpolated(way, np.arange(legs + 1) / legs), axis=0)
        self.path_m += np.hypot(moves[..., 0], moves[..., 1]).sum(0)
        if self._recorder:
            self._recorder.check()

    def happened(self, tick: int, robot: str, event: str, reason: str) -> None:
        """Record what happened to a robot's process."""
        if self._recorder:
            self._recorder.event(self._t(tick), tick, robot, event, {"reason": reason})

    def close(
        self, tick: int, passages: Sequence[Passage], moved_to: Floats | None, summary: Fields, wire: Fields | None
    ) -> None:
        """Write what is left of the run directory; UnwritableError names files for which that cannot be done.

        moved_to: (k, 3) poses that the last actions led to, where no observation was made of them. wire: bytes on
        the robots' links, if they were counted.
        """
        if not self._recorder:
            return
        self._recorder.radio(passages)
        if moved_to is not None:
            self._recorder.trajectories(self._t(tick), moved_to)
        if moved_to is not None or not self._due(tick, METRICS_S):  # else the look at this tick has written them
            self._recorder.metrics(self._metrics(tick))
        for robot, wireframe in self._maps.items():
            self._recorder.snapshot(self._t(tick), robot, wireframe)
        bandwidth = self._books.as_dict(self._robots) | ({"wire": wire} if wire else {})
        self._recorder.close(self._maps, summary, bandwidth)

    def robot_figures(self, physics: Physics) -> dict[str, dict[str, Any]]:
        """Each robot's fields of summary.json but how it ended."""
        figures: dict[str, dict[str, Any]] = {}
        for row, robot in enumerate(self._robots):
            steps = self._step_ms[robot]
            figures[robot] = {
                "coverage": round(float(self.coverage.covered[row]), 6),
                **_milestones(self.coverage.reached[row]),
                "path_m": round(float(self.path_m[row]), 4),
                "wall_contacts": int(physics.wall_contacts[row]),
                "robot_contacts": int(physics.robot_contacts[row]),
                "bytes_sent": self._books.sent[robot],
                "bytes_received": self._books.received[robot],
                **dict(zip(("map_bytes", "filter_bytes"), self._memory[robot], strict=True)),
                "step_ms_median": round(median(steps.elements()), 4) if steps else None,
            }
        return figures

    def team_figures(self) -> dict[str, Any]:
        """The team's fields of summary.json."""
        return {
            "coverage": round(self.coverage.team, 6),
            **_milestones(self.coverage.team_reached),
            "overlap": round(self.coverage.overlap, 6),
        }

    def _t(self, tick: int) -> float:
        return seconds(tick * self._period_s)

    def _due(self, tick: int, every_s: float) -> bool:
        return tick % max(1, round(every_s / self._period_s)) == 0

    def _metrics(self, tick: int) -> Iterator[MetricsRow]:
        t, books, cover = self._t(tick), self._books, self.coverage
        for row, robot in enumerate(self._robots):
            vertices = len(self._maps[robot].points) if robot in self._maps else None
            covered, path_m = float(cover.covered[row]), float(self.path_m[row])
            yield MetricsRow(t, robot, covered, path_m, vertices, books.sent[robot], books.received[robot])
        path_m = float(self.path_m.sum())
        yield MetricsRow(t, TEAM, cover.team, path_m, None, books.sent.total(), books.received.total())


def _milestones(reached: Mapping[float, float]) -> dict[str, float | None]:
    return {f"t_{round(100 * share)}": reached.get(share) for share in Coverage.MILESTONES}
