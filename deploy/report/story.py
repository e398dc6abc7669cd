"""The story of trust in a run: who heard whom, proposed, merged, refused and undid, in sentences."""

from collections import Counter
from typing import Any

from deploy.report.rundir import Run, mapping
from deploy.report.words import number

MAX_BONDS = 5000  # events that begin or end something between two robots
MAX_TOLD = 600  # events on slider and list
GLYPHS = {
    "contact": "◌",
    "proposed": "?",
    "accepted": "✓",
    "rejected": "✗",
    "unmerged": "↶",
    "complete": "■",
    "resumed": "▸",
    "dead": "†",
    "rejoined": "↻",
}
"""Of the events that are told, on the map and under the slider."""
SEVERITY = {"rejected": "warning", "unmerged": "warning", "dead": "error"}
"""Of events that are more than news, for logs."""
MEANINGS = {
    "contact": "hears another robot again",
    "proposed": "proposes where the other's map lies; a dashed line while it is on trial",
    "accepted": "believes it and merges the map",
    "rejected": "refuses it",
    "unmerged": "takes a merged map out again",
    "complete": "has nothing left to explore",
    "resumed": "explores again: a wall leads on, or what a teammate saw was taken back",
    "dead": "is given up: its process ended, or it fell silent, or said what makes no sense",
    "rejoined": "takes part again",
}
"""What the legend says of the marks."""


def told(run: Run) -> list[dict[str, Any]]:
    """The events of the story in their order: t, robot, peer, event, glyph, text."""
    made: list[dict[str, Any]] = []
    for event in _shared(_of_story(run), MAX_TOLD):
        name = event["event"]
        peer = {"peer": event["peer"]} if isinstance(event.get("peer"), str) else {}
        one = {"t": round(event["t"], 1), "robot": event["robot"], "event": name, "glyph": GLYPHS[name]}
        made.append(one | peer | {"text": sentence(event)})
    return made


def left_out(run: Run) -> int:
    """How many events of the story are not told."""
    events = _of_story(run)
    return len(events) - len(_shared(events, MAX_TOLD))


def _of_story(run: Run) -> list[dict[str, Any]]:
    return [event for event in run.events if event["event"] in GLYPHS]


def _shared(events: list[dict[str, Any]], most: int) -> list[dict[str, Any]]:
    """Of too many events the first ones of each robot, so that none that says much hides the others."""
    said = Counter(event["robot"] for event in events)
    share, beyond = 1, most + 1
    while beyond - share > 1:
        middle = (share + beyond) // 2
        fits = sum(min(count, middle) for count in said.values()) <= most
        share, beyond = (middle, beyond) if fits else (share, middle)
    kept, counts = [], Counter[str]()
    for event in events:
        counts[event["robot"]] += 1
        if counts[event["robot"]] <= share:
            kept.append(event)
    return kept[:most]


def bonds(run: Run) -> list[dict[str, Any]]:
    """Between which times pairs hear each other and proposals are on trial: t, robot, peer, event."""
    kinds = ("contact", "lost", "proposed", "accepted", "rejected")
    events = [event for event in run.events if event["event"] in kinds and isinstance(event.get("peer"), str)]
    shared = _shared(events, MAX_BONDS)
    return [{"t": round(e["t"], 1), **{key: e[key] for key in ("robot", "peer", "event")}} for e in shared]


def sentence(event: dict[str, Any]) -> str:
    """What happened, of any event."""
    robot, peer, reason = event["robot"], event.get("peer", "another"), event.get("reason", "")
    because = f": {reason}" if reason else ""
    match event["event"]:
        case "contact":
            return f"{robot} hears {peer}"
        case "proposed":
            corners = f"; {event['inliers']} corners fit" if "inliers" in event else ""
            return f"{robot} proposes how {peer}'s map fits{because}{corners}"
        case "accepted":
            return f"{robot} merges {peer}'s map, {_evidence(event)}"
        case "rejected":
            return f"{robot} refuses {peer}'s map{because}, {_evidence(event)}"
        case "unmerged":
            return f"{robot} takes {peer}'s map out{because}"
        case "complete":
            return f"{robot} is complete{because}"
        case what:
            return f"{robot} {what}{because}"


def _evidence(event: dict[str, Any]) -> str:
    """How much spoke for a proposal, and what."""
    values = mapping(event.get("evidence")).items()
    kinds = [f"{kind.replace('_', ' ')} {value:g}" for kind, value in values if _counts(value)]
    return f"evidence {number(event.get('weight'))} nats" + (f" ({', '.join(kinds)})" if kinds else "")


def _counts(value: Any) -> bool:
    return isinstance(value, int | float) and value != 0
