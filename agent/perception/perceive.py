"""From a lidar scan to a corner scan (paper II): discs left out, then straight pieces, corners and labels.

Nothing else reads ranges (paper I, "strictly sparse").
"""

import math

import numpy as np

from agent.corner_scan import NOISE_SIGMAS, PIECE, CornerScan, Sight, range_noise
from agent.geometry.clearance import distances_to_walls
from agent.kernels import kernel
from agent.perception.config import Method, PerceptionConfig
from agent.perception.disc_memory import Posts, SeenDiscs
from agent.perception.discs import beams_on, find_discs, hidden_beams
from agent.perception.pieces import Beams, pieces_of
from agent.perception.segmentation import MIN_HITS, piecewise
from agent.perception.split_and_merge import split_and_merge
from protocol.arrays import Bools, Floats
from protocol.geometry import Pose, apply, seen_from
from protocol.messages import Observation, RobotSpec
from protocol.walls import lengths
from protocol.wireframe import Wireframe

OPEN_BEAMS = 3  # silent beams in a row that show free space: fewer may have dropped out
IN_WALL_M = 0.08  # a disc centred this near to a known wall is that wall's end: a teammate's centre is a radius away
DISC_MARGIN_M = 0.05  # a beam this near to where a teammate was a moment ago is on it: 5 standard deviations of a range
WALL_M = 0.3  # no teammate stands in a mapped wall, unless the wall is shorter: it may be the teammate's front
NOTHING = np.zeros((0, 4))


class Perception:
    """Turns observations into corner scans, and remembers teammates of the last scans and posts."""

    def __init__(self, config: PerceptionConfig, spec: RobotSpec) -> None:
        self._method, self._spec = config.method, spec
        self._seen_discs, self._posts = SeenDiscs(spec), Posts(spec)
        self._map = Wireframe()
        self._walls = np.zeros((0, 4))  # (m, 4) walls of that map in which no teammate stands, metres

    def see(self, observation: Observation, predicted: Pose, own: Wireframe) -> CornerScan:
        """Corner scan of an observation. predicted: the robot's pose in the frame of its own map, before correction."""
        if own is not self._map:
            walls = own.segments()
            self._map, self._walls = own, walls[lengths(walls) >= WALL_M]
        scan = perceive(
            observation.scan(),
            self._spec,
            self._method,
            expected=self._seen_discs.expected(observation.odometry),
            known=seen_from(predicted, self._walls.reshape(-1, 2)).reshape(-1, 4),
            posts=self._posts.seen_from(predicted),
        )
        self._seen_discs.add(observation.odometry, scan.discs)
        return scan

    def remember(self, tick: int, pose: Pose, scan: CornerScan, heard: bool) -> None:
        """Note where a scan's discs are, once the pose is corrected; heard: whether any message came in this tick."""
        self._posts.add(tick, pose, apply(pose, scan.discs), heard)


def perceive(
    ranges: Floats,
    spec: RobotSpec,
    method: Method = "piecewise",
    *,
    expected: Floats = NOTHING,
    known: Floats = NOTHING,
    posts: Floats = NOTHING,
) -> CornerScan:
    """Corner scan of a full turn.

    ranges: (beams,) float64 metres, inf where nothing came back. Anything else that is no positive number is
    treated as silent. expected: (k, 3) metres, teammates seen a moment ago, centre and slack. known: (m, 4) metres,
    walls of the map, in which no teammate stands. posts: (p, 2) metres, what is round and no teammate. All in the
    robot's frame.
    """
    lidar, radius = spec.lidar, spec.radius_m
    ranges = np.where(np.isfinite(ranges) & (ranges > 0) & (ranges <= lidar.range_max_m + 1.0), ranges, np.inf)
    noise, n = range_noise(lidar), len(ranges)
    discs = find_discs(ranges, radius, noise)
    discs = discs[distances_to_walls(discs, known) > IN_WALL_M]
    if len(posts) and len(discs):
        discs = discs[np.hypot(*(discs[:, None] - posts).transpose(2, 0, 1)).min(1) > radius]
    hidden = hidden_beams(n, discs, radius) | beams_on(ranges, expected, radius, DISC_MARGIN_M)
    returned = np.isfinite(ranges)
    used = np.flatnonzero(returned & ~hidden)
    pieces, unexplained = np.zeros(0, PIECE), returned
    if len(used) >= MIN_HITS:
        cut = piecewise if method == "piecewise" else split_and_merge
        step = 2 * math.pi / n
        cuts, sums = cut(ranges[used], np.multiply(used, step, dtype=np.float64), noise)
        silence = 1 if lidar.dropout == 0 else 2  # one may have dropped out, two in a row went through
        turn = Beams(ranges, hidden, used, step, noise, lidar.range_max_m, silence)
        pieces, explained = pieces_of(turn, cuts, sums)
        unexplained = (returned | hidden) & ~explained
    free, blind = _sectors(~returned & ~hidden, OPEN_BEAMS), _sectors(unexplained, 1)
    return CornerScan(pieces, Sight(free, blind, lidar.range_max_m - NOISE_SIGMAS * noise, math.pi / n), discs)


@kernel
def _sectors(marked: Bools, least: int) -> Floats:
    """(s, 2) rad: runs of at least so many marked beams of a full turn."""
    n, unmarked = len(marked), np.flatnonzero(~marked)
    step = 2 * math.pi / n
    if len(unmarked) == 0:
        return np.array([[0.0, 2 * math.pi]])
    out, count, run = np.empty((n, 2)), 0, 0
    for k in range(unmarked[0], unmarked[0] + n + 1):
        if marked[k % n]:
            run += 1
            continue
        if run >= least:
            out[count, 0], out[count, 1] = (k - run) * step, (k - 1) * step
            count += 1
        run = 0
    return out[:count].copy()
