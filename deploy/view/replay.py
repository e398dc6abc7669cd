"""A finished run as a recording, from the files of its run directory alone."""

from __future__ import annotations

import math
from bisect import bisect_right
from pathlib import Path

import numpy as np

from agent.period import in_ticks
from deploy.recorded.runs import kept_scans, ranges_of
from deploy.report.rundir import Run, read_drawable
from deploy.report.story import bonds
from deploy.view.recording import ViewRecording, replayed
from protocol.arrays import Bools, Floats, Ints
from protocol.errors import InputError
from world.recorder import TEAM

BEAMS_S = 1.0  # between the scans that are drawn: all five of a second would make ten times as many bytes


def record(path: Path, file: Path) -> None:
    """Write the recording of a run directory. Raises InputError where it has no world, frames or paths."""
    run, world = read_drawable(path)
    robots = [robot for robot in run.placed if robot in run.poses]
    if not robots:
        raise InputError(f"{path}: truth.json tells of no robot where its own frame is")
    period_s = 1 / run.lidar.rate_hz
    recording = ViewRecording(file, robots, run.frames, period_s)
    recording.scene(world.solid, run.radius, replayed(run.duration))
    maps = run.snapshots
    for robot in robots:
        poses = run.poses[robot]
        recording.drive(robot, _ticks(poses[:, 0], period_s), poses[:, 1:])
        _beams(recording, run, robot)
        if robot in maps:
            times, drawn = zip(*maps[robot], strict=True)
            recording.maps(robot, _ticks(np.array(times), period_s), drawn)
    for name in (*robots, TEAM):
        if name in run.metrics and "coverage" in run.metrics[name].columns:
            series = run.metrics[name]
            recording.coverage(name, _ticks(series.t, period_s), series.columns["coverage"])
    _radio(recording, run, robots, period_s)
    ticks = _ticks(np.array([event["t"] for event in run.events]), period_s)
    recording.events(ticks, run.events)
    for tick, event in zip(ticks.tolist(), run.events, strict=True):
        peer = event.get("peer")
        known = maps.get(peer, []) if isinstance(peer, str) else []
        now = bisect_right(known, event["t"], key=lambda one: one[0]) - 1
        recording.trust(tick, event, known[now][1] if now >= 0 else None)
    recording.close()


def _ticks(t: Floats, period_s: float) -> Ints:
    return np.round(t / period_s).astype(np.int64)


def _beams(recording: ViewRecording, run: Run, robot: str) -> None:
    """The beams of a robot, where the run has kept its scans."""
    source, apart = run.path / "scans" / f"{robot}.jsonl", in_ticks(BEAMS_S, run.lidar.rate_hz)
    if not source.exists():
        return
    ticks, scans = [], []
    for scan in kept_scans(source, run.lidar.beams):
        if scan["tick"] % apart == 0:
            ticks.append(scan["tick"])
            scans.append(ranges_of(scan))
    if ticks:
        recording.beams(robot, ticks, scans, run.lidar)


def _radio(recording: ViewRecording, run: Run, robots: list[str], period_s: float) -> None:
    """Lines between robots that hear each other."""
    ticks = _ticks(run.poses[robots[0]][:, 0], period_s)
    hearing: dict[tuple[int, int], Bools] = {}
    for bond in bonds(run):
        if not bond["trial"] and {bond["robot"], bond["peer"]} <= set(robots):
            pair = robots.index(bond["robot"]), robots.index(bond["peer"])
            heard = hearing.setdefault(pair, np.zeros(len(ticks), np.bool_))
            times = [bond["since"], math.inf if bond["until"] is None else bond["until"]]
            heard[slice(*np.searchsorted(ticks * period_s, np.array(times) - period_s / 2))] = True
    if not hearing:
        return
    mask = np.array(list(hearing.values())).T  # (ticks, pairs)
    rows, pairs = np.nonzero(mask)
    places = np.array([_at(run.poses[robot], ticks, period_s) for robot in robots])  # (robots, ticks, 2)
    ends = np.array(list(hearing))[pairs]  # (lines, 2)
    recording.radio(ticks, np.split(places[ends, rows[:, None]], np.cumsum(mask.sum(axis=1))[:-1]))


def _at(poses: Floats, ticks: Ints, period_s: float) -> Floats:
    """Places (ticks, 2) of a robot; before the first and after the last known one it stands there."""
    rows = np.searchsorted(_ticks(poses[:, 0], period_s), ticks, "right") - 1
    return poses[np.clip(rows, 0, len(poses) - 1), 1:3]
