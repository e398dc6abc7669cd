"""Loops: a robot is carried around a ring of corridors, and must close that loop and no other."""

import math
from collections.abc import Iterator

import numpy as np

from agent.config import AgentConfig
from agent.geometry.transform import fit_on_points
from agent.mapping.particle_filter import WireframeFilter
from agent.mapping.submaps.chain import Submaps
from agent.mapping.submaps.loop_closing import LoopClosing
from agent.mapping.submaps.wireframe import records_of
from agent.perception.perceive import Perception
from deploy.bench.cases import Figures
from deploy.metrics import score, truth_of
from deploy.sensing import REAL
from protocol.arrays import Floats
from protocol.geometry import Pose, apply, pose_of, relative, wrapped
from protocol.messages import Observation, OdometrySpec, RobotSpec
from protocol.walls import lengths
from protocol.wireframe import Wireframe
from world.lidar.lidar import Lidar
from world.odometry import Odometry
from world.physics import STEP_S
from world.way import interpolated
from world.worldfile import World, from_document

Point = tuple[float, float]

WIDTH_M = 2.0
TURN_RPS = 1.0  # on the spot at corners, about as fast as robots turn while they map
STAND_S = 3.0  # before it is carried, as robots do before they drive
ERRORS = ("distance_sd", "heading_sd_deg", "turn_sd", "wheel_sd", "axle_sd")  # of OdometrySpec
FALSE_M, FALSE_DEG, FALSE_SIGMAS = 1.0, 10.0, 5.0
"""A loop that is farther off than either, and than so many of its own deviations, has taken one place for another. By
those, a loop in a corridor says nothing of how far along it is."""


def measure_ring(side_m: float, laps_driven: float, niches: bool, worse: float, seed: int) -> Figures:
    """Figures of a robot with real sensing that was carried around a ring: its loops, map and way.

    side_m: of the middle of the corridor. niches: whether sides differ. worse: factor of the odometry's errors. The way
    is judged at the begin of each submap, as the loops have settled it, after the best rigid fit. The map is the
    filter's, and judged in the robot's own frame, as in every run. `wall_share`: length of the map over that of the
    visible wall; a wall that stands twice counts twice.
    """
    given = OdometrySpec()
    spec = RobotSpec.model_validate(
        REAL | {"odometry": {"noisy": True, **{name: worse * getattr(given, name) for name in ERRORS}}}
    )
    side_m += WIDTH_M
    world, mapper = ring_world(side_m, niches), Mapper(spec, seed)
    way = laps(side_m, WIDTH_M, laps_driven, spec.max_speed_mps * STEP_S, math.ceil(math.pi / 2 / TURN_RPS / STEP_S))
    way = np.concatenate([np.repeat(way[:1], round(STAND_S / STEP_S), 0), way])
    start, submaps, begun = pose_of(way[0]), mapper.loops.submaps, list[Pose]()
    off_m = 0.0
    for observation, true in carried(world, way, spec, seed):
        mapper.step(observation)
        begun += [true] * (len(submaps.poses) - len(begun))
        off_m = math.dist(mapper.filter.pose[:2], relative(start, true)[:2])
    submaps.compare_all()
    settled, places = submaps.poses[:, :2], np.array(begun)[:, :2]
    off = np.hypot(*(apply(fit_on_points(settled, places, len(places)), settled) - places).T)
    truth = truth_of(world, start[:2], spec.radius_m, spec.lidar.range_max_m)
    wrong = false_loops(submaps, begun)
    wireframe = mapper.wireframe()
    return {
        **score(wireframe, start, truth)._asdict(),
        "wall_share": float(lengths(wireframe.segments()).sum() / truth.seen_lengths.sum()),
        "loops": submaps.loops,
        "false_loops": wrong,
        "closed": submaps.loops > wrong and off_m < FALSE_M,
        "settled": mapper.settled,
        "end_off_m": round(off_m, 4),
        "path_rms_m": round(float(np.sqrt((off**2).mean())), 4),
        "path_max_m": round(float(off.max()), 4),
    }


class Mapper:
    """What a robot's mind does with what it sees (`agent.robot.Robot.step`), without the rest."""

    def __init__(self, spec: RobotSpec, seed: int) -> None:
        config = AgentConfig()
        self._perception = Perception(config.perception, spec, alone=True)
        self.filter = WireframeFilter(config.filter, spec, np.random.SeedSequence(seed))
        self.loops = LoopClosing(config.filter.submaps, spec.lidar.view())
        self.settled = 0
        """How often the map was merged anew from submaps."""

    def step(self, observation: Observation) -> None:
        """Take one scan."""
        way = self.filter.way(observation.poses())
        scan = self._perception.see(observation, way, self.filter.pose, self.wireframe())
        self.filter.update(scan, observation.poses(), tick=observation.tick)
        mind = self.filter
        if self.loops.take(observation.tick, scan, pose_of(way[-1]), mind.length_scale, mind.pose, mind.covariance):
            settled = self.loops.settled()
            self.filter.replace(records_of(settled.walls), settled.pose, settled.places)
            self.settled += 1

    def wireframe(self) -> Wireframe:
        """The map, in the own frame."""
        return self.filter.wireframe()


def false_loops(submaps: Submaps, begun: list[Pose]) -> int:
    """How many loops took one place for another; begun: where the robot truly was when it began each submap."""
    graph, wrong = submaps.graph(), 0
    for k in np.flatnonzero(graph.loop).tolist():
        a, b = graph.ends[k].tolist()
        off = graph.measured[k] - relative(begun[a], begun[b])
        off[2] = wrapped(float(off[2]))
        far = math.hypot(off[0], off[1]) > FALSE_M or math.degrees(abs(off[2])) > FALSE_DEG
        wrong += far and float(off @ graph.information[k] @ off) > FALSE_SIGMAS**2
    return wrong


def carried(world: World, way: Floats, spec: RobotSpec, seed: int) -> Iterator[tuple[Observation, Pose]]:
    """What is observed along a way (n, 3) in the world, a pose each STEP_S, and the true pose at each scan."""
    rng, lidar = np.random.default_rng(seed), Lidar(world.segments, spec.lidar, one_sided=True)
    odometry, steps = Odometry(way[0], spec.odometry, rng), round(1 / spec.lidar.rate_hz / STEP_S)
    read = np.arange(1, spec.poses_per_scan + 1) / spec.poses_per_scan
    for tick, end in enumerate(range(steps, len(way), steps)):
        period = way[end - steps : end + 1, None]
        ranges, met = lidar.trace(period)
        measured = lidar.measured(ranges, [rng], met, lidar.rays(period))[0].astype("<f4")
        told = odometry.update(interpolated(period, read)[:, 0])
        seen = Observation(
            tick=tick, ranges=measured.tobytes(), odometry=odometry.pose, way=told.astype("<f8").tobytes()
        )
        yield seen, pose_of(way[end])


def ring_world(side: float, niches: bool) -> World:
    """The world of a ring."""
    outer, inner = ring(side, WIDTH_M, niches)
    around = [[-4.0, -4.0], [side + 4.0, -4.0], [side + 4.0, side + 4.0], [-4.0, side + 4.0]]
    solids = [[around, list(map(list, outer))], [list(map(list, inner))]]
    return from_document({"name": "ring", "polygons": solids})


def ring(side: float, width: float, niches: bool = True) -> tuple[list[Point], list[Point]]:
    """Outer and inner outline of a corridor around a square block; with a niche of its own in each outer side."""
    corners, outer = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)], []
    for k, (a, b) in enumerate(zip(corners, (*corners[1:], corners[0]), strict=True)):
        outer.append(a)
        ux, uy = (b[0] - a[0]) / side, (b[1] - a[1]) / side
        if niches:
            at, wide, deep = side * (0.25 + 0.15 * k), 0.8 + 0.4 * k, 0.6 + 0.3 * k
            for t, out in ((at, 0.0), (at, deep), (at + wide, deep), (at + wide, 0.0)):
                outer.append((a[0] + t * ux + out * uy, a[1] + t * uy - out * ux))
    return outer, [(width, width), (width, side - width), (side - width, side - width), (side - width, width)]


def laps(side: float, width: float, count: float, step: float = 0.25, turns: int = 4) -> Floats:
    """(n, 3) poses counter-clockwise along the middle of that corridor, `count` times around.

    A pose each `step` metres, and so many `turns` at each corner. Headings go on from lap to lap: what is between two
    poses is interpolated.
    """
    near, far = 0.5 * width, side - 0.5 * width
    stops = [(near, near), (far, near), (far, far), (near, far)]
    out: list[Pose] = []
    for k in range(round(4 * count)):
        a, b = stops[k % 4], stops[(k + 1) % 4]
        heading = 0.5 * math.pi * k
        n = round(math.dist(a, b) / step)
        out += [(a[0] + (b[0] - a[0]) * j / n, a[1] + (b[1] - a[1]) * j / n, heading) for j in range(n)]
        out += [(*b, heading + 0.5 * math.pi * j / turns) for j in range(turns)]
    return np.array(out)
