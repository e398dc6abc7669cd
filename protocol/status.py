"""Exit statuses of the commands."""

from collections.abc import Iterable
from enum import IntEnum


class Status(IntEnum):
    """What a command returns to the shell that called it."""

    OK = 0  # ended as asked, with every robot
    FAILURE = 1  # anything else went wrong
    USAGE = 2  # an option, a file or a setting is wrong, or the world does not let the robot in
    INCOMPLETE = 3  # ended, but a robot died or never completed
    NOT_MET = 4  # a benchmark has all its figures, and some miss their bars
    INTERRUPTED = 130


ENDINGS = {"complete": Status.OK, "time": Status.OK, "dead": Status.INCOMPLETE, "interrupted": Status.INTERRUPTED}
"""Exit status by how a run ended, for a robot alone."""


def of_run(ended: str, until: str | float, robots: Iterable[str]) -> Status:
    """Exit status of a run by how it ended, its setting `until`, and how each robot stood at its end (Clock.status)."""
    if ended == "interrupted":
        return Status.INTERRUPTED
    fine = {"complete"} if until == "complete" else {"complete", "exploring"}
    return Status.OK if fine.issuperset(robots) else Status.INCOMPLETE
