"""The walls of one particle as an array of records: each remembers its line, its ends and its evidence.

A wall's line is the total-least-squares fit of all hits it ever got, kept as six sums, so its covariance is
closed form. Corners are where linked walls meet: they follow their lines and are stored nowhere.
"""

import math

import numpy as np

from agent.corner_scan import FRONTIER, NOMINAL, OCCLUSION
from agent.geometry.lines import MIN_CORNER_SINE, Record, along, meet, pool
from agent.kernels import kernel
from agent.mapping.slots import forget_bare, slot_before
from agent.state import LARGEST
from protocol.arrays import Records
from protocol.geometry import wrapped

FREE, WALL, TENTATIVE = 0, 1, 2  # a record holds nothing, a wall, or hits on one line that are too few yet to be a wall
CONFIRMATIONS = 30.0
"""Views that an end or a wall is confirmed by, at most: so 50 scans that see that it is wrong undo it, however long it
was confirmed."""
PUBLISH_AFTER = 2.0  # scans that must hit a wall before it is in the published map: one may be a false piece
SLOT_SINE = math.sin(math.radians(45.0))
"""Least sine of the turn at a corner beside which a slot may be: there, hits up to 4 cm before it, which is the least
slot, lie on both lines within 3 sd of a range. In `made.traced`, inner corners of 23 degrees passed for slots of 3 to
8 cm, so that both walls ended up to 10 cm beyond it and crossed."""
MIN_WALL_M = 0.05  # shorter remainders of a wall that was cut, and shorter walls of received maps, are left away

EDGE = np.dtype(
    [
        ("kind", "i8"),  # FREE, WALL or TENTATIVE
        ("own", "i8"),  # 1: seen by this robot itself
        ("hits", "f8"),  # beams on the wall: weight of the line
        ("x", "f8"),  # m, centroid of the hits, on the line
        ("y", "f8"),
        ("xx", "f8"),  # m2, scatter of the hits about the centroid
        ("xy", "f8"),
        ("yy", "f8"),
        ("bend", "f8", (2,)),  # of the hits, as in PIECE, summed over all pieces
        ("ux", "f8"),  # unit direction from tail to head: free space on the left
        ("uy", "f8"),
        ("tip", "f8", (2, 2)),  # m, how far the wall was seen: tail and head
        ("slack", "f4", (2,)),  # m by which an occlusion end may lie farther out
        ("label", "i8", (2,)),  # Label of tail and head
        ("link", "i8", (2,)),  # the wall that shares the corner at tail and head, or -1
        ("strength", "f4", (2,)),  # views that confirmed the end: its corner, or where it lies
        ("conflict", "f4", (2,)),  # views that spoke against the end as it is
        ("bare", "f4", (2, 5)),  # what views tell of a slot before the corner (`slots`)
        ("seen", "f4"),  # scans that hit the wall
        ("due", "f4"),  # scans that should have
        ("misses", "f4"),  # scans in a row that should have hit it and did not
        ("probation", "i8"),  # 1: unconfirmed, dropped after a few misses
        ("through", "f4"),  # scans that saw through `gap`, less those that have hit the wall since
        ("gap", "f4", (2, 2)),  # m, the part seen through: from and to
        ("relative", "f8", (3,)),  # covariance of the line as seen from the robot (`related`): m2, m, 1
        ("strain", "f4", (2,)),  # means of how far pieces lie beside its line, and are turned, in deviations (`strain`)
        ("held", "i8", (2,)),  # 1: the joint covariance tells how well the end is known
        ("tip_sd", "f8", (2,)),  # m, standard deviation of the ends along the wall as seen from the robot; 0: not known
        ("twin", "i8"),  # 1 + the wall that this scan cut it out of or joined it into, until `know_walls`; 0: none
    ],
    align=True,
)
"""One wall. An aligned record, so that numba reads its fields like attributes."""
EDGE_BYTES = EDGE.itemsize - sum(EDGE[name].itemsize for name in ("relative", "held", "tip_sd", "twin"))
"""Bytes that a wall needs between scans; what is left out is worked out anew in each."""


def check_records(edges: Records) -> None:
    """Raise ValueError where records (n,) from a file make no sense, as kernels trust them."""
    numbers = [edges[name] for name in EDGE.names or () if edges[name].dtype.kind == "f"]
    whole = {
        "kind": (0, 2),
        "own": (0, 1),
        "label": (0, 2),
        "link": (-1, len(edges) - 1),
        "twin": (0, len(edges)),
        "held": (0, 1),
        "probation": (0, 1),
    }
    if not all((np.abs(values) <= LARGEST).all() for values in numbers):
        raise ValueError("a wall has a number that is not finite or too large")
    if not all(((edges[name] >= low) & (edges[name] <= high)).all() for name, (low, high) in whole.items()):
        raise ValueError("a wall has a kind, a label or a link that there is not")


@kernel
def tip_at(e: Record, side: int) -> float:
    """Coordinate of an end along the wall."""
    return along(e, e.tip[side, 0], e.tip[side, 1])


@kernel
def has_slot(edges: Records, e: int, f: int) -> bool:
    """Whether a slot is beside the corner that the head of e seems to share with the tail of f.

    Where the pose errs, a slot counts only before the corner that it was seen at. Views of a wall that was mapped too
    long show its true end, which seems to be the mouth of a slot, and most are from too far off to take that back.
    """
    if not may_hide_slot(edges[e], edges[f]):
        return False
    slot_e, slot_f = slot_before(edges[e], 1), slot_before(edges[f], 0)
    if edges[e].link[1] != f and related(edges[e]) and related(edges[f]):
        beyond_e = meet(edges[e], edges[f])[1] - tip_at(edges[e], 1)
        beyond_f = tip_at(edges[f], 0) - meet(edges[f], edges[e])[1]
        return (slot_e > 0.0 and beyond_e > 0.5 * slot_e) or (slot_f > 0.0 and beyond_f > 0.5 * slot_f)
    return slot_e > 0.0 or slot_f > 0.0


@kernel
def may_hide_slot(e: Record, f: Record) -> bool:
    """Whether a slot may be beside the corner of the head of e and the tail of f: it stands back, and is not blunt.

    Behind a corner that stands out into the room no wall goes on. Before a blunt one hits lie on either line within
    noise, so that one wall ends early and the other late wherever the lidar is.
    """
    return bool(meet(e, f)[0] > SLOT_SINE)


@kernel
def set_tip(e: Record, side: int, t: float) -> None:
    """Put an end at a coordinate along the wall."""
    e.tip[side, 0] = e.x + t * e.ux
    e.tip[side, 1] = e.y + t * e.uy


@kernel
def length(e: Record) -> float:
    """Length of a wall, metres."""
    return tip_at(e, 1) - tip_at(e, 0)


@kernel
def shared_length(e: Record, f: Record) -> float:
    """Length that two walls have beside each other, along the first one, metres; negative is a gap."""
    high = min(tip_at(e, 1), along(e, f.tip[1, 0], f.tip[1, 1]))
    return high - max(tip_at(e, 0), along(e, f.tip[0, 0], f.tip[0, 1]))


@kernel
def spread(e: Record) -> float:
    """Sum of squared distances of the hits from the centroid along the wall, m2."""
    return max(e.xx * e.ux * e.ux + 2 * e.xy * e.ux * e.uy + e.yy * e.uy * e.uy, 1e-9)


@kernel
def squares_beside(e: Record) -> float:
    """Sum of squared distances of the hits from the wall's line, m2."""
    return e.xx * e.uy * e.uy - 2 * e.xy * e.ux * e.uy + e.yy * e.ux * e.ux


@kernel
def scatter(p: Record) -> tuple[float, float, float]:
    """Scatter xx, xy, yy of a piece's hits about its centroid, m2."""
    xx = p.spread * p.ux * p.ux + p.residual * p.uy * p.uy
    yy = p.spread * p.uy * p.uy + p.residual * p.ux * p.ux
    return xx, (p.spread - p.residual) * p.ux * p.uy, yy


@kernel
def related(e: Record) -> bool:
    """Whether the joint covariance with the robot's pose says how well the line is known, and not its hits alone."""
    return bool(e.relative[0] > 0.0)


@kernel
def line_sd(e: Record, t: float, noise: float) -> float:
    """Standard deviation of the line across its direction, at coordinate t; if related, as the robot sees it."""
    if related(e):
        return math.sqrt(max(e.relative[0] + 2.0 * t * e.relative[1] + t * t * e.relative[2], 0.0))
    return noise * math.sqrt(1.0 / e.hits + t * t / spread(e))


@kernel
def direction_sd(e: Record, noise: float) -> float:
    """Standard deviation of the line's direction, rad."""
    return math.sqrt(max(e.relative[2], 0.0)) if related(e) else noise / math.sqrt(spread(e))


@kernel
def is_published(e: Record) -> bool:
    """Whether a record is a wall that enough scans have hit."""
    return bool(e.kind == WALL and e.seen >= PUBLISH_AFTER)


@kernel
def take_hits(e: Record, p: Record) -> None:
    """Take the hits of a piece on the line of e; it stays where it is where the joint estimate holds it."""
    for k in range(2):
        e.bend[k] += p.bend[k]
    if related(e):
        count_hits(e, p.hits, along(e, p.x, p.y), p.spread)
    else:
        add_hits(e, p.hits, p.x, p.y, scatter(p))


@kernel
def count_hits(e: Record, hits: float, t: float, size: float) -> None:
    """Count hits at coordinate t along a wall, of spread `size` m2, whose line the joint estimate holds."""
    more = size + hits * t * t
    e.hits += hits
    e.xx += more * e.ux * e.ux
    e.xy += more * e.ux * e.uy
    e.yy += more * e.uy * e.uy


@kernel
def add_hits(e: Record, hits: float, x: float, y: float, moments: tuple[float, float, float]) -> None:
    """Fuse hits (count, centroid, moments xx, xy, yy about it) into the wall's line; ends keep their places."""
    pool(e, hits, x, y, moments)
    for side in range(2):
        set_tip(e, side, tip_at(e, side))


@kernel
def keep_share(e: Record, share: float) -> None:
    """Keep a share of the hits on a wall of which only a part is left; its line, and where they lie, stay the same.

    So parts of a wall that are joined again have no more hits than the wall had.
    """
    e.hits *= share
    e.xx, e.xy, e.yy = share * e.xx, share * e.xy, share * e.yy
    e.bend[0], e.bend[1] = share * e.bend[0], share * e.bend[1]


@kernel
def set_end(e: Record, side: int, label: int, slack: float, strength: float) -> None:
    """Replace what is known of an end but for its place and link; no view speaks against it yet."""
    e.label[side], e.slack[side], e.strength[side], e.conflict[side] = label, slack, strength, 0.0


@kernel
def join(edges: Records, e: int, f: int, strength: float) -> None:
    """Let the head of e and the tail of f share a corner."""
    edges[e].link[1], edges[f].link[0] = f, e
    forget_bare(edges[e], 1)
    forget_bare(edges[f], 0)
    set_end(edges[e], 1, NOMINAL, 0.0, strength)
    set_end(edges[f], 0, NOMINAL, 0.0, strength)
    settle_corner(edges, e)


@kernel
def settle_corner(edges: Records, e: int) -> None:
    """Move the ends that meet at the head of e to where the lines meet; lines that hardly cross leave them there."""
    f = edges[e].link[1]
    sine, t = meet(edges[e], edges[f])
    if abs(sine) >= MIN_CORNER_SINE:
        set_tip(edges[e], 1, t)
        edges[f].tip[0] = edges[e].tip[1]


@kernel
def part(edges: Records, e: int, side: int) -> None:
    """Undo a link; both ends are frontiers again, and both walls on probation. A wall ends before a slot, if one is."""
    f = edges[e].link[side]
    if f < 0:
        return
    hides = has_slot(edges, e, f) if side == 1 else has_slot(edges, f, e)
    for k, s in ((e, side), (f, 1 - side)):
        slot = slot_before(edges[k], s) if hides else 0.0
        set_tip(edges[k], s, tip_at(edges[k], s) - (slot if s == 1 else -slot))
        set_end(edges[k], s, OCCLUSION if slot > 0.0 else FRONTIER, 0.0, 0.0)
        edges[k].link[s], edges[k].probation = -1, 1


@kernel
def put_on_probation(e: Record) -> None:
    """Let a few misses in a row drop a wall, until it is hit again (ours).

    What was on probation already keeps its misses: a stump was cut every few scans, and so was there for good.
    """
    if e.probation == 0:
        e.misses = 0.0
    e.probation, e.through = 1, 0.0


@kernel
def doubt(e: Record) -> None:
    """Take back what confirmed a wall: it is not shown until it is hit again, and a few misses drop it (ours).

    What is left of a wall that was cut, or that lost its corner to another, may lie inside solid, where no view
    speaks against it. A true wall is soon hit again: the ends beside it draw the robot there.
    """
    put_on_probation(e)
    e.seen, e.due = 0.0, 0.0


@kernel
def open_end(e: Record, side: int, t: float) -> None:
    """Let a wall end at coordinate t by a frontier."""
    set_end(e, side, FRONTIER, 0.0, 0.0)
    set_tip(e, side, t)
    forget_bare(e, side)


@kernel
def cut_out(edges: Records, count: int, e: int, low: float, high: float) -> tuple[int, int]:
    """Cut what is between two coordinates out of the middle of a wall, which ends by frontiers there.

    Returns the number of the wall beyond, -1 where there is no room for one and it is lost, and the new count.
    """
    tail, head = tip_at(edges[e], 0), tip_at(edges[e], 1)
    f, count = free_record(edges, count)
    if f >= 0:
        edges[f] = edges[e]
        edges[f].twin = e + 1
        if edges[e].link[1] >= 0:
            edges[edges[e].link[1]].link[0] = f
            edges[e].link[1] = -1
        edges[f].link[0] = -1
        keep_share(edges[f], (head - high) / (head - tail))
        open_end(edges[f], 0, high)
    part(edges, e, 1)
    keep_share(edges[e], (low - tail) / (head - tail))
    open_end(edges[e], 1, low)
    return f, count


@kernel
def remove(edges: Records, e: int) -> None:
    """Take a wall out of the map."""
    part(edges, e, 0)
    part(edges, e, 1)
    edges[e].kind, edges[e].twin = FREE, 0


@kernel
def free_record(edges: Records, count: int) -> tuple[int, int]:
    """A free record and the new count; (-1, count) if the array is full.

    One of a wall that this scan has joined into another is not free yet: the joint estimate still asks for both.
    """
    for k in range(count):
        if edges[k].kind == FREE and edges[k].twin == 0:
            return k, count
    return (count, count + 1) if count < len(edges) else (-1, count)


@kernel
def common_axis(edges: Records, count: int) -> tuple[float, float]:
    """Direction of a particle's walls modulo a right angle, and how well they agree in it: 0 not at all, 1 all."""
    c, s, total = 0.0, 0.0, 1e-9
    for e in range(count):
        if edges[e].kind == WALL:
            angle, size = 4 * math.atan2(edges[e].uy, edges[e].ux), length(edges[e])
            c += size * math.cos(angle)
            s += size * math.sin(angle)
            total += size
    return 0.25 * math.atan2(s, c), math.hypot(c, s) / total if total > 1.0 else 0.0


@kernel
def off_axis(e: Record, angle: float) -> float:
    """By how much a wall is turned against an axis, rad, modulo a right angle."""
    return wrapped(math.atan2(e.uy, e.ux) - angle, 0.5 * math.pi)
