"""report.html: one file that opens without a network."""

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from deploy.report import plan, style
from deploy.report.curves import curves
from deploy.report.picture import MAX_SINGLE
from deploy.report.rundir import Run, mapping
from deploy.report.story import GLYPHS, MEANINGS, left_out, told
from deploy.report.words import NONE, headline, number, seconds, share, size, subtitle
from protocol.files import write_whole

MAX_EVENTS = 500  # rows of the events table: the first and the last events; events.jsonl has all
ROUTINE = "frontier"  # the event left out of the table, because one comes with every new goal

ROBOT_COLUMNS = (
    ("coverage", "coverage", share),
    ("90 % after", "t_90", seconds),
    ("99 % after", "t_99", seconds),
    ("path", "path_m", partial(number, unit="m")),
    ("walls touched", "wall_contacts", partial(number, digits=0)),
    ("robots touched", "robot_contacts", partial(number, digits=0)),
    ("sent", "bytes_sent", size),
    ("received", "bytes_received", size),
    ("map", "map_bytes", size),
    ("filter", "filter_bytes", size),
    ("step, median", "step_ms_median", partial(number, digits=2, unit="ms")),
)


def write_page(run: Run, file: Path) -> None:
    """Write report.html."""
    html, css, js = ((Path(__file__).parent / f"page.{kind}").read_text("utf-8") for kind in ("html", "css", "js"))
    page = Template(html).substitute(
        css=css,
        js=js,
        title=escape(headline(run)),
        about=escape(subtitle(run)),
        notes=_notes(run),
        plan=plan.overview(run),
        switches=_switches(run),
        legend=_legend(),
        story=_story(run),
        curves="" if run.of_logs else "\n".join(curves(run)),
        sections="\n".join(section(run) for section in (_singles, _robots, _radio, _events, _configuration)),
        frames=_embedded(plan.slider(run)),
    )
    write_whole(file, page)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1, last: str = "") -> str:
    """An HTML table of plain texts: `words` columns of words, then numbers; `last` is the class of the last row."""

    def cells(tag: str, row: Sequence[str]) -> str:
        kinds = [""] * words + [' class="number"'] * (len(head) - words)
        return "".join(f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, row, strict=True))

    body = [f"<tr>{cells('td', row)}</tr>" for row in rows]
    if last:
        body[-1] = body[-1].replace("<tr", f'<tr class="{last}"', 1)
    inner = f"<thead><tr>{cells('th', head)}</tr></thead>\n<tbody>\n{chr(10).join(body)}\n</tbody>"
    return f'<div class="scroll"><table>{inner}</table></div>'


def _notes(run: Run) -> str:
    items = "".join(f"<li>{escape(note)}</li>" for note in run.notes)
    return items and f'<div class="notes">Some files of this run are missing or broken:<ul>{items}</ul></div>'


def _switches(run: Run) -> str:
    if not run.has_plan:
        return ""
    box = '<input type="checkbox" checked'
    robots = [
        f'<label style="--robot:{style.colour(k)}">{box} data-robot="{escape(robot)}">'
        f'<span class="swatch"></span>{escape(robot)}</label>'
        for k, robot in enumerate(run.robots)
        if robot in run.frames
    ]
    kinds = ("truth", "corners", "paths", "heard walls", "story")
    layers = [f'<label>{box} data-layer="{kind.split()[0]}">{kind}</label>' for kind in kinds]
    return "".join(robots + layers)


def _legend() -> str:
    """What each mark of the map means."""
    marks = {
        '<path class="solid" d="M0 3h22v6h-22z"/>': "the true walls, which no robot knows",
        '<path class="line" d="M0 6h22"/>': "wall that the robot saw itself; where maps agree, side by side",
        '<path class="line dashed" d="M0 6h22"/>': "wall that it has from others only",
        '<circle cx="11" cy="6" r="4"/>': "nominal: a corner, both walls seen",
        '<path d="M11 1l5 9H6z"/>': "occlusion: the wall turns away here",
        '<path d="M7 2h8v8H7z"/>': "frontier: the wall goes on unseen",
        '<circle class="line" cx="11" cy="6" r="4.5"/>': "where a robot started; with its name: where it is",
        '<path class="line dotted" d="M0 6h22"/>': "two robots that hear each other",
        '<path class="line dashed trial" d="M0 6h22"/>': "a proposal on trial",
        '<path class="line thin" d="M0 6h22"/>': "the way that a robot went",
        '<path d="M11 1l5 5l-5 5l-5 -5z"/>': "on a curve: a merge",
        '<path class="undone" d="M7 2l8 8M15 2l-8 8"/>': "on a curve: a merge that was undone",
    }
    svg = '<svg width="22" height="12" aria-hidden="true">'
    rows = [f"<li>{svg}{shape}</svg> {escape(meaning)}</li>" for shape, meaning in marks.items()]
    rows += [f"<li><b>{GLYPHS[event]}</b> {escape(meaning)}</li>" for event, meaning in MEANINGS.items()]
    return f"<ul>{''.join(rows)}</ul>"


def _story(run: Run) -> str:
    """The events of trust as a list, each a button that leads there."""
    rows = [
        f'<li><button data-t="{event["t"]}"><span>{event["t"]:.0f} s</span> <b>{event["glyph"]}</b> '
        f"{escape(event['text'])}</button></li>"
        for event in told(run)
    ]
    more = left_out(run)
    rest = f"<p>{more} more events are not told here; events.jsonl has them.</p>" if more else ""
    return f'<h2>What robots believed of each other</h2>\n<ol id="story">{"".join(rows)}</ol>{rest}' if rows else ""


def _singles(run: Run) -> str:
    figures = []
    for k, robot in enumerate(run.robots[:MAX_SINGLE]):
        about = f"{len(run.maps[robot].edges)} walls" if robot in run.maps else "no map"
        frame = "" if robot in run.frames else ", in its own frame"
        caption = f"<figcaption><b>{escape(robot)}</b> {about}{frame}</figcaption>"
        figures.append(f'<figure style="--robot:{style.colour(k)}">{plan.single(run, robot)}{caption}</figure>')
    more = len(run.robots) - MAX_SINGLE
    rest = f"<p>{more} more robots are not drawn.</p>" if more > 0 else ""
    return f'<h2>The map of each robot</h2>\n<div class="singles">{"".join(figures)}</div>{rest}' if figures else ""


def _robots(run: Run) -> str:
    robots = mapping(run.summary.get("robots"))
    if not robots:
        return ""
    columns = [column for column in ROBOT_COLUMNS if any(column[1] in mapping(row) for row in robots.values())]
    rows = []
    for robot in run.robots:
        figures = mapping(robots.get(robot))
        rows.append([robot, str(figures.get("ended", NONE)), *(show(figures.get(key)) for _, key, show in columns)])
    if team := mapping(run.summary.get("team")):
        rows.append(["team", "", *(show(team[key]) if key in team else "" for _, key, show in columns)])
    about = "Overlap, what the robots' own beams saw more than once, as a share of the visible wall"
    overlap = f"<p>{about}: {number(team['overlap'], 2)}.</p>" if "overlap" in team else ""
    head = ["robot", "ended", *(title for title, _, _ in columns)]
    return f"<h2>Robots</h2>\n{table(head, rows, words=2, last='team' if team else '')}\n{overlap}"


def _radio(run: Run) -> str:
    """Messages per robot and kind, from bandwidth.json: offered, heard, and meant for the robot but dropped."""
    rows = []
    for robot, books in mapping(run.bandwidth.get("robots")).items():
        parts = [mapping(mapping(books).get(part)) for part in ("offered", "delivered", "dropped")]
        for kind in sorted(set().union(*parts)):
            *tallies, reasons = (mapping(part.get(kind)) for part in parts)
            sizes = [text for tally in tallies for text in (number(tally.get("messages"), 0), size(tally.get("bytes")))]
            lost = [f"{number(mapping(tally).get('messages'), 0)} {why}" for why, tally in reasons.items()]
            rows.append([robot, kind, *sizes, ", ".join(lost) or NONE])
    head = ["robot", "kind", "messages offered", "bytes", "messages heard", "bytes", "meant for it, but dropped"]
    about = "Offered is what a robot handed to its radio, also where that held it back for its MTU or capacity."
    return f"<h2>Radio</h2>\n<p>{about}</p>\n{table(head, rows, words=2)}" if rows else ""


def _events(run: Run) -> str:
    if not run.events:
        return ""
    counts = Counter(event["event"] for event in run.events)
    about = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    about += f". Not listed: {ROUTINE}." if ROUTINE in counts else "."
    listed, half = [event for event in run.events if event["event"] != ROUTINE], MAX_EVENTS // 2
    if len(listed) > MAX_EVENTS:
        about += f" The first and the last {half} are listed."
        listed = listed[:half] + listed[-half:]
    columns = ("t", "tick", "robot", "event")
    rows = []
    for event in listed:
        details = ", ".join(f"{key} {_short(value)}" for key, value in event.items() if key not in columns)
        rows.append([number(event["t"]), event["robot"], event["event"], details])
    listing = table(["t (s)", "robot", "event", "about"], rows, words=4) if rows else ""
    return f"<h2>Events</h2>\n<p>{escape(about)}</p>\n{listing}"


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return "[" + ", ".join(_short(item) for item in value) + "]"
    return value if isinstance(value, str) else json.dumps(value)


def _configuration(run: Run) -> str:
    text = escape(json.dumps(run.manifest, indent=2, ensure_ascii=False))
    page = f"<h2>Configuration</h2>\n<details><summary>manifest.json</summary><pre>{text}</pre></details>"
    return page if run.manifest else ""


def _embedded(value: Any) -> str:
    """JSON that cannot end the script element that it stands in."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")
