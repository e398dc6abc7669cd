"""Hostile maps against a live robot: nothing may be merged, nothing may crash."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from agent.robot import Robot, Step
from deploy.bench.alignment.pairs import moved, random_pose
from deploy.bench.alignment.recordings import whole_map
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from deploy.bench.tables import Table, whole
from protocol.geometry import compose, inverted
from protocol.grid_map import quantise
from protocol.map_codec import encode_map
from protocol.messages import EVERYONE, Heard, Observation
from protocol.talk import MAX_PARTS, Beacon, Part, in_parts
from protocol.walls import lengths
from protocol.wireframe import Wireframe, certain
from world.recorder import own_part

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
    settings = {"world": world, "robots": 1, "seed": seed, "starts": "random", "until": limit_s}
    run = explore(settings, {}, make_mind=partial(_Besieged, kinds=kinds, rng=np.random.default_rng(seed)))
    figures: Figures = run.robots["r1"].figures()
    return figures


class _Besieged(Robot):
    """A robot that hears hostile peers."""

    def __init__(self, *which: Any, kinds: Sequence[str], rng: np.random.Generator) -> None:
        super().__init__(*which)
        self.rng, self.kinds = rng, {f"x{k}": kind for k, kind in enumerate(kinds)}
        self.frames = {name: random_pose(rng) for name in self.kinds}
        whole = [whole_map(world) for world in ("office", "hall", "symmetric")]
        # without walls that are shorter than the radio tells apart
        self.elsewhere = [own_part(replace(one, own=lengths(one.segments()) > 0.05)) for one in whole]
        self.swallowed: set[str] = set()
        self.messages, self.refused, self.moved_m = 0, 0, 0.0

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        own = list(heard)
        if observation.tick % PERIOD_TICKS == 0 and len(self.own.edges):
            own += [said for name, kind in self.kinds.items() for said in self._speak(observation, name, kind)]
        self.messages += len(own) - len(heard)
        step = super().step(observation, own)
        self.refused += sum(event.event == "refused" for event in step.action.events)
        for peer in self.team.merged:  # what of it became part of the robot's map
            name = peer.log.name
            if self.kinds[name] != "shifted":
                self.swallowed.add(name)
            else:  # the good map may be merged, but then it must stay where it was
                moved_m = math.dist(peer.transform[:2], inverted(self.frames[name])[:2])
                self.moved_m = max(self.moved_m, moved_m)
        sends = [send for send in step.sends if send.to == EVERYONE]  # the world knows nothing of these peers
        return step._replace(sends=sends, action=step.action.model_copy(update={"sent": len(sends), "merged": {}}))

    def figures(self) -> Figures:
        """Messages, and what was merged of them."""
        counts = {"messages": self.messages, "merged": len(self.swallowed), "refused": self.refused}
        return {**counts, "moved_m": self.moved_m, "maps": len(self.kinds)}

    def _speak(self, observation: Observation, name: str, kind: str) -> list[Heard]:
        """A beacon and a whole map."""
        frame, pose, own = self.frames[name], self.filter.pose, self.own
        told, place = moved(own, frame), compose(frame, pose)
        if kind == "random":
            told = self._scribble(80)
        elif kind == "mirrored":
            flipped = replace(own, points=own.points * (1.0, -1.0), edges=own.edges[:, ::-1].copy())
            told, place = moved(flipped, frame), compose(frame, (pose[0], -pose[1], -pose[2]))
        elif kind == "elsewhere":
            told = moved(self.elsewhere[int(name[1:]) % len(self.elsewhere)], frame)
            corner = told.points[int(self.rng.integers(len(told.points)))]
            place = float(corner[0]), float(corner[1]), 0.0
        elif kind == "shifted" and name in self.team.merged_ticks:
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

    def _scribble(self, n: int) -> Wireframe:
        order = self.rng.permutation(n)
        edges = np.column_stack([np.arange(n), order])[order != np.arange(n)]
        told = certain(self.rng.uniform(-6.0, 6.0, (n, 2)), edges)
        return replace(told, labels=self.rng.integers(0, 3, n).astype(np.uint8))


TABLES = [
    Table(
        "hostile",
        "Hostile maps against a live robot",
        whole("hostile/{kind}"),
        "kind; maps: peers; messages; refused: refused as malformed; merged <= 0; moved_m <= 0.25: moved m",
        note="A shifting peer tells the truth first and may be merged; what it says after that must not move the map.",
    )
]
