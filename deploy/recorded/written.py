"""The scans of a run as CARMEN text logs, with the true path beside each: for other mapping programs and their judges.

A log begins with a PARAM line of ours that tells how the lidar turns. For each scan it has an ODOM line, then a FLASER
line where the lidar looks 180 degrees ahead as far as a SICK, else a ROBOTLASER1 line, which tells the range, too
(carmen.sourceforge.net, "Logger"). Stamps are simulated seconds, at the end of a revolution. Where nothing was measured
0 is written, as by the LDS-01, and where nothing came back a range that no lidar of the kind has.
"""

import math
from pathlib import Path
from typing import Any

from deploy.bandwidth.books import NoRunError
from deploy.bandwidth.replay import config_of, read_track
from deploy.recorded.carmen import FLASER, REVOLUTION, ROBOTLASER, SICK_RANGE_M
from deploy.recorded.runs import kept_files, kept_scans
from deploy.report.rundir import BROKEN
from protocol.files import check_own, make_folder, write_whole
from protocol.geometry import Pose, compose
from protocol.messages import LidarSpec

BEYOND_M = 1.83
"""Over the lidar's range, in place of nothing came back; a SICK writes 81.83 (of 80)."""


def write_carmen(run: Path, out: Path) -> list[Path]:
    """Write ID.log and ID.ref.tum of each robot of a run directory into a folder, and return the logs.

    ID.ref.tum holds the lidar's true pose in the world for each scan, `INDEX x y 0 0 0 qz qw`. Raises NoRunError where
    the directory has no scans or they are damaged, InputError where a file of another kind has the name of one, and
    UnwritableError.
    """
    lidar, made = config_of(run).spec.lidar, []
    sources = kept_files(run)
    for source in sources:
        check_own(f"PARAM {REVOLUTION} ".encode(), out / f"{source.stem}.log")
        check_own(b"0 ", out / f"{source.stem}.ref.tum")
    make_folder(out)
    for source in sources:
        scans = list(kept_scans(source, lidar.beams))
        try:
            track = read_track(run / "trajectories" / f"{source.stem}.tum")
            true = track[[scan["tick"] for scan in scans]].tolist()
        except BROKEN as error:
            raise NoRunError(f"{run}: no true way for each scan of {source.name}: {error}") from None
        poses = [compose((x, y, theta), lidar.mount) for x, y, theta in true]
        made.append(out / f"{source.stem}.log")
        write_whole(made[-1], "".join((_setting(lidar), *map(_lines, scans, [lidar] * len(scans)))))
        reference = (
            f"{index} {x:.6f} {y:.6f} 0 0 0 {math.sin(theta / 2):.9f} {math.cos(theta / 2):.9f}\n"
            for index, (x, y, theta) in enumerate(poses)
        )
        write_whole(out / f"{source.stem}.ref.tum", "".join(reference))
    return made


def _setting(lidar: LidarSpec) -> str:
    """A line that tells how long the lidar takes for a scan, and in which order."""
    seconds = (-1 if lidar.clockwise else 1) / lidar.rate_hz if lidar.turning else 0.0
    return f"PARAM {REVOLUTION} {seconds:g} 0.000 wireswarm 0.000\n"


def _lines(scan: dict[str, Any], lidar: LidarSpec) -> str:
    """Two lines of a log."""
    # readers of FLASER lines take an even number of readings to leave out the leftmost one
    ahead = lidar.field_of_view_deg == 180 and lidar.beams % 2 == 0 and math.isclose(_first(lidar), -math.pi / 2)
    beyond = lidar.range_max_m + BEYOND_M
    told = [0.0 if reading is None else beyond if reading < 0 else reading for reading in scan["ranges"]]
    readings = [f"{reading:.4f}".rstrip("0").rstrip(".") for reading in (told[::-1] if lidar.clockwise else told)]
    robot: Pose = tuple(scan["odometry"])
    seen_from, body = (" ".join(f"{value:.6f}" for value in pose) for pose in (compose(robot, lidar.mount), robot))
    stamp = f"{scan['t']:.3f} wireswarm {scan['t']:.3f}"
    odometry = f"ODOM {body} 0 0 0 {stamp}\n"
    if ahead and lidar.range_max_m == SICK_RANGE_M:
        return f"{odometry}{FLASER} {len(readings)} {' '.join(readings)} {seen_from} {body} {stamp}\n"
    view = f"{_first(lidar):.9f} {math.radians(lidar.field_of_view_deg):.9f} {lidar.beam_step:.9f}"
    kind = f"0 {view} {lidar.range_max_m:g} {lidar.noise_m:g} 0"
    rest = f"0 {seen_from} {body} 0 0 0 0 0 {stamp}"
    return f"{odometry}{ROBOTLASER} {kind} {len(readings)} {' '.join(readings)} {rest}\n"


def _first(lidar: LidarSpec) -> float:
    """Bearing of the rightmost beam from the lidar's own heading, -pi to pi: readings are told from right to left."""
    bearings = lidar.bearings() - math.radians(lidar.mount_yaw_deg)
    return math.remainder(bearings.min(), 2 * math.pi)
