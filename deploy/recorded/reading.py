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
}
"""Options that not all kinds of logs take."""


def read_logs(files: Sequence[Path], given: Given) -> list[LidarLog]:
    """All logs that files hold, in order; a run directory holds one a robot.

    Raises InputError, also for what is given and no file takes.
    """
    kinds = {_kind(file) for file in files}
    for name, (option, takers) in ONLY_OF.items():
        if getattr(given, name) is not None and kinds.isdisjoint(takers):
            raise InputError(f"{option}: it is for {' and '.join(takers)}, leave it out")
    return [log for file in files for log in _read(file, given)]


def _kind(file: Path) -> str:
    if bag_in(file):
        return BAG
    return RUN if file.is_dir() else TEXT


def _read(file: Path, given: Given) -> list[LidarLog]:
    bag = bag_in(file)
    if bag:
        from deploy.recorded.bags import read_bag  # of the extra `bags`

        return [read_bag(bag, given)]
    if file.is_dir():
        return read_run(file, given)
    return [read_carmen(file, given)]
