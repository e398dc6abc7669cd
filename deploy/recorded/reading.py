"""Files that hold recorded scans, each by its kind: CARMEN text, bags of ROS, our own run directories."""

from collections.abc import Sequence
from pathlib import Path

from deploy.recorded.carmen import read_carmen
from deploy.recorded.lidar_log import Given, LidarLog
from deploy.recorded.runs import read_run

BAGS = (".bag", ".mcap", ".db3")


def read_logs(files: Sequence[Path], given: Given) -> list[LidarLog]:
    """All logs that files hold, in order; a run directory holds one a robot. Raises InputError."""
    return [log for file in files for log in _read(file, given)]


def _read(file: Path, given: Given) -> list[LidarLog]:
    if file.suffix in BAGS or (file / "metadata.yaml").exists():
        from deploy.recorded.bags import read_bag  # of the extra `bags`

        return [read_bag(file, given)]
    if file.is_dir():
        return read_run(file, given)
    return [read_carmen(file, given)]
