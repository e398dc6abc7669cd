"""Whole runs of three robots: how exact accepted transforms are, and how much wrong wall a merge adds."""

from itertools import combinations, permutations
from typing import Any

import numpy as np

from deploy.bench import made
from deploy.bench.alignment.live import BUNDLED
from deploy.bench.cases import Case, Figures
from deploy.bench.errors import errors, is_false
from deploy.bench.explored import Explored, explore
from deploy.bench.layouts import FURNISHED, PLAIN, present, written
from deploy.bench.tables import Reduce, Runs, Table, columns, over
from deploy.metrics import Truth, distance_to
from protocol.arrays import Floats
from protocol.geometry import apply
from protocol.walls import directions, lengths, points_along
from protocol.wireframe import Wireframe

TWINS = ("symmetric", "rooms", "loop", "turned", "traced")  # how the names of worlds begin whose places look alike
OFFICES = MAZES = 20
LOOPS = TRACED = 5
TURNED = 10
RUNS = 1000
LIMIT_S = 600.0  # simulated seconds of a run
LATER_S = 10.0  # after which an accepted transform must be exact
SETTLED_S = 30.0  # after which a merge may have added no wrong wall
TOGETHER_S = 30.0  # of contact, between both directions of a pair
WRONG_M = 0.05  # from any true wall
SAMPLE_M = 0.05
PAIRS_MERGED, TWINS_MERGED = 0.95, 0.8  # of pairs that met


def worlds(quick: bool) -> list[str]:
    """Names of layouts, and of worlds that are made from a kind and a seed."""
    if quick:
        return ["apartment", "loop-0"]
    kinds = [f"rooms-{seed}" for seed in range(OFFICES)] + [f"loop-{seed}" for seed in range(LOOPS)]
    kinds += [f"turned-{seed}" for seed in range(TURNED)] + [f"traced-{seed}" for seed in range(TRACED)]
    mazes = [f"generated-12x12-{seed}" for seed in range(MAZES)]
    return [*BUNDLED, *present(PLAIN + FURNISHED), *kinds, *mazes]


def cases(quick: bool) -> list[Case]:
    """As many runs of each world as make 1,000 in all; every world once before any twice."""
    names = worlds(quick)
    pairs = [(world, k) for k in range(1 if quick else -(-RUNS // len(names))) for world in names]
    limit = 60.0 if quick else LIMIT_S
    return [
        Case(f"exact/{world}/{seed}", measure, {"world": world, "seed": seed, "limit_s": limit})
        for world, seed in pairs[: len(names) if quick else RUNS]
    ]


def _file(world: str) -> str:
    """What `explore` takes for a world of `worlds`."""
    kind, _, seed = world.rpartition("-")
    return written(getattr(made, kind)(int(seed))) if kind in TWINS[1:] else world


def measure(world: str, seed: int, limit_s: float = LIMIT_S) -> Figures:
    """One run: errors of accepted transforms at once and later, wrong wall that merges added, and pairs merged."""
    merges: dict[tuple[str, str], dict[str, Any]] = {}  # those that stand
    done: list[dict[str, Any]] = []  # all
    mutual = Mutual()

    def look(run: Explored) -> bool:
        t = run.episode.t
        mutual.look(run)
        for one, two in permutations(run.robots, 2):
            mind, merge = run.robots[one], merges.get((one, two))
            if two not in mind.team.merged_ticks:
                merges.pop((one, two), None)
                continue
            if merge is None:
                false = is_false(mind.team.peers[two].transform, run.frame(one), run.frame(two))
                merge = {"robot": one, "peer": two, "t": t, "at_once": _off(run, one, two), "false": false}
                merges[one, two] = merge
                done.append(merge)
            if "later" not in merge and t >= merge["t"] + LATER_S:
                merge["later"] = _off(run, one, two)
            if "wrong_m" not in merge and t >= merge["t"] + SETTLED_S:
                truth, frame = run.truth(one), run.frame(one)
                both, own = (wrong_wall(wireframe, frame, truth) for wireframe in (mind.wireframe, mind.own))
                merge["wrong_m"] = round(both - own, 3)
        return False

    settings = {"world": _file(world), "robots": 3, "seed": seed, "starts": "random", "max_time_s": limit_s}
    run = explore(settings, {}, enough=look)
    heard = {(one, two) for one, mind in run.robots.items() for two in mind.team.peers}
    merged = {(one, two) for one, mind in run.robots.items() for two in mind.team.merged_ticks}
    summary = run.summary["robots"]
    return {
        "world": world,
        "twins": world.startswith(TWINS),
        "ended_at": run.episode.t,
        "merges": done,
        "false": sum(merge["false"] for merge in done),
        "met": len(heard),
        "merged": len(heard & merged),
        "both": mutual.waits(),
        "bytes": sum(robot["bytes_sent"] for robot in summary.values()),
        "t_99": [robot["t_99"] for robot in summary.values()],
        "crossing_m": max(crossing_m(mind.wireframe) for mind in run.robots.values()),
    }


def _off(run: Explored, one: str, two: str) -> tuple[float, float]:
    """Metres in the middle of a peer's map and degrees that a robot's transform of it is off."""
    peer = run.robots[one].team.peers[two]
    points = run.robots[two].own.points
    return errors(peer.transform, run.frame(one), run.frame(two), points.mean(0))


def wrong_wall(wireframe: Wireframe, frame: tuple[float, float, float], truth: Truth) -> float:
    """Metres of wall of a map, in the frame of that pose, that are farther than 5 cm from any true wall."""
    segments = apply(frame, wireframe.points)[wireframe.edges].reshape(-1, 4)
    segments = segments[lengths(segments) > 1e-6]
    if not len(segments):
        return 0.0
    count = np.maximum(1, np.round(lengths(segments) / SAMPLE_M)).astype(np.int64)
    points, wall = points_along(segments, count)
    ways: Floats = directions(segments)[wall]
    stands_for = (lengths(segments) / count)[wall]
    return float(stands_for[distance_to(points, ways, truth.outline) > WRONG_M].sum())


def crossing_m(wireframe: Wireframe) -> float:
    """How far walls of a map reach beyond others that they cross, metres, at the deepest crossing; 0 without any."""
    segments = wireframe.segments()
    segments = segments[lengths(segments) > 1e-6]
    size, (ux, uy), (x, y) = lengths(segments), directions(segments).T, segments[:, :2].T
    sine = ux[:, None] * uy - uy[:, None] * ux
    off = (x - x[:, None]) * uy - (y - y[:, None]) * ux  # of each wall's start from the line of each other one
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel walls cross nowhere
        along = off / sine  # where a wall meets each other one, metres along it
        beyond = np.minimum(along, size[:, None] - along) * np.abs(sine)
    deepest = np.minimum(beyond, beyond.T)[np.isfinite(along)]
    return round(float(deepest.max(initial=0.0)), 4)


class Mutual:
    """How long each pair is in contact while only one of the two has merged the other.

    Simulated seconds of contact: who is out of range can tell nobody what it has merged.
    """

    def __init__(self) -> None:
        self.one_sided: dict[tuple[str, str], float] = {}  # pairs, the smaller name first, that wait for the other way
        self.mutual: dict[tuple[str, str], float] = {}  # how long those that have merged both ways had waited

    def look(self, run: Explored) -> None:
        """Look at the run after a tick."""
        for pair in combinations(sorted(run.robots), 2):
            ways = [two in run.robots[one].team.merged_ticks for one, two in (pair, pair[::-1])]
            if any(ways) and pair not in self.mutual:
                heard = any(two in run.robots[one].exchange.contacts for one, two in (pair, pair[::-1]))
                waited = self.one_sided.get(pair, 0.0)
                if all(ways):
                    self.mutual[pair] = waited
                self.one_sided[pair] = waited + heard / run.episode.config.spec.lidar.rate_hz

    def waits(self) -> list[float]:
        """Seconds of all pairs that merged, but of those that were not in contact for as long as they have."""
        open_still = {pair: waited for pair, waited in self.one_sided.items() if pair not in self.mutual}
        return [*self.mutual.values(), *(waited for waited in open_still.values() if waited > TOGETHER_S)]


def _quantile(key: str, part: int | None, share: float) -> Reduce:
    """A quantile of a figure of all merges that have it; part: which of a pair of figures."""

    def reduce(runs: Runs, _: str) -> float | None:
        merges = [merge[key] for run in runs for merge in run["merges"] if key in merge]
        found = merges if part is None else [figures[part] for figures in merges]
        return float(np.quantile(found, share, method="higher")) if found else None

    return reduce


def _soon(runs: Runs, _: str) -> float | None:
    """Share of the pairs that had the time whose two directions merged soon after each other."""
    waits = [seconds for run in runs for seconds in run["both"]]
    return sum(seconds <= TOGETHER_S for seconds in waits) / len(waits) if waits else None


def _table(name: str, title: str, twins: bool) -> Table:
    which = f"(?{'=' if twins else '!'}(?:{'|'.join(TWINS)}))"
    heads = columns(
        f"world; runs count; false total <= 0; pairs >= {TWINS_MERGED if twins else PAIRS_MERGED}: pairs merged; "
        "m_95 <= 0.02: 95 % m; worst_m <= 0.04; deg_95 <= 0.1: 95 % deg; worst_deg <= 0.3; "
        "wrong_99 <= 0.5: wrong wall 99 % m; wrong <= 2: worst m; crossing_m most: walls cross m; "
        "soon >= 0.95: both ways in 30 s of contact; bytes median",
        pairs=over("merged", "met"),
        m_95=_quantile("later", 0, 0.95),
        worst_m=_quantile("later", 0, 1.0),
        deg_95=_quantile("later", 1, 0.95),
        worst_deg=_quantile("later", 1, 1.0),
        wrong_99=_quantile("wrong_m", None, 0.99),
        wrong=_quantile("wrong_m", None, 1.0),
        soon=_soon,
    )
    note = "Errors 10 s after a merge, wrong wall it added 30 s after it. Pairs: robot and peer that heard each other."
    rows = f"exact/{which}{{world}}/*"
    return Table(name, title, rows, heads, total="all", judged=lambda row: bool(row["world"] == "all"), note=note)


TABLES = [
    _table("exact", "3 robots, starts from the seed: how exact and mutual merges are", False),
    _table("exact-twins", "... in worlds of like rooms and corridors", True),
]
