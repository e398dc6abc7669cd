"""Sensing as a real robot has it: a lidar that turns, noise that grows with range, wheels that err and slip."""

from collections.abc import Callable, Mapping
from typing import Any

from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import explore
from deploy.bench.filter.faults import KINDS
from deploy.bench.filter.runs import BUNDLED
from deploy.bench.filter.trials import SCOPES, counts_of, gone_percent, measure_faults
from deploy.bench.layouts import present
from deploy.bench.rings import false_loops, measure_ring
from deploy.bench.tables import Outcomes, Row, Table, columns, runs_of, share
from deploy.metrics import corners_fitted
from deploy.sensing import IDEAL, REAL
from protocol.geometry import pose_of
from protocol.messages import Observation

PLAIN = ["maze-15", "office", "apartment", "symmetric", "hall"]
SHARED = ["drlnav_stage7", "tb3_dqn_stage4", "gbeltramo_building"]
HARD = ["pal_passage_110cm_w"]  # a corridor of 12 m without a feature
CLUTTERED = ["uday_building", "drlnav_house_tomas", "hurtado_apartment", "pal_home_w"]
SEEDS = 5
PEOPLE = {"office": 5, "hall": 10}
ROBOT_WORLD, ROBOT_SEEDS = "apartment", 2
LIDARS: dict[str, dict[str, Any]] = {
    **{f"{beams} beams": {"beams": beams} for beams in (90, 180, 720, 1440)},
    **{f"{rate_hz} Hz": {"rate_hz": rate_hz} for rate_hz in (10, 20)},
    **{f"{range_m} m": {"range_max_m": range_m} for range_m in (2, 8, 25)},
    **{f"{view} degrees": {"field_of_view_deg": view, "first_beam_deg": -view / 2} for view in (180, 270)},
    "5 % lost": {"dropout": 0.05},
    "clockwise, off centre": {"clockwise": True, "first_beam_deg": 30, "mount_x_m": -0.03, "mount_yaw_deg": 180},
}
BODIES: dict[str, dict[str, Any]] = {
    **{f"radius {radius_m} m": {"radius_m": radius_m} for radius_m in (0.08, 0.16, 0.25)},
    **{f"{speed_mps} m/s": {"max_speed_mps": speed_mps} for speed_mps in (0.1, 0.5, 1.0)},
}
"""Robots that differ from the default in one thing each."""
RING_SEEDS, RING_M = 10, 60.0
ODOMETRY = {"as given": 1.0, "twice as bad": 2.0}
FALSE_SEEDS = 25  # of `symmetric` and of a ring of four equal sides: 50 runs
LIMIT_S = 4000.0  # simulated seconds after which a run counts as not finished: twice what the largest layout takes


def cases(quick: bool) -> list[Case]:
    """One robot in every layout, with real and with ideal sensing, and among people; rings; faults."""
    worlds = ["apartment"] if quick else PLAIN + present(SHARED + HARD + CLUTTERED)
    seeds = range(1 if quick else SEEDS)
    made = each("real/{world}/{seed}", measure, {"ideal": False}, seed=seeds, world=worlds)
    made += each("ideal/{world}/{seed}", measure, {"ideal": True}, seed=seeds, world=worlds)
    for world, people in [] if quick else PEOPLE.items():
        made += each(
            f"people/{world}/{{seed}}", measure, {"ideal": False, "world": world, "people": people}, seed=seeds
        )
    some = range(1 if quick else ROBOT_SEEDS)
    robots = {name: {"lidar": lidar} for name, lidar in LIDARS.items()} | BODIES
    for name, robot in [] if quick else robots.items():
        own = {"ideal": False, "world": ROBOT_WORLD, "robot": robot}
        made += each(f"robot/{name.replace('/', ' a ')}/{{seed}}", measure, own, seed=some)
    made += _rings(quick)
    trials, limit_s = (3, 120.0) if quick else (25, 1200.0)
    faults = {"trials": trials, "particles": None, "scopes": SCOPES[:1], "limit_s": limit_s, "real": True}
    return made + each("faults/{world}", measure_faults, faults, world=BUNDLED[:1] if quick else BUNDLED)


def _rings(quick: bool) -> list[Case]:
    """A robot that is carried around; and where places are alike, carried and driving."""
    made = []
    for name, worse in ODOMETRY.items():
        ring = {"side_m": 12.0 if quick else RING_M, "laps_driven": 2.0, "niches": True, "worse": worse}
        made += each(f"ring/{name}/{{seed}}", measure_ring, ring, seed=range(1 if quick else RING_SEEDS))
    alike, seeds = {"side_m": 20.0, "laps_driven": 2.0, "niches": False, "worse": 2.0}, range(FALSE_SEEDS)
    made += each("alike/ring/{seed}", measure_ring, alike, seed=() if quick else seeds)
    symmetric = {"ideal": False, "world": "symmetric"}
    return made + each("alike/symmetric/{seed}", measure, symmetric, seed=() if quick else seeds[SEEDS:])


def measure(world: str, seed: int, ideal: bool, people: int = 0, robot: Mapping[str, Any] | None = None) -> Figures:
    """Figures of one robot's whole run: its map, its path, contacts, CPU time of a step, and how it ended.

    robot: settings of `spec` that differ.
    """
    sensing, other = IDEAL if ideal else REAL, dict(robot or {})
    spec = {**sensing, **other, "lidar": sensing["lidar"] | other.get("lidar", {})}
    settings = {"world": world, "robots": 1, "seed": seed, "spec": spec, "people": people, "max_time_s": LIMIT_S}
    begun: list[int] = []  # ticks at which the robot began each of its submaps

    def watch(robot: Robot, observation: Observation, _: Step) -> None:
        if robot.loops:
            begun.extend([observation.tick] * (len(robot.loops.submaps.poses) - len(begun)))

    run = explore(settings, {}, watch)
    fitted = corners_fitted(run.robots["r1"].wireframe, run.frame(), run.truth())
    found = run.figures() | run.told() | run.path_errors() | {"corner_fitted_m": fitted}
    if closing := run.robots["r1"].loops:
        places = [pose_of(run.tracks.true[tick][0]) for tick in begun]
        found |= {"loops": closing.submaps.loops, "false_loops": false_loops(closing.submaps, places)}
    return found


def _worst(
    name: str,
    title: str,
    layouts: list[str],
    bars: tuple[str, str, str, str] = ("", "", "", ""),
    judged: Callable[[Row], bool] = lambda row: True,
) -> Table:
    """A row a layout, or a robot: the worst of its runs. bars: of recall, precision, corners and paths."""
    (recall, precision, corner, path), label = bars, "robot" if name == "robot" else "world"
    heads = columns(
        f"{label}; runs count; complete >= 1; wall_recall least{recall}: recall; "
        f"wall_precision least{precision}: precision; corner_rmse_m most{corner}; corner_fitted_m most: ... fitted; "
        f"path_rms_m most{path}; path_max_m most; frame_rms_m most: in own frame; "
        "odometry_rms_m most; repeated most; wall_contacts most <= 0; t_99 most; ended_at most; step_ms_median most",
        complete=share(lambda run: run["ended"] == "complete" and run["reason"]),
    )
    kind, pattern = name.split("-")[0], "|".join(layouts)
    return Table(
        name,
        title,
        f"{kind}/(?=(?:{pattern})/){{{label}}}/*",
        heads,
        judged=judged,
        note=NOTE,
        sensing="ideal" if name == "ideal" else "real",
    )


def _alike(figures: Outcomes) -> list[Row]:
    """A row for the ring of equal sides, and one for `symmetric`, whose runs of other tables count, too."""
    rows: list[Row] = []
    for where, patterns in {"ring": ["alike/ring/*"], "symmetric": ["real/symmetric/*", "alike/symmetric/*"]}.items():
        runs = [run for pattern in patterns for run in runs_of(figures, pattern)]
        wrong = [run["false_loops"] for run in runs]
        if runs:
            row = {"loops": sum(run["loops"] for run in runs), "false_loops": sum(wrong)}
            rows.append({"where": where, "runs": len(runs), **row, "runs_false": sum(map(bool, wrong))})
    return rows


def _faults(figures: Outcomes) -> list[Row]:
    """A row for each kind of fault, all worlds together."""
    runs = runs_of(figures, "faults/*")
    counts = {kind: counts_of(runs, [kind], SCOPES[0]) for kind in KINDS}
    return [{"fault": kind, "trials": len(of), "gone": gone_percent(of)} for kind, of in counts.items() if of]


NOTE = (
    "Worst of the runs. Recall, precision: within 5 cm. Corners: in the own frame, and after the best rigid fit. "
    "Paths: rms after that fit, and in the own frame."
)
EVERYWHERE = [*PLAIN, *SHARED, *HARD, *CLUTTERED]
TABLES = [
    _worst("real", "One robot, real sensing", PLAIN + SHARED, (" >= 0.99", " >= 0.99", " <= 0.01", " <= 0.02")),
    _worst("real-cluttered", "... in furnished layouts, and among steps", CLUTTERED, (" >= 0.95", " >= 0.97", "", "")),
    _worst("real-corridor", "... in a corridor without a feature", HARD, (" >= 0.95", " >= 0.95", "", "")),
    _worst("people", "One robot among people, real sensing", [*PEOPLE], (" >= 0.98", " >= 0.99", "", "")),
    Table(
        "ring",
        f"Two laps of a ring of corridors, {RING_M:g} m a side, carried, real sensing",
        "ring/{odometry}/*",
        columns(
            "odometry; runs count; closed >= 1; false_loops total <= 0: false loops; wall_share most <= 1.05: walls "
            "mapped over true; path_rms_m most <= 0.15; path_max_m most; end_off_m most: end off m; "
            "wall_recall least; wall_precision least; loops least; settled most",
            closed=share(lambda run: run["closed"]),
        ),
        note="Closed: by loops of which none is false, and at the end the robot knows within 1 m where it is. "
        "Paths: of the submaps, after the best rigid fit. Recall, precision: of the filter's map, in the own frame.",
        sensing="real",
    ),
    Table(
        "alike",
        "Loops where places are alike, real sensing",
        _alike,
        "where; runs; loops; false_loops <= 0: false loops; runs_false <= 0: runs with one",
        sensing="real",
    ),
    Table(
        "faults",
        "Discrete faults injected in mid-run, real sensing",
        _faults,
        "fault; trials; gone >= 95: gone in 50 scans %",
        sensing="real",
    ),
    _worst(
        "robot",
        f"Any robot, real sensing, {ROBOT_WORLD}",
        [".*"],
        (" >= 0.97", "", "", ""),
        judged=lambda row: row["robot"] != "90 beams",
    ),
    _worst("ideal", "One robot, ideal sensing", EVERYWHERE),
]
