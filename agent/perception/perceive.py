"""From a lidar scan to a corner scan (paper II): discs left out, then straight pieces, corners and labels.

Nothing else of the mind reads ranges (paper I, "strictly sparse").
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from agent.corner_scan import BRIDGE_M, NOISE_FLOOR_M, NOISE_SIGMAS, PIECE, CornerScan, Sight, noise_at, range_noise
from agent.geometry.clearance import distance_to_walls, walls_near
from agent.kernels import kernel
from agent.perception.beams import Beams, ring_of, width_of
from agent.perception.config import PerceptionConfig, Segmentation
from agent.perception.disc_memory import Posts, SeenDiscs
from agent.perception.discs import beams_on, find_discs, hidden_beams, peeping_beams
from agent.perception.median_scan import MedianScan, noise_of
from agent.perception.pieces import OPEN_BEAMS, RangeScan, pieces_of
from agent.perception.segmentation import MIN_HITS, piecewise
from agent.perception.split_and_merge import split_and_merge
from protocol.arrays import Bools, Floats, Ints
from protocol.geometry import Pose, apply, compose, pose_of, relative, seen_from
from protocol.messages import LidarSpec, Observation, RobotSpec
from protocol.walls import lengths
from protocol.wireframe import Wireframe

CLOSE_BEAMS = 3  # hits in a row that are close: one or two may be mixed readings at an edge
CLOSE_TICKS = 3  # what body or blind zone may reach in so many ticks is close: driving looks two ahead, and keeps air
DISC_MARGIN_M = 0.05  # a beam this near to where a teammate was a moment ago is on it: 5 standard deviations of a range
WALL_M = 0.3  # no teammate stands in a mapped wall of this length; a shorter one may be a teammate's front itself
TOUCH_RAD = math.radians(15.0)
"""View that must be too near to be measured where the robot touches something. A teammate's body takes 40 degrees of
it, beams that are lost because they graze a wall 4 at most."""
TOUCH_BEAMS = 5
"""Beams in a row that must not be measured for something to be that near; lost ones seldom are. When they counted one
by one, a robot whose lidar loses 5 % of them seemed to touch something all the time. It took its wheels to slip, knew
its place to 4 cm, and joined walls across doors: recall 0.1 to 0.74 in six runs instead of 1."""
BESIDE = 2.0
"""Least ranges within which a beam next to these must have met something. Beside open space, of which many drivers say
0, nothing is so near; of what touches the body, a teammate's round one is left at 1.5 at most."""
IN_WALL = 0.8
"""Share of the radius. A disc is a wall's where the point halfway from its centre to its front is nearer to a wall: to
one that merely fits a disc, the point lies half a radius behind; from a teammate's, any wall in view is a radius away.
In 8 runs of 3 robots 24 of 24,370 discs on teammates were lost so, and of 219,500 on anything else 10,700 left."""
NOT_BEYOND_M = 1.5  # walls beyond the lidar's range by more than this are on no disc that it shows
NO_WALLS, NO_PLACES, NO_DISCS = np.zeros((0, 4)), np.zeros((0, 3)), np.zeros((0, 2))


class Foreseen(NamedTuple):
    """What a robot knows of what stands around it, in its frame, metres."""

    teammates: Floats = NO_PLACES  # (k, 3) those seen a moment ago: centre and slack
    walls: Floats = NO_WALLS  # (m, 4) of the map, in which no teammate stands
    posts: Floats = NO_DISCS  # (p, 2) what is round and no teammate
    places: Floats = NO_PLACES  # (t, 3) where teammates say that they are, and by how much each may be off


NOTHING = Foreseen()


class Perception:
    """Turns observations into corner scans, and remembers posts, and teammates of the last scans."""

    def __init__(
        self, config: PerceptionConfig, spec: RobotSpec, *, alone: bool = False, bridge_m: float = BRIDGE_M
    ) -> None:
        """alone: no other robot is about, so that nothing round is a teammate. bridge_m: as in `perceive`."""
        self._method, self._spec, self._alone, self._bridge = config.method, spec, alone, bridge_m
        self._seen_discs, self._posts = SeenDiscs(spec), Posts(spec)
        self._median_scan = MedianScan(spec.lidar)
        self._tick = -1  # of the last observation
        self._discs = NO_DISCS  # (d, 2) discs of the last scan, whether they are teammates or not
        self._places = NO_PLACES  # (t, 3) where merged teammates said that they were, as of `see`
        self._map = Wireframe()
        self._walls = NO_WALLS  # (m, 4) walls of that map in which no teammate stands, metres

    def see(
        self,
        observation: Observation,
        way: Floats,
        start: Pose,
        known: Wireframe,
        heard: bool = False,
        places: Floats = NO_PLACES,
        *,
        strangers: bool = True,
    ) -> CornerScan:
        """Corner scan of an observation. Its discs are teammates: nobody after perception judges that again.

        way: (k + 1, 3) poses from the last observation to this one, in the frame of the first; that one is `start` in
        the frame of the map. known: the robot's map. heard: whether any message came in this tick. places: (t, 3)
        where merged teammates say that they are, in the frame of the map, and by how much each may be off; metres.
        strangers: whether any message that came may be of somebody else.
        """
        if known is not self._map:
            walls = known.segments()
            self._map, self._walls = known, walls[lengths(walls) >= WALL_M]
        x, y, theta = way[-1].tolist()
        predicted = compose(start, (x, y, theta))
        unrolled = _of_revolution(way, observation.tick - self._tick)
        self._tick = observation.tick
        if heard:
            self._posts.hear(observation.tick, predicted, stranger=strangers)
        company, ranges = self._posts.company(observation.tick), observation.scan()
        if self._spec.odometry.noisy and not self._median_scan.ended:
            self._median_scan.add(ranges, np.array(observation.odometry), _touching(ranges, self._spec))
        median_of = self._median_scan.number
        near = walls_near(self._walls, predicted[0], predicted[1], self._spec.lidar.range_max_m + NOT_BEYOND_M)
        scan = perceive(
            self._median_scan.median() if median_of else ranges,
            self._spec,
            self._method,
            way=unrolled,
            foreseen=Foreseen(
                self._seen_discs.expected(observation.odometry),
                seen_from(predicted, near.reshape(-1, 2)).reshape(-1, 4),
                self._posts.seen_from(predicted),
                np.column_stack((seen_from(predicted, places[:, :2]), places[:, 2])),
            ),
            alone=self._alone,
            company=company,
            median_of=median_of,
            bridge_m=self._bridge,
        )
        self._seen_discs.add(observation.odometry, scan.discs)
        self._discs, self._places = scan.discs, places
        return scan if company else replace(scan, discs=NO_DISCS)

    @property
    def takes_as_one(self) -> bool:
        """Whether the last scan was taken as one with those before it, as the robot stands where it began."""
        return self._median_scan.number > 0

    def take_scans(self, number: int) -> None:
        """Take so many scans as one while the robot stands where it began, or as many as it takes anyway."""
        self._median_scan.most = max(self._median_scan.most, number)

    def remember(self, tick: int, pose: Pose) -> None:
        """Note where the last scan's discs are, once the pose is corrected."""
        self._posts.add(tick, apply(pose, self._discs), self._places)

    def forget_posts(self) -> None:
        """The map was torn and is merged anew: posts are elsewhere in it."""
        self._posts.forget()


def _of_revolution(way: Floats, ticks: int) -> Floats:
    """The way of the last revolution, of a way (k + 1, 3) since the last scan, so many ticks ago.

    Where scans were missed, odometry does not tell where it began: its first step is taken to be like the second, and
    where it tells one step a scan, that to be as long in each tick.
    """
    if ticks == 1:
        return way
    if len(way) < 3:
        return np.vstack(((1.0 - 1.0 / max(ticks, 1)) * way[1], way[1:]))
    first, second = pose_of(way[1]), pose_of(way[2])
    return np.vstack((compose(first, relative(second, first)), way[1:]))


def perceive(
    ranges: Floats,
    spec: RobotSpec,
    method: Segmentation = "piecewise",
    *,
    way: Floats | None = None,
    foreseen: Foreseen = NOTHING,
    alone: bool = False,
    company: bool = True,
    median_of: int = 0,
    bridge_m: float = BRIDGE_M,
) -> CornerScan:
    """Corner scan of a revolution of the lidar, in the robot's frame at its stamp.

    ranges: (beams,) float64 metres, inf where nothing came back, NaN or 0 where nothing was measured. What is more
    than 1 m beyond the lidar's range counts as inf. way: (k + 1, 3) odometry poses at equal steps from the
    start of the revolution to the stamp, in a frame of their own; None where the robot stood. alone: whether nothing
    round can be a teammate. company: whether somebody may be near; else beams on discs tell of walls, too.
    median_of: of how many scans of a robot that stands the ranges are the median; 0 where they are one scan.
    bridge_m: up to so far apart, two neighbouring hits of a sure line show that there is wall between them.

    The scan's discs are those that may be teammates, whether there is company or not.
    """
    lidar, radius = spec.lidar, spec.radius_m
    beams = ring_of(_possible(ranges, lidar.range_max_m + 1.0), lidar, way)
    noise = noise_at(lidar, np.minimum(beams.distances, lidar.range_max_m))
    noise = noise_of(noise, median_of) if median_of else noise
    discs, hidden, used = _teammates(beams, noise, foreseen, radius, alone, company)
    pieces, explained = np.zeros(0, PIECE), np.zeros(len(hidden), np.bool_)
    if len(used) >= MIN_HITS:
        cut = piecewise if method == "piecewise" else split_and_merge
        # however exact a median is, what is uneven has no corners
        cuts, sums = cut(beams.distances[used], beams.bearings[used], np.maximum(noise[used], NOISE_FLOOR_M))
        silence = 1 if lidar.dropout == 0 else 2  # one may have dropped out, two in a row went through
        unit, farthest = range_noise(lidar), lidar.range_max_m
        range_scan = RangeScan(beams, noise, hidden, used, farthest, silence, unit, lidar.noise_share > 0, bridge_m)
        pieces, explained = pieces_of(range_scan, cuts, sums)
    reach = lidar.range_max_m - NOISE_SIGMAS * float(noise_at(lidar, np.array(lidar.range_max_m)))
    sight = Sight(*_open_and_blind(beams, hidden, explained), reach, 0.5 * beams.step, beams.shift)
    touching = median_of == 0 and _touching(ranges, spec)  # the median has no range where the lidar cuts some off
    reach_m = max(radius, lidar.range_min_m) + CLOSE_TICKS * spec.max_speed_mps / lidar.rate_hz
    close = _close_sectors(beams, explained, discs if company else NO_DISCS, radius, reach_m)
    return CornerScan(pieces, sight, discs, close, touching, median_of)


@kernel
def _teammates(
    beams: Beams, noise: Floats, foreseen: Foreseen, radius: float, alone: bool, company: bool
) -> tuple[Floats, Bools, Ints]:
    """Discs that may be teammates (d, 2), which beams (n,) tell nothing of walls, and the rows (m,) of those that may.

    Arguments as in `perceive`. One kernel for all of it: each call of one takes as long as the work of most of them.
    """
    expected, known, posts, places = foreseen
    discs = np.zeros((0, 2)) if alone else find_discs(beams, noise, radius)
    discs = discs[_may_be_teammates(discs, known, posts, radius)]
    hidden = np.isnan(beams.ranges)
    if company:
        centres = np.empty((len(expected), 2))
        centres[:, 0], centres[:, 1] = expected[:, 0], expected[:, 1]
        expected = expected[_may_be_teammates(centres, known, posts, radius)]
        unmeasured, teammates = hidden, beams_on(beams, expected, radius, DISC_MARGIN_M)
        hidden = unmeasured | hidden_beams(beams, discs, radius) | teammates
        unseen = places[~_are_at(places, discs)]
        hidden |= peeping_beams(beams, hidden, teammates | _in_gap(unmeasured), unseen, radius)
    return discs, hidden, np.flatnonzero(np.isfinite(beams.ranges) & ~hidden)


@kernel
def _in_gap(unmeasured: Bools) -> Bools:
    """(n,) which of the beams that were not measured have a neighbour that was not: behind these somebody may stand.

    One alone hides nobody. The seam of a revolution is one, straight ahead of a robot that goes and looks at a post: in
    company it was never seen from there.
    """
    out = np.zeros(len(unmeasured), np.bool_)
    for k in range(len(out)):
        out[k] = unmeasured[k] and (unmeasured[k - 1] or unmeasured[(k + 1) % len(out)])
    return out


@kernel
def _are_at(places: Floats, discs: Floats) -> Bools:
    """(t,) at which of places (t, 3), centre and slack, one of discs (d, 2) is."""
    out = np.zeros(len(places), np.bool_)
    for t in range(len(places)):
        for d in range(len(discs)):
            out[t] |= math.hypot(places[t, 0] - discs[d, 0], places[t, 1] - discs[d, 1]) <= places[t, 2]
    return out


@kernel
def _possible(ranges: Floats, most: float) -> Floats:
    """Ranges (beams,), inf beyond the most that is possible, NaN where none is: many lidars say 0 for not measured."""
    out = ranges.copy()
    for k in range(len(out)):
        if out[k] > most:
            out[k] = math.inf
        elif out[k] <= 0.0:
            out[k] = math.nan
    return out


def _touching(ranges: Floats, spec: RobotSpec) -> bool:
    """Whether the body may touch something: much of the view (beams,) is nearer than its edge, or than any range."""
    lidar, edges = spec.lidar, _edges(spec.lidar, spec.radius_m)
    many = min(TOUCH_BEAMS, math.ceil(TOUCH_RAD / lidar.beam_step))
    return _number_near(ranges, edges, range_noise(lidar), lidar.range_min_m, many) * lidar.beam_step > TOUCH_RAD


@lru_cache
def _edges(lidar: LidarSpec, radius: float) -> Floats:
    """(beams,) metres from the lidar to where its beams leave the body, 0 where they miss it; not to be changed."""
    x, y, bearings = lidar.mount_x_m, lidar.mount_y_m, lidar.bearings()
    inward = -x * np.cos(bearings) - y * np.sin(bearings)
    half_chord2 = radius**2 - (x**2 + y**2 - inward**2)
    return np.where(half_chord2 > 0.0, inward + np.sqrt(np.maximum(half_chord2, 0.0)), 0.0)


@kernel
def _number_near(ranges: Floats, edges: Floats, noise: float, least: float, many: int) -> int:
    """How many of ranges (beams,) are nearer than the body's edges (beams,), or than the least that is measured.

    Those were not measured, many in a row, and what is next to them is near. noise: of a range. All in metres.
    """
    n, near, measured = len(ranges), 0, np.flatnonzero(ranges > 0.0)
    for m in range(len(measured)):
        first, after = measured[m], measured[(m + 1) % len(measured)]
        near += ranges[first] < edges[first] + noise
        missing = (after - first - 1) % n
        if missing >= many and min(ranges[first], ranges[after]) < BESIDE * least:
            for k in range(first + 1, first + 1 + missing):
                near += edges[k % n] <= least
    return near


@kernel
def _may_be_teammates(discs: Floats, known: Floats, posts: Floats, radius: float) -> Bools:
    """(d,) which discs (d, 2) are neither on a known wall (m, 4) nor on a post (p, 2); robot's frame, metres."""
    out = np.empty(len(discs), np.bool_)
    for d in range(len(discs)):
        x, y = discs[d]
        share = 1.0 - 0.5 * radius / max(math.hypot(x, y), radius)
        out[d] = distance_to_walls(x * share, y * share, known) > IN_WALL * radius
        for p in range(len(posts)):
            out[d] &= math.hypot(x - posts[p, 0], y - posts[p, 1]) > radius
    return out


@kernel
def _open_and_blind(beams: Beams, hidden: Bools, explained: Bools) -> tuple[Floats, Floats]:
    """The sectors of Sight. hidden, explained: (n,) beams that tell nothing of walls, and those that are on a piece."""
    returned = np.isfinite(beams.ranges)
    return _sectors(~returned & ~hidden, beams, OPEN_BEAMS), _sectors((returned | hidden) & ~explained, beams, 1)


@kernel
def _close_sectors(beams: Beams, explained: Bools, discs: Floats, radius: float, reach: float) -> Floats:
    """(s, 3) sectors, as in Sight, of hits within reach that are on no piece and on no disc (d, 2)."""
    near = np.isfinite(beams.ranges) & (beams.distances < reach) & ~explained
    if not near.any():
        return np.zeros((0, 3))
    exact = np.zeros((len(discs), 3))
    exact[:, :2] = discs
    near &= ~beams_on(beams, exact, radius, DISC_MARGIN_M)
    return _sectors(near, beams, CLOSE_BEAMS)


@kernel
def _sectors(marked: Bools, beams: Beams, least: int) -> Floats:
    """(s, 3) sectors, as in Sight, of runs of at least so many marked beams (n,) of a ring.

    From and to in radians, and metres to the nearest hit: inf without hits, 0 where a beam was not measured.
    """
    n, unmarked = len(marked), np.flatnonzero(~marked)
    far = np.where(np.isnan(beams.ranges), 0.0, beams.distances)
    if len(unmarked) == 0:
        return np.array([[0.0, 2 * math.pi, far.min()]])
    out, count, run, near = np.empty((n, 3)), 0, 0, math.inf
    for k in range(unmarked[0], unmarked[0] + n + 1):
        if marked[k % n]:
            run += 1
            near = min(near, far[k % n])
            continue
        if run >= least:
            width = width_of(beams, k - run, k - 1)
            first = beams.bearings[(k - run) % n] + min(width, 0.0)  # parallax may swap two beams
            out[count, 0] = first % (2 * math.pi)
            out[count, 1] = out[count, 0] + abs(width)
            out[count, 2] = near
            count += 1
        run, near = 0, math.inf
    return out[:count].copy()
