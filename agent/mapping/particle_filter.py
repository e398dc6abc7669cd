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
from agent.mapping.config import FilterConfig
from agent.mapping.contradiction import contradict
from agent.mapping.edges import EDGE, PUBLISH_AFTER, WALL, check_records
from agent.mapping.layers import Layer, merged
from agent.mapping.likelihood import log_likelihood
from agent.mapping.pose_correction import axis_of, correct_pose, pose_at
from agent.mapping.scan_merge import merge_scan
from agent.mapping.views import MARGIN_M, View
from agent.mapping.wheels import FLOOR, Wheels, moves_of, way_from
from agent.state import State, checked
from protocol.arrays import Bools, Floats, Ints, Labels, Records
from protocol.geometry import Pose, pose_of, wrapped
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe

SPARE = 64  # free records of a particle for one scan; 360 beams make at most 120 pieces, in practice 20
MAX_WALLS = 4096  # a particle takes no new wall beyond; ten times what the largest layout has
FORGET = 0.98  # share of its past log-weight that a particle keeps per scan: the map is the best of the last 50
TEMPER = 0.2  # scans in a row share their errors, so each counts only as this part of an independent one
RESAMPLE_BELOW = 0.5  # resample when the effective sample size falls below this share of the particles; the usual half
PATIENCE_SPREAD = 0.5  # a particle's patience, a factor on the scans that change a map, is from 1 - this to 1 + this


@kernel
def update_particles(
    edges: Records,
    counts: Ints,
    poses: Floats,
    covariances: Floats,
    grown: Floats,
    raw: Records,
    sight: Sight,
    noise: float,
    dice: Floats,
    patience: Floats,
) -> Floats:
    """One scan into every particle: associate, correct the pose, weigh, merge, contradict.

    edges (p, e), counts (p,), poses (p, 3) and covariances (p, 3, 3) are updated in place. Poses of covariance 0 are
    exact. grown (p, 2): by how much the variance of place (m2) and heading (rad2) grew during the turn. raw (k,): the
    scan's pieces, robot's frame. noise: m, standard deviation of a range. dice: (p, 2, k + 3), for each particle a row
    for association and one for insertion, and standard normals for the pose at the end of the first. patience: (p,)
    each particle's own, as a factor. Returns the scan's log-likelihoods (p,), up to a constant.
    """
    scores = np.zeros(len(counts))
    for p in range(len(counts)):
        pose_sd = math.sqrt(max(covariances[p, 0, 0], covariances[p, 1, 1]))
        gates = Gates(noise, OFFSET_GATE_M, pose_sd, math.sqrt(covariances[p, 2, 2]))
        predicted, new = (poses[p, 0], poses[p, 1], poses[p, 2]), np.zeros(2)
        if covariances[p, 0, 0] > 0.0:
            new[0] = grown[p, 0] / (covariances[p, 0, 0] + covariances[p, 1, 1])
            new[1] = grown[p, 1] / covariances[p, 2, 2]
            _correct(edges[p], counts[p], poses[p], covariances[p], new, raw, gates, dice[p, 0])
        pose = (poses[p, 0], poses[p, 1], poses[p, 2])
        pieces = _placed(raw, predicted, pose, covariances[p], grown[p], new, noise)
        tilt = abs(wrapped(pose[2] - predicted[2])) * new[1]
        view = View(pose, pieces, sight, max(MARGIN_M, NOISE_SIGMAS * noise), noise, tilt)
        walls = associate(edges[p], counts[p], view.pieces, gates, dice[p, 0])
        if len(counts) > 1:  # the weight of one alone decides nothing
            scores[p] = log_likelihood(edges[p], counts[p], view, walls, gates)
        counts[p] = merge_scan(edges[p], counts[p], view.pieces, walls, dice[p, 1], gates, patience[p], True)
        counts[p] = contradict(edges[p], counts[p], view, walls, patience[p])
    return scores


@kernel
def _placed(
    raw: Records, predicted: Pose, pose: Pose, covariance: Floats, grown: Floats, new: Floats, noise: float
) -> Records:
    """Pieces (k,) in the map's frame, each from where the robot was at its moment, and worth what that is known to.

    Hits that share an error of the pose are worth as many independent ones as have the same variance: so a wall's line
    is the work of scans whose pose was known well. Between the ends of a turn the pose is a bridge of its random walk.
    """
    out = raw.copy()
    for k in range(len(raw)):
        then, p = pose_at(predicted, pose, raw[k].moment, new), out[k]
        out[k : k + 1] = to_map_frame(raw[k : k + 1], then)
        bridge = p.moment * (1.0 - p.moment)
        lever = p.uy * (p.y - then[1]) + p.ux * (p.x - then[0])
        j = (-p.uy, p.ux, lever)
        across = 0.5 * bridge * grown[0] + bridge * grown[1] * lever * lever
        for row in range(3):
            for column in range(3):
                across += j[row] * covariance[row, column] * j[column]
        worth = 1.0 / (1.0 + p.hits * across / noise**2)
        p.hits, p.residual = worth * p.hits, worth * p.residual
        p.spread /= 1.0 + p.spread * (covariance[2, 2] + bridge * grown[1]) / noise**2
    return out


@kernel
def _correct(
    edges: Records, count: int, pose: Floats, covariance: Floats, new: Floats, raw: Records, gates: Gates, dice: Floats
) -> None:
    """Correct a particle's pose (3,) and covariance (3, 3) in place by a scan, and draw the pose from the result.

    dice: for the association of the pieces, and three standard normals at the end.
    """
    predicted = (pose[0], pose[1], pose[2])
    walls = associate(edges, count, to_map_frame(raw, predicted), gates, dice)
    axis = axis_of(edges, count, gates.noise)
    found, corrected = correct_pose(edges, raw, walls, predicted, covariance, new, axis, gates.noise)
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
        self._odometry = np.zeros(3)  # (x, y, theta) where the robot's frame begins, also for one that starts late
        self._noisy = spec.odometry.noisy and config.correct_pose
        self.poses, self.wheels = np.zeros((n, 3)), Wheels(spec.odometry, n)
        # A particle's patience is a decision, too: drawn once, so that hasty and patient ones compete.
        self._patience = 1 + PATIENCE_SPREAD * (2 * self._random.random(n) - 1)
        self._patience[0] = 1.0

    def update(self, scan: CornerScan, odometry: Floats | Pose) -> None:
        """Merge a corner scan into every particle, weigh and resample them.

        odometry: (k, 3) poses (m, rad) since the last scan, or the last one alone, robot's frame.
        """
        if self.counts.max() + SPARE > self.edges.shape[1] and self.edges.shape[1] < MAX_WALLS:
            self.edges = np.hstack((self.edges, np.zeros_like(self.edges)))
        way = np.atleast_2d(odometry)
        told, self._odometry = moves_of(np.vstack((self._odometry, way))), way[-1].copy()
        grown = np.zeros((len(self.poses), 2))
        covariances = np.zeros((len(self.poses), 3, 3))
        if self._noisy:
            grown = self.wheels.move(self.poses, told)
            covariances = self.wheels.covariances[:, :3, :3].copy()
        else:
            self.poses[:] = self._odometry
        predicted, pieces, dice = self.poses.copy(), scan.pieces, self._throw_dice(len(scan.pieces))
        scores = update_particles(
            self.edges,
            self.counts,
            self.poses,
            covariances,
            grown,
            pieces,
            scan.sight,
            self._noise,
            dice,
            self._patience,
        )
        if self._noisy:
            self.wheels.learn(self.poses - predicted, covariances)
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
            for values in (self.edges, self.counts, self.poses, *self.wheels.arrays, self.standing):
                values[fallen] = values[copied]
            self.log_weights[:] = 0.0
        self.best = int(np.argmax(self.standing))

    def replace(self, walls: Records, pose: Pose) -> None:
        """Let every particle begin anew from walls (n,) of EDGE and a pose."""
        while len(walls) + SPARE > self.edges.shape[1]:
            self.edges = np.hstack((self.edges, np.zeros_like(self.edges)))
        self.edges[:, : len(walls)], self.counts[:], self.poses[:] = walls, len(walls), pose

    def state(self) -> dict[str, NDArray[Any]]:
        """The particles, for a checkpoint; random numbers begin anew."""
        edges = self.edges[:, : self.counts.max()].copy()
        kept = {name: values.copy() for name, values in self._kept().items()}
        return {"edges": edges.view(np.uint8), "odometry": self._odometry.copy(), **kept}

    def restore(self, state: State) -> None:
        """Go on with kept particles. Raises ValueError or LookupError where they make no sense."""
        kept = {name: checked(state, name, like) for name, like in self._kept().items()}
        odometry = checked(state, "odometry", np.zeros(3))
        edges, counts = np.frombuffer(state["edges"].tobytes(), EDGE).reshape(len(self.counts), -1), kept["counts"]
        if not ((counts >= 0) & (counts <= edges.shape[1])).all() or edges.shape[1] > 2 * MAX_WALLS:
            raise ValueError("more or fewer walls than it says")
        for walls, count in zip(edges, counts.tolist(), strict=True):
            check_records(walls[:count])
        if not (np.linalg.eigvalsh(kept["covariances"]) > -FLOOR).all():
            raise ValueError("covariances that are none")
        size = 4 * SPARE
        while size < edges.shape[1]:
            size *= 2
        self.edges = np.zeros((len(counts), size), EDGE)
        self.edges[:, : edges.shape[1]] = edges
        for name, values in self._kept().items():
            values[...] = kept[name]
        self._odometry, self.best = odometry, int(np.argmax(self.standing))

    def _kept(self) -> dict[str, NDArray[Any]]:
        return {
            "counts": self.counts,
            "log_weights": self.log_weights,
            "standing": self.standing,
            "poses": self.poses,
            "covariances": self.wheels.covariances,
            "constants": self.wheels.constants,
            "patience": self._patience,
        }

    @property
    def pose(self) -> Pose:
        """Pose of the maximum-likelihood particle, in the robot's own frame."""
        x, y, theta = self.poses[self.best].tolist()
        return x, y, theta

    def way(self, odometry: Floats) -> Floats:
        """(k + 1, 3) poses since the last scan, in the frame of the first, by odometry (k, 3) and the best particle."""
        way = way_from(pose_of(self._odometry), odometry)
        return np.array(self.wheels.way(moves_of(way), self.best)) if self._noisy else way

    @property
    def nbytes(self) -> int:
        """Bytes that the particles need."""
        return int(self.counts.sum()) * EDGE.itemsize + self.wheels.covariances.nbytes + self.poses.nbytes

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
