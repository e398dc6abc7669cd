"""A map made ready to be aligned: features of its corners, an index of its walls, and where a robot can be in it."""

from dataclasses import dataclass
from functools import cached_property

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

    @cached_property
    def free_space(self) -> FreeSpace:
        """Where a robot can be: only candidates are asked that nothing else refuses."""
        found = self.corners
        return free_space_of(found.points, found.parent, found.child, found.walls)


def prepare(wireframe: Wireframe, config: AlignmentConfig) -> PreparedMap | None:
    """A map ready to be aligned; None where it is larger than the configuration allows. Must have passed `check`."""
    if int(wireframe.own.sum()) > config.max_walls:
        return None
    found = corners(wireframe)
    return PreparedMap(found, index_walls(found.walls, found.juts))
