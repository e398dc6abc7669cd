"""Scans that our own runs kept (`--set scans=true`), as recorded logs of its robots."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from deploy.bandwidth.books import NoRunError
from deploy.bandwidth.replay import config_of
from deploy.recorded.lidar_log import Given, LidarLog, Scan
from deploy.report.rundir import MAX_M, MAX_TIME_S
from protocol.arrays import Floats
from protocol.document import check_is_file
from protocol.geometry import Pose, compose

MAX_LINE = 100_000
"""Characters of a line of scans/ID.jsonl: 4096 readings, and three numbers more, are 40,000."""


def kept_files(run: Path) -> list[Path]:
    """scans/ID.jsonl of each robot. Raises NoRunError where there is none."""
    sources = sorted((run / "scans").glob("*.jsonl"))
    if not sources:
        raise NoRunError(f"{run} has no scans: run it with --set scans=true")
    return sources


def kept_scans(source: Path, beams: int) -> Iterator[dict[str, Any]]:
    """Lines of scans/ID.jsonl. Raises NoRunError."""
    try:
        check_is_file(source)
        with source.open(encoding="utf-8") as stream:
            while line := stream.readline(MAX_LINE):
                scan = json.loads(line)
                numbers = [*scan["odometry"], *(0.0 if reading is None else reading for reading in scan["ranges"])]
                timed = all(0 <= scan[name] < MAX_TIME_S for name in ("t", "tick"))
                bounded = all(abs(number) <= MAX_M for number in numbers)
                if len(scan["ranges"]) != beams or len(scan["odometry"]) != 3 or not (timed and bounded):
                    raise ValueError(f"a scan of {beams} readings, a pose and a time is wanted at tick {scan['tick']}")
                yield scan
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        raise NoRunError(f"{source}: no scans of a run, or damaged: {error}") from None


def ranges_of(kept: dict[str, Any]) -> Floats:
    """Readings (beams,) of such a line, m: inf where nothing came back, NaN where nothing was measured."""
    return np.array([math.nan if one is None else math.inf if one < 0 else one for one in kept["ranges"]])


def read_run(run: Path, given: Given) -> list[LidarLog]:
    """What each robot of a run directory saw, by name. Raises NoRunError."""
    lidar = config_of(run).spec.lidar
    told = {"range_max_m": lidar.range_max_m if given.range_max_m is None else given.range_max_m}
    alone = lidar.model_copy(update=told | {"mount_x_m": 0.0, "mount_y_m": 0.0, "mount_yaw_deg": 0.0})
    logs = []
    for source in kept_files(run):
        log = LidarLog(alone, f"{run}, {source.stem}")
        before: tuple[int, Pose] | None = None
        for number, kept in enumerate(kept_scans(source, lidar.beams)):
            pose = compose(tuple(kept["odometry"]), lidar.mount)
            way = None if before is None or kept["tick"] != before[0] + 1 else np.array((before[1], pose))
            log.add(Scan(number, kept["t"], alone.cleaned(ranges_of(kept)), pose, way))
            before = kept["tick"], pose
        if not log.scans:
            raise NoRunError(f"{source}: it has no scan that can be used")
        log.note_odd()
        logs.append(log)
    return logs
