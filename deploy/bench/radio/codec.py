"""Bytes a vertex of robots' own maps: whole ones at the end of a run, partial ones on the way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agent.robot import Robot, Step
from deploy.bench.bars import Column, Section
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from deploy.bench.layouts import present
from protocol.grid_map import main_axis, quantise
from protocol.map_codec import decode_map, encode_map
from protocol.messages import Observation
from protocol.wireframe import Wireframe

SHARED = [
    "drlnav_house_tomas", "drlnav_stage7", "gbeltramo_building", "hurtado_apartment", "pal_home_w",
    "pal_passage_110cm_w", "tb3_dqn_stage4", "uday_building",
]  # fmt: skip
EVERY_TICKS = 50
"""Partial maps are taken every 10 s."""


def cases(quick: bool) -> list[Case]:
    """One exploration run per layout."""
    worlds = ["apartment"] if quick else present(SHARED)
    return [Case(f"codec/{world}", measure_maps, {"world": world}) for world in worlds]


def measure_maps(world: str) -> Figures:
    """Sizes of the maps of one run; each is checked to come back."""
    partial: list[Wireframe] = []

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        if observation.tick % EVERY_TICKS == 0 and len(robot.wireframe.points):
            partial.append(robot.wireframe)

    run = explore({"world": world, "robots": 1, "seed": 0, "max_time_s": 3600.0}, {}, watch)
    return {"full": _sizes([run.robots["r1"].wireframe]), "partial": _sizes(partial)}


def _sizes(maps: list[Wireframe]) -> dict[str, int]:
    bare = with_likelihoods = 0
    for wireframe in maps:
        grid_map = quantise(wireframe, 10, main_axis(wireframe))
        coded = encode_map(grid_map)
        if decode_map(coded.data) != coded.map or not coded.map.alike(grid_map):
            raise AssertionError("a map did not come back")
        with_likelihoods += len(coded.data)
        bare += len(encode_map(grid_map, likelihoods=False).data)
    vertices = sum(len(wireframe.points) for wireframe in maps)
    return {"maps": len(maps), "vertices": vertices, "bytes": bare, "with_likelihoods": with_likelihoods}


def sections(figures: Mapping[str, Figures]) -> list[Section]:
    """Bytes a vertex, header included, per layout and pooled."""
    found = {name.removeprefix("codec/"): one for name, one in figures.items() if name.startswith("codec/")}
    rows: list[dict[str, Any]] = []
    for world, parts in [*found.items(), ("all pooled", None)]:
        row: dict[str, Any] = {"world": world}
        for part in ("full", "partial"):
            counted = [one[part] for one in (found.values() if parts is None else [parts])]
            vertices = sum(one["vertices"] for one in counted)
            for key in ("bytes", "with_likelihoods"):
                row[f"{part}_{key}"] = sum(one[key] for one in counted) / vertices if vertices else None
            row[f"{part}_vertices"] = vertices
        rows.append(row)
    columns = [
        Column("world", "world"),
        Column("full_vertices", "vertices of\nthe full map"),
        Column("full_bytes", "bytes a vertex", at_most=2.5),
        Column("full_with_likelihoods", "with\nlikelihoods"),
        Column("partial_vertices", "vertices of\npartial maps"),
        Column("partial_bytes", "bytes a vertex", at_most=3.2),
        Column("partial_with_likelihoods", "with\nlikelihoods"),
    ]
    note = "Robots' own maps, quantised to 1 cm, header included."
    return [Section("codec", "Codec", columns, rows if found else [], frozenset(range(len(found))), note)]
