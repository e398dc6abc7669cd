"""The map of one robot: a weighted set of whole wireframes, the particles (paper III-B; equations ours)."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.corner_scan import CornerScan, Sight, at_start, range_noise, to_map_frame
from agent.kernels import kernel
from agent.mapping.association import BEST, OFFSET_GATE_M, Gates, associate
from agent.mapping.bodies import NO_TEAMMATES, Bodies, put_off
from agent.mapping.config import FilterConfig
from agent.mapping.contradiction import contradict
from agent.mapping.edges import EDGE, EDGE_BYTES, TENTATIVE, check_records, common_axis
from agent.mapping.exactness import Exactness
from agent.mapping.first_look import heading_sd, hold_first_ends, keep_first_look
from agent.mapping.joined import hold_joined
from agent.mapping.joint import (
    AXIS,
    BEGIN,
    MAX_JOINT,
    PER_WALL,
    WALLS,
    carry,
    has_rows,
    hold_corners,
    know_walls,
    move_walls,
    relate,
    row_of,
)
from agent.mapping.layers import Layer, Tellings, merged
from agent.mapping.likelihood import log_likelihood
from agent.mapping.poles import MOST, POLE, Places, draw_poles, see_poles, settle_poles
from agent.mapping.pose_correction import Axis, axis_of, correct_pose, hold_axis, pose_at
from agent.mapping.publication import published
from agent.mapping.scan_merge import LIKELIER, merge_scan
from agent.mapping.views import View, margin_of
from agent.mapping.wheels import FLOOR, Wheels, moves_of, way_from
from agent.state import LARGEST, State, checked
from protocol.arrays import Floats, Ints, Records
from protocol.geometry import Pose, pose_of, wrapped
from protocol.messages import RobotSpec
from protocol.wireframe import MAX_COORDINATE_M, Wireframe

SPARE = 64  # free records of a particle for one scan; 360 beams make at most 120 pieces, in practice 20
SPARE_ROWS = 16
"""Walls that a scan may bring for which the covariance has rows; further ones get theirs with the next scan. Unused
rows cost time, as each number of a scan goes through all."""
MAX_WALLS = 4096  # a particle takes no new wall beyond; ten times what the largest layout has
STILL = 1e-4  # m and rad that odometry tells of a robot that stands, at most
FORGET = 0.98  # share of its past log-weight that a particle keeps per scan: the map is the best of the last 50
TEMPER = 0.2  # scans in a row share their errors, so each counts only as this part of an independent one
RESAMPLE_BELOW = 0.5  # resample when the effective sample size falls below this share of the particles; the usual half
STILL_SCANS = 20
"""Scans in a row without a move that tell of pose and walls. Those that follow have the same beams on the same faces
and err alike: maps that were right to 0.05 degrees were turned by 0.2 to 0.4 while their robots stood parked."""
PATIENCE_SPREAD = 0.5  # a particle's patience, a factor on the scans that change a map, is from 1 - this to 1 + this


class Particles(NamedTuple):
    """What each particle believes, a row each."""

    edges: Records  # (p, e) walls, of EDGE
    counts: Ints  # (p,) how many of these records are in use
    poses: Floats  # (p, 3) m, rad; own frame
    constants: Floats  # (p, 3) of the wheels
    axes: Floats  # (p,) rad, of rectilinear walls
    joint: Floats  # (p, m, m) covariance of the errors of all these


@kernel
def update_particles(
    particles: Particles,
    grown: Floats,
    raw: Records,
    sight: Sight,
    bodies: Bodies,
    noise: float,
    dice: Floats,
    patience: Floats,
    tells: bool,
) -> Floats:
    """One scan into every particle: associate, correct the joint estimate, weigh, merge, contradict.

    particles: updated in place; poses of variance 0 are exact. grown (p, 2): by how much the variance of place (m2)
    and heading (rad2) grew in the revolution. raw (k,): the scan's pieces, robot's frame. bodies: where teammates are.
    noise: m, standard deviation of a range. dice: (p, 2, k), for each particle a row for association and one for
    insertion. patience: (p,) each particle's own, as a factor. tells: whether the scan tells more of pose and walls
    than those before. Returns the scan's log-likelihoods (p,), up to a constant.
    """
    edges, counts, poses, _, axes, joint = particles
    scores, gates = np.zeros(len(counts)), Gates(noise, OFFSET_GATE_M)
    for p in range(len(counts)):
        predicted, exact = (poses[p, 0], poses[p, 1], poses[p, 2]), joint[p, 0, 0] == 0.0
        shift, axis = np.zeros(WALLS), Axis(0.0, math.inf)
        if not exact:
            shift, axis = _no_shift(counts[p], joint[p]), axis_of(edges[p], counts[p], noise)
            relate(edges[p], counts[p], joint[p], predicted)
            pieces = _placed(raw, predicted, shift, grown[p], noise)
            walls = associate(edges[p], counts[p], pieces, gates, dice[p, 0])
            known = Axis(axes[p], axis.sd if joint[p, AXIS, AXIS] > 0.0 else math.inf)
            if tells:
                correct_pose(edges[p], counts[p], pieces, walls, predicted, joint[p], shift, known, gates)
            _move(particles, p, shift)
        pose = (poses[p, 0], poses[p, 1], poses[p, 2])
        relate(edges[p], counts[p], joint[p], pose)
        pieces = _placed(raw, predicted, shift, grown[p], noise)
        tilt = abs(shift[2] - shift[BEGIN + 2])
        view = View(pose, pieces, sight, margin_of(noise), noise, tilt)
        walls = associate(edges[p], counts[p], view.pieces, gates, dice[p, 0])
        if len(counts) > 1:  # the weight of one alone decides nothing
            scores[p] = log_likelihood(edges[p], counts[p], view, walls, gates)
        put_off(view.pieces, dice[p, 1], bodies, view.margin)
        before = edges[p, : counts[p]].copy()
        tentative = before["kind"] == TENTATIVE
        counts[p] = merge_scan(edges[p], counts[p], view.pieces, walls, dice[p, 1], gates, patience[p], True)
        counts[p] = contradict(edges[p], counts[p], view, walls, bodies, patience[p])
        if not exact:
            shift = _no_shift(counts[p], joint[p])
            if hold_joined(edges[p], before, joint[p], shift):
                _move(particles, p, shift)
                pose = (poses[p, 0], poses[p, 1], poses[p, 2])
            fresh = know_walls(edges[p], counts[p], joint[p], pose, noise, tentative)
            shift = _no_shift(counts[p], joint[p])
            hold_corners(edges[p], before, joint[p], shift, noise)
            axes[p] = hold_axis(edges[p], fresh, joint[p], shift, axes[p], axis)
            _move(particles, p, shift)
    return scores


@kernel
def _no_shift(count: int, joint: Floats) -> Floats:
    """(m,) a shift by nothing of the rows that are in use."""
    return np.zeros(row_of(min(count, has_rows(joint))))


@kernel
def _move(particles: Particles, p: int, shift: Floats) -> None:
    """Move all that a particle estimates by what was found, (m,), and its covariance along."""
    edges, pose = particles.edges[p], particles.poses[p]
    carry(edges, particles.joint[p], shift, (pose[0], pose[1], pose[2]))
    for k in range(3):
        pose[k] += shift[k]
        particles.constants[p, k] += shift[3 + k]
    pose[2] = wrapped(pose[2])
    particles.axes[p] += shift[AXIS]
    move_walls(edges, shift)


@kernel
def _placed(raw: Records, predicted: Pose, shift: Floats, grown: Floats, noise: float) -> Records:
    """Pieces (k,) in the map's frame, each from where the robot was at its moment, and worth what that is known to.

    Between the ends of a revolution the pose is a bridge of its random walk. Hits that share an error of it are worth
    as many independent ones as have the same variance.
    """
    out = raw.copy()
    for k in range(len(raw)):
        then, p = pose_at(predicted, shift, raw[k].moment), out[k]
        out[k : k + 1] = to_map_frame(raw[k : k + 1], then)
        bridge = p.moment * (1.0 - p.moment)
        lever = p.uy * (p.y - then[1]) + p.ux * (p.x - then[0])
        across = 0.5 * bridge * grown[0] + bridge * grown[1] * lever * lever
        worth = 1.0 / (1.0 + p.hits * across / noise**2)
        p.hits, p.residual = worth * p.hits, worth * p.residual
        p.spread /= 1.0 + p.spread * bridge * grown[1] / noise**2
    return out


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
        self._radius = spec.radius_m
        self._noise, self._noise_share = range_noise(spec.lidar), spec.lidar.noise_share
        self._odometry = np.zeros(3)  # (x, y, theta) where the own frame begins, also for one that starts late
        self._still = 0  # scans since the robot moved
        self._noisy = spec.odometry.noisy and config.correct_pose
        self.poses, self._axes = np.zeros((n, 3)), np.zeros(n)
        self.wheels = Wheels(spec.odometry, n, spec.lidar.rate_hz)
        self.poles: Records = np.zeros(MOST, POLE)
        self.glimpses = np.zeros((0, 2))
        """(g, 2) metres: middles of what the last scan that was merged hit and is no wall yet."""
        self.joint = np.zeros((n, WALLS, WALLS))  # of errors of poses, constants, axes and walls
        if self._noisy:
            self.joint[:, :6, :6] = self.wheels.first
        # A particle's patience is a decision, too: drawn once, so that hasty and patient ones compete.
        self._patience = 1 + PATIENCE_SPREAD * (2 * self._random.random(n) - 1)
        self._patience[0] = 1.0

    def update(
        self, scan: CornerScan, odometry: Floats | Pose, teammates: Floats = NO_TEAMMATES, tick: int = 0
    ) -> None:
        """Merge a corner scan into every particle, weigh and resample them.

        odometry: (k, 3) poses (m, rad) since the last scan, or the last one alone, in the odometry's frame.
        teammates: (t, 3) where merged ones say that they are, and by how much each may be off; metres, own frame.
        tick: of the scan.
        """
        if self.counts.max() + SPARE > self.edges.shape[1] and self.edges.shape[1] < MAX_WALLS:
            self.edges = np.hstack((self.edges, np.zeros_like(self.edges)))
        if scan.median_of:
            self._begin_anew()
        grown = self.move(odometry, slips=scan.touching)
        self._still += 1
        best = self.edges[self.best]  # of this scan: weighing may make another particle the best
        hit_before = _scans_of_tentative(best)
        scores = update_particles(
            self._particles(),
            grown,
            scan.pieces,
            scan.sight,
            Bodies(scan.discs, teammates, self._radius),
            self._noise,
            self._throw_dice(len(scan.pieces)),
            self._patience,
            self._still <= STILL_SCANS or scan.median_of > 0,
        )
        glimpses = best["tip"][_scans_of_tentative(best) > hit_before].mean(1)
        self._weigh(scores)
        if scan.median_of:
            self.edges["seen"], self.edges["due"] = scan.median_of, scan.median_of  # each of them has shown these walls
            gates = Gates(self._noise, OFFSET_GATE_M)
            hold_first_ends(self.edges, self.counts, self.joint, scan.pieces, gates, scan.median_of)
            return
        walls, count = self.edges[self.best], int(self.counts[self.best])
        self.glimpses = glimpses
        see_poles(self.poles, walls, count, self.pose, scan.pieces, scan.sight, self._noise, self._noise_share, tick)

    def _begin_anew(self) -> None:
        """Forget all scans: the next one shows all that they did, and better."""
        self.counts[:], self.poses[:], self._axes[:], self.joint[:] = 0, 0.0, 0.0, 0.0
        if self._noisy:
            self.joint[:, :6, :6] = self.wheels.first

    def move(self, odometry: Floats | Pose, *, slips: bool = False) -> Floats:
        """Move every particle by odometry alone, as in `update`.

        slips: whether the wheels may have slipped. Returns (p, 2): by how much the variance of place and heading grew.
        """
        way, before = np.atleast_2d(odometry), self._odometry
        self._odometry = way[-1].copy()
        if not self._noisy:
            self.poses[:] = self._odometry
            return np.zeros((len(self.poses), 2))
        leaves = at_start(before) and not at_start(way[-1])
        told = moves_of(np.vstack((before, way)))
        if slips or np.abs(told).max() > STILL:
            self._still = 0
        self._make_room()
        if leaves:
            keep_first_look(self.edges, self.counts, self._noise)
        return self.wheels.move(self.poses, self.joint, told, slips)

    def _particles(self) -> Particles:
        return Particles(self.edges, self.counts, self.poses, self.wheels.constants, self._axes, self.joint)

    def _make_room(self) -> None:
        """Have rows of the joint covariances for all walls, and for those that a scan may bring."""
        needed = WALLS + PER_WALL * min(MAX_JOINT, SPARE_ROWS * (int(self.counts.max()) // SPARE_ROWS + 2))
        more = needed - self.joint.shape[1]
        if more > 0:
            self.joint = np.pad(self.joint, ((0, 0), (0, more), (0, more)))

    def _throw_dice(self, k: int) -> Floats:
        """(p, 2, k) dice of one scan, each particle's from its own generator; the first takes the likelier side."""
        dice = np.empty((len(self._dice), 2, k))
        dice[0, 0], dice[0, 1] = BEST, LIKELIER
        for p in range(1, len(dice)):
            self._dice[p].random(out=dice[p])
        return dice

    def _weigh(self, scores: Floats) -> None:
        """Weights in the log domain; systematic resampling on effective sample size."""
        if len(scores) == 1:
            return
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
            for values in (*self._particles(), self.standing):
                values[fallen] = values[copied]
            self.log_weights[:] = 0.0
        self.best = int(np.argmax(self.standing))

    def replace(self, walls: Records, pose: Pose, places: Places) -> None:
        """Let every particle begin anew from walls (n,) of EDGE and a pose. places: as of `settle_poles`."""
        self.glimpses = self.glimpses[:0]  # they are of the map before
        while len(walls) + SPARE > self.edges.shape[1]:
            self.edges = np.hstack((self.edges, np.zeros_like(self.edges)))
        self.edges[:, : len(walls)], self.counts[:], self.poses[:] = walls, len(walls), pose
        self.joint[:, AXIS:], self.joint[:, :, AXIS:] = 0.0, 0.0
        settle_poles(self.poles, places)

    def state(self) -> dict[str, NDArray[Any]]:
        """The particles, for a checkpoint; random numbers begin anew."""
        edges = self.edges[:, : self.counts.max()].copy()
        kept = {name: values.copy() for name, values in self._kept().items()}
        joint = self.joint[:, : self._rows, : self._rows].copy()
        return {"edges": edges.view(np.uint8), "joint": joint, "odometry": self._odometry.copy(), **kept}

    def restore(self, state: State) -> None:
        """Go on with kept particles. Raises ValueError or LookupError where they make no sense."""
        kept = {name: checked(state, name, like) for name, like in self._kept().items()}
        odometry = checked(state, "odometry", np.zeros(3))
        if max(np.abs(kept["poses"]).max(), np.abs(odometry).max()) > MAX_COORDINATE_M:
            raise ValueError(f"a pose beyond {MAX_COORDINATE_M:g} m")
        if not self.wheels.are_possible(kept["constants"]):
            raise ValueError("constants of no possible wheels")
        edges, counts = np.frombuffer(state["edges"].tobytes(), EDGE).reshape(len(self.counts), -1), kept["counts"]
        if not ((counts >= 0) & (counts <= edges.shape[1])).all() or edges.shape[1] > 2 * MAX_WALLS:
            raise ValueError("more or fewer walls than it says")
        for walls, count in zip(edges, counts.tolist(), strict=True):
            check_records(walls[:count])
        joint = state["joint"]
        if joint.dtype != np.float64 or joint.shape != (len(counts), joint.shape[-1], joint.shape[-1]):
            raise ValueError("joint has a wrong type or shape")
        if not WALLS <= joint.shape[1] <= WALLS + PER_WALL * MAX_JOINT or not (np.abs(joint) <= LARGEST).all():
            raise ValueError("joint has too many rows, or a number that is not finite or too large")
        if not (np.linalg.eigvalsh(joint) > -FLOOR).all():
            raise ValueError("covariances that are none")
        self.joint = joint.copy()
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
            "axes": self._axes,
            "constants": self.wheels.constants,
            "steady": self.wheels.steady,
            "patience": self._patience,
            "poles": self.poles.view(np.float64),
        }

    @property
    def pose(self) -> Pose:
        """Pose of the maximum-likelihood particle, in the robot's own frame."""
        x, y, theta = self.poses[self.best].tolist()
        return x, y, theta

    @property
    def covariance(self) -> Floats:
        """(3, 3) of that pose: m2, m rad, rad2."""
        return np.asarray(self.joint[self.best, :3, :3])

    @property
    def length_scale(self) -> float:
        """Metres of way for a metre that the wheels tell, by that particle."""
        return 1.0 / float(self.wheels.constants[self.best, 0])

    @property
    def place_sd_m(self) -> float:
        """Standard deviation of the place of that pose, metres, beside what is due to how the walls' axis is turned.

        A robot whose map is turned as much as it takes no wall for another.
        """
        joint = self.joint[self.best]
        turned = float(joint[:2, AXIS] @ joint[:2, AXIS]) / joint[AXIS, AXIS] if joint[AXIS, AXIS] > 0.0 else 0.0
        return math.sqrt(max(float(np.trace(joint[:2, :2])) - turned, 0.0))

    def first_heading_sd(self) -> float:
        """How well what was seen tells the heading of who comes back to where it began, rad; before it leaves.

        0 where poses are taken as odometry tells them.
        """
        if not self._noisy:
            return 0.0
        return float(heading_sd(self._walls(), self.joint[self.best], self._noise))

    @property
    def exactness(self) -> Exactness:
        """How exact that map is, until the next scan."""
        return Exactness(self._walls(), self.joint[self.best], self.pose)

    @property
    def is_at_start(self) -> bool:
        """Whether the robot has not moved yet, by odometry."""
        return at_start(self._odometry)

    def way(self, odometry: Floats) -> Floats:
        """(k + 1, 3) poses since the last scan, in the frame of the first, by odometry (k, 3) and the best particle."""
        way = way_from(pose_of(self._odometry), odometry)
        return self.wheels.way(moves_of(way), self.best) if self._noisy else way

    @property
    def nbytes(self) -> int:
        """Bytes that the particles need."""
        rows = self._rows if self._noisy else 6
        poles = int((self.poles["score"] > 0.0).sum()) * POLE.itemsize
        return int(self.counts.sum()) * EDGE_BYTES + poles + len(self.poses) * rows**2 * 8 + self.poses.nbytes

    @property
    def _rows(self) -> int:
        """Rows of the joint covariances that are in use, at most."""
        return min(WALLS + PER_WALL * int(self.counts.max()), self.joint.shape[1])

    def wireframe(self) -> Wireframe:
        """The maximum-likelihood particle as a wireframe in the robot's own frame."""
        return self._drawn(self._walls(), [])

    def wireframe_with(self, layers: Sequence[Layer], offset_m: float) -> Wireframe:
        """The same with received maps laid over it; offset_m: how far their walls may lie beside own ones."""
        return self._drawn(merged(self._walls(), layers, Gates(self._noise, offset_m)), layers)

    def told_with(self, layers: Sequence[Layer], offset_m: float) -> Callable[[int | None], Wireframe]:
        """The same as it is told to peers, from layers of what their senders saw themselves, without one of these.

        What is returned holds until the filter changes.
        """
        tellings = Tellings(self._walls(), layers, Gates(self._noise, offset_m))
        return lambda layer: self._drawn(tellings.without(layer), [x for k, x in enumerate(layers) if k != layer])

    def _drawn(self, walls: Records, layers: Sequence[Layer]) -> Wireframe:
        """The published ones of walls (n,) of EDGE, and all poles, also those of layers."""
        wireframe, heard = Wireframe(*published(walls, self._noise)), [layer.poles for layer in layers]
        if not self.poles["known"].any() and not any(map(len, heard)):
            return wireframe
        return draw_poles(wireframe, self.poles, heard, common_axis(walls, len(walls))[0])

    def _walls(self) -> Records:
        """(n,) of EDGE: the records of the maximum-likelihood particle."""
        return self.edges[self.best, : self.counts[self.best]]


def _scans_of_tentative(walls: Records) -> Floats:
    """(n,) how many scans have hit each record of a particle; 0 of what is no tentative wall."""
    return np.where(walls["kind"] == TENTATIVE, walls["seen"], 0.0)
