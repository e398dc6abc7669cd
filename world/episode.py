"""One run of the world, tick by tick: observations out, actions in. No clock, no network."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.errors import ProtocolError
from protocol.messages import (
    EVERYONE,
    PROTOCOL_VERSION,
    Action,
    Heard,
    LinkReport,
    MapReport,
    Observation,
    Send,
    Welcome,
)
from protocol.talk import DELTA, MAP
from protocol.wireframe import Wireframe, decode_wireframe
from world.config import WorldConfig
from world.coverage import Coverage
from world.lidar import Lidar
from world.odometry import Odometry
from world.physics import Physics
from world.radio import Passage, Radio
from world.recorder import Recorder, seconds
from world.worldfile import load

METRICS_S = 1.0
"""Simulated time between the rows of metrics.csv (contracts.md)."""

TEAM = "team"
"""The name of the union of all robots in metrics.csv."""


class Inputs(NamedTuple):
    """What a live robot gets in one tick."""

    heard: list[Heard]
    observation: Observation


class Look(NamedTuple):
    """What one tick showed, for the books."""

    rows: NDArray[np.intp]
    """(r,) the live robots."""
    poses: NDArray[np.float64]
    """(r, 3) true ones."""
    ranges: NDArray[np.float64]
    """(r, beams) m, true ones."""
    met: NDArray[np.intp]
    """(r, beams) the wall that each beam met, -1 for none."""
    passages: Sequence[Passage]
    """What became of messages."""


class Outputs(NamedTuple):
    """What a live robot answers."""

    sends: list[Send]
    action: Action
    map: MapReport | None


class BadOutputsError(ProtocolError):
    """A robot answered what cannot be; kill it and advance with the others."""

    def __init__(self, robot: str, reason: str) -> None:
        super().__init__(f"{robot}: {reason}")
        self.robot = robot


class Episode:
    """The truth of one run. Deterministic: the same config and the same answers give the same bytes."""

    def __init__(self, config: WorldConfig, out: Path | None) -> None:
        """`out` is the run directory, None to record nothing.

        Raises WorldFileError for a world that cannot be run, OSError where `out` cannot be written.
        """
        spec = config.spec
        self.config = config
        self.world = load(config.world)
        self.robots = [f"r{i + 1}" for i in range(config.robots)]
        self.tick = 0
        self.period_s = 1 / spec.lidar.rate_hz
        self.ended: str | None = None
        """None while it runs; "complete", "time", "dead" (nobody left), or what `close` was told."""
        self.late_ticks = 0
        """Set by a shell in real time: ticks that robots missed."""
        self.wall_s: float | None = None
        """Set by a shell before `close`: seconds that the run took; the core has no clock."""
        self.wire: dict[str, Any] | None = None
        """Set by a shell before `close`: bytes on the robots' links, for bandwidth.json."""
        self.complete = dict.fromkeys(self.robots, False)
        """Whether each robot's last action said that it is complete."""
        self.dead: dict[str, str] = {}
        """Dead robots, and why."""

        rng = generator(config.seed, "starts")
        self.starts = self.world.starts(config.robots, spec.radius_m, rng, drawn=config.starts == "random")
        """(k, 3) poses in the world at tick 0: the robots' own frames."""
        self._rows = {robot: i for i, robot in enumerate(self.robots)}
        self._physics = Physics(self.world.segments, self.starts, spec, config.physics, self.period_s)
        self._lidar = Lidar(self.world.segments, spec.lidar, one_sided=True)
        self._scanning = [generator(config.seed, "lidar", robot) for robot in self.robots]
        self._odometry = [
            Odometry(start, config.spec.odometry, generator(config.seed, "odometry", robot))
            for robot, start in zip(self.robots, self.starts, strict=True)
        ]
        reach = spec.lidar.range_max_m
        self._coverage = Coverage(self.world, self.starts, spec.radius_m, reach, config.coverage)
        self._radio = Radio(self.robots, config.radio, config.seed, self.period_s, self.world.segments)
        self._path = np.zeros(config.robots)
        self._maps: dict[str, Wireframe] = {}
        self._last: dict[str, Action] = {}
        self._step_ms: dict[str, list[float]] = {robot: [] for robot in self.robots}
        self._inputs: dict[str, Inputs] | None = None
        self._unbooked: Look | None = None
        self._closed = False
        self._recorder = Recorder(out, self.world, self.robots, self.starts, spec.radius_m, reach) if out else None

    @property
    def t(self) -> float:
        """Simulated seconds at this tick."""
        return seconds(self.tick * self.period_s)

    @property
    def live(self) -> list[str]:
        """Robots that are not dead."""
        return [robot for robot in self.robots if robot not in self.dead]

    @property
    def poses(self) -> NDArray[np.float64]:
        """(k, 3) true poses at this tick."""
        return self._physics.poses

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the visible wall that each robot has covered, by own beams or merged maps (contracts.md)."""
        self.book()
        return dict(zip(self.robots, self._coverage.covered.tolist(), strict=True))

    @property
    def paths(self) -> dict[str, float]:
        """Metres that each robot has driven."""
        return dict(zip(self.robots, self._path.tolist(), strict=True))

    @property
    def team_coverage(self) -> float:
        """The same for all robots' beams together."""
        self.book()
        return self._coverage.team

    @property
    def links(self) -> list[LinkReport]:
        """Who hears whom, as the public link table says it."""
        return self._radio.table(self.tick)

    def welcome(self, robot: str) -> Welcome:
        """What a robot must know of its body and seed."""
        rng = generator(self.config.seed, "mind", robot)
        return Welcome(
            version=PROTOCOL_VERSION,
            robot=robot,
            spec=self.config.spec.model_copy(
                update={
                    "radio_range_m": self.config.radio.range_m,
                    "radio_mtu_bytes": self.config.radio.mtu_bytes,
                }
            ),
            seed=int(rng.integers(2**63)),
            lockstep=True,
        )

    def inputs(self) -> dict[str, Inputs]:
        """Per live robot what the radio delivers at this tick and what it sees; the same on every call."""
        if self._inputs is None:
            self._inputs = self._look()
        return {robot: inputs for robot, inputs in self._inputs.items() if robot not in self.dead}

    def _look(self) -> dict[str, Inputs]:
        heard, passages = self._radio.deliver(self.tick, self.live)
        rows = np.array([self._rows[robot] for robot in self.live], np.intp)
        poses = self.poses[rows]
        radius = np.full((len(self.robots), 1), self.config.spec.radius_m)
        ranges, met = self._lidar.trace(poses, np.hstack([self.poses[:, :2], radius]))
        measured = self._lidar.measured(ranges, [self._scanning[row] for row in rows]) if len(rows) else ranges
        met[np.isinf(measured)] = -1  # a beam that returned nothing covers nothing
        self._unbooked = Look(rows, poses, ranges, met, passages)
        return {
            robot: Inputs(
                heard[robot],
                Observation(
                    tick=self.tick,
                    ranges=scan.astype("<f4").tobytes(),
                    odometry=self._odometry[row].update(pose),
                    heard=len(heard[robot]),
                ),
            )
            for robot, row, scan, pose in zip(self.live, rows.tolist(), measured, poses, strict=True)
        }

    def book(self) -> None:
        """Account for coverage and radio of this tick, and record them.

        Costs nobody time where a shell calls it while the robots think; otherwise `advance` does it.
        """
        look, self._unbooked = self._unbooked, None
        if look is None:
            return
        self._coverage.update(self.t, self.tick, look.rows, look.poses, look.ranges, look.met)
        if self._recorder:
            self._recorder.radio(look.passages)
            for robot, pose in zip(self.robots, self.poses.tolist(), strict=True):
                self._recorder.trajectory(self.t, robot, pose)
            if self._due(METRICS_S):
                self._write_metrics()

    def advance(self, outputs: Mapping[str, Outputs]) -> None:
        """Take the answers of all live robots to this tick, and drive to the next.

        Raises BadOutputsError, a ProtocolError that names the robot, before anything has changed; KeyError
        where a live robot's answer is missing.
        """
        live = self.live
        maps = {robot: self._checked(robot, outputs[robot]) for robot in live}
        self.inputs()  # a shell that skipped them still gets the same world
        self.book()
        commands = np.zeros((len(self.robots), 2))
        for robot in live:
            action, wireframe = outputs[robot].action, maps[robot]
            commands[self._rows[robot]] = action.speed_mps, action.turn_rps
            self.complete[robot] = action.complete
            self._last[robot] = action
            self._coverage.merge(
                self.tick, self._rows[robot], {self._rows[peer]: tick for peer, tick in action.merged.items()}
            )
            self._step_ms[robot].append(action.step_ms)
            if wireframe is not None:
                self._maps[robot] = wireframe
            self._record(robot, action)
            self._record_updates(robot, outputs[robot].sends)
        if self._recorder and self._due(self.config.snapshot_s):
            self._recorder.flush()
        self._radio.offer(self.tick, {robot: outputs[robot].sends for robot in live}, self.poses[:, :2])
        before = self.poses
        after = self._physics.advance(commands)
        self._path += np.hypot(*(after - before)[:, :2].T)
        self.tick += 1
        self._inputs = None
        if self.ended is None:
            self.ended = self._end()

    def _record(self, robot: str, action: Action) -> None:
        if not self._recorder:
            return
        for event in action.events:
            self._recorder.event(self.t, self.tick, robot, event.event, event.data)
        if self._due(self.config.snapshot_s) and robot in self._maps:
            self._recorder.snapshot(self.t, robot, self._maps[robot])

    def _record_updates(self, robot: str, sends: Sequence[Send]) -> None:
        """The map at each moment at which a robot tells peers something new of it: what baselines are charged for."""
        told = sorted(
            {send.to for send in sends if send.kind in (MAP, DELTA) and send.to != EVERYONE}, key=self._rows.__getitem__
        )
        if self._recorder and told and robot in self._maps:
            self._recorder.update(self.t, self.tick, robot, told, self._maps[robot])

    def _checked(self, robot: str, outputs: Outputs) -> Wireframe | None:
        """The new map of a robot's answer, if any; raises BadOutputsError."""
        action = outputs.action
        ticks = {action.tick, *(send.tick for send in outputs.sends)}
        ticks |= {outputs.map.tick} if outputs.map is not None else set()
        if ticks != {self.tick}:
            wrong = min(ticks - {self.tick})
            raise BadOutputsError(robot, f"answered for tick {wrong} at tick {self.tick}")
        if action.sent != len(outputs.sends):
            raise BadOutputsError(robot, f"says it sent {action.sent} messages, but {len(outputs.sends)} came")
        if not (math.isfinite(action.speed_mps) and math.isfinite(action.turn_rps)):
            raise BadOutputsError(robot, "a drive command is not finite")
        for peer, tick in action.merged.items():
            if peer == robot or peer not in self._rows or tick > self.tick:
                raise BadOutputsError(robot, f"cannot have merged a map of {peer} at tick {tick}")
        try:
            self._radio.check(robot, outputs.sends)
            return decode_wireframe(outputs.map.wireframe) if outputs.map is not None else None
        except ProtocolError as error:
            raise BadOutputsError(robot, str(error)) from None

    def _end(self) -> str | None:
        until = self.config.until
        if not self.live:
            return "dead"
        if until == "complete" and all(self.complete[robot] for robot in self.live):
            return "complete"
        limit = self.config.max_time_s if until == "complete" else min(until, self.config.max_time_s)
        return "time" if self.t >= limit - 1e-6 else None

    def kill(self, robot: str, reason: str) -> None:
        """Log a robot as dead: it stands where it is, hears and says nothing more; the others go on."""
        if robot in self.dead:
            return
        self.dead[robot] = reason
        if self._recorder:
            self._recorder.event(self.t, self.tick, robot, "dead", {"reason": reason})
        if not self.live and self.ended is None:
            self.ended = "dead"

    def close(self, ended: str | None = None) -> None:
        """Write what is left of the run directory; `ended` says why, where the run did not end by itself."""
        if self._closed:
            return
        self._closed = True
        self.book()
        self.ended = self.ended or ended or "interrupted"
        _, passages = self._radio.deliver(self.tick, self.live, ended=True)
        if not self._recorder:
            return
        self._recorder.radio(passages)
        if self._inputs is None:  # the pose that the last actions led to
            for robot, pose in zip(self.robots, self.poses.tolist(), strict=True):
                self._recorder.trajectory(self.t, robot, pose)
        self._write_metrics()
        for robot, wireframe in self._maps.items():
            self._recorder.snapshot(self.t, robot, wireframe)
        bandwidth = self._radio.books.as_dict(self.robots) | ({"wire": self.wire} if self.wire else {})
        self._recorder.close(self._maps, self.summary(), bandwidth)

    def summary(self) -> dict[str, Any]:
        """The fields of summary.json."""
        books, cover = self._radio.books, self._coverage
        robots = {}
        for row, robot in enumerate(self.robots):
            last = self._last.get(robot)
            steps = self._step_ms[robot]
            robots[robot] = {
                "coverage": round(float(cover.covered[row]), 6),
                **_milestones(cover.reached[row]),
                "path_m": round(float(self._path[row]), 4),
                "wall_contacts": int(self._physics.wall_contacts[row]),
                "robot_contacts": int(self._physics.robot_contacts[row]),
                "bytes_sent": books.sent[robot],
                "bytes_received": books.received[robot],
                "map_bytes": last.map_bytes if last else 0,
                "filter_bytes": last.filter_bytes if last else 0,
                "step_ms_median": round(median(steps), 4) if steps else None,
                "ended": self._how(robot),
            }
        team = {
            "coverage": round(cover.team, 6),
            **_milestones(cover.team_reached),
            "overlap": round(float(cover.own.sum()) - 1, 6),
        }
        factor = round(self.t / self.wall_s, 2) if self.wall_s else None
        return {
            "robots": robots,
            "team": team,
            "real_time_factor": factor,
            "late_ticks": self.late_ticks,
        }

    def _how(self, robot: str) -> str:
        """How a robot ended: complete, time, dead, interrupted."""
        if robot in self.dead:
            return "dead"
        if self.complete[robot]:
            return "complete"
        return self.ended or "interrupted"

    def _due(self, every_s: float) -> bool:
        return self.tick % max(1, round(every_s / self.period_s)) == 0

    def _write_metrics(self) -> None:
        assert self._recorder is not None
        books, cover = self._radio.books, self._coverage
        for row, robot in enumerate(self.robots):
            vertices = len(self._maps[robot].points) if robot in self._maps else None
            self._recorder.metrics(
                self.t,
                robot,
                float(cover.covered[row]),
                float(self._path[row]),
                vertices,
                books.sent[robot],
                books.received[robot],
            )
        sent, received = sum(books.sent.values()), sum(books.received.values())
        self._recorder.metrics(self.t, TEAM, cover.team, float(self._path.sum()), None, sent, received)


def generator(seed: int, purpose: str, robot: str = "") -> np.random.Generator:
    """The run's generator for one purpose and robot: a draw in one moves nothing in another."""
    words = [zlib.crc32(word.encode()) for word in (purpose, robot)]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))


def _milestones(reached: Mapping[float, float]) -> dict[str, float | None]:
    return {f"t_{round(100 * share)}": reached.get(share) for share in Coverage.MILESTONES}
