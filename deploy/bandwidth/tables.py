"""The bandwidth measurement as tables for people and a document for programs."""

from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Column, Table
from rich.text import Text

from deploy.bandwidth.replay import config_of
from deploy.bandwidth.representations import FORMS, Measurement
from deploy.sensing import named
from deploy.terminal.console import Terminal
from deploy.terminal.tables import add_row
from protocol.text import printable

BY_DEFAULT = "the whole map anew, by default settings"
WIDTH = 110  # characters that a line needs
MANY_LINKS = 12  # more links than that are in the JSON only


def document(run: Path, measurement: Measurement) -> dict[str, Any]:
    """All figures of a run. full_by_default: its robots' settings are not on record, as by `wireswarm world`."""
    totals = measurement.totals()
    ratios = {name: round(totals["delta"] / size, 6) if size else None for name, size in totals.items()}
    config = config_of(run)
    full_by_default = "agent" not in config.model_fields_set
    about = {"run": str(run), "sensing": named(config.spec), "full_by_default": full_by_default}
    return {**about, **measurement.books, **measurement.as_dict(), "delta_against": ratios}


def print_tables(figures: dict[str, Any]) -> None:
    """Print a document's tables to stdout."""
    console = Terminal(stderr=False, least_width=WIDTH)
    heard = f": {figures['updates']} contact updates, {figures['sensing']} sensing"
    console.print(Text(printable(figures["run"]), "bold"), heard, sep="", highlight=False)
    console.print(_robots(figures["robots"]))
    if len(figures["links"]) <= MANY_LINKS:
        console.print(_links(figures["links"]))
    if "wire" in figures:
        console.print(_wire(figures["wire"]))
    console.print(_representations(figures))


def _table(title: str, *heads: str) -> Table:
    words = ("robot", "from", "to", "kind", "form", "is")
    columns = (Column(head, justify="left" if head in words else "right") for head in heads)
    return Table(*columns, title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))


def _counts(tally: dict[str, int] | None) -> str:
    return f"{tally['messages']:,} / {tally['bytes']:,}" if tally else "-"


def _lost(dropped: dict[str, dict[str, int]]) -> str:
    return ", ".join(f"{why} {_counts(tally)}" for why, tally in dropped.items()) or "-"


def _robots(robots: dict[str, Any]) -> Table:
    table = _table("Messages / bytes per robot", "robot", "kind", "offered", "addressed", "delivered to it", "dropped")
    for robot, books in robots.items():
        for kind in sorted({*books["offered"], *books["delivered"], *books["dropped"]}):
            parts = [_counts(books[part].get(kind)) for part in ("offered", "addressed", "delivered")]
            add_row(table, robot, kind, *parts, _lost(books["dropped"].get(kind, {})))
    return table


def _links(links: list[dict[str, Any]]) -> Table:
    table = _table("Messages / bytes per link", "from", "to", "kind", "offered", "delivered", "dropped")
    for link in links:
        for kind, counts in link["kinds"].items():
            parts = [_counts(counts[part]) for part in ("offered", "delivered")]
            add_row(table, link["sender"], link["receiver"], kind, *parts, _lost(counts["dropped"]))
    return table


def _wire(wire: dict[str, Any]) -> Table:
    heads = ("messages", "payload bytes", "overhead", "explained", "on the wire", "unexplained")
    table = _table("Links to the world's process, telemetry and scans included", "robot", "to", *heads)
    for robot, flows in wire.items():
        for way, flow in flows.items():
            explained = flow["payload_bytes"] + flow["overhead_bytes"]
            figures = (flow["messages"], flow["payload_bytes"], flow["overhead_bytes"], explained, flow["wire_bytes"])
            to = "robot" if way == "to_robot" else "world"
            add_row(table, robot, to, *(f"{value:,}" for value in figures), f"{flow['unexplained_share']:.3%}")
    return table


def _representations(figures: dict[str, Any]) -> Table:
    table = _table("Map traffic", "form", "bytes", "per update", "per m2 explored", "delta / it", "is")
    area = sum(figures["explored_m2"].values())
    meanings = FORMS | ({"full": BY_DEFAULT} if figures["full_by_default"] else {})
    for name, meaning in meanings.items():
        size, ratio = figures["representations"][name], figures["delta_against"][name]
        each = f"{size / figures['updates']:,.1f}" if figures["updates"] else "-"
        per_area = f"{size / area:,.2f}" if area else "-"
        add_row(table, name, f"{size:,}", each, per_area, "-" if ratio is None else f"{ratio:.5f}", meaning)
    add_row(table, "viewpoints", f"{figures['viewpoint_bytes']:,}", "", "", "", "where robots looked from: no map")
    add_row(table, "frames", f"{figures['frame_bytes']:,}", "", "", "", "where those of merged peers lie: no map")
    add_row(table, "beacons", f"{figures['beacon_bytes']:,}", "", "", "", "on the air, the same for every form")
    return table
