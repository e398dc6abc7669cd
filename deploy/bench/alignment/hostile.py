"""Hostile maps against a live robot: nothing may be merged, nothing may crash."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from agent.config import AgentConfig
from agent.geometry.transform import inverse
from agent.robot import Robot, Step
from agent.shell.mind import Mind
from deploy import inprocess
from deploy.bench.alignment.pairs import moved, random_pose
from deploy.bench.alignment.recordings import whole_map
from deploy.bench.cases import Case, Figures
from deploy.bench.layouts import path_of
from deploy.bench.tables import Table, whole
from protocol.geometry import apply, compose
from protocol.grid_map import quantise
from protocol.map_codec import encode_map
from protocol.messages import EVERYONE, Heard, Observation, RobotSpec
from protocol.talk import MAX_PARTS, Beacon, Part, in_parts
from protocol.walls import lengths
from protocol.wireframe import Wireframe
from world.config import WorldConfig

KINDS = ("random", "mirrored", "elsewhere", "shifted", "not finite", "dangling", "huge", "off its map")
EACH = 25  # maps of each kind: 200 in all
PERIOD_TICKS = 5  # a hostile peer speaks once a second


def cases(quick: bool) -> list[Case]:
    """One run a kind."""
    world, limit_s, peers = ("apartment", 25.0, 5) if quick else ("maze-15", 150.0, EACH)
    return [
        Case(f"hostile/{kind}", besiege, {"world": world, "seed": k, "limit_s": limit_s, "kinds": [kind] * peers})
        for k, kind in enumerate(KINDS)
    ]


def besiege(world: str, seed: int, limit_s: float, kinds: Sequence[str]) -> Figures:
    """One robot that explores, and as many hostile peers as kinds, which all speak once a second."""
    made: list[_Besieged] = []

    def make(name: str, spec: RobotSpec, config: AgentConfig, own_seed: int) -> Mind:
        made.append(_Besieged(Robot(name, spec, config, own_seed), kinds, np.random.default_rng(seed)))
        return made[0]

    settings = {"world": path_of(world), "robots": 1, "seed": seed, "starts": "random", "until": limit_s}
    inprocess.run(WorldConfig.model_validate(settings), AgentConfig(), None, None, make)
    return made[0].figures()


class _Besieged:
    """A robot that hears hostile peers."""

    def __init__(self, robot: Robot, kinds: Sequence[str], rng: np.random.Generator) -> None:
        self.robot, self.rng = robot, rng
        self.kinds = {f"x{k}": kind for k, kind in enumerate(kinds)}
        self.frames = {name: random_pose(rng) for name in self.kinds}
        self.elsewhere = [_travels(whole_map(world)) for world in ("office", "hall", "symmetric")]
        self.messages = 0
        self.merged: set[str] = set()
        self.refused = 0
        self.moved_m = 0.0

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        own = list(heard)
        if observation.tick % PERIOD_TICKS == 0 and len(self.robot.own.edges):
            for name, kind in self.kinds.items():
                said = self._speak(observation, name, kind)
                own += said
                self.messages += len(said)
        step = self.robot.step(observation, own)
        self.refused += sum(event.event == "refused" for event in step.action.events)
        self._judge()
        sends = [send for send in step.sends if send.to == EVERYONE]  # the world knows nothing of these peers
        return step._replace(sends=sends, action=step.action.model_copy(update={"sent": len(sends), "merged": {}}))

    def _judge(self) -> None:
        """What of it became part of the robot's map."""
        for peer in self.robot.team.merged:
            name = peer.log.name
            if self.kinds[name] != "shifted":
                self.merged.add(name)
                continue
            # the good map may be merged, but then it must stay where it was
            gap = apply(peer.transform, np.zeros((1, 2))) - apply(inverse(self.frames[name]), np.zeros((1, 2)))
            self.moved_m = max(self.moved_m, float(np.hypot(*gap[0])))

    def figures(self) -> Figures:
        """Messages, and what was merged of them."""
        counts = {"messages": self.messages, "merged": len(self.merged), "refused": self.refused}
        return {**counts, "moved_m": self.moved_m, "maps": len(self.kinds)}

    def _speak(self, observation: Observation, name: str, kind: str) -> list[Heard]:
        """A beacon and a whole map."""
        x, y, theta = self.frames[name].tolist()
        frame, pose, own = (x, y, theta), self.robot.filter.pose, self.robot.own
        told, place = moved(own, frame), compose(frame, pose)
        if kind == "random":
            told = self._random(80)
        elif kind == "mirrored":
            flipped = replace(own, points=own.points * (1.0, -1.0), edges=own.edges[:, ::-1].copy())
            told, place = moved(flipped, frame), compose(frame, (pose[0], -pose[1], -pose[2]))
        elif kind == "elsewhere":
            told = moved(self.elsewhere[int(name[1:]) % len(self.elsewhere)], frame)
            corner = told.points[int(self.rng.integers(len(told.points)))]
            place = float(corner[0]), float(corner[1]), 0.0
        elif kind == "shifted" and name in self.robot.team.merged_ticks:
            told = moved(told, np.array([1.0, 0.0, 0.0]))
        elif kind == "off its map":
            place = place[0] + 500.0, place[1], place[2]
        body = encode_map(quantise(told, 10, 0)).data
        if kind == "not finite":
            body = np.full(len(body) // 4, math.nan, "<f4").tobytes()
        elif kind == "dangling":  # bits that lead anywhere
            at = int(self.rng.integers(len(body)))
            body = body[:at] + self.rng.bytes(len(body) - at)
        parts = in_parts(observation.tick, 0, body, 1_200)
        if kind == "huge":  # more than any map may have
            parts = [Part(observation.tick, 0, k, MAX_PARTS, self.rng.bytes(1_150)) for k in range(MAX_PARTS)]
        payloads = [("beacon", Beacon(observation.tick, place).encode()), *(("map", part.encode()) for part in parts)]
        return [Heard(tick=observation.tick, sender=name, kind=what, payload=data) for what, data in payloads]

    def _random(self, n: int) -> Wireframe:
        order = self.rng.permutation(n)
        edges = np.column_stack([np.arange(n), order])[order != np.arange(n)].astype(np.int32)
        m = len(edges)
        points = self.rng.uniform(-6.0, 6.0, (n, 2))
        labels = self.rng.integers(0, 3, n).astype(np.uint8)
        return Wireframe(points, labels, edges, np.ones(m, np.float32), np.ones(m, np.bool_))


def _travels(wireframe: Wireframe) -> Wireframe:
    """A map without walls that are shorter than the radio tells apart."""
    keep = lengths(wireframe.segments()) > 0.05
    kept = {name: getattr(wireframe, name)[keep] for name in ("edges", "likelihood", "own")}
    return replace(wireframe, **kept)


TABLES = [
    Table(
        "hostile",
        "Hostile maps against a live robot",
        whole("hostile/{kind}"),
        "kind; maps: peers; messages; refused: refused as malformed; merged <= 0; moved_m <= 0.25: moved m",
        note="A shifting peer tells the truth first and may be merged; what it says after that must not move the map.",
    )
]
