"""Pictures of two tables: what division does by number of robots, and what the radio's range does."""

from collections.abc import Sequence
from pathlib import Path

from deploy.bench.tables import Section


def draw(sections: Sequence[Section], stem: Path) -> list[Path]:
    """Write STEM-division.png and STEM-range.png, where there are rows to draw; returns what was written."""
    from matplotlib.figure import Figure

    tables = {section.name: list(section.rows) for section in sections}
    written = []
    division, ranges = tables.get("division", []), tables.get("range", [])
    if division:
        figure = Figure(figsize=(5, 3.4), layout="constrained")
        axes = figure.subplots()
        robots = [row["robots"] for row in division]
        for key, label in (("divided", "with division"), ("undivided", "without")):
            axes.plot(robots, [row[key] for row in division], "o-", label=label)
        axes.axhline(division[0]["alone"], color="0.5", ls="--", label="one robot")
        axes.set(xlabel="robots", ylabel="s until 99 % by the team", title="maze-15", xticks=robots, ylim=(0, None))
        axes.legend()
        written.append(stem.with_name(f"{stem.name}-division.png"))
        figure.savefig(written[-1], dpi=120)
    if ranges:
        figure = Figure(figsize=(5, 3.4), layout="constrained")
        axes = figure.subplots()
        places = range(len(ranges))
        axes.plot(places, [row["t_99"] for row in ranges], "o-", label="every robot 99 %")
        axes.plot(places, [row["team"] for row in ranges], "o-", label="team 99 %")
        axes.set_xticks(places, ["unlimited" if row["range"] >= 1000 else f"{row['range']:g}" for row in ranges])
        axes.set(xlabel="radio range, m", ylabel="s", title="maze-15, 3 robots", ylim=(0, None))
        beside = axes.twinx()
        beside.plot(places, [row["bytes"] / 1000 for row in ranges], "s:", color="0.4", label="kB sent")
        beside.set(ylabel="kB sent", ylim=(0, None))
        figure.legend(loc="outside lower center", ncols=3)
        written.append(stem.with_name(f"{stem.name}-range.png"))
        figure.savefig(written[-1], dpi=120)
    return written
