"""Kernels compiled at installation, and loaded before a robot's first step (ours).

    python -m agent.warmup

Two robots explore a made-up building, with no world and no network: they map, meet, align, verify and merge, which
calls every kernel with the types that real runs call it with.
"""

import gc
import math
import multiprocessing
import os
import sys
import time
from collections.abc import Sequence

import numpy as np

from agent.alignment.align import align_prepared
from agent.alignment.prepared import prepare
from agent.config import AgentConfig
from agent.cooperation.verification import Watch
from agent.corner_scan import PIECE, CornerScan, Sight
from agent.exploration.explorer import Explorer
from agent.exploration.surroundings import Situation
from agent.kernels.cache import announce
from agent.mapping.first_look import keep_first_look
from agent.mapping.layers import layer_of
from agent.mapping.particle_filter import WireframeFilter
from agent.passenger import Passenger
from agent.robot import Robot
from protocol.arrays import Floats
from protocol.geometry import Pose, compose
from protocol.messages import Heard, LidarSpec, Observation, RobotSpec
from protocol.wireframe import enclosed

TICKS_TO_LOAD = 40  # enough for one robot to look about, map some walls, choose a frontier, plan and drive
LOADING = RobotSpec(lidar=LidarSpec(rate_hz=2.0))  # a slow lidar: the first look is of 20 scans instead of 50
TICKS_TO_COMPILE = 170  # enough for two robots to merge their maps, after 137, and to explore what is left

TICKS_TO_CLOSE = 60  # enough for five submaps of 5 m, the last of which close loops

_OUTLINE = [
    (0, 0), (3, 0), (3, 2), (3.2, 2), (3.2, 0), (6.5, 0), (6.5, 2), (8, 2), (8, 5), (4, 5), (4, 3.2), (3.8, 3.2),
    (3.8, 5), (0.5, 5), (0.5, 3), (0, 3),
]  # fmt: skip
_PILLAR = [(5.5, 3.8), (5.5, 4.2), (5.9, 4.2), (5.9, 3.8)]
_BUILDING = enclosed([np.array(_OUTLINE, np.float64), np.array(_PILLAR)])
_STARTS: list[Pose] = [(1.0, 1.0, 0.0), (5.0, 1.0, math.pi / 2)]
_NOISE_M = 0.003

_rehearsed = False


def rehearse() -> None:
    """Load all kernels that a robot's first minutes call; later calls, and those in its forks, do nothing."""
    global _rehearsed
    if not _rehearsed:
        _rehearsed = True
        _explore(_STARTS[:1], TICKS_TO_LOAD, LOADING)
        _align()


def rehearse_carried() -> None:
    """Load all kernels that a mind which is carried calls, of itself and with peers."""
    _close_a_loop()
    _align()


def compile_kernels() -> None:
    """Compile all kernels, in two processes where there are two cores.

    The other one begins with mapping, this one with planning and perception. When this one comes to need mapping, it
    finds those kernels in the cache.
    """
    gc.disable()  # numba makes millions of objects that live on
    other = None
    if len(os.sched_getaffinity(0)) > 1:
        other = multiprocessing.get_context("fork").Process(target=_map_and_align)
        other.start()
    _plan()
    _explore(_STARTS, TICKS_TO_COMPILE, RobotSpec())
    if other is not None:
        other.join()
    _map_and_align()  # what the other failed to compile, or all of it where there is no other


def _map_and_align() -> None:
    """Call the kernels of mapping and of watching a teammate that an empty scan reaches, of alignment and of loops."""
    mapped = WireframeFilter(AgentConfig().filter, RobotSpec(), np.random.SeedSequence(0))
    nowhere = np.zeros((0, 3))
    sight = Sight(nowhere, nowhere, 1.0, 0.0, 0.0)
    scan = CornerScan(np.zeros(0, PIECE), sight, np.zeros((0, 2)), nowhere)
    mapped.update(scan, (0.0, 0.0, 0.0))
    mapped.wireframe()
    layer = layer_of(_BUILDING, np.zeros(3), np.zeros(len(_BUILDING.edges), np.bool_), 1.0)
    mapped.told_with([layer], _NOISE_M)(None)  # what one peer told, as a third robot is told it: here are but two
    keep_first_look(mapped.edges, mapped.counts, _NOISE_M)  # of robots whose wheels err
    mapped.first_heading_sd()
    mapped.exactness.sd_m()  # at the end of a run
    mapped.exactness.looks()
    Watch().look(np.zeros(3), (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), scan, scan.discs, RobotSpec().radius_m)
    _align()
    _close_a_loop()


def _close_a_loop() -> None:
    """Let a mind be carried to and fro past the same walls, until it knows them again."""
    spec = RobotSpec()
    mind = Passenger(spec, AgentConfig())
    for tick in range(TICKS_TO_CLOSE):
        moved = (1.0 + 0.5 * math.sin(tick), 0.0, 0.0)
        ranges = _ranges(_beams(compose(_STARTS[0], moved), (0.0, 0.0, 0.0), spec), np.zeros((0, 2)), spec)
        mind.step(Observation(tick=tick, ranges=ranges.astype("<f4").tobytes(), odometry=moved))
    mind.finish()
    mind.wireframe()


def _plan() -> None:
    spec, config = RobotSpec(), AgentConfig()
    explorer = Explorer(config.exploration, config.driving, spec, np.random.default_rng(0))
    scene = explorer.look(Situation(0, _BUILDING, 1, _STARTS[0], _BUILDING, np.zeros((0, 2))))
    explorer.drive(scene, explorer.frontier(scene) or explorer.default_state(scene))


def _align() -> None:
    config = AgentConfig().alignment
    building = prepare(_BUILDING, config)
    align_prepared(building, building, config, np.random.default_rng(0))


def _explore(starts: Sequence[Pose], ticks: int, spec: RobotSpec) -> None:
    """Let robots explore from their starts and hear each other."""
    config, rng = AgentConfig(), np.random.default_rng(0)
    robots = [Robot(f"r{k + 1}", spec, config, k) for k in range(len(starts))]
    moves: list[Pose] = [(0.0, 0.0, 0.0)] * len(starts)  # in the last period, in the frame of its begin
    moved = list(moves)  # since the start
    heard: list[list[Heard]] = [[] for _ in starts]
    for tick in range(ticks):
        begins = [compose(start, by) for start, by in zip(starts, moved, strict=True)]
        poses = [compose(begin, by) for begin, by in zip(begins, moves, strict=True)]
        said: list[list[Heard]] = [[] for _ in starts]
        for k, robot in enumerate(robots):
            others = np.array([pose[:2] for n, pose in enumerate(poses) if n != k]).reshape(-1, 2)
            ranges = _ranges(_beams(begins[k], moves[k], spec), others, spec)
            ranges += rng.normal(0.0, _NOISE_M, spec.lidar.beams)
            moved[k] = compose(moved[k], moves[k])
            seen = Observation(tick=tick, ranges=ranges.astype("<f4").tobytes(), odometry=moved[k])
            step = robot.step(seen, heard[k])
            ahead = step.action.speed_mps / spec.lidar.rate_hz
            moves[k] = (ahead, 0.0, step.action.turn_rps / spec.lidar.rate_hz)
            sent = [Heard(tick=tick, sender=robot.robot, kind=send.kind, payload=send.payload) for send in step.sends]
            for n in set(range(len(robots))) - {k}:  # with two robots, all messages are for the other
                said[n] += sent
        heard = said


def _beams(begin: Pose, move: Pose, spec: RobotSpec) -> Floats:
    """(beams, 3) where each beam begins and points in a period with this move, given in the frame of its begin."""
    x, y, _ = compose(begin, move)
    way = np.outer(spec.lidar.moments(), [x - begin[0], y - begin[1], move[2]])
    way[:, 2] += spec.lidar.bearings()
    beams: Floats = np.array(begin) + way
    return beams


def _ranges(beams: Floats, others: Floats, spec: RobotSpec) -> Floats:
    """(beams,) metres to the building's walls and to other robots, inf beyond the lidar's range."""
    walls, pose = _BUILDING.segments(), beams.T[:, :, None]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    from_x, from_y = walls[:, 0] - pose[0], walls[:, 1] - pose[1]
    along_x, along_y = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = c * along_y - s * along_x
        distance = (from_x * along_y - from_y * along_x) / cross
        share = (from_x * s - from_y * c) / cross
        met = (distance > 0) & (share >= 0) & (share <= 1)
        nearest = np.where(met, distance, np.inf).min(1)
        x, y = others[:, 0] - pose[0], others[:, 1] - pose[1]
        ahead, aside = x * c + y * s, y * c - x * s
        front = ahead - np.sqrt(spec.radius_m**2 - aside**2)
    nearest = np.minimum(nearest, np.where((ahead > 0) & (front > 0), front, np.inf).min(1, initial=np.inf))
    return np.where(nearest <= spec.lidar.range_max_m, nearest, np.inf)


def main() -> None:
    """Compile, and say how long it took. A failure is told and ends nothing: a run compiles what it needs."""
    begin = time.perf_counter()
    announce()
    try:
        compile_kernels()
    except Exception as error:
        print(f"kernels are not compiled yet: {type(error).__name__}: {error}", file=sys.stderr)
    else:
        print(f"kernels compiled in {time.perf_counter() - begin:.1f} s")
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # at a usual end, Python takes millions of numba's objects apart, which lasts 2 s


if __name__ == "__main__":
    main()
