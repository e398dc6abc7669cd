"""Logs mapped: a mind for each, without driving, into a run directory."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress

from agent.config import AgentConfig
from agent.passenger import carried
from deploy import manifest
from deploy.recorded.lidar_log import LidarLog
from deploy.recorded.team import Player, play
from deploy.terminal.console import Terminal
from protocol.arrays import Floats
from protocol.errors import ProtocolError
from protocol.files import write_whole
from protocol.grid_map import main_axis, quantise
from protocol.map_codec import encode_map
from protocol.settings import Config
from protocol.text import printable
from protocol.wireframe import Wireframe
from world.recorder import map_fields

TELL_EVERY = 50  # scans from one word of progress to the next


class LogsConfig(Config):
    """Settings of `wireswarm map`."""

    agent: AgentConfig = AgentConfig()
    """Every log's mind."""


def map_logs(
    logs: Sequence[LidarLog], config: AgentConfig, out: Path, *, range_m: float = math.inf, quiet: bool = False
) -> dict[str, Any]:
    """Map each log by a mind of its own, r1 the first, and write the run directory; returns the fields of summary.json.

    range_m: of the radio, where all logs have a reference. Raises UnwritableError.
    """
    config = carried(config)
    manifest.begin(out, manifest.of_logs(config, [log.source for log in logs]))
    with Progress(console=Terminal(), disable=quiet, transient=True) as bars:
        named = {f"r{k + 1}": log for k, log in enumerate(logs)}
        tasks = {
            robot: bars.add_task(printable(f"{robot}: {Path(log.source).name}"), total=len(log.scans))
            for robot, log in named.items()
        }

        def tell(robot: str, done: int) -> None:
            if done % TELL_EVERY == 0 or done == len(named[robot].scans):
                bars.update(tasks[robot], completed=done)

        players = play(logs, config, range_m, tell)
    team = len(players) > 1
    own = {player.name: player.mind.drawn() for player in players}
    for player in players:
        _write(out, player, own[player.name], team)
    if team:
        events = sorted((event for player in players for event in player.events), key=lambda event: event["tick"])
        write_whole(out / "events.jsonl", "".join(json.dumps(event, allow_nan=False) + "\n" for event in events))
    summary: dict[str, Any] = {
        "robots": {player.name: _figures(player, own[player.name], config, team) for player in players}
    }
    if team:
        summary["heard"] = "all" if players[0].mind.team.spec.radio_range_m is None else "in range"
    write_whole(out / "summary.json", json.dumps(summary, indent=1) + "\n")
    manifest.finish(out, ended="complete", exit_status=0)
    return summary


def _figures(player: Player, own: Wireframe, config: AgentConfig, team: bool) -> dict[str, Any]:
    """Fields of summary.json. own: the map of own scans."""
    mind, log = player.mind, player.log
    figures = {
        "log": log.source,
        "ended": "complete",
        "scans": len(log.scans),
        "skipped": dict(log.skipped),
        "notes": log.notes,
        "path_m": round(float(np.hypot(*np.diff(mind.path()[:, :2], axis=0).T).sum()), 3),
        "loops": mind.submaps.loops,
        "map_bytes": _told_bytes(own, config.radio.cell_mm),
        "filter_bytes": mind.submaps.nbytes,
        "step_ms_median": round(float(np.median(player.step_ms)), 3),
        "step_ms_99": round(float(np.percentile(player.step_ms, 99)), 3),
    }
    if team:
        figures |= {
            "bytes_sent": player.sent_bytes,
            "bytes_received": player.received_bytes,
            "merged": {peer.log.name: np.round(peer.transform, 4).tolist() for peer in mind.team.merged},
        }
    return figures


def _told_bytes(own: Wireframe, cell_mm: int) -> int | None:
    """Of a map on the radio; None for one that is too large for it, or reaches too far."""
    try:
        return len(encode_map(quantise(own, cell_mm, main_axis(own))).data)
    except ProtocolError:
        return None


def _write(out: Path, player: Player, own: Wireframe, team: bool) -> None:
    """Write maps/ID.json, in a team maps/ID.own.json, and estimate/ID.tum. Raises UnwritableError."""
    robot, mind = player.name, player.mind
    for folder in ("maps", "estimate"):
        (out / folder).mkdir(exist_ok=True)
    maps = {robot: mind.wireframe(), f"{robot}.own": own} if team else {robot: own}
    for name, wireframe in maps.items():
        write_whole(out / "maps" / f"{name}.json", json.dumps(map_fields(robot, wireframe), indent=1) + "\n")
    write_whole(out / "estimate" / f"{robot}.tum", _tum(player.log, mind.path()))


def _tum(log: LidarLog, path: Floats) -> str:
    lines = (
        f"{scan.number} {x:.4f} {y:.4f} 0 0 0 {math.sin(0.5 * theta):.6f} {math.cos(0.5 * theta):.6f}\n"
        for scan, (x, y, theta) in zip(log.scans, path.tolist(), strict=True)
    )
    return "".join(lines)
