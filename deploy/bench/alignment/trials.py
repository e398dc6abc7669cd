"""All methods on the same pairs of partial maps: right, wrong or none."""

import time
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from statistics import median

import numpy as np

from agent.alignment.align import align_prepared
from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.alignment.prepared import prepare
from deploy.bench.alignment import recordings
from deploy.bench.alignment.baselines import METHODS
from deploy.bench.alignment.pairs import BINS, MIN_CORNERS, RANGE_M, SMALL_CORNERS, Pair, pairs_of, strangers
from deploy.bench.cases import Case, Figures, each, kept, measure_all
from deploy.bench.layouts import KEEP
from deploy.bench.tables import Column, Outcomes, Row, Table, runs_of
from deploy.sensing import IDEAL_BENCHMARK
from deploy.sweep.statistics import wilson
from protocol.command import say
from protocol.messages import RobotSpec

NAMES = {"features": "features (ours)", "4pcs": "4PCS", "icp": "ICP"}
HIGH = 0.4  # overlap from which the issue asks for right proposals
Accepts = Callable[[Row], bool]  # whether a method's word on a pair counts as a proposal

PER_BIN = 20  # pairs of one overlap in one world
PER_BIN_SYMMETRIC = 60  # the issue asks for 300 of `symmetric`; six overlaps
STRANGERS = 300  # the issue asks for 300 without overlap


def cases(quick: bool) -> list[Case]:
    """One case a world, one for its small maps, and one for maps of different buildings."""
    worlds = sorted({str(case.arguments["world"]) for case in recordings.cases(quick)})
    return [
        *each("pairs/{world}", within, {"quick": quick}, world=worlds),
        *each("small/{world}", within, {"quick": quick, "small": True}, world=[] if quick else worlds),
        Case("pairs/strangers", between, {"quick": quick, "worlds": worlds}),
    ]


def beforehand(quick: bool) -> None:
    """Make the recordings that are missing; cases, which may run at once, only read them. Those that fail are told."""
    for name, reason in measure_all(*_recordings(quick), 1, quiet=True).failed.items():
        say(f"no recording {name}: {reason}")


def recorded(quick: bool, worlds: Sequence[str]) -> dict[str, list[recordings.Recording]]:
    """Recordings of these worlds with the benchmark's sensing, by world.

    Raises InputError where they have not been made, and RuntimeError where one has failed: pairs of the rest would be
    kept for those of all.
    """
    cases, folder = _recordings(quick)
    made = kept([case for case in cases if case.arguments["world"] in worlds], folder)
    for name, reason in made.failed.items():
        raise RuntimeError(f"no recording {name}: {reason}")
    by_world: dict[str, list[recordings.Recording]] = {}
    for _, figures in sorted(made.figures.items()):
        by_world.setdefault(figures["world"], []).append(recordings.recording_of(figures))
    return by_world


def _recordings(quick: bool) -> tuple[list[Case], Path]:
    """The cases that record, and the folder that keeps them."""
    cases = [replace(case, ideal=IDEAL_BENCHMARK.get()) for case in recordings.cases(quick)]
    return cases, KEEP / "recordings" / ("quick" if quick else "full")


def within(world: str, quick: bool, small: bool = False) -> Figures:
    """Pairs of maps of one world."""
    per_bin = 4 if quick else PER_BIN // 2 if small else PER_BIN_SYMMETRIC if world == "symmetric" else PER_BIN
    low, high = (SMALL_CORNERS, MIN_CORNERS) if small else (MIN_CORNERS, np.inf)
    rng = np.random.default_rng(zlib.crc32(world.encode()))
    return {
        "pairs": [trial(pair, small) for pair in pairs_of(recorded(quick, [world])[world], rng, per_bin, low, high)]
    }


def between(quick: bool, worlds: Sequence[str]) -> Figures:
    """Pairs of maps of different ones of these worlds."""
    pairs = strangers(recorded(quick, worlds), np.random.default_rng(0), 8 if quick else STRANGERS, MIN_CORNERS)
    return {"pairs": [trial(pair) for pair in pairs]}


def trial(pair: Pair, small: bool = False) -> Row:
    """What each method says of one pair; small: without the least size that maps must have."""
    return {
        "world": f"{pair.one.world} and {pair.two.world}" if pair.stranger else pair.one.world,
        "overlap": pair.overlap,
        "stranger": pair.stranger,
        "contact": pair.contact,
        "corners": pair.corners,
        "methods": {method: _said(pair, method, small) for method in METHODS},
    }


def _said(pair: Pair, method: str, small: bool) -> Row:
    config = AlignmentConfig(min_corners=4) if small else AlignmentConfig()
    begin = time.perf_counter()
    mine, theirs = prepare(pair.mine.wireframe, config), prepare(pair.theirs.wireframe, config)
    found = align_prepared(mine, theirs, config, np.random.default_rng(7), method=METHODS[method])
    ms = (time.perf_counter() - begin) * 1e3
    possible = False
    if found.best is not None and mine is not None and theirs is not None:
        spaces, encounter = (mine.free_space, theirs.free_space), Encounter(pair.mine.pose, pair.theirs.pose)
        possible = bool(encounter.allows(np.array([found.best]), *spaces, RANGE_M, RobotSpec().radius_m)[0])
    is_right = found.best is not None and pair.right(found.best)
    said = {"ms": ms, "possible": possible, "reason": found.reason, "right": is_right, "best": found.best is not None}
    return {**said, "inliers": found.inliers, "margin": found.margin}


def proposes(said: Row) -> bool:
    """By the method's own rule and default threshold, from the maps alone."""
    return bool(said["reason"] == "aligned")


def possible(said: Row) -> bool:
    """The same, and possible within the radio range and the free space around both robots."""
    return proposes(said) and bool(said["possible"])


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


def _shares(said: Sequence[Row], accepts: Accepts) -> Row:
    right = sum(accepts(one) and one["right"] for one in said)
    wrong = sum(accepts(one) and not one["right"] for one in said)
    n = max(len(said), 1)
    row: Row = {"pairs": len(said), "right": right / n, "wrong": wrong / n, "none": 1 - (right + wrong) / n}
    for word, count in (("right", right), ("wrong", wrong)):
        low, high = wilson(count, len(said))
        row[f"{word}_95"] = f"{low:.3f}-{high:.3f}"
    return row


PARTS = "pairs; right; right_95: 95 %; wrong; wrong_95: 95 %; none"  # columns of `_shares`


def pairs_in(figures: Outcomes, which: str) -> list[Row]:
    """All pairs of the cases WHICH/WORLD."""
    return [pair for found in runs_of(figures, f"{which}/*") for pair in found["pairs"]]


def _overlaps(name: str, which: str, title: str) -> Table:
    """From the maps of the cases WHICH/WORLD alone, a row a method and overlap."""

    def rows(figures: Outcomes) -> list[Row]:
        made, pairs = [], pairs_in(figures, which)
        for method, group in product(METHODS, GROUPS):
            if said := [pair["methods"][method] for pair in pairs if group_of(pair) == group]:
                ms = median(one["ms"] for one in said)
                made.append({"method": NAMES[method], "overlap": group, **_shares(said, proposes), "ms": ms})
        return made

    return Table(name, title, rows, f"method; overlap; {PARTS}; ms: ms median")


def _with_contact(figures: Outcomes) -> list[Row]:
    """Ours, of pairs whose robots hear each other, a row an overlap."""
    pairs = [(group_of(pair), pair["methods"]["features"]) for pair in pairs_in(figures, "pairs") if pair["contact"]]
    groups = {group: [said for other, said in pairs if other == group] for group in GROUPS}
    return [{"overlap": group, **_shares(said, possible)} for group, said in groups.items() if said]


def _worlds(figures: Outcomes) -> list[Row]:
    """Ours, a row a world."""
    by_world: dict[str, list[Row]] = {}
    for pair in sorted(pairs_in(figures, "pairs"), key=lambda pair: str(pair["world"])):
        if not pair["stranger"]:
            by_world.setdefault(pair["world"], []).append(pair)
    rows = []
    for world, pairs in by_world.items():
        high, every = (
            _shares([pair["methods"]["features"] for pair in pairs if pair["overlap"] >= least], proposes)
            for least in (HIGH, 0.0)
        )
        rows.append({"world": world, **high, "all_pairs": every["pairs"], "all_wrong": every["wrong"]})
    return rows


def _strength(said: Row, method: str) -> float:
    """What a method's threshold bounds: margin over the next best (ours), matched corners; -1 without a candidate."""
    if method == "features":
        return float(said["margin"]) if said["reason"] in ("aligned", "ambiguous") else -1.0
    return float(said["inliers"]) if said["best"] else -1.0


def swept(pairs: Sequence[Row], method: str) -> list[Row]:
    """Recall (of pairs with overlap >= 40 %) and wrong proposals (of all) by threshold, loosest first."""
    rows: list[Row] = []
    for threshold in [round(k / 20, 2) for k in range(20)] if method == "features" else map(float, range(2, 41, 2)):
        accepted = [pair for pair in pairs if _strength(pair["methods"][method], method) >= threshold]
        wrong = [pair for pair in accepted if not pair["methods"][method]["right"]]
        recall = (sum(map(is_high, accepted)) - sum(map(is_high, wrong))) / max(sum(map(is_high, pairs)), 1)
        plain = sum(pair["world"] != "symmetric" for pair in wrong)
        row = {"method": NAMES[method], "threshold": threshold, "recall": recall}
        rows.append({**row, "wrong": len(wrong), "wrong_plain": plain})
    return rows


def _sweep(figures: Outcomes) -> list[Row]:
    pairs = pairs_in(figures, "pairs")
    return [row for method in METHODS for row in swept(pairs, method)] if pairs else []


def _bar(measure: str, value: float, of: str, sign: str, bound: float) -> Row:
    """One bar of the issue; of: counts, or the interval of 95 %."""
    bar = Column("value", "", sign=sign, bound=bound)
    return {"measure": measure, "value": value, "of": of, "bar": bar.bar, "met": int(not bar.misses(value))}


def _judged(measure: str, pairs: Iterable[Row], word: str, accepts: Accepts, sign: str, bound: float) -> Row:
    """The bar of ours on some pairs."""
    row = _shares([pair["methods"]["features"] for pair in pairs], accepts)
    return _bar(word + measure, row[word], f"{row[f'{word}_95']} of {row['pairs']}", sign, bound)


def _bars(figures: Outcomes) -> list[Row]:
    """The issue's bars, one a row."""
    pairs = pairs_in(figures, "pairs")
    if not pairs:
        return []
    sweeps = [swept(pairs, method) for method in ("features", "4pcs")]
    both = min(max(row["recall"] for row in rows) for rows in sweeps)
    ours, theirs = (min(row["wrong"] for row in rows if row["recall"] >= both - 1e-9) for rows in sweeps)
    measure = f"wrong at the highest recall that both reach ({both:.3f}), ours against 4PCS"
    rows = [
        _bar(measure, ours / max(theirs, 1), f"{ours} / {theirs}", "<=", 0.2),
        _judged(" at overlap >= 40 %, without symmetric", filter(is_high, pairs), "right", proposes, ">=", 0.9),
    ]
    for name, groups in (("no overlap", ("none", "two buildings")), ("symmetric", ("symmetric",))):
        some = [pair for pair in pairs if group_of(pair) in groups]
        heard = [pair for pair in some if pair["contact"]]
        rows.append(_judged(f", {name}, from the maps alone", some, "wrong", proposes, "<=", 0.03))
        rows.append(_judged(f", {name}, with the radio range", heard, "wrong", possible, "<=", 0.01))
    return rows


TABLES = [
    Table(
        "bars",
        "Bars of the alignment",
        _bars,
        "measure; value; of: 95 % or counts; bar; met >= 1",
        note=lambda figures: f"{len(pairs_in(figures, 'pairs'))} pairs.",
    ),
    _overlaps("overlap", "pairs", "Pairs of partial maps with at least 16 true corners each, from the maps alone"),
    Table(
        "contact",
        "Ours with the radio range at contact and free space around both robots",
        _with_contact,
        f"overlap; {PARTS}",
        note="Pairs whose robots are within 4 m of each other; in two buildings as if they were.",
    ),
    _overlaps("small", "small", "Small maps: 8 to 15 true corners, with the least size switched off"),
    Table(
        "worlds",
        "Ours by world, overlap of 40 % and more; at the right all its pairs",
        _worlds,
        f"world; {PARTS}; all_pairs; all_wrong",
    ),
    Table(
        "sweep",
        "Sweep of each method's threshold",
        _sweep,
        "method; threshold; recall: recall at >= 40 %; wrong: wrong, all pairs; wrong_plain: no symmetric",
        note=f"Threshold: margin over the next best (ours, default {AlignmentConfig().margin}), "
        "matched corners (others).",
    ),
]
