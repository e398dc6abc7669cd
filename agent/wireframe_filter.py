"""The map of one robot: a set of whole wireframes, the particles (paper III-B)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agent.association import Gates, associate
from agent.config import MapConfig
from agent.contradiction import ViewRules, contradict
from agent.corner_scan import CornerScan
from agent.edges import EDGE, OCCLUSION, Edges
from agent.scan_merge import MergeRules, merge_scan, to_map_frame
from protocol.wireframe import Wireframe

Pose = tuple[float, float, float]

SPARE = 64
"""Free records that a particle keeps for one scan; a scan of 360 beams has at most 120 pieces, in practice 20."""


@njit(cache=True)
def update_particle(
    edges: Edges,
    count: int,
    raw: NDArray[np.void],
    opened: NDArray[np.float64],
    reach: float,
    pose: tuple[float, float, float],
    dice: NDArray[np.float64],
    gates: Gates,
    rules: MergeRules,
    views: ViewRules,
) -> int:
    """One scan into one particle: associate, merge, contradict; returns the particle's new count of records."""
    pieces = to_map_frame(raw, pose)
    walls = associate(edges, count, pieces, gates, dice)
    count = merge_scan(edges, count, pieces, walls, gates, rules)
    return contradict(edges, count, pose, raw, pieces, walls, opened, reach, views)


class WireframeFilter:
    """Particles, each a whole wireframe; for now one, whose decisions are the most likely ones."""

    def __init__(self, config: MapConfig, noise: float, beams: int) -> None:
        """noise: m, standard deviation of a range. beams: of a full turn."""
        self.config = config
        self.edges: Edges = np.zeros((1, 4 * SPARE), EDGE)
        self.counts = np.zeros(1, np.int64)
        self._gates = Gates(
            noise,
            config.gate_sigmas,
            config.offset_gate_m,
            math.radians(config.angle_gate_deg),
            config.bridge_m,
        )
        self._rules = MergeRules(
            config.end_margin_m,
            config.patience,
            config.patience_growth,
            math.radians(config.max_direction_sd_deg),
            math.sin(math.radians(config.min_corner_deg)),
            config.close_corner_m,
            math.radians(config.off_axis_deg),
            config.off_axis_hits,
            config.axis_trust,
        )
        self._views = ViewRules(
            config.view_step_m,
            max(config.view_margin_m, config.gate_sigmas * noise),
            math.pi / beams,
            config.end_skip_m,
            config.cut_after,
            config.drop_after,
            config.drop_growth,
            config.sure_after,
            config.min_length_m,
        )

    def update(self, scan: CornerScan, pose: Pose) -> None:
        """Merge a corner scan seen from a pose (m, rad, map frame) into every particle."""
        if self.counts.max() + SPARE > self.edges.shape[1]:
            grown = np.zeros((len(self.edges), 2 * self.edges.shape[1]), EDGE)
            grown[:, : self.edges.shape[1]] = self.edges
            self.edges = grown
        dice = np.zeros(len(scan.pieces))
        for p in range(len(self.edges)):
            self.counts[p] = update_particle(
                self.edges[p],
                int(self.counts[p]),
                scan.pieces,
                scan.open,
                scan.reach,
                pose,
                dice,
                self._gates,
                self._rules,
                self._views,
            )

    @property
    def nbytes(self) -> int:
        """Bytes that the particles need."""
        return int(self.counts.sum()) * EDGE.itemsize

    def wireframe(self) -> Wireframe:
        """The maximum-likelihood particle as a wireframe in the map's frame."""
        return wireframe_of(self.edges[0, : self.counts[0]], self.config.publish_after)


def wireframe_of(edges: Edges, publish_after: float) -> Wireframe:
    """Walls that enough scans have hit, as a wireframe; walls that share a corner share a vertex."""
    shown = np.flatnonzero((edges["alive"] == 1) & (edges["seen"] >= publish_after))
    place = np.full(len(edges) + 1, -1)
    place[shown] = np.arange(len(shown))
    points = edges["tip"][shown].reshape(-1, 2).astype(np.float64)
    labels = edges["label"][shown].reshape(-1).astype(np.uint8)
    vertex = np.arange(2 * len(shown)).reshape(-1, 2)
    following = edges["link"][shown, 1]
    linked = np.flatnonzero((following >= 0) & (place[following] >= 0))
    vertex[place[following[linked]], 0] = vertex[linked, 1]
    for side in (0, 1):  # a corner whose other wall is not shown yet is an occlusion
        partner = edges["link"][shown, side]
        lonely = (partner >= 0) & (place[partner] < 0)
        labels[2 * np.flatnonzero(lonely) + side] = OCCLUSION
    used, index = np.unique(vertex, return_inverse=True)
    likelihood = (edges["seen"][shown] + 1) / (edges["due"][shown] + 2)
    return Wireframe(
        points[used],
        labels[used],
        index.reshape(-1, 2).astype(np.int32),
        np.clip(likelihood, 0, 1).astype(np.float32),
        edges["own"][shown].astype(np.bool_),
    )
