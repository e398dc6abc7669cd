"""The map of one robot: a weighted set of whole wireframes, the particles (paper III-B; equations ours)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import CornerScan, Sight
from agent.geometry.chains import chained
from agent.geometry.matrix3 import lower_root, times
from agent.kernels import kernel
from agent.mapping.association import Gates, associate, uncertain
from agent.mapping.config import FilterConfig, MapConfig
from agent.mapping.contradiction import ViewRules, contradict, patient_view
from agent.mapping.edges import EDGE, OCCLUSION, WALL, Edges
from agent.mapping.layers import Layer, merge_gates, merged
from agent.mapping.likelihood import Odds, log_likelihood
from agent.mapping.pose_correction import correct_pose, motion_covariance
from agent.mapping.scan_merge import MergeRules, main_axis, merge_scan, patient_merge, to_map_frame
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, relative
from protocol.messages import OdometrySpec
from protocol.wireframe import Wireframe

SPARE = 64
"""Free records that a particle keeps for one scan; a scan of 360 beams has at most 120 pieces, in practice 20."""
MAX_WALLS = 4096
"""A particle takes no new wall beyond; ten times what the largest layout has."""


class Compass(NamedTuple):
    """What holds a pose beside covariances, as plain numbers for the kernel (agent.config.FilterConfig says why)."""

    axis_sd: float
    trust: float
    floor_m: float
    floor_rad: float


FORGET = 0.98
"""Share of its past log-weight that a particle's standing keeps per scan: the map is the best of the last 50 scans."""


@kernel
def update_particles(
    edges: Edges,
    counts: NDArray[np.int64],
    poses: Floats,
    covariances: Floats,
    raw: NDArray[np.void],
    sight: Sight,
    noisy: bool,
    dice: Floats,
    patience: Floats,
    gates: Gates,
    rules: MergeRules,
    views: ViewRules,
    odds: Odds,
    compass: Compass,
) -> Floats:
    """One scan into every particle: associate, correct the pose, weigh, merge, contradict.

    edges (p, e), counts (p,), poses (p, 3) and covariances (p, 3, 3) are updated in place. dice: (p, 2, k + 3), for
    each particle a row for association and one for insertion, and standard normals for the pose at the end of the
    first. patience: (p,) factor of each particle's own. Returns the scan's log-likelihoods (p,).
    """
    k = len(raw)
    scores = np.empty(len(counts))
    for p in range(len(counts)):
        pose = (poses[p, 0], poses[p, 1], poses[p, 2])
        if noisy:
            gates = uncertain(gates, covariances[p])
            axis, trust = main_axis(edges[p], counts[p])
            walls = associate(edges[p], counts[p], to_map_frame(raw, pose), gates, dice[p, 0])
            axis_sd = compass.axis_sd if trust > compass.trust else math.inf
            pose, covariances[p] = correct_pose(
                edges[p], raw, walls, pose, covariances[p], axis, axis_sd, compass.floor_m, compass.floor_rad, gates
            )
            shift = times(lower_root(covariances[p]), dice[p, 0, k : k + 3])
            pose = (pose[0] + shift[0], pose[1] + shift[1], pose[2] + shift[2])
            poses[p, 0], poses[p, 1], poses[p, 2] = pose
        pieces = to_map_frame(raw, pose)
        walls = associate(edges[p], counts[p], pieces, gates, dice[p, 0])
        scores[p] = log_likelihood(edges[p], counts[p], pose, raw, pieces, walls, sight, gates, views, odds)
        own_rules, own_views = patient_merge(rules, patience[p]), patient_view(views, patience[p])
        counts[p] = merge_scan(edges[p], counts[p], pieces, walls, dice[p, 1], gates, own_rules, 1)
        counts[p] = contradict(edges[p], counts[p], pose, raw, pieces, walls, sight, own_views)
    return scores


@kernel
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
    """Particles, each a whole wireframe and a pose. The first takes the likeliest decisions, the others sample."""

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
        self.poses = np.zeros((n, 3))
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
        self._rules = MergeRules(
            config.end_margin_m,
            config.patience,
            config.patience_growth,
            config.confirmations,
            math.radians(config.max_direction_sd_deg),
            math.sin(math.radians(config.min_corner_deg)),
            config.close_corner_m,
            config.prolonged_m,
            config.steady,
            config.smear_m,
            config.straight_sigmas,
            config.wall_hits,
            math.radians(config.off_axis_deg),
            math.radians(config.oblique_sd_deg),
            config.axis_trust,
            filter_config.early_wall,
        )
        self._views = ViewRules(
            config.view_step_m,
            max(config.view_margin_m, config.gate_sigmas * noise),
            math.pi / beams,
            config.end_skip_m,
            config.cut_after,
            config.drop_after,
            config.drop_growth,
            config.confirmations,
            config.sure_after,
            config.min_length_m,
        )
        self._compass = Compass(
            math.radians(filter_config.axis_sd_deg),
            filter_config.heading_trust,
            filter_config.wall_floor_m,
            math.radians(filter_config.wall_floor_deg),
        )
        # A particle's patience is a decision, too: drawn once, so that hasty and patient ones compete.
        self._patience = 1 + filter_config.patience_spread * (2 * self._random.random(n) - 1)
        self._patience[0] = 1.0

    def update(self, scan: CornerScan, odometry: Pose) -> None:
        """Merge a corner scan into every particle, weigh and resample them. odometry: pose (m, rad), robot's frame."""
        if self.counts.max() + SPARE > self.edges.shape[1] and self.edges.shape[1] < MAX_WALLS:
            grown = np.zeros((len(self.edges), 2 * self.edges.shape[1]), EDGE)
            grown[:, : self.edges.shape[1]] = self.edges
            self.edges = grown
        by = relative(self._odometry, odometry) if self._odometry is not None else (0.0, 0.0, 0.0)
        self._odometry = odometry
        if self._noisy:
            for p, pose in enumerate(self.poses):
                before = (float(pose[0]), float(pose[1]), float(pose[2]))
                self.covariances[p] = motion_covariance(self.covariances[p], before, by, self._odometry_noise)
                self.covariances[p] += 1e-8 * np.eye(3)  # never singular
                self.poses[p] = compose(before, by)
        else:
            self.poses[:] = odometry
        scores = update_particles(
            self.edges,
            self.counts,
            self.poses,
            self.covariances,
            scan.pieces,
            scan.sight,
            self._noisy,
            self._throw_dice(len(scan.pieces)),
            self._patience,
            self._gates,
            self._rules,
            self._views,
            self._odds,
            self._compass,
        )
        self._weigh(scores)

    def _throw_dice(self, k: int) -> Floats:
        """(p, 2, k + 3) dice of one scan, each particle's from its own generator; the first takes the likelier side."""
        dice = np.zeros((len(self._dice), 2, k + 3))
        dice[0, 1] = 0.5
        for p in range(1, len(dice)):
            self._dice[p].random(out=dice[p])
            if self._noisy:
                dice[p, 0, k:] = self._dice[p].standard_normal(3)
        return dice

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
        x, y, theta = self.poses[self.best].tolist()
        return x, y, theta

    def predicted(self, odometry: Pose) -> Pose:
        """Where the best particle would be at this odometry, before a scan corrects it."""
        return compose(self.pose, relative(self._odometry, odometry)) if self._odometry is not None else odometry

    @property
    def nbytes(self) -> int:
        """Bytes that the particles need."""
        return int(self.counts.sum()) * EDGE.itemsize + self.covariances.nbytes + self.poses.nbytes

    def wireframe(self) -> Wireframe:
        """The maximum-likelihood particle as a wireframe in the robot's own frame."""
        return wireframe_of(self.edges[self.best, : self.counts[self.best]], self.config.publish_after)

    def wireframe_with(self, layers: Sequence[Layer], offset_m: float) -> Wireframe:
        """The same with received maps laid over it; offset_m: how far their walls may lie beside own ones."""
        own, gates = self.edges[self.best, : self.counts[self.best]], merge_gates(self._gates, offset_m)
        publish_after = self.config.publish_after
        return wireframe_of(merged(own, layers, gates, self._rules, publish_after), publish_after)

    def view_rules(self, margin_m: float) -> ViewRules:
        """How scans are held against walls that are known to this precision, metres."""
        return self._views._replace(margin=margin_m)


def wireframe_of(edges: Edges, publish_after: float) -> Wireframe:
    """Walls that enough scans have hit, as a wireframe; walls that share a corner share a vertex."""
    return Wireframe(*_published(edges, publish_after))


@kernel
def _published(
    edges: Edges, publish_after: float
) -> tuple[Floats, NDArray[np.uint8], NDArray[np.int32], NDArray[np.float32], NDArray[np.bool_]]:
    """The arrays of that wireframe, in the order of its fields."""
    place = np.full(len(edges), -1)
    m = 0
    for k in range(len(edges)):
        if edges[k].alive == WALL and edges[k].seen >= publish_after:
            place[k] = m
            m += 1
    tips, labels, following = np.empty((m, 2, 2)), np.empty((m, 2), np.uint8), np.empty(m, np.int64)
    likelihood, own = np.empty(m, np.float32), np.empty(m, np.bool_)
    for k in range(len(edges)):
        w = place[k]
        if w < 0:
            continue
        e = edges[k]
        for side in range(2):
            tips[w, side, 0], tips[w, side, 1] = e.tip[side, 0], e.tip[side, 1]
            lonely = e.link[side] >= 0 and place[e.link[side]] < 0  # its partner is not shown yet
            labels[w, side] = OCCLUSION if lonely else e.label[side]
        following[w] = place[e.link[1]] if e.link[1] >= 0 else -1
        likelihood[w] = min(max((e.seen + 1.0) / (e.due + 2.0), 0.0), 1.0)
        own[w] = e.own == 1
    points, names, chains = chained(tips, labels, following)
    return points, names, chains, likelihood, own
