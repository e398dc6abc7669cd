"""What became of each pair of robots, from the events of a run directory."""

import json
from dataclasses import dataclass
from pathlib import Path


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
    last: str = "contact"  # the last event, and its reason


def fates(out: Path) -> list[PairFate]:
    """For each pair that met, by name. Raises OSError or ValueError where events.jsonl cannot be read."""
    pairs: dict[tuple[str, str], PairFate] = {}
    for event in map(json.loads, (out / "events.jsonl").read_text(encoding="utf-8").splitlines()):
        what = event["event"]
        if what not in ("contact", "attempt", "proposed", "accepted", "rejected", "unmerged"):
            continue
        pair = event["robot"], event["peer"]
        fate = pairs.setdefault(pair, PairFate(*pair))
        fate.contacts += what == "contact"
        fate.attempts += what == "attempt"
        fate.proposed += what == "proposed"
        if what != "contact":
            fate.last = f"{what}: {event['reason']}"
        if what in ("accepted", "unmerged"):
            fate.merged_at, fate.transform = (event["t"], event["transform"]) if what == "accepted" else (None, None)
    return [pairs[pair] for pair in sorted(pairs)]
