"""What is left of a scan after perception: wall pieces, sectors and teammates' discs, in the robot's frame.

Nothing after perception sees a range (paper I: strict adherence to sparsity).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agent.geometry.chains import chained
from agent.geometry.lines import Record, placed
from agent.kernels import kernel, shared_kernel
from protocol.arrays import Floats, Records
from protocol.geometry import Pose
from protocol.messages import LidarSpec
from protocol.wireframe import Label, Wireframe

NOMINAL, OCCLUSION, FRONTIER = int(Label.NOMINAL), int(Label.OCCLUSION), int(Label.FRONTIER)
"""Labels as kernels and records hold them."""
NOISE_SIGMAS = 3.5  # standard deviations by which noise may part a measurement from its prediction: 0.9995 of the noise
NOISE_FLOOR_M = 0.003  # least standard deviation of a range: real walls are not flatter, whatever the lidar promises
CUT_SIGMAS = 2.0  # deviations before the lidar's range from which it cuts off what noise has not shortened
BRIDGE_M = 0.25  # two hits on one line farther apart along it do not show that there is wall between them
STILL_M = 0.06  # a disc that moved by no more is still: its spread from scan to scan; a teammate drives so far in 0.3 s
TELLING_HITS = 1.0
"""Pieces with fewer hits than this, as PIECE counts them, tell of no ends, but for corners that they share with pieces
of more. Every sixth end of such a piece is none, and the others are off by the distance of two beams."""

START_TOLERANCE = 1e-3  # m and rad by which the odometry of a robot that has not moved differs from zero at most

PIECE = np.dtype(
    [
        ("hits", "f8"),  # beams on the piece; one that is noisier than a near one counts less, by its variance
        ("x", "f8"),  # m, centroid of the hits, on the fitted line
        ("y", "f8"),
        ("ux", "f8"),  # unit direction, counter-clockwise: free space on the left
        ("uy", "f8"),
        ("spread", "f8"),  # m2, sum of squared distances of the hits from the centroid along the line
        ("residual", "f8"),  # m2, the same across it: how well the hits fit the line
        ("bend", "f8", (2,)),  # m3, m4: of the parabola through the hits; by how much it bends back is their ratio, 1/m
        ("end", "f8", (2,)),  # m along the line from the centroid: tail (< 0) and head (> 0)
        ("slack", "f8", (2,)),  # m by which an occlusion end may lie farther out
        ("face", "f8", (2,)),  # m by which it may lie farther in, where the last hits may be on a small face beyond it
        ("gap", "f8", (2,)),  # m from the last hit to a nominal end: the line is prolonged so far to its corner
        ("apart", "f8", (2,)),  # m between two beams there, if a slot before the corner would show by its gap; else 0
        ("stray", "i8", (2,)),  # 1 where noise may have made an occlusion end, as the wall goes on behind one beam
        ("label", "i8", (2,)),  # Label of tail and head
        ("link", "i8", (2,)),  # the piece that shares the corner at tail and head, or -1
        ("moment", "f8"),  # when the hits were taken, on average: 0 at the start of the revolution, 1 at the stamp
        ("bearing", "f8", (2,)),  # rad, of the first and the last beam, rising; the last may exceed 2 pi
    ],
    align=True,
)
"""One wall piece of a corner scan. An aligned record, so that numba reads its fields like attributes."""


class Sight(NamedTuple):
    """What a scan shows beside walls, for the kernels."""

    open: Floats  # (s, 3) sectors without anything within reach: from and to, rad (to may exceed 2 pi), and inf
    blind: Floats
    """(b, 3) sectors with hits on no piece, such as a teammate or a post, or without measurements: from and to as in
    `open`, and how near the nearest hit is, m; 0 where nothing was measured."""
    reach: float  # m, how far open sectors are known to be free
    half_beam: float  # half the angle between two beams, rad: the edges of sectors and pieces are uncertain by this
    shift: float  # m, by which the lidar moved in the revolution: seen from the stamp, edges are uncertain by this, too


@dataclass(frozen=True, slots=True, eq=False)
class CornerScan:
    """A scan as corners and walls."""

    pieces: Records  # (k,) of PIECE, by rising bearing of the first beam
    sight: Sight  # open and blind sectors
    discs: Floats  # (d, 2) m, centres of teammates
    close: Floats  # (c, 3) sectors as in Sight of what stands close to the body and is neither piece nor disc
    touching: bool = False  # whether something is so near that the body may touch it: its wheels may have slipped
    median_of: int = 0
    """Where a robot whose wheels err has not moved yet: of how many scans, from its start, this one is the median."""

    def wireframe(self) -> Wireframe:
        """The scan as a wireframe in the robot's frame; pieces that share a corner share a vertex."""
        p = self.pieces
        tips = np.empty((len(p), 2, 2))
        tips[:, :, 0] = p["x"][:, None] + p["end"] * p["ux"][:, None]
        tips[:, :, 1] = p["y"][:, None] + p["end"] * p["uy"][:, None]
        following = np.where(p["label"][:, 1] == NOMINAL, p["link"][:, 1], -1)
        points, labels, edges = chained(tips, p["label"].astype(np.uint8), following)
        return Wireframe(points, labels, edges, np.ones(len(p), np.float32), np.ones(len(p), np.bool_))


def range_noise(spec: LidarSpec) -> float:
    """Standard deviation of a near range in metres: the lidar's, or the unevenness of walls where that is larger."""
    return max(spec.noise_m, NOISE_FLOOR_M)


def noise_at(spec: LidarSpec, ranges: Floats) -> Floats:
    """The same of ranges (n,) in metres, as it grows with them."""
    return np.maximum(range_noise(spec), spec.noise_share * ranges)


def at_start(odometry: Floats) -> bool:
    """Whether a robot is where its frame begins, by odometry (3,) since then."""
    return all(abs(part) < START_TOLERANCE for part in odometry)


@kernel
def piece_sd(piece: Record, t: float, noise: float) -> float:
    """Standard deviation of a piece's line across its direction, t metres from its centroid. noise: of a range."""
    return noise * math.sqrt(1.0 / piece.hits + t * t / piece.spread)


@shared_kernel
def to_map_frame(lines: Records, pose: Pose | Floats) -> Records:
    """Pieces or segments (k,) moved from the frame of a pose into that in which it is given; bearings stay the same."""
    out = lines.copy()
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(out)):
        p = out[k]
        p.x, p.y, p.ux, p.uy = placed(p.x, p.y, p.ux, p.uy, pose, c, s)
    return out
