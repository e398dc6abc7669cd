"""Pictures of two tables: what division does by number of robots, and what the radio's range does."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deploy.bench.tables import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_division(rows: Sequence[Row], figure: "Figure") -> None:
    """Time of the team with and without division, and of one robot."""
    axes, robots = figure.subplots(), [row["robots"] for row in rows]
    for key, label in (("divided", "with division"), ("undivided", "without")):
        axes.plot(robots, [row[key] for row in rows], "o-", label=label)
    if (alone := rows[0]["alone"]) is not None:
        axes.axhline(alone, color="0.5", ls="--", label="one robot")
    axes.set(xlabel="robots", ylabel="s until 99 % by the team", xticks=robots, ylim=(0, None))
    axes.legend()


def draw_range(rows: Sequence[Row], figure: "Figure") -> None:
    """Times and bytes by range of the radio."""
    axes = figure.subplots()
    for key, label in (("t_99", "every robot 99 %"), ("team", "team 99 %")):
        axes.plot([row[key] for row in rows], "o-", label=label)
    ticks = ["unlimited" if row["range"] >= 1000 else f"{row['range']:g}" for row in rows]
    axes.set_xticks(range(len(rows)), ticks)
    axes.set(xlabel="radio range, m", ylabel="s", ylim=(0, None))
    beside = axes.twinx()
    beside.plot([row["bytes"] / 1000 for row in rows], "s:", color="0.4", label="kB sent")
    beside.set(ylabel="kB sent", ylim=(0, None))
    figure.legend(loc="outside lower center", ncols=3)
