"""Whether this machine has room for a run, asked before anything is started. Figures are those of whole runs."""

import math
import os
import resource
from collections.abc import Iterator
from pathlib import Path

import psutil

from protocol.configuration import ConfigError

WORLD_BYTES, ROBOT_BYTES = 400 << 20, 40 << 20
"""Memory (PSS) of launcher, server of forks and world, and of each robot. Measured with 100 robots in a maze of 80 m:
360 and 28 MiB; maps grow with time."""
WORLD_THREADS, ROBOT_THREADS = 40, 9
"""Measured; Zenoh begins eight in each robot."""
WORLD_FILES, ROBOT_FILES = 60, 4
"""Open files of the launcher: pipes and sentinels."""


def check(robots: int) -> None:
    """Raise ConfigError where so many robots find too little memory, threads or files. Raises the limit of files."""
    _raise_file_limit(WORLD_FILES + robots * ROBOT_FILES)
    soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    files = math.inf if soft == resource.RLIM_INFINITY else soft
    _compare(robots, "open files", WORLD_FILES, ROBOT_FILES, files, 1)
    _compare(robots, "threads", WORLD_THREADS, ROBOT_THREADS, min(_threads_left()), 1)
    _compare(robots, "MiB of memory", WORLD_BYTES, ROBOT_BYTES, min(_bytes_left()), 1 << 20)


def _compare(robots: int, what: str, base: int, each: int, room: float, unit: int) -> None:
    if (need := base + robots * each) > room:
        most = max(0, int(room - base) // each)
        take = f"take at most {most}" if most else "make room"
        raise ConfigError(
            f"robots: {robots} need about {need // unit} {what}, and this machine has {max(0, int(room)) // unit} left "
            f"for them: {take}"
        )


def _raise_file_limit(files: int) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < files:
        resource.setrlimit(
            resource.RLIMIT_NOFILE, (files if hard == resource.RLIM_INFINITY else min(hard, files), hard)
        )


def _threads_left() -> Iterator[float]:
    """Threads that may be begun: of the kernel, of this user, of our control groups."""
    running = int(Path("/proc/loadavg").read_text().split()[3].partition("/")[2])
    yield min(int(Path("/proc/sys/kernel", name).read_text()) for name in ("pid_max", "threads-max")) - running
    most, user = resource.getrlimit(resource.RLIMIT_NPROC)[0], os.getuid()
    if most != resource.RLIM_INFINITY and user:  # root has no such limit
        own = (process.info for process in psutil.process_iter(["uids", "num_threads"]) if process.info["uids"])
        yield most - sum(info["num_threads"] or 0 for info in own if info["uids"].real == user)
    yield from (most - used for most, used, _ in _limits("pids", "pids.max", "pids.current"))


def _bytes_left() -> Iterator[float]:
    """Memory that may be taken: of the machine, of our control groups. Pages of files are given back when needed."""
    yield psutil.virtual_memory().available
    yield from (most - used + cached for most, used, cached in _limits("memory", "memory.max", "memory.current"))
    old = _limits("memory", "memory.limit_in_bytes", "memory.usage_in_bytes")
    yield from (most - used + cached for most, used, cached in old)


def _limits(
    controller: str,
    limit: str,
    usage: str,
    groups: Path = Path("/proc/self/cgroup"),
    root: Path = Path("/sys/fs/cgroup"),
) -> Iterator[tuple[int, int, int]]:
    """Limit, usage and cached pages of the control groups that this process is in, and those above them."""
    for line in groups.read_text().splitlines() if groups.exists() else ():
        _, names, path = line.split(":", 2)
        if names and controller not in names.split(","):
            continue
        mount = root / controller if names else root  # version 1 has a tree for each controller
        place = mount / path.lstrip("/")
        for folder in (place, *place.parents):
            if not folder.is_relative_to(mount):
                break
            try:
                most, used = (int((folder / name).read_text()) for name in (limit, usage))
            except (OSError, ValueError):  # no such group here, or "max"
                continue
            yield most, used, _cached(folder)


def _cached(folder: Path) -> int:
    try:
        stat = dict(line.split(maxsplit=1) for line in (folder / "memory.stat").read_text().splitlines())
    except (OSError, ValueError):
        return 0
    return int(stat.get("total_inactive_file", stat.get("inactive_file", 0)))
