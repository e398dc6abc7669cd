"""What became of each pair of robots, from the events of a run directory."""

import json
from pathlib import Path
from typing import Any, NamedTuple

EVENTS = ("attempt", "proposed", "accepted", "rejected", "unmerged")


class PairFate(NamedTuple):
    """What one robot made of the maps of one peer."""

    robot: str
    peer: str
    contacts: int
    attempts: int
    """Alignments that came to no proposal."""
    proposed: int
    merged_at: float | None
    """Simulated seconds of the acceptance that holds at the end; None without one."""
    transform: list[float] | None
    """The peer's frame in the robot's own, of that acceptance."""
    last: str
    """The last event, and its reason."""


def fates(out: Path) -> list[PairFate]:
    """For each pair that met, by name. Raises OSError or ValueError where events.jsonl cannot be read."""
    pairs: dict[tuple[str, str], dict[str, Any]] = {}
    for line in (out / "events.jsonl").read_text(encoding="utf-8").splitlines():
        event = json.loads(line)
        what = event["event"]
        if what != "contact" and what not in EVENTS:
            continue
        fate = pairs.setdefault(
            (event["robot"], event["peer"]),
            {"contacts": 0, "attempts": 0, "proposed": 0, "merged_at": None, "transform": None, "last": "contact"},
        )
        if what == "contact":
            fate["contacts"] += 1
            continue
        fate["last"] = f"{what}: {event['reason']}"
        if what == "attempt":
            fate["attempts"] += 1
        elif what == "proposed":
            fate["proposed"] += 1
        elif what == "accepted":
            fate["merged_at"], fate["transform"] = event["t"], event["transform"]
        elif what == "unmerged":
            fate["merged_at"] = fate["transform"] = None
    return [PairFate(robot, peer, **fate) for (robot, peer), fate in sorted(pairs.items())]
