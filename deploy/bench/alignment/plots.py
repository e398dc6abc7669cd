"""Pictures of two tables: what division does by number of robots, and what the radio's range does."""

from collections.abc import Sequence
from pathlib import Path

from deploy.bench.tables import Section


def draw(sections: Sequence[Section], stem: Path) -> list[Path]:
    """Write STEM-division.png and STEM-range.png, where there are rows to draw; returns what was written."""
    from matplotlib.figure import Figure

    written = []
    for table in sections:
        if table.name not in ("division", "range"):
            continue
        figure, rows = Figure(figsize=(5, 3.4), layout="constrained"), table.rows
        axes = figure.subplots()
        if table.name == "division":
            robots = [row["robots"] for row in rows]
            for key, label in (("divided", "with division"), ("undivided", "without")):
                axes.plot(robots, [row[key] for row in rows], "o-", label=label)
            axes.axhline(rows[0]["alone"], color="0.5", ls="--", label="one robot")
            axes.set(xlabel="robots", ylabel="s until 99 % by the team", title="maze-15", xticks=robots, ylim=(0, None))
            axes.legend()
        else:
            for key, label in (("t_99", "every robot 99 %"), ("team", "team 99 %")):
                axes.plot([row[key] for row in rows], "o-", label=label)
            ticks = ["unlimited" if row["range"] >= 1000 else f"{row['range']:g}" for row in rows]
            axes.set_xticks(range(len(rows)), ticks)
            axes.set(xlabel="radio range, m", ylabel="s", title="maze-15, 3 robots", ylim=(0, None))
            beside = axes.twinx()
            beside.plot([row["bytes"] / 1000 for row in rows], "s:", color="0.4", label="kB sent")
            beside.set(ylabel="kB sent", ylim=(0, None))
            figure.legend(loc="outside lower center", ncols=3)
        written.append(stem.with_name(f"{stem.name}-{table.name}.png"))
        figure.savefig(written[-1], dpi=120)
    return written
