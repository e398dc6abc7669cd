"""Exit statuses of the commands."""

from enum import IntEnum


class Status(IntEnum):
    """What a command returns to the shell that called it."""

    OK = 0  # ended as asked, with every robot
    FAILURE = 1  # anything else went wrong
    USAGE = 2  # an option, a file or a setting is wrong, or the world does not let the robot in
    INCOMPLETE = 3  # ended, but a robot died or never completed
    INTERRUPTED = 130


ENDINGS = {"complete": Status.OK, "time": Status.OK, "dead": Status.INCOMPLETE, "interrupted": Status.INTERRUPTED}
"""Exit status by how a run ended, for a world or a robot alone."""
