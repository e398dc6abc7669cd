"""The map of one robot: a weighted set of whole wireframes, the particles (paper III-B; equations ours)."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import NOISE_SIGMAS, OCCLUSION, CornerScan, Sight, range_noise, to_map_frame
from agent.geometry.chains import chained
from agent.geometry.matrix3 import lower_root, times
from agent.kernels import kernel
from agent.mapping.association import OFFSET_GATE_M, Gates, associate
from agent.mapping.candidates import main_axis
from agent.mapping.config import FilterConfig
from agent.mapping.contradiction import contradict
from agent.mapping.edges import EDGE, PUBLISH_AFTER, WALL, check_records
from agent.mapping.layers import Layer, merged
from agent.mapping.likelihood import log_likelihood
from agent.mapping.pose_correction import AXIS_SD, HEADING_TRUST, Axis, correct_pose, motion_covariance
from agent.mapping.scan_merge import merge_scan
from agent.mapping.views import MARGIN_M, View
from agent.state import State, checked
from protocol.arrays import Bools, Floats, Ints, Labels, Records
from protocol.geometry import Pose, compose, relative
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe

SPARE = 64  # free records of a particle for one scan; 360 beams make at most 120 pieces, in practice 20
MAX_WALLS = 4096  # a particle takes no new wall beyond; ten times what the largest layout has
FORGET = 0.98  # share of its past log-weight that a particle keeps per scan: the map is the best of the last 50
TEMPER = 0.2  # scans in a row share their errors, so each counts only as this part of an independent one
RESAMPLE_BELOW = 0.5  # resample when the effective sample size falls below this share of the particles; the usual half
PATIENCE_SPREAD = 0.5  # a particle's patience, a factor on the scans that change a map, is from 1 - this to 1 + this
COVARIANCE_FLOOR = 1e-8  # m2 and rad2 added to the pose's covariance in each step, so that it is never singular


@kernel
def update_particles(
    edges: Records,
    counts: Ints,
    poses: Floats,
    covariances: Floats,
    raw: Records,
    sight: Sight,
    noise: float,
    dice: Floats,
    patience: Floats,
) -> Floats:
    """One scan into every particle: associate, correct the pose, weigh, merge, contradict.

    edges (p, e), counts (p,), poses (p, 3) and covariances (p, 3, 3) are updated in place. raw (k,): the scan's pieces,
    robot's frame. Poses of covariance 0 are exact. noise: m, standard deviation of a range. dice: (p, 2, k + 3), for
    each particle a row for association and one for insertion, and standard normals for the pose at the end of the
    first. patience: (p,) each particle's own, as a factor. Returns the scan's log-likelihoods (p,), up to a constant.
    """
    scores = np.zeros(len(counts))
    for p in range(len(counts)):
        pose_sd = math.sqrt(max(covariances[p, 0, 0], covariances[p, 1, 1]))
        gates = Gates(noise, OFFSET_GATE_M, pose_sd, math.sqrt(covariances[p, 2, 2]))
        if covariances[p, 0, 0] > 0.0:
            _correct(edges[p], counts[p], poses[p], covariances[p], raw, gates, dice[p, 0])
        pose = (poses[p, 0], poses[p, 1], poses[p, 2])
        view = View(pose, to_map_frame(raw, pose), sight, max(MARGIN_M, NOISE_SIGMAS * noise))
        walls = associate(edges[p], counts[p], view.pieces, gates, dice[p, 0])
        if len(counts) > 1:  # the weight of one alone decides nothing
            scores[p] = log_likelihood(edges[p], counts[p], view, walls, gates)
        counts[p] = merge_scan(edges[p], counts[p], view.pieces, walls, dice[p, 1], gates, patience[p], True)
        counts[p] = contradict(edges[p], counts[p], view, walls, patience[p])
    return scores


@kernel
def _correct(
    edges: Records, count: int, pose: Floats, covariance: Floats, raw: Records, gates: Gates, dice: Floats
) -> None:
    """Correct a particle's pose (3,) and covariance (3, 3) in place by a scan, and draw the pose from the result.

    dice: for the association of the pieces, and three standard normals at the end.
    """
    predicted = (pose[0], pose[1], pose[2])
    angle, trust = main_axis(edges, count)
    walls = associate(edges, count, to_map_frame(raw, predicted), gates, dice)
    axis = Axis(angle, AXIS_SD if trust > HEADING_TRUST else math.inf)
    found, corrected = correct_pose(edges, raw, walls, predicted, covariance, axis, gates.noise)
    shift = times(lower_root(corrected), dice[len(raw) :])
    for i in range(3):
        pose[i] = found[i] + shift[i]
        for j in range(3):
            covariance[i, j] = corrected[i, j]


def systematic(weights: Floats, offset: float) -> Ints:
    """Systematic resampling: (n,) ancestors of (n,) normalised weights, from one offset in [0, 1)."""
    n = len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), (np.arange(n) + offset) / n), n - 1)


class WireframeFilter:
    """Particles, each a whole wireframe and a pose. The first takes the likeliest decisions, the others sample."""

    def __init__(self, config: FilterConfig, spec: RobotSpec, seed: np.random.SeedSequence) -> None:
        """Begin with empty maps, at the origin."""
        n = config.particles
        own, *children = seed.spawn(n + 1)
        self._random = np.random.default_rng(own)
        self._dice = [np.random.default_rng(child) for child in children]
        self.edges: Records = np.zeros((n, 4 * SPARE), EDGE)
        self.counts = np.zeros(n, np.int64)
        self.log_weights, self.standing = np.zeros(n), np.zeros(n)
        self.best = 0
        self._noise = range_noise(spec.lidar)
        self._odometry: Pose = (0.0, 0.0, 0.0)  # where the robot's frame begins, also for one that starts late
        drift = spec.odometry
        self._odometry_noise = np.array([drift.distance_sd, math.radians(drift.heading_sd_deg), drift.turn_sd])
        self._noisy = drift.noisy and config.correct_pose
        self.poses, self.covariances = np.zeros((n, 3)), np.zeros((n, 3, 3))
        # A particle's patience is a decision, too: drawn once, so that hasty and patient ones compete.
        self._patience = 1 + PATIENCE_SPREAD * (2 * self._random.random(n) - 1)
        self._patience[0] = 1.0

    def update(self, scan: CornerScan, odometry: Pose) -> None:
        """Merge a corner scan into every particle, weigh and resample them. odometry: pose (m, rad), robot's frame."""
        if self.counts.max() + SPARE > self.edges.shape[1] and self.edges.shape[1] < MAX_WALLS:
            self.edges = np.hstack((self.edges, np.zeros_like(self.edges)))
        by = relative(self._odometry, odometry)
        self._odometry = odometry
        if self._noisy:
            for p, pose in enumerate(self.poses):
                before = (float(pose[0]), float(pose[1]), float(pose[2]))
                self.covariances[p] = motion_covariance(self.covariances[p], before, by, self._odometry_noise)
                self.covariances[p] += COVARIANCE_FLOOR * np.eye(3)
                self.poses[p] = compose(before, by)
        else:
            self.poses[:] = odometry
        pieces, sight, dice = scan.pieces, scan.sight, self._throw_dice(len(scan.pieces))
        scores = update_particles(
            self.edges, self.counts, self.poses, self.covariances, pieces, sight, self._noise, dice, self._patience
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
        gained = TEMPER * (scores - scores.max())
        self.standing = FORGET * self.standing + gained
        self.log_weights += gained
        self.log_weights -= self.log_weights.max()
        weights = np.exp(self.log_weights)
        weights /= weights.sum()
        if 1.0 / (weights @ weights) < RESAMPLE_BELOW * len(weights):
            ancestors = systematic(weights, float(self._random.random()))
            # survivors keep their places, so that only the fallen are copied over
            copied = ancestors[1:][np.diff(ancestors) == 0]
            fallen = np.setdiff1d(np.arange(len(weights)), ancestors)[::-1]
            for values in (self.edges, self.counts, self.poses, self.covariances, self.standing):
                values[fallen] = values[copied]
            self.log_weights[:] = 0.0
        self.best = int(np.argmax(self.standing))

    def state(self) -> dict[str, NDArray[Any]]:
        """The particles, for a checkpoint; random numbers begin anew."""
        edges = self.edges[:, : self.counts.max()].copy()
        return {"edges": edges.view(np.uint8), "odometry": np.array(self._odometry)} | {
            name: values.copy() for name, values in self._kept().items()
        }

    def restore(self, state: State) -> None:
        """Go on with kept particles. Raises ValueError or LookupError where they make no sense."""
        kept = {name: checked(state, name, like) for name, like in self._kept().items()}
        x, y, theta = checked(state, "odometry", np.zeros(3)).tolist()
        edges, counts = np.frombuffer(state["edges"].tobytes(), EDGE).reshape(len(self.counts), -1), kept["counts"]
        if not ((counts >= 0) & (counts <= edges.shape[1])).all() or edges.shape[1] > 2 * MAX_WALLS:
            raise ValueError("more or fewer walls than it says")
        for walls, count in zip(edges, counts.tolist(), strict=True):
            check_records(walls[:count])
        if not (np.linalg.eigvalsh(kept["covariances"]) > -COVARIANCE_FLOOR).all():
            raise ValueError("covariances that are none")
        size = 4 * SPARE
        while size < edges.shape[1]:
            size *= 2
        self.edges = np.zeros((len(counts), size), EDGE)
        self.edges[:, : edges.shape[1]] = edges
        for name, values in self._kept().items():
            values[...] = kept[name]
        self._odometry, self.best = (x, y, theta), int(np.argmax(self.standing))

    def _kept(self) -> dict[str, NDArray[Any]]:
        return {
            "counts": self.counts,
            "log_weights": self.log_weights,
            "standing": self.standing,
            "poses": self.poses,
            "covariances": self.covariances,
            "patience": self._patience,
        }

    @property
    def pose(self) -> Pose:
        """Pose of the maximum-likelihood particle, in the robot's own frame."""
        x, y, theta = self.poses[self.best].tolist()
        return x, y, theta

    def predicted(self, odometry: Pose) -> Pose:
        """Where the best particle would be at this odometry, before a scan corrects it."""
        return compose(self.pose, relative(self._odometry, odometry))

    @property
    def nbytes(self) -> int:
        """Bytes that the particles need."""
        return int(self.counts.sum()) * EDGE.itemsize + self.covariances.nbytes + self.poses.nbytes

    def wireframe(self) -> Wireframe:
        """The maximum-likelihood particle as a wireframe in the robot's own frame."""
        return Wireframe(*_published(self._walls()))

    def wireframe_with(self, layers: Sequence[Layer], offset_m: float) -> Wireframe:
        """The same with received maps laid over it; offset_m: how far their walls may lie beside own ones."""
        return Wireframe(*_published(merged(self._walls(), layers, Gates(self._noise, offset_m, 0.0, 0.0))))

    def _walls(self) -> Records:
        """(n,) of EDGE: the records of the maximum-likelihood particle."""
        return self.edges[self.best, : self.counts[self.best]]


@kernel
def _published(edges: Records) -> tuple[Floats, Labels, NDArray[np.int32], NDArray[np.float32], Bools]:
    """The arrays of that wireframe, in the order of its fields."""
    place, m = np.full(len(edges), -1), 0
    for k in range(len(edges)):
        if edges[k].alive == WALL and edges[k].seen >= PUBLISH_AFTER:
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
