"""What became of each pair of robots, from the events of a run directory."""

import json
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deploy.report.story import forgets
from protocol.document import read_lines


@dataclass
class PairFate:
    """What one robot made of the maps of one peer."""

    robot: str
    peer: str
    contacts: int = 0
    attempts: int = 0  # alignments that came to no proposal
    proposed: int = 0
    merged_at: float | None = None  # simulated seconds of the acceptance that holds at the end; None without one
    transform: list[float] | None = None  # the peer's frame in the robot's own, of that acceptance
    last: str = "contact"  # the last event that changed something, and its reason


def fates(out: Path) -> list[PairFate]:
    """For each pair that met, by name. Raises OSError or ValueError where events.jsonl cannot be read.

    A line whose fields are not as docs/formats.md says is left out: a robot may write anything.
    """
    pairs: dict[tuple[str, str], PairFate] = {}
    holding: defaultdict[str, list[PairFate]] = defaultdict(list)
    for line in read_lines(out / "events.jsonl"):
        event: Any = None
        with suppress(ValueError, RecursionError):
            event = json.loads(line)
        match event:
            case {"event": "contact" as what, "robot": str(robot), "peer": str(peer)}:
                reason = ""
            case {
                "event": ("attempt" | "proposed" | "accepted" | "rejected" | "unmerged") as what,
                "robot": str(robot),
                "peer": str(peer),
                "reason": str(reason),
            }:
                pass
            case {"robot": str(robot)} if forgets(event):
                for fate in holding.pop(robot, ()):
                    if fate.merged_at is not None:
                        fate.merged_at, fate.transform, fate.last = None, None, f"rejoined: {event['reason']}"
                continue
            case _:
                continue
        fate = pairs.setdefault((robot, peer), PairFate(robot, peer))
        fate.contacts += what == "contact"
        fate.attempts += what == "attempt"
        fate.proposed += what == "proposed"
        if what != "contact":
            fate.last = f"{what}: {reason}"
        if what in ("accepted", "unmerged"):
            fate.merged_at, fate.transform = _merged(event) if what == "accepted" else (None, None)
            holding[robot].append(fate)
    return [pairs[pair] for pair in sorted(pairs)]


def _merged(event: dict[str, Any]) -> tuple[float | None, list[float] | None]:
    """Time and transform of an acceptance; None for each that is not of numbers."""
    match event:
        case {"t": int() | float() as t, "transform": [int() | float(), int() | float(), int() | float()] as transform}:
            return t, transform
    return None, None
