"""Bytes a vertex of robots' own maps: whole ones at the end of a run, partial ones on the way."""

from agent.robot import Robot, Step
from deploy.bench.cases import Case, Figures, each
from deploy.bench.explored import explore
from deploy.bench.layouts import FURNISHED, PLAIN, present
from deploy.bench.tables import Table, columns, over
from protocol.grid_map import main_axis, quantise
from protocol.map_codec import decode_map, encode_map
from protocol.messages import Observation
from protocol.wireframe import Wireframe

EVERY_TICKS = 50  # partial maps are taken every 10 s


def cases(quick: bool) -> list[Case]:
    """One exploration run per layout."""
    return each("codec/{world}", measure_maps, world=["apartment"] if quick else sorted(present(FURNISHED + PLAIN)))


def measure_maps(world: str) -> Figures:
    """Sizes of the maps of one run; each is checked to come back."""
    partial: list[Wireframe] = []

    def watch(robot: Robot, observation: Observation, step: Step) -> None:
        if observation.tick % EVERY_TICKS == 0 and len(robot.wireframe.points):
            partial.append(robot.wireframe)

    run = explore({"world": world, "robots": 1, "seed": 0, "max_time_s": 3600.0}, {}, watch)
    return _sizes("full", [run.robots["r1"].wireframe]) | _sizes("partial", partial)


def _sizes(part: str, maps: list[Wireframe]) -> Figures:
    bare = with_likelihoods = 0
    for wireframe in maps:
        grid_map = quantise(wireframe, 10, main_axis(wireframe))
        coded = encode_map(grid_map)
        if decode_map(coded.data) != coded.map or not coded.map.alike(grid_map):
            raise AssertionError("a map did not come back")
        with_likelihoods += len(coded.data)
        bare += len(encode_map(grid_map, likelihoods=False).data)
    vertices = sum(len(wireframe.points) for wireframe in maps)
    sizes = {"maps": len(maps), "vertices": vertices, "bytes": bare, "with_likelihoods": with_likelihoods}
    return {f"{part}_{key}": size for key, size in sizes.items()}


A_VERTEX = [f"{part}_{size}" for part in ("full", "partial") for size in ("bytes", "with_likelihoods")]
COLUMNS = columns(
    "world; full_vertices total: vertices of the full map; full_bytes <= 2.5: bytes a vertex; "
    "full_with_likelihoods: with likelihoods; partial_vertices total: vertices of partial maps; "
    "partial_bytes <= 3.2: bytes a vertex; partial_with_likelihoods: with likelihoods",
    **{key: over(key, f"{key.partition('_')[0]}_vertices") for key in A_VERTEX},
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
