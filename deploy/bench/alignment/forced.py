"""Wrong proposals forced into the queue of live robots: twins, near misses, quarter turns, the best wrong candidate."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from agent.alignment.candidates import ranked
from agent.alignment.prepared import prepare
from agent.cooperation.peer import Merged, Proposed, Unaligned
from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures, each
from deploy.bench.errors import is_false
from deploy.bench.explored import explore
from deploy.bench.layouts import drawn_starts, path_of
from deploy.bench.tables import Outcomes, Row, Runs, Table, by_label, runs_of
from protocol.geometry import Pose, compose, pose_of, relative
from protocol.messages import Observation
from protocol.wireframe import Wireframe
from world.worldfile import load

KINDS = ("twin", "near", "turned", "rival")
"""A symmetry of the building, 0.3 to 1.5 m off, a quarter or half turn about the meeting, the best wrong candidate."""
RUNS = {"symmetric": 4, "hall": 2, "maze-15": 2, "office": 2, "apartment": 2}
LIMIT_S = 160.0  # simulated seconds; most pairs meet in the first 100
EVERY_S = 5.0  # time to a pair's next forced proposal: sooner, the same meetings would decide it again
LESS = ("symmetric", "maze-15", "office")  # worlds of the rows with less evidence, one run each
LEAST_WALLS = 8  # a proposal is forced once both maps have so many walls
ROWS: dict[str, Mapping[str, Any]] = {
    "all evidence": {},
    "without ground": {"ground": False},
    "without discs": {"discs": False},
    "without range": {"heard": False},
    "without later maps": {"later_maps": False},
    "the drive alone (paper)": {"discs": False, "heard": False, "later_maps": False, "accept": 2.5},
}
"""What each kind of evidence is worth; the last needs a bound that the drive can reach."""


def cases(quick: bool) -> list[Case]:
    """Runs with all evidence over all worlds, and some a row with less."""
    if quick:
        return each("forced/all evidence/{world}/0", measure, {"seed": 0, "limit_s": 60.0}, world=["apartment"])
    return [
        Case(f"forced/{row}/{world}/{k}", measure, {"world": world, "seed": 100 + k, "evidence": row})
        for row in ROWS
        for world, runs in (RUNS if row == "all evidence" else dict.fromkeys(LESS, 1)).items()
        for k in range(runs)
    ]


def measure(world: str, seed: int, evidence: str = "all evidence", limit_s: float = LIMIT_S) -> Figures:
    """One run with the evidence of a row."""
    return ForcedRun(world, seed, limit_s, ROWS[evidence]).figures()


class ForcedRun:
    """A run of three robots whose proposals are all forced, and nearly all of them wrong."""

    def __init__(self, world: str, seed: int, limit_s: float, evidence: Mapping[str, Any] | None = None) -> None:
        self.frames = {f"r{k + 1}": pose_of(start) for k, start in enumerate(drawn_starts(world, 3, seed))}
        x0, y0, x1, y1 = load(path_of(world)).solid.bounds
        self.centre = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        self.rng = np.random.default_rng(seed)
        self.forced: list[Figures] = []
        self.open: dict[tuple[str, str], Figures] = {}
        self._next: dict[tuple[str, str], int] = {}
        settings = {"world": world, "robots": 3, "seed": seed, "starts": "random", "max_time_s": limit_s}
        explore(settings, {"cooperation": {"verification": evidence or {}}}, self._watch)

    def figures(self) -> Figures:
        """All proposals that were decided, and how."""
        return {"forced": self.forced, "open": len(self.open)}

    def _watch(self, robot: Robot, observation: Observation, step: Step) -> None:
        team = robot.team
        if observation.tick == 0:  # nothing but what is on trial is aligned
            align = team._align
            team._align = lambda tick, peer, own: isinstance(peer, Proposed) and align(tick, peer, own)  # type: ignore[method-assign]
        for event in step.action.events:
            if event.event in ("accepted", "rejected"):
                self._close(robot.robot, event.event, event.data)
        for name, peer in list(team.peers.items()):
            early = observation.tick < self._next.get((robot.robot, name), 0)
            if early or (robot.robot, name) in self.open:
                continue
            if isinstance(peer, Merged):  # a near miss that later maps put right, or a failure: go on
                team.undo(peer, "made free for the next", {})
            elif isinstance(peer, Unaligned) and peer.log.first_encounter is not None and peer.log.map is not None:
                theirs = peer.log.map.wireframe
                if min(len(theirs.edges), len(robot.own.edges)) >= LEAST_WALLS:
                    self._force(robot, peer, theirs, observation.tick)

    def _force(self, robot: Robot, peer: Unaligned, theirs: Wireframe, tick: int) -> None:
        kind, name = KINDS[len(self.forced) % len(KINDS)], peer.log.name
        robot.team.propose(peer, self._wrong(kind, robot, peer, theirs), robot.own, {"forced": True})
        peer.log.aligned_walls = len(robot.own.edges), len(theirs.edges)
        self._next[robot.robot, name] = tick + round(EVERY_S * robot.spec.lidar.rate_hz)
        self.open[robot.robot, name] = {"kind": kind, "t": tick / robot.spec.lidar.rate_hz}

    def _wrong(self, kind: str, robot: Robot, peer: Unaligned, theirs: Wireframe) -> Pose:
        """A transform of that kind that is wrong."""
        mine, their_frame = self.frames[robot.robot], self.frames[peer.log.name]
        truth = relative(mine, their_frame)
        if kind == "twin":  # the half turn about the building's centre, or the next room of `symmetric`
            half = 2.0 * self.centre[0], 2.0 * self.centre[1], math.pi
            step = float(self.rng.choice([-4.0, 4.0])), 0.0, 0.0
            return relative(mine, compose(half if self.rng.random() < 0.5 else step, their_frame))
        if kind == "near":
            angle, away = self.rng.uniform(0.0, 2.0 * math.pi), self.rng.uniform(0.3, 1.5)
            return compose((away * math.cos(angle), away * math.sin(angle), 0.0), truth)
        if kind == "rival":
            config = robot.config.alignment
            one, two = prepare(robot.own, config), prepare(theirs, config)
            if one is not None and two is not None:
                for found in ranked(one, two, config, self.rng).transforms:
                    if is_false(found, mine, their_frame):
                        return pose_of(found)
        # a turn about where the peer was at the contact, which stays within range
        assert peer.log.first_encounter is not None
        x, y, _ = compose(truth, peer.log.first_encounter.theirs)
        turn = float(self.rng.choice([0.5, 1.0, 1.5])) * math.pi
        return compose(compose((x, y, turn), (-x, -y, 0.0)), truth)

    def _close(self, one: str, event: str, data: Mapping[str, Any]) -> None:
        opened = self.open.pop((one, data["peer"]), None)
        if opened is None:
            return
        false = is_false(data["transform"], self.frames[one], self.frames[data["peer"]])
        said = {key: data[key] for key in ("reason", "weight", "evidence")}
        self.forced.append({**opened, "accepted": event == "accepted", "wrong": false, **said})


def _wrong(runs: Runs) -> list[Figures]:
    """The forced proposals that stayed wrong to the end."""
    return [one for run in runs for one in run["forced"] if not one["accepted"] or one["wrong"]]


def _by_evidence(figures: Outcomes) -> list[Row]:
    """What became of all forced proposals, a row a set of evidence."""
    rows = []
    for row, runs in by_label(figures, "forced/{evidence}/*/*").items():
        wrong, forced = _wrong(runs), sum(len(run["forced"]) for run in runs)
        accepted = sum(one["accepted"] for one in wrong)
        rejected = sum(one["reason"] == "the evidence decides" and not one["accepted"] for one in wrong)
        counts = {"forced": forced, "accepted": accepted, "righted": forced - len(wrong), "by_evidence": rejected}
        rows.append({"evidence": row, **counts, "given_up": len(wrong) - rejected - accepted})
    return [row for row in rows if row["forced"]]


def _by_kind(figures: Outcomes) -> list[Row]:
    """Accepted with all evidence, a row a kind."""
    wrong = _wrong(runs_of(figures, "forced/all evidence/*/*"))
    by_kind = {kind: [one["accepted"] for one in wrong if one["kind"] == kind] for kind in KINDS if wrong}
    return [{"kind": kind, "forced": len(some), "accepted": sum(some)} for kind, some in by_kind.items()]


TABLES = [
    Table(
        "forced",
        "Wrong proposals forced into the queue",
        _by_evidence,
        "evidence; forced; accepted <= 0: wrong accepted; righted: put right by later maps; "
        "by_evidence: rejected by evidence; given_up: unreachable, time or undecided",
        judged=lambda row: row["evidence"] == "all evidence",
    ),
    Table("forced_kinds", "The same by kind, all evidence", _by_kind, "kind; forced; accepted <= 0"),
]
