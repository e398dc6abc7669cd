"""Files that hold recorded scans, each by its kind: CARMEN text, bags of ROS, our own run directories."""

from collections.abc import Sequence
from pathlib import Path

from deploy.recorded.bag_files import bag_in
from deploy.recorded.carmen import read_carmen
from deploy.recorded.lidar_log import Given, LidarLog
from deploy.recorded.runs import read_run
from protocol.errors import InputError

TEXT, BAG, RUN = "CARMEN text", "a bag", "a run directory"
ONLY_OF = {
    "field_of_view_deg": ("--field-of-view", (TEXT,)),
    "scan_topic": ("--scan-topic", (BAG,)),
    "odometry_topic": ("--odometry-topic", (BAG,)),
    "mount": ("--mount", (BAG,)),
    "revolution_s": ("--revolution", (TEXT, BAG)),
    "upside_down": ("--upside-down", (BAG,)),
}
"""Options that not all kinds of logs take."""


def read_logs(files: Sequence[Path], given: Given) -> list[LidarLog]:
    """All logs that files hold, in order; a run directory holds one a robot.

    Raises InputError, also for what is given and no file takes.
    """
    found = [_kind(file) for file in files]
    kinds = {kind for kind, _ in found}
    for name, (option, takers) in ONLY_OF.items():
        if getattr(given, name) is not None and kinds.isdisjoint(takers):
            raise InputError(f"{option}: it is for {' and '.join(takers)}, leave it out")
    return [log for kind, path in found for log in _read(kind, path, given)]


def _kind(file: Path) -> tuple[str, Path]:
    """Of which kind a log is, and where it lies: a bag may be a file of the folder that was named."""
    if bag := bag_in(file):
        return BAG, bag
    return RUN if file.is_dir() else TEXT, file


def _read(kind: str, path: Path, given: Given) -> list[LidarLog]:
    if kind == BAG:
        from deploy.recorded.bags import read_bag  # of the extra `bags`

        return [read_bag(path, given)]
    return read_run(path, given) if kind == RUN else [read_carmen(path, given)]
