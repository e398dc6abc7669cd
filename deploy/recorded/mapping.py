"""Logs mapped: one mind for each, without driving, into a run directory."""

import json
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import Progress

from agent.config import AgentConfig
from agent.passenger import Passenger
from deploy import manifest
from deploy.recorded.lidar_log import LidarLog, Scan
from protocol.arrays import Floats
from protocol.files import write_whole
from protocol.geometry import Pose, pose_of, relative
from protocol.grid_map import main_axis, quantise
from protocol.map_codec import encode_map
from protocol.messages import Observation, RobotSpec
from protocol.text import printable
from protocol.wireframe import Wireframe
from world.recorder import map_fields

TELL_EVERY = 50  # scans from one word of progress to the next


def map_logs(logs: Sequence[LidarLog], config: AgentConfig, out: Path, *, quiet: bool = False) -> dict[str, Any]:
    """Map each log by a mind of its own, r1 the first, and write the run directory; returns the fields of summary.json.

    Raises UnwritableError.
    """
    manifest.begin(out, manifest.of_logs(config, [log.source for log in logs]))
    robots = {}
    with Progress(console=Console(stderr=True), disable=quiet, transient=True) as bars:
        for k, log in enumerate(logs):
            robot = f"r{k + 1}"
            bar = bars.add_task(printable(f"{robot}: {Path(log.source).name}"), total=len(log.scans))
            mapped = map_log(log, config, partial(_advance, bars, bar))
            write_mapped(out, robot, log, mapped)
            robots[robot] = {"log": log.source} | mapped.figures
    summary = {"robots": robots}
    write_whole(out / "summary.json", json.dumps(summary, indent=1) + "\n")
    manifest.finish(out, ended="complete", exit_status=0)
    return summary


def _advance(bars: Progress, bar: Any, done: int) -> None:
    bars.update(bar, completed=done)


class Mapped(NamedTuple):
    """What a mind made of a log."""

    wireframe: Wireframe
    path: Floats  # (scans, 3) own frame
    figures: dict[str, Any]  # as in summary.json


def map_log(log: LidarLog, config: AgentConfig, progress: Callable[[int], None]) -> Mapped:
    """Let a mind map a log; progress is told the number of scans that are done."""
    mind, origin = Passenger(RobotSpec(lidar=log.lidar), config), log.scans[0].odometry
    took = np.zeros(len(log.scans))
    for k, scan in enumerate(log.scans):
        begin = time.perf_counter()
        mind.step(_observation(k, scan, origin))
        took[k] = 1e3 * (time.perf_counter() - begin)
        if k % TELL_EVERY == 0:
            progress(k)
    mind.finish()
    progress(len(log.scans))
    path, wireframe = mind.path(), mind.wireframe()
    way = float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())
    figures = {
        "ended": "complete",
        "scans": len(log.scans),
        "skipped": dict(log.skipped),
        "notes": log.notes,
        "path_m": round(way, 3),
        "loops": mind.submaps.loops,
        "map_bytes": len(encode_map(quantise(wireframe, config.radio.cell_mm, main_axis(wireframe))).data),
        "filter_bytes": mind.submaps.nbytes,
        "step_ms_median": round(float(np.median(took)), 3),
        "step_ms_99": round(float(np.percentile(took, 99)), 3),
    }
    return Mapped(wireframe, path, figures)


def _observation(tick: int, scan: Scan, origin: Pose) -> Observation:
    """A scan as a mind takes it, the odometry from where the log began."""
    ranges, odometry = scan.ranges.astype("<f4").tobytes(), relative(origin, scan.odometry)
    if scan.turn is None:
        return Observation(tick=tick, ranges=ranges, odometry=odometry)
    way = np.array([*(relative(origin, pose_of(pose)) for pose in scan.turn[:-1]), odometry], "<f8")
    return Observation(tick=tick, ranges=ranges, odometry=odometry, way=way.tobytes())


def write_mapped(out: Path, robot: str, log: LidarLog, mapped: Mapped) -> None:
    """Write maps/ID.json and estimate/ID.tum. Raises UnwritableError."""
    for folder in ("maps", "estimate"):
        (out / folder).mkdir(exist_ok=True)
    write_whole(out / "maps" / f"{robot}.json", json.dumps(map_fields(robot, mapped.wireframe), indent=1) + "\n")
    lines = (
        f"{scan.number} {x:.4f} {y:.4f} 0 0 0 {math.sin(0.5 * theta):.6f} {math.cos(0.5 * theta):.6f}\n"
        for scan, (x, y, theta) in zip(log.scans, mapped.path.tolist(), strict=True)
    )
    write_whole(out / "estimate" / f"{robot}.tum", "".join(lines))
