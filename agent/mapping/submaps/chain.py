"""The way of a robot as a chain of submaps: tracked from wall to wall, closed in loops, relaxed (ours).

A submap holds the walls of some metres of way in the frame of its first pose. Scans are matched against the present
and the last one; a finished one against all that it may overlap. What errs is then the poses of submaps alone, which
the pose graph settles, and one map is merged from their walls.
"""

import math
from collections.abc import Sequence

import numpy as np

from agent.corner_scan import CornerScan
from agent.geometry.matrix3 import inverse
from agent.kernels import kernel
from agent.mapping.config import SubmapConfig
from agent.mapping.layers import Layer
from agent.mapping.submaps.bend import Bend
from agent.mapping.submaps.gathered import NONE, Gathered
from agent.mapping.submaps.length_scale import LengthScale
from agent.mapping.submaps.loops import AGAIN_PRIOR, CONFIRMED, Submap, find, look_again
from agent.mapping.submaps.matching import SAMPLE_SD_M, TRUST, share_beside, tiles_of
from agent.mapping.submaps.merging import united
from agent.mapping.submaps.pose_graph import Edges, covariances_from, relaxed
from agent.mapping.submaps.segments import moved, samples_along, segments_in, segments_of
from agent.mapping.submaps.tracking import track
from protocol.arrays import Floats, Records
from protocol.geometry import Pose, apply, compose, inverted, pose_of, relative

VIEW_M = 0.4  # of way, or twice this in radians, from one kept view to the next: a dozen a submap
MERGE_AFTER_M = 0.2  # of way, or twice this in radians: scans from one place show its walls with the same errors
SKIPPED = 2  # submaps before a finished one hold it by the way already and are no loops
SIGMAS = 6.0
"""Deviations of the way up to which a loop is looked for. Errors of tracking are no white noise: where walls bend, or
beams are few, a lap of 100 m was off by 25 degrees, six deviations. With three its loops were never tried."""
BENT = np.diag((0.05, 0.05, math.radians(1.0))) ** 2
"""m2 and rad2 of a submap's end beside what is known of it, where loops are looked for: bends that no scan tells of."""
NEIGHBOUR_M = 8.0  # between the middles of two submaps that show many of the same walls
LOOK_AGAIN = 2  # rounds in which all loops are measured again, from relaxed poses, at the end
FLOOR = np.diag((0.1, 0.1, 0.01)) ** 2  # m2 and rad2 added to what the graph believes to know of a loop
LAID_SHARE = 0.5  # of a received wall's length that must lie beside own ones for it to be one of them
LAID_M = 0.3  # a received wall so near beside an own one is the same: transforms between buildings' maps err as much
HELD_BY = 2.0
"""Samples, 0.4 m of wall, that must hold a loop in a direction. Short smears lie oblique to a corridor's walls and hold
a loop along it by a fourth of a sample: loops that were believed there were 1.6 to 4.4 m off."""


def travelled(by: Pose) -> float:
    """Metres of a motion, a turn counting half its radians: by which views and merged scans are told apart."""
    return math.hypot(by[0], by[1]) + 0.5 * abs(by[2])


class Submaps:
    """The chain, and the pose of the robot in it. Frame: the robot's own, in which the first submap lies at zero."""

    def __init__(
        self,
        config: SubmapConfig,
        view: tuple[float, float] = (0.0, math.pi),
        scale_sd: float = 0.0,
        bend_sd: float = 0.0,
    ) -> None:
        """view: rad, as of `LidarSpec.view`. scale_sd: of the odometry's metres, as a share. bend_sd: rad a metre by
        which it bends a straight way."""
        self._config = config
        self._looks = np.array((0.0, 0.0, view[0]))  # from a pose to the middle of the view there
        self._half_view = view[1]
        self._length, self._bend = LengthScale(scale_sd), Bend(bend_sd)
        self._window = np.array((config.search_m, config.search_m, math.radians(config.search_deg)))
        self.poses = np.zeros((1, 3))
        """(n, 3) poses of the submaps, the present one's last."""
        self.loops = 0
        self.finished: list[Submap] = []
        self._ends: list[tuple[int, int]] = []  # of the graph's edges, as in Edges
        self._measured: list[Floats] = []
        self._information: list[Floats] = []
        self._is_loop: list[bool] = []
        self._scales: list[float] = []  # as of `take`, with which each edge was measured
        self._by_wheels: list[float] = []  # share of each edge's length that wheels told, and not walls
        self._scale_now = 1.0
        self._candidates: list[tuple[int, Floats, Floats]] = []  # as in `_look_for_loops`
        self._loops_relaxed = 0
        self._overruled: list[Floats] = []
        """(3,) where odometry had the last scan, if walls did not say so; else nothing."""
        self._begin(NONE)

    def _begin(self, behind: Records) -> None:
        """Start an empty submap at the robot's place; behind: walls of the last one, in the frame of that place."""
        self._own = Gathered()  # walls of the present submap
        self._near = Gathered(behind)
        """The same with those of the last one: what scans are matched against. Each wall stands there once: of two that
        are the same, a sample would be held by the one to which the odometry has put it."""
        self._local = np.zeros(3)  # the robot's pose in the present submap
        self._views, self._since_view, self._way = [np.zeros(3)], 0.0, 0.0
        self._told_way = 0.0  # metres of the way that wheels told, and not walls
        self._since_merged = math.inf
        self._unsure = np.zeros((3, 3))  # covariance of the robot's pose in the present submap, by all scans in it

    @property
    def pose(self) -> Pose:
        """Of the robot, in its own frame."""
        return self.pose_at(*self.place)

    @property
    def place(self) -> tuple[int, Floats]:
        """Where the robot is: the number of the present submap, and the pose (3,) in that."""
        return len(self.poses) - 1, self._local

    def pose_at(self, submap: int, local: Floats) -> Pose:
        """Where a place is in the own frame, by what is known now."""
        return compose(pose_of(self.poses[submap]), pose_of(local))

    @property
    def nbytes(self) -> int:
        """Bytes of the submaps and the graph."""
        kept = sum(place.walls.nbytes + place.samples.nbytes + place.views.nbytes for place in self.finished)
        return kept + self._own.walls.nbytes + self._near.walls.nbytes + self.poses.nbytes + len(self._ends) * 136

    def take(self, scan: CornerScan, by: Pose, scale: float = 1.0) -> None:
        """Take a corner scan; by: the odometry's motion since the last one, in the robot's frame then.

        scale: metres of it for a metre that the wheels told, as far as who calls has learned that.
        """
        ahead, aside = self._length.mean * by[0], self._length.mean * by[1]
        by = (ahead, aside, by[2] + self._bend.mean * ahead)
        self._scale_now = self._length.mean * scale
        before = self._local
        guesses = [np.array(compose(pose_of(pose), by)) for pose in (self._local, *self._overruled)]
        self._local, self._overruled = guesses[0], []
        seen, walls, prior = segments_of(scan.pieces), self._near.walls, self._by_odometry(by)
        known, held = prior, False
        if len(seen) and len(walls):
            samples = samples_along(seen)
            last_view = Submap(walls, samples, (before + self._looks)[None], self._config.view_m, self._half_view)
            self._local, known, held, overruled = track(samples, last_view, guesses, prior)
            self._overruled = guesses[:1] if overruled else []
        if held:
            self._length.learn(by, before, self._local, prior, known)
            self._bend.learn(by, before, self._local, prior, known)
        else:
            self._length.lose()
            self._bend.lose()
        travel = travelled(by)
        self._unsure = _carried(self._unsure, before, self._local)
        if travel > 0.0:
            self._unsure += self._covariance_of(by, min(travel / MERGE_AFTER_M, 1.0), known - prior)
        self._since_merged += travel
        if self._since_merged >= MERGE_AFTER_M or not len(self._own.walls):
            here = moved(seen, self._local)
            for gathered in (self._own, self._near):
                gathered.add(here)
            self._since_merged = 0.0
        metres = math.hypot(by[0], by[1])
        self._way += metres
        self._told_way += metres * _share_of(prior, known, self._local - before)
        self._since_view += travel
        if self._since_view > VIEW_M:
            self._views.append(self._local)
            self._since_view = 0.0
        if self._way > self._config.length_m:
            self.close()
        elif self.is_comparing:
            self._compare()

    def _by_odometry(self, by: Pose) -> Floats:
        """(3, 3) information of a pose that odometry tells, after a motion."""
        far, config = math.hypot(by[0], by[1]), self._config
        place = config.distance_sd**2 * far + config.still_sd_m**2
        heading = math.radians(config.heading_sd_deg) ** 2 * far + config.turn_sd**2 * abs(by[2])
        return np.diag((1 / place, 1 / place, 1 / (heading + math.radians(config.still_sd_deg) ** 2)))

    def _covariance_of(self, by: Pose, share: float, walls: Floats) -> Floats:
        """(3, 3) by which a motion leaves the pose unsure; walls: (3, 3) what a scan then tells of it.

        Scans from one place err alike: the motion counts as this share of a longer one to a place of its own.
        """
        ahead, aside, turn = by
        longer = self._by_odometry((ahead / share, aside / share, turn / share))
        return self._config.way_share * share * inverse(walls + longer)

    @property
    def is_comparing(self) -> bool:
        """Whether the last finished submap is still to be held against earlier ones."""
        return bool(self._candidates)

    def close(self) -> None:
        """Finish the present submap and begin the next one.

        The scans that follow hold the finished one against one earlier submap each: with all at once, the hundredth
        scan of freiburg-079 that took longest took 20 ms of an idle core, of 0.7 in the median.
        """
        self.compare_all()
        walls, new = united([self._own.walls]), len(self.finished)
        sure = walls[walls["seen"] >= CONFIRMED]
        views = np.array(self._views) + self._looks
        place = Submap(walls, samples_along(sure), views, self._config.view_m, self._half_view)
        self.finished.append(place)
        self.poses = np.vstack((self.poses, compose(pose_of(self.poses[-1]), pose_of(self._local))))
        sd = np.array((self._config.way_sd_m, self._config.way_sd_m, math.radians(self._config.way_sd_deg)))
        known = np.asarray(np.linalg.inv(self._unsure + np.diag(sd**2)), np.float64)
        self._add_edge(new, new + 1, self._local, known, False, self._told_way / max(self._way, 1e-9))
        behind = moved(walls, np.array(inverted(pose_of(self._local))))
        self._overruled = [np.array(relative(pose_of(self._local), pose_of(pose))) for pose in self._overruled]
        self._begin(behind)
        self._candidates = self._look_for_loops(new)

    def finish(self) -> None:
        """Close the last submap and measure all loops again from where the graph has put the submaps."""
        if len(self._own.walls):
            self.close()
        self.compare_all()
        if not self.loops:
            return
        self._join_neighbours()
        for _ in range(LOOK_AGAIN):
            for k, (earlier, later) in enumerate(self._ends):
                if self._is_loop[k]:
                    guess = self._relative(earlier, later)
                    match = look_again(self.finished[later], self.finished[earlier], guess)
                    self._measured[k], self._information[k] = match.pose, self._loop_information(match.information)
            self.poses = relaxed(self.poses, self.graph())

    def _join_neighbours(self) -> None:
        """Add the loops between submaps that lie side by side and were not compared while the robot was under way."""
        known = set(self._ends)
        middles = np.array([self._middle(k) for k in range(len(self.finished))])
        for later in range(len(self.finished)):
            apart = np.hypot(*(middles[: max(later - SKIPPED, 0)] - middles[later]).T)
            for earlier in np.flatnonzero(apart < NEIGHBOUR_M).tolist():
                if (earlier, later) not in known:
                    self._try_loop(earlier, later, np.zeros(3), AGAIN_PRIOR)
        self.poses = relaxed(self.poses, self.graph())

    def _try_loop(self, earlier: int, later: int, window: Floats, prior: Floats) -> None:
        """Hold a submap against an earlier one, window (3,) and prior (3, 3) as in `find`, and take a loop down."""
        found = find(self.finished[later], self.finished[earlier], self._relative(earlier, later), window, prior)
        if found is None or not found.accepted:
            return
        self._add_edge(earlier, later, found.pose, self._loop_information(found.information), True)
        self.loops += 1

    def _look_for_loops(self, new: int) -> list[tuple[int, Floats, Floats]]:
        """Earlier submaps that a finished one may overlap, nearest first, each with window and prior as in `find`."""
        last = new - SKIPPED
        if last <= 0:
            return []
        config, out = self._config, []
        graph = self.graph()
        bent = np.linalg.inv(np.linalg.inv(graph.information) + BENT)
        information = np.where(graph.loop[:, None, None], graph.information, bent)
        known = covariances_from(new, self.poses, graph._replace(information=information))[:last]
        middles = np.array([self._middle(k) for k in range(last)])
        apart = np.hypot(*(middles - self._middle(new)).T)
        sd = np.sqrt(np.maximum(known[:, 0, 0], known[:, 1, 1]))
        near = np.flatnonzero(apart < config.length_m + SIGMAS * sd)
        for k in near[np.argsort(apart[near], kind="stable")][: config.compared].tolist():
            c, s = math.cos(self.poses[k, 2]), math.sin(self.poses[k, 2])
            turn = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
            covariance = turn @ known[k] @ turn.T + FLOOR
            spread = np.minimum(SIGMAS * np.array((sd[k], sd[k], math.sqrt(known[k, 2, 2]))), self._window)
            out.append((k, spread, np.linalg.inv(covariance)))
        return out

    def compare_all(self) -> None:
        """Hold the last finished submap against all candidates that are left."""
        while self.is_comparing:
            self._compare()

    def _compare(self) -> None:
        """Hold the last finished submap against the next candidate; after the last one, relax what loops were found."""
        earlier, window, prior = self._candidates.pop(0)
        self._try_loop(earlier, len(self.finished) - 1, window, prior)
        if not self.is_comparing and self.loops > self._loops_relaxed:
            self.poses = relaxed(self.poses, self.graph())
            self._loops_relaxed = self.loops

    def _loop_information(self, matched: Floats) -> Floats:
        """(3, 3) of a loop's edge, from that of its match: none along a corridor, and bounded everywhere."""
        strength, ways = np.linalg.eigh(matched[:2, :2])
        held = np.eye(3)
        held[:2, :2] = ways @ np.diag(strength >= HELD_BY / SAMPLE_SD_M**2) @ ways.T
        matched = held @ matched @ held
        place, heading = self._config.loop_sd_m, math.radians(self._config.loop_sd_deg)
        floor = np.diag((place, place, heading)) ** 2
        return np.asarray(np.linalg.inv(np.linalg.inv(TRUST * matched + 1e-3 * np.eye(3)) + floor), np.float64)

    def _add_edge(
        self, a: int, b: int, measured: Floats, information: Floats, loop: bool, by_wheels: float = 0.0
    ) -> None:
        self._ends.append((a, b))
        self._measured.append(measured)
        self._information.append(information)
        self._is_loop.append(loop)
        self._scales.append(self._scale_now)
        self._by_wheels.append(by_wheels)

    def graph(self) -> Edges:
        """What was measured between submaps. What wheels told of the way is as long as the present scale has it.

        In a long corridor the wheels' size is learned late, and no loop tells how large a ring is. Of 17 rings of 60 m
        a side the path came out 0.11 m off (rms; 0.18 at most), with the scale as it was when each part was driven;
        with that of the end 0.09 m (0.15). Walls need no scale: with all lengths changed, a log whose scans walls hold
        (csail-drift) was 0.097 m off instead of 0.079.
        """
        measured = np.array(self._measured).reshape(-1, 3)
        longer = self._scale_now / np.array(self._scales) - 1.0
        measured[:, :2] *= 1.0 + (np.array(self._by_wheels) * longer)[:, None]
        return Edges(np.array(self._ends), measured, np.array(self._information), np.array(self._is_loop))

    def _relative(self, a: int, b: int) -> Floats:
        """Pose (3,) of submap b in the frame of submap a."""
        return np.array(relative(pose_of(self.poses[a]), pose_of(self.poses[b])))

    def _middle(self, k: int) -> Floats:
        """(2,) mean place of a finished submap's views."""
        middle: Floats = apply(self.poses[k], self.finished[k].views[:, :2].mean(0, keepdims=True))[0]
        return middle

    def walls(self, layers: Sequence[Layer] = ()) -> Records:
        """(n,) of SEGMENT: the walls of all submaps as one map, by the poses that are known now.

        Of layers, maps of others in the own frame, those walls are added that do not lie beside own ones.
        """
        parts = [place.walls for place in self.finished] + [self._own.walls]
        walls = united([moved(part, pose) for part, pose in zip(parts, self.poses, strict=True)])
        for layer in layers:
            walls = np.concatenate((walls, _new_to(walls, segments_in(layer))))
        return walls


@kernel
def _share_of(prior: Floats, known: Floats, step: Floats) -> float:
    """Share of odometry, prior (3, 3), in what is known, (3, 3), of the length of a step (3,)."""
    x, y = step[0], step[1]
    told = prior[0, 0] * x * x + 2.0 * prior[0, 1] * x * y + prior[1, 1] * y * y
    both = known[0, 0] * x * x + 2.0 * known[0, 1] * x * y + known[1, 1] * y * y
    return told / both if both > 0.0 else 1.0


@kernel
def _carried(covariance: Floats, before: Floats, after: Floats) -> Floats:
    """(3, 3) of a pose (3,), as that of one before it in the same frame: what turns that one swings this one."""
    out, dx, dy = covariance.copy(), after[0] - before[0], after[1] - before[1]
    for k in range(3):
        out[0, k] -= dy * covariance[2, k]
        out[1, k] += dx * covariance[2, k]
    for k in range(3):
        turn = out[k, 2]
        out[k, 0] -= dy * turn
        out[k, 1] += dx * turn
    return out


@kernel
def _new_to(walls: Records, others: Records) -> Records:
    """Those of the segments (k,) of others, in the frame of the walls, that lie beside none for half their length."""
    new, tiles = np.zeros(len(others), np.bool_), tiles_of(walls)
    for k in range(len(others)):
        new[k] = share_beside(tiles, others[k : k + 1], LAID_M) < LAID_SHARE
    return others[new]
