"""Whole runs of several robots that meet: what is merged, rightly or wrongly, and what sharing is worth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agent.geometry.transform import compose, inverse
from agent.robot import Robot, Step
from deploy.bench.alignment.pairs import RIGHT_DEG, RIGHT_M
from deploy.bench.alignment.recordings import KEEP, mapped
from deploy.bench.alignment.tables import wilson
from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import Explored, explore
from deploy.bench.layouts import path_of
from deploy.metrics import Truth, score, truth_of
from protocol.arrays import Floats
from protocol.geometry import apply, wrapped
from protocol.messages import Observation, RobotSpec
from world.episode import Episode, generator
from world.worldfile import load, to_yaml

BUNDLED = ("maze-15", "office", "apartment", "hall", "symmetric")
SEEDS = 20
"""Of each bundled world: 100 runs."""
PAIRED_SEEDS = 10
"""Of maze-15 for comparisons (the issue's)."""
TEAM_SEEDS = 5
"""Of them for teams of 2 and 5 robots, which have no bar."""
LIMIT_S = 600.0
"""Simulated seconds of the runs: all robots have seen all before, though some sweep on."""
UNSHARED_S = 1200.0
"""The same where robots do not share: alone in maze-15 they need 500 to 750 s."""
LOOK_S = 10.0
"""Simulated time between two looks at what maps have in common."""
OVERLAP = 0.3
JOINT_S = 120.0
"""Pairs in contact with this overlap and this time left should be merged by the end (the issue's)."""
RANGES = (1.0, 2.0, 4.0, 8.0, 1000.0)
"""Radio ranges in metres; the last one is more than any building."""
RANGE_SEEDS = 3
EVENTS = ("attempt", "proposed", "accepted", "rejected", "unmerged")


def cases(quick: bool) -> list[Case]:
    """Runs over the bundled worlds, and the comparisons in maze-15. Each ends when what it is for is known."""
    if quick:
        return _quick()
    made = [
        _case(f"live/{world}/{seed}", world, seed, until=None if _kept_whole(world, seed) else "merged")
        for seed in range(SEEDS)
        for world in BUNDLED
    ]
    for seed in range(PAIRED_SEEDS):
        made.append(_unshared("maze-15", seed))
        made += [_alone("maze-15", seed, start) for start in range(3)]
        for robots in (2, 3, 5) if seed < TEAM_SEEDS else (3,):
            made += _teams("maze-15", seed, robots)
    made += [
        _case(f"range/{range_m:g}/{seed}", "maze-15", seed, range_m=range_m)
        for seed in range(RANGE_SEEDS)
        for range_m in RANGES
        if range_m != 4.0  # that is the default, and among the runs already
    ]
    return made


def _quick() -> list[Case]:
    """One run of each row, in the smallest world."""
    world = "apartment"
    made = [_case(f"live/{world}/0", world, 0, until="merged"), _unshared(world, 0)]
    made += [_alone(world, 0, start) for start in range(3)]
    made += [case for robots in (2, 3, 5) for case in _teams(world, 0, robots)]
    made.append(_case("divided/3/0", world, 0, until="each"))
    return [*made, _case("range/1000/0", world, 0, range_m=1000.0, until="each")]


def _divided(figures: Mapping[str, Figures], robots: int, seed: int) -> Figures | None:
    """The run with sharing and division of that many robots."""
    found = figures.get(f"divided/{robots}/{seed}")
    return figures.get(f"live/maze-15/{seed}") if found is None and robots == 3 else found


def _where(figures: Mapping[str, Figures]) -> str:
    """World of the comparisons."""
    return next((run["world"] for name, run in figures.items() if name.startswith("unshared/")), "maze-15")


def _kept_whole(world: str, seed: int) -> bool:
    """Runs whose last maps are scored, and whose bytes are compared, go on to their own end."""
    return world == "maze-15" and seed < PAIRED_SEEDS


def _unshared(world: str, seed: int) -> Case:
    return _case(f"unshared/{seed}", world, seed, {"sharing": False}, limit_s=UNSHARED_S, until="each")


def _alone(world: str, seed: int, start: int) -> Case:
    return _case(f"alone/{seed}/{start}", world, seed, start=start, limit_s=UNSHARED_S, until="each")


def _teams(world: str, seed: int, robots: int) -> list[Case]:
    """With and without division; three robots with it are among the live runs."""
    made = [_case(f"undivided/{robots}/{seed}", world, seed, {"division": False}, robots=robots, until="team")]
    if robots != 3:
        made.append(_case(f"divided/{robots}/{seed}", world, seed, robots=robots, until="team"))
    return made


def _case(
    name: str,
    world: str,
    seed: int,
    cooperation: Mapping[str, Any] | None = None,
    robots: int = 3,
    range_m: float = 4.0,
    start: int | None = None,
    limit_s: float = LIMIT_S,
    until: str | None = None,
) -> Case:
    arguments = {"world": world, "seed": seed, "robots": robots, "range_m": range_m, "limit_s": limit_s}
    return Case(name, measure, {**arguments, "cooperation": cooperation or {}, "start": start, "until": until})


def measure(
    world: str,
    seed: int,
    robots: int,
    range_m: float,
    limit_s: float,
    cooperation: Mapping[str, Any],
    start: int | None,
    until: str | None,
) -> Figures:
    """One run, until `team` or `each` robot has 99 %, until all is `merged`, or to its own end (None)."""
    if start is not None:
        world, robots = alone_from(world, seed, start), 1
    starts = load(path_of(world)).starts(robots, RobotSpec().radius_m, generator(seed, "starts"), drawn=start is None)
    watched = Watched(world, {f"r{k + 1}": place for k, place in enumerate(starts)})
    settings = {
        "world": world,
        "robots": robots,
        "seed": seed,
        "starts": "random" if start is None else "file",
        "max_time_s": limit_s,
        "radio": {"range_m": range_m},
    }
    enough = None if until is None else {"team": _team, "each": _each, "merged": watched.all_merged}[until]
    run = explore(settings, {"cooperation": cooperation}, watched, enough=enough)
    return watched.figures(run)


FULL = 0.99 - 1e-9


def _team(episode: Episode) -> bool:
    return episode.team_coverage >= FULL


def _each(episode: Episode) -> bool:
    return min(episode.coverage.values()) >= FULL


def alone_from(world: str, seed: int, start: int) -> str:
    """File of a world with one spawn: where the robot of that number begins in a run of three."""
    place = load(path_of(world))
    starts = place.starts(3, RobotSpec().radius_m, generator(seed, "starts"), drawn=True)
    path = KEEP / "worlds" / f"{Path(world).stem}-{seed}-{start}.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(to_yaml({**place.document, "spawns": [starts[start].tolist()]}), encoding="utf-8")
    return str(path)


class Watched:
    """Looks over the shoulders of all robots of a run."""

    def __init__(self, world: str, starts: Mapping[str, Floats]) -> None:
        """starts: (3,) pose of each robot's own frame in the world."""
        self.world = world
        self.starts = starts
        self.minds: dict[str, Robot] = {}
        self.events: list[dict[str, Any]] = []
        self.due: dict[tuple[str, str], float] = {}
        """Since when a pair has been in contact with enough overlap."""

    def __call__(self, robot: Robot, observation: Observation, step: Step) -> None:
        """See one step of one robot."""
        self.minds.setdefault(robot.robot, robot)
        t = observation.tick / robot.spec.lidar.rate_hz
        for event in step.action.events:
            if event.event in EVENTS:
                self.events.append({"t": t, "robot": robot.robot, "event": event.event, **event.data})
        if observation.tick % round(LOOK_S * robot.spec.lidar.rate_hz) == 0:
            for peer in robot.exchange.contacts.present:
                if (robot.robot, peer) not in self.due and peer in self.minds:
                    self.see_overlap(t, robot.robot, peer)

    def all_merged(self, episode: Episode) -> bool:
        """Whether no pair can be merged any more, all have 99 %, and every pair had the time that the issue gives."""
        since = max(self.due.values(), default=0.0)
        others = len(self.minds) - 1
        merged = all(len(mind.team.merged_ticks) == others for mind in self.minds.values())
        return merged and _each(episode) and episode.t >= since + JOINT_S

    def see_overlap(self, t: float, one: str, two: str) -> None:
        """Note that two maps have enough in common."""
        a, b = self._pieces(one), self._pieces(two)
        lengths = self._truth(one).seen_lengths
        smaller = min(float(lengths[a].sum()), float(lengths[b].sum()))
        if smaller > 0 and float(lengths[a & b].sum()) / smaller >= OVERLAP:
            self.due[one, two] = t

    def _truth(self, robot: str) -> Truth:
        return _truth(self.world, float(self.starts[robot][0]), float(self.starts[robot][1]))

    def _pieces(self, robot: str) -> NDArray[np.bool_]:
        x, y, theta = self.starts[robot].tolist()
        return mapped(self.minds[robot].own, (x, y, theta), self._truth(robot))

    def figures(self, run: Explored) -> Figures:
        """All that the tables need."""
        frames = {name: np.array(run.frame(name)) for name in run.robots}
        accepted = []
        for event in self.events:
            if event["event"] == "accepted":
                peer_map = run.robots[event["peer"]].own.points
                centre = peer_map.mean(0) if len(peer_map) else np.zeros(2)
                off = errors(event["transform"], frames[event["robot"]], frames[event["peer"]], centre)
                accepted.append({**event, "error_m": off[0], "error_deg": off[1], "false": not right(*off)})
        end = run.episode.t
        pairs = []
        for (one, two), since in sorted(self.due.items()):
            if since <= end - JOINT_S:
                merged = two in run.robots[one].team.merged_ticks
                pairs.append(
                    {"robot": one, "peer": two, "since": since, "merged": merged, "reason": self._last(one, two)}
                )
        scores = {}
        for name, mind in run.robots.items():
            x, y, theta = frames[name].tolist()
            truth = _truth(self.world, x, y)
            scores[name] = score(mind.wireframe, (x, y, theta), truth)._asdict()
        return {
            "world": Path(self.world).stem,
            "ended_at": end,
            "robots": run.summary["robots"],
            "team": run.summary["team"],
            "real_time_factor": run.summary["real_time_factor"],
            "scores": scores,
            "accepted": accepted,
            "counts": {name: sum(event["event"] == name for event in self.events) for name in EVENTS},
            "reasons": self._reasons(),
            "pairs": pairs,
        }

    def _reasons(self) -> dict[str, int]:
        out: dict[str, int] = {}
        for event in self.events:
            key = f"{event['event']}: {event['reason']}"
            out[key] = out.get(key, 0) + 1
        return dict(sorted(out.items()))

    def _last(self, one: str, two: str) -> str:
        said = [f"{e['event']}: {e['reason']}" for e in self.events if (e["robot"], e["peer"]) == (one, two)]
        return said[-1] if said else "never tried"


@cache
def _truth(world: str, x: float, y: float) -> Truth:
    spec = RobotSpec()
    return truth_of(load(path_of(world)), (x, y), spec.radius_m, spec.lidar.range_max_m)


def true_transform(mine: Floats, theirs: Floats) -> Floats:
    """(3,) frame of a peer in that of a robot, from both frames' poses (3,) in the world."""
    return compose(inverse(mine), theirs)


def errors(transform: Sequence[float], mine: Floats, theirs: Floats, centre: Floats) -> tuple[float, float]:
    """Metres at the centre (2,) of the peer's map, and degrees, that a transform is off."""
    truth, found = true_transform(mine, theirs), np.array(transform)
    gap = (apply(found, centre[None]) - apply(truth, centre[None]))[0]
    turn = wrapped(float(found[2] - truth[2]))
    return math.hypot(gap[0], gap[1]), abs(math.degrees(turn))


def right(metres: float, degrees: float) -> bool:
    """Whether an alignment counts as right (the scorer's)."""
    return metres <= RIGHT_M and degrees <= RIGHT_DEG


# tables


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """All tables of the runs."""
    live = {name: found for name, found in figures.items() if name.startswith("live/")}
    made = [_accepted(live), _pairs(live), _left(live), _maps(live), _sharing(figures), _division(figures)]
    return [*made, _range(figures)]


def _by_world(live: Mapping[str, Figures]) -> dict[str, list[Figures]]:
    groups: dict[str, list[Figures]] = {}
    for name, found in live.items():
        groups.setdefault(name.split("/")[1], []).append(found)
    return dict(sorted(groups.items())) | ({"all": list(live.values())} if live else {})


def _accepted(live: Mapping[str, Figures]) -> Section:
    rows = []
    for world, runs in _by_world(live).items():
        accepted = [one for run in runs for one in run["accepted"]]
        rows.append(
            {
                "world": world,
                "runs": len(runs),
                "accepted": len(accepted),
                "false": sum(one["false"] for one in accepted),
                "worst_m": max((one["error_m"] for one in accepted), default=None),
                "worst_deg": max((one["error_deg"] for one in accepted), default=None),
                **{name: sum(run["counts"][name] for run in runs) for name in ("proposed", "rejected", "unmerged")},
            }
        )
    columns = [
        Column("world", "world"),
        Column("runs", "runs"),
        Column("accepted", "accepted"),
        Column("false", "false", at_most=0),
        Column("worst_m", "worst m"),
        Column("worst_deg", "worst deg", digits=2),
        Column("proposed", "proposed"),
        Column("rejected", "rejected"),
        Column("unmerged", "unmerged"),
    ]
    note = "False: more than 0.25 m or 5 degrees off, also if undone later."
    return Section("accepted", "3 robots, starts from the seed: accepted alignments", columns, rows, note=note)


def _pairs(live: Mapping[str, Figures]) -> Section:
    rows = []
    for world, runs in _by_world(live).items():
        pairs = [pair for run in runs for pair in run["pairs"]]
        merged = sum(pair["merged"] for pair in pairs)
        low, high = wilson(merged, len(pairs))
        row = {"world": world, "pairs": len(pairs), "merged": merged, "share": merged / max(len(pairs), 1)}
        rows.append(row | {"interval": f"{low:.2f} to {high:.2f}"})
    columns = [
        Column("world", "world"),
        Column("pairs", "pairs"),
        Column("merged", "merged"),
        Column("share", "share", at_least=0.8),
        Column("interval", "95 %"),
    ]
    title = "Robot and peer in contact with overlap >= 30 % and 120 s left: merged by the end"
    beside = frozenset(number for number, row in enumerate(rows) if row["world"] != "all")
    return Section("merged", title, columns, rows, beside)


def _left(live: Mapping[str, Figures]) -> Section:
    counts: dict[str, int] = {}
    for name, run in live.items():
        for pair in run["pairs"]:
            if not pair["merged"]:
                key = f"{name.split('/')[1]}: {pair['reason']}"
                counts[key] = counts.get(key, 0) + 1
    rows = [{"reason": reason, "pairs": count} for reason, count in sorted(counts.items(), key=lambda item: -item[1])]
    return Section("left", "Why the rest is not", [Column("reason", "last word"), Column("pairs", "pairs")], rows)


def _maps(live: Mapping[str, Figures]) -> Section:
    rows = []
    for world, runs in _by_world(live).items():
        chosen = runs[:PAIRED_SEEDS] if world != "all" else []
        scores = [one for run in chosen for one in run["scores"].values()]
        if scores:
            row = {"world": world, "maps": len(scores), "rtf": median(run["real_time_factor"] for run in chosen)}
            rows.append(row | {key: min(one[key] for one in scores) for key in ("wall_recall", "wall_precision")})
    columns = [
        Column("world", "world"),
        Column("maps", "maps"),
        Column("wall_recall", "recall", at_least=0.97),
        Column("wall_precision", "precision", at_least=0.97),
        Column("rtf", "real-time factor", digits=1),
    ]
    beside = frozenset(number for number, row in enumerate(rows) if row["world"] != "maze-15")
    return Section("maps", "Every robot's map with sharing, worst of 10 seeds", columns, rows, beside)


def _last_t99(run: Figures) -> float | None:
    """When every robot had 99 %."""
    times = [robot["t_99"] for robot in run["robots"].values()]
    return None if any(t is None for t in times) else float(max(times))


def _spread(ratios: Sequence[float]) -> str:
    """Middle half of paired ratios."""
    low, high = np.quantile(ratios, (0.25, 0.75), method="nearest").tolist()
    return f"{low:.2f} to {high:.2f}"


def _sharing(figures: Mapping[str, Figures]) -> Section:
    ratios, rows = [], []
    for seed in range(PAIRED_SEEDS):
        on, off = _divided(figures, 3, seed), figures.get(f"unshared/{seed}")
        if on is None or off is None:
            continue
        with_, without = _last_t99(on), _last_t99(off)
        ratio = with_ / without if with_ is not None and without is not None else None
        ratios.append(math.inf if ratio is None else ratio)
        rows.append({"seed": str(seed), "on": with_, "off": without, "ratio": ratio})
    if rows:
        middle = median(ratios)
        rows.append({"seed": "median", "ratio": middle if math.isfinite(middle) else None, "spread": _spread(ratios)})
    columns = [
        Column("seed", "seed"),
        Column("on", "sharing s", digits=0),
        Column("off", "without s", digits=0),
        Column("ratio", "ratio", at_most=0.75),
        Column("spread", "quarters"),
    ]
    beside = frozenset(range(len(rows) - 1))
    return Section("sharing", f"{_where(figures)}: time until every robot has 99 %", columns, rows, beside)


def _division(figures: Mapping[str, Figures]) -> Section:
    rows = []
    for robots in (2, 3, 5):
        ratios, sooner, with_, without, alone_ = [], [], [], [], []
        for seed in range(PAIRED_SEEDS):
            divided = _divided(figures, robots, seed)
            undivided = figures.get(f"undivided/{robots}/{seed}")
            alone = [figures.get(f"alone/{seed}/{start}") for start in range(3)]
            times = [run["team"]["t_99"] for run in (divided, undivided, *alone) if run is not None]
            if len(times) < 5 or any(t is None for t in times):
                continue
            ratios.append(times[0] / mean(times[2:]))
            sooner.append(times[0] / times[1])
            with_.append(times[0])
            without.append(times[1])
            alone_.append(mean(times[2:]))
        if ratios:
            rows.append(
                {
                    "robots": robots,
                    "seeds": len(ratios),
                    "divided": median(with_),
                    "undivided": median(without),
                    "alone": median(alone_),
                    "ratio": median(ratios),
                    "spread": _spread(ratios),
                    "sooner": median(sooner),
                }
            )
    columns = [
        Column("robots", "robots"),
        Column("seeds", "seeds"),
        Column("divided", "with division s", digits=0),
        Column("undivided", "without s", digits=0),
        Column("alone", "one robot s", digits=0),
        Column("ratio", "to one robot", at_most=0.55),
        Column("spread", "quarters"),
        Column("sooner", "to without", at_most=1.0),
    ]
    beside = frozenset(number for number, row in enumerate(rows) if row["robots"] != 3)
    return Section("division", f"{_where(figures)}: team coverage of 99 %, medians of the seeds", columns, rows, beside)


def _range(figures: Mapping[str, Figures]) -> Section:
    rows = []
    for range_m in RANGES:
        found = [
            _divided(figures, 3, s) if range_m == 4.0 else figures.get(f"range/{range_m:g}/{s}")
            for s in range(RANGE_SEEDS)
        ]
        runs = [run for run in found if run is not None]
        if not runs:
            continue
        times = [t for run in runs if (t := _last_t99(run)) is not None]
        sent = [sum(robot["bytes_sent"] for robot in run["robots"].values()) for run in runs]
        rows.append(
            {
                "range": range_m,
                "runs": len(runs),
                "t_99": median(times) if len(times) == len(runs) else None,
                "team": median(run["team"]["t_99"] or math.inf for run in runs),
                "bytes": median(sent),
                "accepted": sum(len(run["accepted"]) for run in runs),
                "false": sum(one["false"] for run in runs for one in run["accepted"]),
            }
        )
    columns = [
        Column("range", "radio range m", digits=0),
        Column("runs", "runs"),
        Column("t_99", "every robot 99 % s", digits=0),
        Column("team", "team 99 % s", digits=0),
        Column("bytes", "bytes sent"),
        Column("accepted", "accepted"),
        Column("false", "false", at_most=0),
    ]
    return Section("range", f"{_where(figures)}, 3 robots, by radio range", columns, rows)
