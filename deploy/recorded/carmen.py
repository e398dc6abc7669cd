"""CARMEN text logs, plain or gzipped: their FLASER or ROBOTLASER1 lines (carmen.sourceforge.net, "Logger")."""

import gzip
import math
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedReader, TextIOWrapper
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from agent.shell.ros2.laser_scan import believed_range
from deploy.recorded.lidar_log import OF_LOGS, Given, LidarLog, Scan, check_amount
from deploy.recorded.revolution import Revolution
from deploy.recorded.untold import find_untold
from protocol.arrays import Floats
from protocol.document import check_is_file
from protocol.errors import InputError
from protocol.geometry import Pose, compose, relative
from protocol.messages import MAX_BEAMS, LidarSpec
from protocol.settings import MAX_NUMBER
from protocol.text import in_own_words

FLASER, ROBOTLASER = "FLASER", "ROBOTLASER1"
REVOLUTION = "wireswarm_revolution_s"
"""Name of a PARAM line of ours: seconds that the lidar turns for a scan, negative where readings are told in the
opposite order of that in which they were taken; 0 for scans of one moment."""
MAX_REVOLUTION_S = 100.0
MAX_LINE = 200_000  # characters: 4096 readings with 12 digits, remissions and poses are 100,000
MAX_BYTES = 1 << 32  # of text, also out of a small gzip file
MAX_HEAD = 1 << 24  # of text before the first scan: settings are some kB, three hours of other lines are this
MAX_LASERS = 8  # of a log, that are told apart
MOUNT_M = 2.0  # a lidar farther than this from its robot's middle is no mount, but two ways of counting poses
SICK_RANGE_M = 80.0  # FLASER lines tell no range (`ceiling.py`): most SICKs give 81.83 m where nothing came back
NEAR_M = 0.05  # no lidar sees nearer; 0 stands for not measured

CUT = "lines that are cut or hold no numbers"


class _NoLidarError(ValueError):
    """A line is of no lidar that there can be; the text is why it is skipped."""


def read_carmen(file: Path, given: Given) -> LidarLog:
    """The scans of a log, those of the kind that comes first and of the lidar that has most.

    Raises InputError where there is none, or no file.
    """
    try:
        return _read(file, given)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except OSError as error:
        raise InputError(f"{file}: it cannot be read: {error}") from None


@dataclass
class _Laser:
    """One of the lidars whose lines a log has, and what it saw."""

    log: LidarLog

    def is_of(self, lidar: LidarSpec) -> bool:
        """Whether beams of a line's lidar point where this one's do."""
        mine, apart_deg = self.log.lidar, math.degrees(0.5 * lidar.beam_step)
        off = mine.first_beam_deg - lidar.first_beam_deg, mine.field_of_view_deg - lidar.field_of_view_deg
        alike = (mine.beams, mine.clockwise) == (lidar.beams, lidar.clockwise)
        return alike and max(map(abs, off)) < apart_deg

    def add(self, number: int, time_s: float, readings: Floats, seen_from: Pose, robot: Pose) -> None:
        """Take a line's scan, or count why it cannot be used."""
        if all(abs(value) <= MAX_NUMBER for value in (*robot, *seen_from)):  # NaN is not
            if self.log.mount is None:  # by its first line
                self.log.mount = relative(robot, seen_from)
                if (away_m := math.hypot(self.log.mount[0], self.log.mount[1])) > MOUNT_M:
                    self.log.mount = (0.0, 0.0, 0.0)
                    self.log.notes.append(
                        f"its lidar is told to be {away_m:.1f} m from the robot: taken as in its middle"
                    )
            robot = compose(robot, self.log.mount)
        else:
            robot = (math.nan, math.nan, math.nan)
        self.log.add(Scan(number, time_s, self.log.lidar.cleaned(readings), robot))


def _read(file: Path, given: Given) -> LidarLog:
    lasers: list[_Laser] = []
    kind, index, skipped = "", -1, Counter[str]()
    told: Revolution | None = None
    damage: list[str] = []
    for words, read in _lines(file, damage):
        if not lasers and read > MAX_HEAD:
            raise InputError(f"its first {MAX_HEAD >> 20} MB hold no scan; it should be a CARMEN text log")
        if words[:2] == ["PARAM", REVOLUTION]:
            told = _revolution(words) or told
        if not words or words[0] not in (FLASER, ROBOTLASER):
            continue
        if kind and words[0] != kind:
            skipped[f"{words[0]} lines, as the first scan is a {kind} line"] += 1
            continue
        index += 1
        check_amount(index + 1, sum(one.log.lidar.beams * len(one.log.scans) for one in lasers))
        try:
            lidar, readings, seen_from, robot, time_s = _parsed(words, given)
        except (ValueError, IndexError) as error:
            skipped[str(error) if isinstance(error, _NoLidarError) else CUT] += 1
            continue
        laser = next((one for one in lasers if one.is_of(lidar)), None)
        if laser is None:
            laser, kind = _Laser(LidarLog(lidar, str(file))), words[0]
            if len(lasers) == MAX_LASERS:
                skipped[f"scans of a lidar that comes after {MAX_LASERS} others"] += 1
                continue
            lasers.append(laser)
        laser.add(index, time_s, readings, seen_from, robot)
    if damage and not lasers:
        raise InputError(f"it cannot be read: {damage[0]}")
    if not lasers and not skipped:
        raise InputError("no line of it is a FLASER or ROBOTLASER1 scan; it should be a CARMEN text log")
    log = _of_most(lasers, skipped)
    if damage:
        log.notes.append(f"damaged after {index + 1} scans, and what follows is left out: {damage[0]}")
    if given.field_of_view_deg is not None and kind == ROBOTLASER:
        log.notes.append(f"--field-of-view is left out: {ROBOTLASER} lines tell it")
    find_untold(log, given, told)
    return log


def _of_most(lasers: list[_Laser], skipped: Counter[str]) -> LidarLog:
    """What the lidar with most scans saw, the first of several; what others saw is skipped.

    skipped: lines of no lidar. Raises InputError where no scan can be used.
    """
    log = max((one.log for one in lasers), key=lambda log: len(log.scans), default=None)
    if log is None or not log.scans:
        reasons = sum((one.log.skipped for one in lasers), skipped)
        raise InputError(f"none of its scans can be used: {', '.join(reasons)}")
    lidar = log.lidar
    reason = (
        f"scans of another lidar than the one read, which has {lidar.beams} beams over {lidar.field_of_view_deg:.4g} "
        f"degrees from {lidar.first_beam_deg:.4g} degrees on"
    )
    others = sum(len(one.log.scans) + one.log.skipped.total() for one in lasers if one.log is not log)
    log.skipped += skipped + Counter({reason: others})
    return log


def _revolution(words: list[str]) -> Revolution | None:
    """What a PARAM line tells of the lidar's revolution; None where it cannot be."""
    try:
        seconds = float(words[2])
    except (ValueError, IndexError):
        return None
    return Revolution(abs(seconds), backwards=seconds < 0) if abs(seconds) <= MAX_REVOLUTION_S else None


def _lines(file: Path, damage: list[str]) -> Iterator[tuple[list[str], int]]:
    """Words of each line, whatever ends it, and the characters up to there.

    What is wrong with a gzip file ends them, as of a recording that was broken off, and is added to `damage`.
    """
    check_is_file(file)
    with file.open("rb") as raw:
        zipped = raw.read(2) == b"\x1f\x8b"
        raw.seek(0)
        unzipped = BufferedReader(gzip.GzipFile(fileobj=raw)) if zipped else raw
        with TextIOWrapper(unzipped, "utf-8-sig", "replace") as stream:
            read = 0
            while line := _line(stream, damage):
                read += len(line)
                if read > MAX_BYTES:
                    raise InputError(f"more than {MAX_BYTES >> 20} MB of text; split it")
                yield line.lstrip("\0").split(), read  # a power cut leaves zeros


def _line(stream: TextIOWrapper, damage: list[str]) -> str:
    """The next line; none where the rest is damaged."""
    try:
        return stream.readline(MAX_LINE)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        damage.append(str(error))
        return ""


def _parsed(words: list[str], given: Given) -> tuple[LidarSpec, Floats, Pose, Pose, float]:
    """Lidar, readings, pose of the lidar, pose of the robot and time of a line. Raises ValueError or IndexError."""
    flaser, clockwise = words[0] == FLASER, False
    begin = 2 if flaser else 9
    count = int(words[begin - 1])
    if not 8 <= count <= MAX_BEAMS:
        raise _NoLidarError(f"scans of fewer than 8 or more than {MAX_BEAMS} beams")
    if flaser:
        view = 180.0 if given.field_of_view_deg is None else given.field_of_view_deg
        first, step, limit = -0.5 * view, view / (count - count % 2), SICK_RANGE_M
        after = begin + count
    else:
        first, step = math.degrees(float(words[2])), math.degrees(float(words[4]))
        limit = believed_range(float(words[5]))
        clockwise, step = step < 0, abs(step)
        after = begin + count + 1 + max(int(words[begin + count]), 0)
    if len(words) < after + 7:
        raise ValueError
    readings = np.array(words[begin : begin + count], np.float64)
    values = [float(word) for word in words[after : after + 6]]
    if step * (count - 0.5) > 360:  # the last beam is the first one again
        count, readings = count - 1, readings[:-1]
    if step * (count - 0.5) > 360:
        raise _NoLidarError("scans of no possible lidar: their beams are over more than 360 degrees")
    try:
        lidar = LidarSpec(
            beams=count,
            field_of_view_deg=min(step * count, 360.0),
            first_beam_deg=first,
            clockwise=clockwise,
            range_min_m=NEAR_M,
            range_max_m=limit if given.range_max_m is None else given.range_max_m,
            **OF_LOGS,
        )
    except ValidationError as error:
        wrong = error.errors()[0]
        why = ": ".join((*map(str, wrong["loc"]), in_own_words(wrong["msg"])))
        raise _NoLidarError(f"scans of no possible lidar: {why}") from None
    time_s = float(words[after + (6 if flaser else 11)])
    return lidar, readings, (values[0], values[1], values[2]), (values[3], values[4], values[5]), time_s
