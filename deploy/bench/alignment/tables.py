"""Tables of the pairs: right, wrong and none by overlap, and the sweep of each method's threshold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

from agent.alignment import AlignmentConfig
from deploy.bench.alignment.pairs import BINS
from deploy.bench.alignment.trials import METHODS
from deploy.bench.bars import Column, Section
from deploy.bench.cases import Figures

Row = Mapping[str, Any]
Accepts = Callable[[Row], bool]
"""Whether a method's word on a pair counts as a proposal."""

HIGH = 0.4
"""Overlap from which the issue asks for right proposals."""
NAMES = {"features": "features (ours)", "4pcs": "4PCS", "icp": "ICP"}


def wilson(count: int, of: int) -> tuple[float, float]:
    """Wilson score interval of a share, 95 %."""
    if not of:
        return 0.0, 1.0
    z, p = 1.959964, count / of
    middle = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    return max(0.0, middle - half), min(1.0, middle + half)


def proposes(said: Row) -> bool:
    """By the method's own rule and default threshold, from the maps alone."""
    return bool(said["reason"] == "aligned")


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """All tables of the pairs."""
    pairs = [pair for name, found in figures.items() if name.startswith("pairs/") for pair in found["pairs"]]
    small = [pair for name, found in figures.items() if name.startswith("small/") for pair in found["pairs"]]
    if not pairs:
        return []
    return [
        _bars(pairs),
        _by_overlap("overlap", "Pairs of partial maps with at least 16 true corners each, from the maps alone", pairs),
        _with_contact(pairs),
        _by_overlap("small", "Small maps: 8 to 15 true corners, with the least size switched off", small),
        _worlds(pairs),
        _sweep(pairs),
    ]


def group_of(pair: Row) -> str:
    """Row of a pair in the tables by overlap."""
    if pair["world"] == "symmetric":
        return "symmetric"
    if pair["stranger"]:
        return "two buildings"
    low, high = next((low, high) for low, high in BINS if low <= pair["overlap"] < high)
    return "none" if not low else f"{low:.0%} to {min(high, 1.0):.0%}"


GROUPS = ["two buildings", "none", "1% to 20%", "20% to 40%", "40% to 60%", "60% to 80%", "80% to 100%", "symmetric"]


def is_high(pair: Row) -> bool:
    """Of those that should be aligned."""
    return bool(pair["overlap"] >= HIGH and pair["world"] != "symmetric")


def _shares(said: Sequence[Row], accepts: Accepts) -> dict[str, Any]:
    right = sum(accepts(one) and one["right"] for one in said)
    wrong = sum(accepts(one) and not one["right"] for one in said)
    n = max(len(said), 1)
    row: dict[str, Any] = {"pairs": len(said), "right": right / n, "wrong": wrong / n, "none": 1 - (right + wrong) / n}
    for word, count in (("right", right), ("wrong", wrong)):
        low, high = wilson(count, len(said))
        row[f"{word}_95"] = f"{low:.3f}-{high:.3f}"
    return row


COLUMNS = [
    Column("pairs", "pairs"),
    Column("right", "right"),
    Column("right_95", "95 %"),
    Column("wrong", "wrong"),
    Column("wrong_95", "95 %"),
    Column("none", "none"),
]


def _by_overlap(name: str, title: str, pairs: Sequence[Row]) -> Section:
    rows = []
    for method in METHODS:
        for group in GROUPS:
            said = [pair["methods"][method] for pair in pairs if group_of(pair) == group]
            if said:
                ms = median(one["ms"] for one in said)
                rows.append({"method": NAMES[method], "overlap": group, **_shares(said, proposes), "ms": ms})
    columns = [Column("method", "method"), Column("overlap", "overlap"), *COLUMNS, Column("ms", "ms median", digits=1)]
    return Section(name, title, columns, rows)


def _with_contact(pairs: Sequence[Row]) -> Section:
    rows = []
    for group in GROUPS:
        said = [pair["methods"]["features"] for pair in pairs if group_of(pair) == group and pair["contact"]]
        if said:
            rows.append({"overlap": group, **_shares(said, lambda one: proposes(one) and one["possible"])})
    note = "Pairs whose robots are within 4 m of each other; in two buildings as if they were."
    title = "Ours with the radio range at contact and free space around both robots"
    return Section("contact", title, [Column("overlap", "overlap"), *COLUMNS], rows, note=note)


def _worlds(pairs: Sequence[Row]) -> Section:
    rows = []
    for world in sorted({pair["world"] for pair in pairs if not pair["stranger"]}):
        here = [pair for pair in pairs if pair["world"] == world]
        said = [pair["methods"]["features"] for pair in here if pair["overlap"] >= HIGH]
        row = _shares(said, proposes)
        everything = _shares([pair["methods"]["features"] for pair in here], proposes)
        rows.append({"world": world, **row, "all_pairs": len(here), "all_wrong": everything["wrong"]})
    columns = [Column("world", "world"), *COLUMNS, Column("all_pairs", "all pairs"), Column("all_wrong", "all wrong")]
    return Section("worlds", "Ours by world, overlap of 40 % and more; at the right all its pairs", columns, rows)


def swept(pairs: Sequence[Row], method: str) -> list[dict[str, Any]]:
    """Recall (of pairs with overlap >= 40 %) and wrong proposals (of all) by threshold, loosest first."""
    margins, counts = [round(k / 20, 2) for k in range(20)], [float(k) for k in range(2, 41, 2)]
    thresholds = margins if method == "features" else counts
    rows = []
    for threshold in thresholds:

        def accepts(said: Row, least: float = threshold) -> bool:
            if method == "features":
                return said["reason"] in ("aligned", "ambiguous") and said["margin"] >= least
            return bool(said["best"] and said["inliers"] >= least)

        said = [(pair, pair["methods"][method]) for pair in pairs]
        high = [one for pair, one in said if is_high(pair)]
        rows.append(
            {
                "method": NAMES[method],
                "threshold": threshold,
                "recall": sum(accepts(one) and one["right"] for one in high) / max(len(high), 1),
                "wrong": sum(accepts(one) and not one["right"] for _, one in said),
                "wrong_plain": sum(
                    accepts(one) and not one["right"] for pair, one in said if pair["world"] != "symmetric"
                ),
            }
        )
    return rows


def _sweep(pairs: Sequence[Row]) -> Section:
    columns = [
        Column("method", "method"),
        Column("threshold", "threshold", digits=2),
        Column("recall", "recall at >= 40 %"),
        Column("wrong", "wrong, all pairs"),
        Column("wrong_plain", "without symmetric"),
    ]
    note = f"Threshold: margin over the next best (ours, default {AlignmentConfig().margin}), matched corners (others)."
    rows = [row for method in METHODS for row in swept(pairs, method)]
    return Section("sweep", "Sweep of each method's threshold", columns, rows, note=note)


def _at_recall(rows: Sequence[Row], recall: float) -> Row:
    """The threshold with fewest wrong proposals that reaches a recall."""
    return min((row for row in rows if row["recall"] >= recall - 1e-9), key=lambda row: row["wrong"])


def _bars(pairs: Sequence[Row]) -> Section:
    """The issue's bars, one a row."""
    ours, theirs = swept(pairs, "features"), swept(pairs, "4pcs")
    both = min(max(row["recall"] for row in rows) for rows in (ours, theirs))
    wrong_ours, wrong_theirs = _at_recall(ours, both)["wrong"], _at_recall(theirs, both)["wrong"]
    rows: list[dict[str, Any]] = [
        {
            "measure": f"wrong at the highest recall that both reach ({both:.3f}), ours against 4PCS",
            "value": wrong_ours / max(wrong_theirs, 1),
            "of": f"{wrong_ours} / {wrong_theirs}",
            "most": 0.2,
        }
    ]
    none = [pair for pair in pairs if group_of(pair) in ("none", "two buildings")]
    twins = [pair for pair in pairs if pair["world"] == "symmetric"]
    high = [pair for pair in pairs if is_high(pair)]
    right = _shares([pair["methods"]["features"] for pair in high], proposes)
    rows.append({"measure": "right at overlap >= 40 %, without symmetric", **_share(right, "right"), "least": 0.9})
    for word, some in (("no overlap", none), ("symmetric", twins)):
        alone = _shares([pair["methods"]["features"] for pair in some], proposes)
        rows.append({"measure": f"wrong, {word}, from the maps alone", **_share(alone, "wrong"), "most": 0.03})
        met = [pair["methods"]["features"] for pair in some if pair["contact"]]
        range_ = _shares(met, lambda said: proposes(said) and said["possible"])
        rows.append({"measure": f"wrong, {word}, with the radio range", **_share(range_, "wrong"), "most": 0.01})
    for row in rows:
        row["bar"] = f"<= {row['most']:g}" if "most" in row else f">= {row['least']:g}"
        value = row["value"]
        good = value is not None and (value <= row["most"] if "most" in row else value >= row["least"])
        row["met"] = int(good)
    columns = [
        Column("measure", "measure"),
        Column("value", "value"),
        Column("of", "95 % or counts"),
        Column("bar", "bar"),
        Column("met", "met", at_least=1),
    ]
    return Section("bars", "Bars of the alignment", columns, rows, note=f"{len(pairs)} pairs.")


def _share(row: Mapping[str, Any], word: str) -> dict[str, Any]:
    return {"value": row[word], "of": f"{row[f'{word}_95']} of {row['pairs']}"}
