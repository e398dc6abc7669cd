"""A map made ready to be aligned: features of its corners, an index of its walls, and where a robot can be in it."""

from dataclasses import dataclass

from agent.alignment.agreement import Walls, index_walls
from agent.alignment.config import AlignmentConfig
from agent.alignment.feature import Corners, corners
from agent.alignment.free_space import FreeSpace, free_space_of
from protocol.wireframe import Wireframe


@dataclass(frozen=True)
class PreparedMap:
    """What alignment reads of a map. It is worth keeping where the map is aligned with several others."""

    corners: Corners
    walls: Walls
    free_space: FreeSpace


def prepare(wireframe: Wireframe, config: AlignmentConfig) -> PreparedMap | None:
    """A map ready to be aligned; None where it is larger than the configuration allows. Must have passed `check`."""
    if int(wireframe.own.sum()) > config.max_vertices:
        return None
    found = corners(wireframe)
    free_space = free_space_of(found.points, found.parent, found.child, found.walls)
    return PreparedMap(found, index_walls(found.walls, found.juts), free_space)
