"""Bytes a vertex of robots' own maps: whole ones at the end of a run, partial ones on the way."""

from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import explore
from deploy.bench.layouts import present
from deploy.bench.tables import Reduce, Runs, Table, columns, total
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
    return each("codec/{world}", measure_maps, world=worlds)


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


PARTS = ("full", "partial")


def _a_vertex(part: str, key: str) -> Reduce:
    """Bytes of all maps over their vertices."""

    def bytes_a_vertex(runs: Runs, _: str) -> float | None:
        parts = [run[part] for run in runs]
        vertices = total(parts, "vertices")
        return total(parts, key) / vertices if vertices else None

    return bytes_a_vertex


def _vertices(part: str) -> Reduce:
    return lambda runs, _: sum(run[part]["vertices"] for run in runs)


COLUMNS = columns(
    "world; full_vertices: vertices of the full map; full_bytes <= 2.5: bytes a vertex; "
    "full_with_likelihoods: with likelihoods; partial_vertices: vertices of partial maps; "
    "partial_bytes <= 3.2: bytes a vertex; partial_with_likelihoods: with likelihoods",
    **{f"{part}_vertices": _vertices(part) for part in PARTS},
    **{f"{part}_{key}": _a_vertex(part, key) for part in PARTS for key in ("bytes", "with_likelihoods")},
)
TABLES = [
    Table(
        "codec",
        "Codec",
        "codec/{world}",
        COLUMNS,
        total="all pooled",
        judged=lambda row: row["world"] == "all pooled",
        note="Robots' own maps, quantised to 1 cm, header included.",
    )
]
