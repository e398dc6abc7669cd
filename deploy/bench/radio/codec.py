"""Bytes a vertex of robots' own maps: whole ones at the end of a run, partial ones on the way."""

from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import explore
from deploy.bench.layouts import FURNISHED, PLAIN, present
from deploy.bench.tables import Runs, Table, columns
from protocol.grid_map import main_axis, quantise
from protocol.map_codec import decode_map, encode_map
from protocol.messages import Observation
from protocol.wireframe import Wireframe

EVERY_TICKS = 50  # partial maps are taken every 10 s


def cases(quick: bool) -> list[Case]:
    """One exploration run per layout."""
    worlds = ["apartment"] if quick else sorted(present(FURNISHED + PLAIN))
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


def _vertices(runs: Runs, key: str) -> int:
    """Vertices of all maps of the part that the key names."""
    return sum(run[key.partition("_")[0]]["vertices"] for run in runs)


def _a_vertex(runs: Runs, key: str) -> float | None:
    """Bytes of all maps of the part that the key names, over their vertices."""
    part, _, size = key.partition("_")
    vertices = _vertices(runs, key)
    return sum(run[part][size] for run in runs) / vertices if vertices else None


COLUMNS = columns(
    "world; full_vertices: vertices of the full map; full_bytes <= 2.5: bytes a vertex; "
    "full_with_likelihoods: with likelihoods; partial_vertices: vertices of partial maps; "
    "partial_bytes <= 3.2: bytes a vertex; partial_with_likelihoods: with likelihoods",
    **{f"{part}_vertices": _vertices for part in ("full", "partial")},
    **{f"{part}_{key}": _a_vertex for part in ("full", "partial") for key in ("bytes", "with_likelihoods")},
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
