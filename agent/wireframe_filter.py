"""The map of one robot: a weighted set of whole wireframes, the particles (paper III-B; equations ours)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agent.association import Gates, associate
from agent.config import FilterConfig, MapConfig
from agent.contradiction import ViewRules, contradict
from agent.corner_scan import CornerScan
from agent.edges import EDGE, OCCLUSION, Edges
from agent.likelihood import Odds, log_likelihood
from agent.matrix3 import lower_root, times
from agent.pose_correction import correct_pose, motion_covariance, moved
from agent.scan_merge import MergeRules, main_axis, merge_scan, to_map_frame
from protocol.messages import OdometrySpec
from protocol.wireframe import Wireframe

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]

SPARE = 64
"""Free records that a particle keeps for one scan; a scan of 360 beams has at most 120 pieces, in practice 20."""
MAX_WALLS = 4096
"""A particle takes no new wall beyond; ten times what the largest layout has."""
FORGET = 0.98
"""Share of its past log-weight that a particle's standing keeps per scan: the map is the best of the last 50 scans."""


@njit(cache=True)
def update_particle(
    edges: Edges,
    count: int,
    raw: NDArray[np.void],
    opened: Floats,
    reach: float,
    pose: tuple[float, float, float],
    covariance: Floats,
    noisy: bool,
    dice: Floats,
    gates: Gates,
    rules: MergeRules,
    views: ViewRules,
    odds: Odds,
    axis_sd: float,
    heading_trust: float,
    floor_m: float,
    floor_rad: float,
) -> tuple[int, float, tuple[float, float, float], Floats]:
    """One scan into one particle: associate, correct the pose, weigh, merge, contradict.

    dice: (2, k + 3), a row for association and one for insertion, and standard normals for the pose at the end of
    the first. Returns the particle's count of records, the scan's log-likelihood, the pose and its covariance.
    """
    k = len(raw)
    if noisy:
        gates = Gates(
            gates.noise,
            gates.sigmas,
            gates.offset,
            gates.angle,
            gates.bridge,
            math.sqrt(max(covariance[0, 0], covariance[1, 1])),
            math.sqrt(covariance[2, 2]),
        )
        axis, trust = main_axis(edges, count)
        walls = associate(edges, count, to_map_frame(raw, pose), gates, dice[0])
        axis_sd = axis_sd if trust > heading_trust else math.inf
        pose, covariance = correct_pose(edges, raw, walls, pose, covariance, axis, axis_sd, floor_m, floor_rad, gates)
        shift = times(lower_root(covariance), dice[0, k : k + 3])
        pose = (pose[0] + shift[0], pose[1] + shift[1], pose[2] + shift[2])
    pieces = to_map_frame(raw, pose)
    walls = associate(edges, count, pieces, gates, dice[0])
    weight = log_likelihood(edges, count, pose, raw, pieces, walls, opened, reach, gates, views, odds)
    count = merge_scan(edges, count, pieces, walls, dice[1], gates, rules)
    return contradict(edges, count, pose, raw, pieces, walls, opened, reach, views), weight, pose, covariance


@njit(cache=True)
def systematic(weights: Floats, offset: float) -> NDArray[np.int64]:
    """Systematic resampling: (n,) ancestors of (n,) normalised weights, from one offset in [0, 1)."""
    n = len(weights)
    out = np.empty(n, np.int64)
    total, j = weights[0], 0
    for k in range(n):
        while total < (k + offset) / n and j < n - 1:
            j += 1
            total += weights[j]
        out[k] = j
    return out


class WireframeFilter:
    """Particles, each a whole wireframe and a pose. The first makes the likeliest decisions, the others sample theirs."""

    def __init__(
        self,
        config: MapConfig,
        filter_config: FilterConfig,
        noise: float,
        beams: int,
        odometry: OdometrySpec,
        seed: int | np.random.SeedSequence,
    ) -> None:
        """noise: m, standard deviation of a range; beams: of a full turn."""
        n = filter_config.particles
        self.config = config
        self.filter_config = filter_config
        sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        own, *children = sequence.spawn(n + 1)
        self._random = np.random.default_rng(own)
        self._dice = [np.random.default_rng(child) for child in children]
        self.edges: Edges = np.zeros((n, 4 * SPARE), EDGE)
        self.counts = np.zeros(n, np.int64)
        self.log_weights = np.zeros(n)
        self.standing = np.zeros(n)
        self.best = 0
        self._odometry: Pose | None = None
        self._odometry_noise = np.array(
            [odometry.distance_sd, math.radians(odometry.heading_sd_deg), odometry.turn_sd], np.float64
        )
        self._noisy = odometry.noisy and filter_config.correct_pose
        self.poses: list[Pose] = [(0.0, 0.0, 0.0)] * n
        self.covariances = np.zeros((n, 3, 3))
        self._gates = Gates(
            noise,
            config.gate_sigmas,
            config.offset_gate_m,
            math.radians(config.angle_gate_deg),
            config.bridge_m,
            0.0,
            0.0,
        )
        self._odds = Odds(
            filter_config.match_odds,
            filter_config.extra_odds,
            filter_config.missing_odds,
            filter_config.through_odds,
            filter_config.corner_odds,
            filter_config.label_odds,
        )
        # A particle's patience is a decision, too: drawn once, so that hasty and patient ones compete.
        spread = filter_config.patience_spread * (2 * self._random.random(n) - 1)
        spread[0] = 0.0
        self._rules = [self._merge_rules(1 + float(s)) for s in spread]
        self._views = [self._view_rules(1 + float(s), noise, beams) for s in spread]

    def _merge_rules(self, patience: float) -> MergeRules:
        c = self.config
        return MergeRules(
            c.end_margin_m,
            c.patience * patience,
            c.patience_growth,
            math.radians(c.max_direction_sd_deg),
            math.sin(math.radians(c.min_corner_deg)),
            c.close_corner_m,
            math.radians(c.off_axis_deg),
            c.off_axis_hits,
            c.axis_trust,
            self.filter_config.oblique_wall,
        )

    def _view_rules(self, patience: float, noise: float, beams: int) -> ViewRules:
        c = self.config
        return ViewRules(
            c.view_step_m,
            max(c.view_margin_m, c.gate_sigmas * noise),
            math.pi / beams,
            c.end_skip_m,
            c.cut_after * patience,
            c.drop_after * patience,
            c.drop_growth,
            c.sure_after,
            c.min_length_m,
        )

    def update(self, scan: CornerScan, odometry: Pose) -> None:
        """Merge a corner scan into every particle, weigh and resample them. odometry: pose (m, rad), robot's frame."""
        if self.counts.max() + SPARE > self.edges.shape[1] and self.edges.shape[1] < MAX_WALLS:
            grown = np.zeros((len(self.edges), 2 * self.edges.shape[1]), EDGE)
            grown[:, : self.edges.shape[1]] = self.edges
            self.edges = grown
        by = _between(self._odometry, odometry) if self._odometry is not None else (0.0, 0.0, 0.0)
        self._odometry = odometry
        k = len(scan.pieces)
        c = self.filter_config
        scores = np.empty(len(self.edges))
        for p in range(len(self.edges)):
            dice = np.zeros((2, k + 3))
            dice[1] = 0.5
            if p > 0:
                dice[:, :k] = self._dice[p].random((2, k))
                if self._noisy:
                    dice[0, k:] = self._dice[p].standard_normal(3)
            pose, covariance = odometry, self.covariances[p]
            if self._noisy:
                covariance = motion_covariance(covariance, self.poses[p], by, self._odometry_noise)
                covariance = covariance + np.diag([1e-8, 1e-8, 1e-8])  # never singular
                pose = moved(self.poses[p], by)
            self.counts[p], scores[p], self.poses[p], self.covariances[p] = update_particle(
                self.edges[p],
                int(self.counts[p]),
                scan.pieces,
                scan.open,
                scan.reach,
                pose,
                covariance,
                self._noisy,
                dice,
                self._gates,
                self._rules[p],
                self._views[p],
                self._odds,
                math.radians(c.axis_sd_deg),
                c.heading_trust,
                c.wall_floor_m,
                math.radians(c.wall_floor_deg),
            )
        self._weigh(scores)

    def _weigh(self, scores: Floats) -> None:
        """Weights in the log domain; systematic resampling on effective sample size."""
        gained = self.filter_config.temper * (scores - scores.max())
        self.standing = FORGET * self.standing + gained
        self.log_weights += gained
        self.log_weights -= self.log_weights.max()
        weights = np.exp(self.log_weights)
        weights /= weights.sum()
        if 1.0 / (weights @ weights) < self.filter_config.resample_below * len(weights):
            ancestors = systematic(weights, float(self._random.random()))
            # survivors keep their places, so that only the fallen are copied over
            free = [p for p in range(len(weights)) if p not in ancestors]
            kept: set[int] = set()
            for ancestor in ancestors.tolist():
                if ancestor not in kept:
                    kept.add(ancestor)
                    continue
                p = free.pop()
                n = int(max(self.counts[ancestor], self.counts[p]))
                self.edges[p, :n] = self.edges[ancestor, :n]
                self.counts[p] = self.counts[ancestor]
                self.poses[p] = self.poses[ancestor]
                self.covariances[p] = self.covariances[ancestor]
                self.standing[p] = self.standing[ancestor]
            self.log_weights[:] = 0.0
        self.best = int(np.argmax(self.standing))

    @property
    def pose(self) -> Pose:
        """Pose of the maximum-likelihood particle, in the robot's own frame."""
        return self.poses[self.best]

    @property
    def nbytes(self) -> int:
        """Bytes that the particles need."""
        return int(self.counts.sum()) * EDGE.itemsize + self.covariances.nbytes + 24 * len(self.poses)

    def wireframe(self) -> Wireframe:
        """The maximum-likelihood particle as a wireframe in the robot's own frame."""
        return wireframe_of(self.edges[self.best, : self.counts[self.best]], self.config.publish_after)


def _between(a: Pose, b: Pose) -> Pose:
    """Pose b in the frame a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    turn = b[2] - a[2]
    return c * dx + s * dy, c * dy - s * dx, math.atan2(math.sin(turn), math.cos(turn))


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
