"""A mapper that knows the true outline, and robots that move as commanded: exploration tested on its own.

The oracle keeps, per true wall, what the beams have hit so far, and gives it out as the wireframe that a perfect
mapper would have: true corners where both walls were seen, occlusion or frontier ends elsewhere.
"""

import math
import time
from dataclasses import dataclass, field

import numpy as np

from agent.exploration.config import DrivingConfig, ExplorationConfig
from agent.exploration.explorer import Command, Explorer
from agent.exploration.surroundings import Situation
from agent.geometry.clearance import distance_to_walls
from deploy.metrics import score, truth_of
from protocol.messages import Event, RobotSpec
from protocol.wireframe import Label, Wireframe
from tests.ideal import ideal_spec
from world.coverage import Coverage
from world.lidar.lidar import Lidar
from world.worldfile import World

JOIN_M = 0.02
"""Seen stretches of a wall this close to each other are one."""
CLAIM_M = 0.25
"""A corner farther than this from the last hit is not claimed."""
TIP_M = 0.01
"""The end of a wall without thickness, which no two beams hit: seen where a wall beside it is seen to the corner."""


class OracleMapper:
    def __init__(self, world: World, start: np.ndarray) -> None:
        self.walls = world.segments
        counts = [len(ring) - 1 for ring in world.rings]
        self.next = np.concatenate(
            [first + (np.arange(n) + 1) % n for first, n in zip(np.cumsum([0, *counts[:-1]]), counts, strict=True)]
        )
        self.delta = self.walls[:, 2:] - self.walls[:, :2]
        self.length = np.hypot(*self.delta.T)
        self.unit = self.delta / self.length[:, None]
        after = self.unit[self.next]
        self.turns_away = self.unit[:, 0] * after[:, 1] - self.unit[:, 1] * after[:, 0] < 0
        self.before = np.argsort(self.next)
        self.seen: dict[int, list[list[float]]] = {}
        self.start = start
        self.version = 0
        self._shape: object = None
        self._map: Wireframe | None = None

    def update(self, pose: np.ndarray, ranges: np.ndarray, met: np.ndarray) -> None:
        """Take in one noise-free scan: pose (3,) in the world, ranges and met walls (beams,)."""
        beams = len(met)
        angles = pose[2] + np.arange(beams) * 2 * math.pi / beams
        finite = np.where(np.isfinite(ranges), ranges, 0.0)
        hits = pose[:2] + finite[:, None] * np.stack((np.cos(angles), np.sin(angles)), 1)
        apart = np.hypot(*(hits - np.roll(hits, 1, 0)).T) > CLAIM_M
        for first, last in runs(met, apart):
            wall = int(met[first % beams])
            ends = []
            for beam, beyond, corner, neighbour in (
                (first, first - 1, 0.0, int(self.before[wall])),
                (last, last + 1, self.length[wall], int(self.next[wall])),
            ):
                along = float((hits[beam % beams] - self.walls[wall, :2]) @ self.unit[wall])
                at = self.walls[wall, :2] + corner * self.unit[wall]
                away = math.hypot(*(at - pose[:2]))
                ended = met[beyond % beams] == neighbour or ranges[beyond % beams] > away
                if ended and abs(along - corner) < CLAIM_M and away < 3.5:
                    along = float(corner)
                    if self.length[neighbour] < TIP_M:
                        self._add(neighbour, [0.0, float(self.length[neighbour])])
                ends.append(min(max(along, 0.0), float(self.length[wall])))
            if ends[1] - ends[0] > 0.005:
                self._add(wall, ends)

    def _add(self, wall: int, new: list[float]) -> None:
        kept = []
        for old in self.seen.get(wall, []):
            if old[0] > new[1] + JOIN_M or old[1] < new[0] - JOIN_M:
                kept.append(old)
            else:
                new = [min(old[0], new[0]), max(old[1], new[1])]
        pieces = sorted([*kept, new])
        if pieces != self.seen.get(wall):
            self.seen[wall] = pieces
            self._map = None

    def wireframe(self) -> Wireframe:
        """The map in the robot's own frame."""
        if self._map is not None:
            return self._map
        points, labels, edges, shape = [], [], [], []
        tails, heads = {}, {}
        for wall in sorted(self.seen):
            for lo, hi in self.seen[wall]:
                for along, is_tail in ((lo, True), (hi, False)):
                    points.append(self.walls[wall, :2] + along * self.unit[wall])
                    labels.append(Label.FRONTIER)
                    if is_tail and along < 1e-6:
                        tails[wall] = len(points) - 1
                    if not is_tail and along > self.length[wall] - 1e-6:
                        heads[wall] = len(points) - 1
                edges.append([len(points) - 2, len(points) - 1])
        gone = {}
        for wall, head in heads.items():
            after = int(self.next[wall])
            if after in tails:
                gone[tails[after]] = head
                labels[head] = Label.NOMINAL
            elif self.turns_away[wall]:
                labels[head] = Label.OCCLUSION
        for wall, tail in tails.items():
            if tail not in gone and self.turns_away[self.before[wall]]:
                labels[tail] = Label.OCCLUSION
        kept = [k for k in range(len(points)) if k not in gone]
        index = {k: i for i, k in enumerate(kept)}
        index |= {k: index[head] for k, head in gone.items()}
        m = len(edges)
        c, s = math.cos(self.start[2]), math.sin(self.start[2])
        own = (np.array(points).reshape(-1, 2)[kept] - self.start[:2]) @ np.array(((c, -s), (s, c)))
        self._map = Wireframe(
            own,
            np.array([labels[k] for k in kept], np.uint8),
            np.array([[index[a], index[b]] for a, b in edges], np.int32).reshape(m, 2),
            np.ones(m, np.float32),
            np.ones(m, np.bool_),
        )
        shape = [(w, len(p)) for w, p in sorted(self.seen.items())], self._map.labels.tolist()
        if shape != self._shape:
            self._shape = shape
            self.version += 1
        return self._map


def runs(met: np.ndarray, apart: np.ndarray | None = None) -> list[tuple[int, int]]:
    """First and last beam of each wall's consecutive beams, once around; the last may exceed the count.

    apart (beams,): where a run is to be cut before a beam though the wall is the same.
    """
    n = len(met)
    change = met != np.roll(met, 1)
    change = np.flatnonzero(change if apart is None else change | apart)
    if not len(change):
        return [(0, n - 1)] if met[0] >= 0 else []
    ends = np.append(change[1:], change[0] + n) - 1
    return [(int(a), int(b)) for a, b in zip(change, ends, strict=True) if met[a] >= 0]


def corner_scan(ranges: np.ndarray, met: np.ndarray) -> Wireframe:
    """What is seen now as walls in the robot's frame."""
    n = len(met)
    angles = np.arange(n) * 2 * math.pi / n
    points, edges = [], []
    for a, b in runs(met):
        if b > a:
            points += [(ranges[k] * math.cos(angles[k]), ranges[k] * math.sin(angles[k])) for k in (a % n, b % n)]
            edges.append((len(points) - 2, len(points) - 1))
    m = len(edges)
    return Wireframe(
        np.array(points).reshape(-1, 2), np.full(len(points), Label.FRONTIER, np.uint8),
        np.array(edges, np.int32).reshape(m, 2), np.ones(m, np.float32), np.ones(m, np.bool_),
    )  # fmt: skip


@dataclass
class Trial:
    """One robot's run."""

    complete_s: float | None = None
    reason: str = ""
    coverage: float = 0.0
    recall: float = 0.0
    """Share of the visible wall in the map, as the scorer counts it."""
    t_90: float | None = None
    t_99: float | None = None
    path_m: float = 0.0
    least_clearance_m: float = math.inf
    contacts: int = 0
    step_ms: float = 0.0
    unreachable: int = 0
    stuck: int = 0
    events: list[tuple[int, Event]] = field(default_factory=list)
    trajectory: list[np.ndarray] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    map: Wireframe | None = None
    explorer: Explorer | None = None


def step(explorer: Explorer, situation: Situation) -> Command:
    """One tick, by the branches of `Robot.step`."""
    scene = explorer.look(situation)
    if not len(situation.wireframe.edges):
        return explorer.drive_forward(scene)
    return explorer.drive(
        scene,
        explorer.place_of_contact(scene)
        or explorer.way_home(scene)
        or explorer.frontier(scene)
        or explorer.default_state(scene),
    )


def explore(
    world: World,
    seconds: float,
    *,
    robots: int = 1,
    seed: int = 0,
    config: ExplorationConfig | None = None,
    starts: np.ndarray | None = None,
    until_complete: bool = True,
    spec: RobotSpec | None = None,
) -> list[Trial]:
    """Robots that explore the world each on its own, until all are complete or time is up."""
    spec = spec or ideal_spec()
    rng = np.random.default_rng(seed)
    poses = world.starts(robots, spec.radius_m, rng) if starts is None else np.array(starts, float)
    origins = poses.copy()
    lidar = Lidar(world.segments, spec.lidar, one_sided=True)
    coverage = Coverage(world, poses, spec.radius_m, spec.lidar.range_max_m)
    mappers = [OracleMapper(world, pose) for pose in origins]
    explorers = [Explorer(config or ExplorationConfig(), DrivingConfig(), spec, child) for child in rng.spawn(robots)]
    trials = [Trial(explorer=explorer) for explorer in explorers]
    spent = [[] for _ in trials]
    touching = [False] * robots
    for tick in range(round(seconds * spec.lidar.rate_hz)):
        discs = np.hstack((poses[:, :2], np.full((robots, 1), spec.radius_m)))
        ranges, met = lidar.trace(poses, discs)
        coverage.update(tick / spec.lidar.rate_hz, tick, np.arange(robots), lidar.rays(poses), ranges, met)
        commands: list[Command] = []
        for k, (trial, mapper, explorer) in enumerate(zip(trials, mappers, explorers, strict=True)):
            mapper.update(poses[k], ranges[k], met[k])
            scan = corner_scan(ranges[k], met[k])
            local = to_frame(origins[k], poses[k])
            seen = to_frame(poses[k], np.hstack((np.delete(poses, k, 0)[:, :2], np.zeros((robots - 1, 1)))))[:, :2]
            beams = np.round(np.arctan2(seen[:, 1], seen[:, 0]) * 180 / math.pi).astype(int) % 360
            seen = seen[ranges[k][beams] > np.hypot(*seen.T) - 0.2]
            wireframe = mapper.wireframe()
            wireframe.check()
            began = time.thread_time()
            command = step(explorer, Situation(tick, wireframe, mapper.version, tuple(local), scan, seen))
            spent[k].append(time.thread_time() - began)
            trial.events += [(tick, event) for event in command.events]
            trial.trajectory.append(poses[k].copy())
            trial.reasons.append(command.reason)
            if command.complete and trial.complete_s is None:
                trial.complete_s = tick / spec.lidar.rate_hz
            if not command.complete:
                trial.complete_s = None
            commands.append(command)
        if until_complete and all(command.complete for command in commands):
            break
        for k, (command, trial) in enumerate(zip(commands, trials, strict=True)):
            assert abs(command.speed_mps) <= spec.max_speed_mps + 1e-9
            assert abs(command.turn_rps) <= spec.max_turn_rps + 1e-9
            for _ in range(10):
                dt = 0.1 / spec.lidar.rate_hz
                middle = poses[k, 2] + 0.5 * dt * command.turn_rps
                poses[k, :2] += command.speed_mps * dt * np.array((math.cos(middle), math.sin(middle)))
                poses[k, 2] += command.turn_rps * dt
                clear = distance_to_walls(poses[k, 0], poses[k, 1], world.segments)
                trial.least_clearance_m = min(trial.least_clearance_m, clear)
            trial.path_m += command.speed_mps / spec.lidar.rate_hz
            others = np.delete(poses, k, 0)
            near = np.hypot(*(others[:, :2] - poses[k, :2]).T) < 2 * spec.radius_m
            trial.contacts += int(near.any() and not touching[k])
            touching[k] = bool(near.any())
    for k, (trial, mapper, explorer) in enumerate(zip(trials, mappers, explorers, strict=True)):
        trial.coverage = float(coverage.own[k])
        trial.t_90, trial.t_99 = (coverage.reached[k].get(share) for share in (0.9, 0.99))
        trial.step_ms = 1e3 * float(np.median(spent[k]))  # the first ones compile kernels
        trial.unreachable = sum(record.unreachable for record in explorer.goals.memory.tried)
        trial.stuck = sum(event.event == "stuck" for _, event in trial.events)
        trial.reason = trial.reasons[-1]
        trial.map = mapper.wireframe()
        x, y, theta = origins[k].tolist()
        truth = truth_of(world, (x, y), spec.radius_m, spec.lidar.range_max_m)
        trial.recall = score(trial.map, (x, y, theta), truth).wall_recall
    return trials


def to_frame(frame: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Poses (3,) or (k, 3) of the outer frame, in the given one."""
    c, s = math.cos(frame[2]), math.sin(frame[2])
    d = np.atleast_2d(poses) - frame
    out = np.stack((c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], d[:, 2]), 1)
    return out[0] if np.ndim(poses) == 1 else out


def draw(world: World, trial: Trial, path: str) -> None:
    """Picture of a run: walls, path, open ends."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    _, ax = plt.subplots(figsize=(10, 10))
    for ring in world.rings:
        ax.plot(*ring.T, "k-", lw=0.8)
    way = np.array(trial.trajectory)
    colours = {"frontier": "tab:blue", "occlusion": "tab:cyan", "sweep": "tab:orange", "complete": "tab:green"}
    for k in range(len(way) - 1):
        ax.plot(*way[k : k + 2, :2].T, color=colours.get(trial.reasons[k], "tab:red"), lw=1)
    c, s = math.cos(way[0, 2]), math.sin(way[0, 2])
    points = trial.map.points @ np.array(((c, s), (-s, c))) + way[0, :2]
    for a, b in trial.map.edges:
        ax.plot(*points[[a, b]].T, "g-", lw=2, alpha=0.5)
    for label, mark in ((Label.FRONTIER, "rs"), (Label.OCCLUSION, "m^")):
        ax.plot(*points[trial.map.labels == label].T, mark, ms=5)
    ax.plot(*way[-1, :2], "ko")
    ax.set_aspect("equal")
    ax.set_title(f"{trial.complete_s} s, coverage {trial.coverage:.3f}, unreachable {trial.unreachable}")
    plt.savefig(path, dpi=70, bbox_inches="tight")
    plt.close()
