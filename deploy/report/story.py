"""The story of trust in a run: who heard whom, proposed, merged, refused and undid, in sentences."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import Any

from deploy.report.rundir import Run, mapping
from deploy.report.words import NONE, number
from world.recorder import REPLACED

MAX_BONDS = 5000  # times in which a robot hears another, or has its map on trial
MAX_TOLD = 600  # events on slider and list
HEARING, TRIAL = ("contact", "lost"), ("proposed", "accepted", "rejected")
"""Events of which the first begins something between two robots, and the others end it."""
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


def forgets(event: Mapping[str, Any]) -> bool:
    """Whether a robot's mind begins anew with what it knows of others: their maps are no part of its own any more."""
    return event.get("event") == "rejoined" and event.get("reason") == REPLACED


def bonds(run: Run) -> list[dict[str, Any]]:
    """When a robot hears a peer, or has its map on `trial`: robot, peer, trial, `since` and `until`.

    Both are simulated seconds; `until` is None for what lasts to the end of the run.
    """
    made: list[dict[str, Any]] = []
    lasting: defaultdict[str, dict[tuple[str, bool], dict[str, Any]]] = defaultdict(dict)
    for event in run.events:
        t, robot, peer, what = round(event["t"], 1), event["robot"], event.get("peer"), event["event"]
        if what == "dead" or forgets(event):
            for bond in lasting.pop(robot, {}).values():
                bond["until"] = t
        elif isinstance(peer, str) and what in (*HEARING, *TRIAL):
            trial, own = what in TRIAL, lasting[robot]
            own.pop((peer, trial), {})["until"] = t
            if what in (HEARING[0], TRIAL[0]):
                own[peer, trial] = {"robot": robot, "peer": peer, "trial": trial, "since": t, "until": None}
                made.append(own[peer, trial])
    return _shared(made, MAX_BONDS)


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
    return number(value) != NONE and value != 0
