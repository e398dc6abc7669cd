"""Loops of a robot that drives: where its wireframe is torn, it is merged anew from submaps (ours).

The filter's walls anchor it better than submaps would, as long as they fit each other. So submaps follow beside it, and
take over only when a loop finds a place somewhere else than the filter has it.
"""

import math

import numpy as np

from agent.corner_scan import CornerScan
from agent.mapping.config import SubmapConfig
from agent.mapping.submaps.chain import MERGE_AFTER_M, SKIPPED, Submaps, travelled
from agent.mapping.submaps.loops import RIVAL_SCORE, on_walls
from agent.mapping.submaps.matching import tiles_of
from agent.mapping.submaps.segments import moved
from agent.mapping.submaps.settled import Settled
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, inverted, pose_of, relative, wrapped

TORN_M = 0.15  # between where a loop and the filter have a submap; matches of submaps err by 0.05 m
TORN_RAD = math.radians(3.0)
LOST_SIGMAS = 10.0
"""How far a loop may have a place from where the filter has it, in deviations of what the filter knows of it. A robot
in `hall` that knew its place to 8 mm was put 2.4 m aside, by two loops among like columns that agreed."""
TORN_SIGMAS = 5.0  # by the loop's own information
HELD_SIGMAS = 3.0
"""Deviations of loop and filter together up to which a loop may be off, and say nothing against the map: the filter's
own gates still take the walls there, and so it closes the loop itself, with all that it knows. Rings of 60 m a side,
wheels twice as bad: 5 settlings of 4 runs came after that, and maps that were right to 23 to 66 mm became 35 to 100."""
HEADING_SIGMAS = 3.0
"""How far a loop may turn a submap from the filter's heading when it began, in that heading's deviations, and say
nothing against the map. The heading errs from scan to scan, the walls that the filter has placed do not: a map in
`hall`, exact to 6 mm, was given up for two loops that were 4 degrees off such a heading."""


class LoopClosing:
    """Submaps that follow a robot, and where its filter had it at the begin of each."""

    def __init__(self, config: SubmapConfig, view: tuple[float, float]) -> None:
        """view: rad, as of `LidarSpec.view`."""
        self.submaps = Submaps(config, view)
        self._frames: list[Pose] = []  # of the submaps, by the filter
        self._begins: list[int] = []  # ticks at which they began
        self._sds: list[Floats] = []  # (3,) how well it knew each: m, m, rad
        self._against: list[tuple[int, int, Pose]] = []
        """Loops against the filter: both submaps, and the motion of the filter's frame that the loop asks for."""
        self._judged = 0  # loops of the submaps
        self._by: Pose = (0.0, 0.0, 0.0)  # the motion since the last scan that submaps have taken

    def take(self, tick: int, scan: CornerScan, by: Pose, scale: float, pose: Pose, covariance: Floats) -> bool:
        """Take a tick's scan; whether a loop shows that the filter's map is torn.

        by: the motion since the last one, in the robot's frame then: the filter's way, its constants of the wheels
        applied. scale: metres of it for a metre that the wheels told. pose: the filter's after the scan, with
        its covariance (3, 3).
        """
        if not self._frames:
            self._begin(tick, pose, covariance)
            return False  # what was driven before led to where the first submap begins
        self._by = compose(self._by, by)
        if travelled(self._by) < MERGE_AFTER_M:
            return False
        submaps = len(self.submaps.poses)
        self.submaps.take(scan, self._by, scale)
        self._by = (0.0, 0.0, 0.0)
        if len(self.submaps.poses) > submaps:
            self._begin(tick, pose, covariance)
        if self.submaps.is_comparing:  # loops found so far are not in the poses yet
            return False
        known, self._judged = self._judged, self.submaps.loops
        return self._torn(known)

    def _begin(self, tick: int, pose: Pose, covariance: Floats) -> None:
        """A submap begins where the filter has the robot, with that pose's covariance (3, 3)."""
        self._begins.append(tick if self._begins else 0)
        self._frames.append(pose)
        self._sds.append(np.sqrt(np.diag(covariance)))

    def _torn(self, known: int) -> bool:
        """Whether any loop after the first `known` agrees with another one that the filter has a place elsewhere.

        One alone may be wrong: halls have the same columns everywhere. Nor are two of one submap two witnesses: where
        its walls are turned in its frame, it says so in each of its loops.
        """
        ends, loops = self.submaps.graph().ends, np.flatnonzero(self.submaps.graph().loop)[known:].tolist()
        for k in filter(self._speaks_against, loops):
            a, b = ends[k].tolist()
            measured = pose_of(self.submaps.graph().measured[k])
            # of the filter's frame, that puts the later submap where the loop has it
            moved_by = compose(compose(self._frames[a], measured), inverted(self._frames[b]))
            at = self._frames[b]
            others = [other for earlier, later, other in self._against if earlier != a and later != b]
            if any(_agree(compose(moved_by, at), compose(other, at)) for other in others):
                return True
            self._against.append((a, b, moved_by))
        return False

    def _speaks_against(self, k: int) -> bool:
        """Whether a loop is not where the filter has it, and cannot be there either. k: its edge in the graph.

        Where it is farther off than the filter can have drifted, or where earlier submaps, all together, show the walls
        of the later one where the filter has it, the loop lies among columns or rooms that are alike.
        """
        graph, finished = self.submaps.graph(), self.submaps.finished
        a, b = graph.ends[k].tolist()
        held, measured = np.array(relative(self._frames[a], self._frames[b])), graph.measured[k]
        off = held - measured
        unsure = HEADING_SIGMAS * math.hypot(self._sds[a][2], self._sds[b][2])
        turn = wrapped(float(off[2]))
        off[2] = math.copysign(max(abs(turn) - unsure, 0.0), turn)
        if _is_small(off) or off @ graph.information[k] @ off < TORN_SIGMAS**2:  # along a corridor a loop says nothing
            return False
        known_m = self._known_to_m(a, b)
        if math.hypot(off[0], off[1]) > LOST_SIGMAS * known_m or _explains(known_m, off, graph.information[k]):
            return False
        at, samples = self._frames[b], finished[b].samples
        known = np.zeros(len(samples), np.bool_)
        for place, frame in zip(finished[: b - SKIPPED], self._frames, strict=False):
            known |= on_walls(tiles_of(place.walls), samples, np.array(relative(frame, at)))
        return bool(known.sum() < RIVAL_SCORE * on_walls(tiles_of(finished[a].walls), samples, measured).sum())

    def _known_to_m(self, a: int, b: int) -> float:
        """Standard deviation, in metres, of where the filter has submap b in the frame of submap a."""
        one, other = self._sds[a], self._sds[b]
        lever = math.dist(self._frames[a][:2], self._frames[b][:2])
        return math.hypot(one[0], one[1], other[0], other[1], lever * one[2])

    def settled(self) -> Settled:
        """The map and the pose by the submaps, in the filter's frame, which the submaps hold from now on."""
        start, torn = self._frames[0], self._frames
        self._against = []
        self._frames = [compose(start, pose) for pose in map(pose_of, self.submaps.poses)]
        by = [compose(new, inverted(old)) for old, new in zip(torn, self._frames, strict=True)]
        walls = moved(self.submaps.walls(), np.array(start))
        return Settled(walls, compose(start, self.submaps.pose), np.array(self._begins, np.int64), np.array(by))


def _explains(known_m: float, off: Floats, information: Floats) -> bool:
    """Whether a place known to so many metres, its standard deviation, explains that a loop is off by so much, (3,).

    information: (3, 3) of the loop, which tells nothing along a corridor.
    """
    both = np.linalg.solve(np.eye(3) + information * (known_m**2, known_m**2, 0.0), information)
    return bool(off @ both @ off < HELD_SIGMAS**2)


def _agree(one: Pose, other: Pose) -> bool:
    """Whether two poses are nearer to each other than a tear is wide."""
    return _is_small(np.subtract(one, other))


def _is_small(off: Floats) -> bool:
    """Whether a motion (3,), metres and rad, is less than a tear."""
    return math.hypot(off[0], off[1]) < TORN_M and abs(wrapped(float(off[2]))) < TORN_RAD
