"""Alignment of two maps: found where they share enough, and no word where they do not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from agent.alignment.agreement import agreement, beside, index_walls
from agent.alignment.align import Alignment, Method, align_prepared, by_features
from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.alignment.feature import AT_LEAST, EXACT, UNKNOWN, corners, likeness
from agent.alignment.free_space import free_space_of
from agent.alignment.prepared import prepare
from agent.geometry.transform import inverse
from deploy.bench.errors import distance
from protocol.geometry import apply
from protocol.wireframe import Label, Wireframe
from world.maze import generate
from world.worldfile import from_document

CONFIG = AlignmentConfig()
RNG = np.random.default_rng(0)


def chain(*polylines: list[tuple[float, float]], label: Label = Label.FRONTIER) -> Wireframe:
    """Polylines as chains with open ends; one that ends where it began is a ring."""
    points: list[tuple[float, float]] = []
    edges: list[tuple[int, int]] = []
    labels: list[int] = []
    for line in polylines:
        closed = line[0] == line[-1]
        corners = line[:-1] if closed else line
        first, n = len(points), len(corners)
        points += corners
        labels += [Label.NOMINAL] * n
        if not closed:
            labels[first] = labels[-1] = label
        edges += [(first + k, first + (k + 1) % n) for k in range(n if closed else n - 1)]
    n, m = len(points), len(edges)
    return Wireframe(
        np.array(points, np.float64).reshape(n, 2), np.array(labels, np.uint8), np.array(edges, np.int32).reshape(m, 2),
        np.ones(m, np.float32), np.ones(m, np.bool_),
    )  # fmt: skip


def moved(wireframe: Wireframe, by: np.ndarray, noise: float = 0.0, seed: int = 0) -> Wireframe:
    shift = np.random.default_rng(seed).normal(0.0, noise, wireframe.points.shape)
    return replace(wireframe, points=apply(np.asarray(by, np.float64), wireframe.points + shift))


def maze(seed: int, side: float = 9.0) -> Wireframe:
    """The outline of a generated maze as a whole map."""
    world = from_document(generate(side, side, np.random.default_rng(seed)))
    rings = [[(float(x), float(y)) for x, y in ring] for part in world.free for ring in world.outline(part)]
    return chain(*[[*ring[:-1], ring[0]] for ring in rings])


def part_of(wireframe: Wireframe, low: float, high: float) -> Wireframe:
    """Walls between two abscissas, as a robot would have them that saw nothing else: cut ends are frontiers."""
    inside = (wireframe.points[:, 0] >= low) & (wireframe.points[:, 0] <= high)
    keep = inside[wireframe.edges].all(1)
    edges = wireframe.edges[keep]
    used, index = np.unique(edges, return_inverse=True)
    labels = wireframe.labels[used].copy()
    index = index.reshape(-1, 2)
    degree = np.bincount(index.reshape(-1), minlength=len(used))
    labels[degree < 2] = Label.OCCLUSION
    m = len(edges)
    return Wireframe(wireframe.points[used], labels, index.astype(np.int32), np.ones(m, np.float32), np.ones(m, bool))


def found(mine: Wireframe, theirs: Wireframe, method: Method = by_features, **config: object) -> Alignment:
    rules = AlignmentConfig.model_validate(config)
    maps = prepare(mine, rules), prepare(theirs, rules)
    return align_prepared(*maps, rules, np.random.default_rng(1), method)


def off(alignment: Alignment, truth: np.ndarray, theirs: Wireframe) -> tuple[float, float]:
    assert alignment.transform is not None
    return distance(np.array(alignment.transform), np.asarray(truth), theirs.points.mean(0))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("drawing", ["ranked", "random"])
def test_two_views_of_one_maze_are_laid_on_each_other(seed: int, drawing: str) -> None:
    whole = maze(seed)
    x0, x1 = whole.points[:, 0].min(), whole.points[:, 0].max()
    mine, theirs = part_of(whole, x0, x0 + 0.75 * (x1 - x0)), part_of(whole, x0 + 0.25 * (x1 - x0), x1)
    frame = np.random.default_rng([seed, 9]).uniform((-20, -20, -math.pi), (20, 20, math.pi))
    theirs = moved(theirs, frame, 0.005, seed)
    said = found(mine, theirs, drawing=drawing)
    assert said.reason == "aligned"
    metres, turn = off(said, inverse(frame), theirs)
    assert metres < 0.05 and turn < math.radians(1.0)
    assert said.inliers >= 6 and said.residual < 0.03 and said.conflict < 0.5


def test_maps_of_two_buildings_are_not_aligned() -> None:
    said = [found(maze(k), moved(maze(k + 50), np.array([3.0, 1.0, 2.0]))) for k in range(6)]
    assert all(one.transform is None for one in said)
    assert all(one.reason != "aligned" for one in said)


def test_a_mirrored_map_is_another_building() -> None:
    whole = maze(2)
    mirrored = replace(whole, points=whole.points * (-1.0, 1.0), edges=whole.edges[:, ::-1].copy())
    assert found(whole, mirrored).transform is None


def test_small_and_large_maps_wait() -> None:
    room = chain([(0, 0), (3, 0), (3, 2), (1, 2), (1, 3), (0, 3), (0, 0)])
    assert found(room, room).reason == "small"
    assert found(maze(0), maze(0), max_walls=20).reason == "large"
    assert found(Wireframe(), Wireframe()).reason == "small"


L_ROOM = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (2.5, 3.0), (2.5, 4.0), (0.0, 4.0), (0.0, 0.0)]


def test_twin_rooms_in_one_map_make_any_fit_on_one_of_them_ambiguous() -> None:
    def at(x: float, y: float) -> list[tuple[float, float]]:
        return [(px + x, py + y) for px, py in L_ROOM]

    mine = chain(at(0, 0), at(6, 0), at(12, 0), at(18, 0))
    theirs = moved(chain(at(0, 0), at(6, 0), at(12, 0)), np.array([1.0, 2.0, 0.5]))
    said = found(mine, theirs)
    assert said.reason == "ambiguous" and said.transform is None and said.margin < CONFIG.margin
    assert said.best is not None
    assert found(mine, theirs, repetition=False, margin=0.0).reason == "aligned"


def test_a_row_of_twins_is_ambiguous_though_only_one_transform_lays_all_of_it_on_itself() -> None:
    row = chain(*[[(px + 6.0 * k, py) for px, py in L_ROOM] for k in range(4)])
    theirs = moved(row, np.ones(3))
    assert found(row, theirs).reason == "ambiguous"  # it may lie farther on, beyond what either has seen


@pytest.mark.parametrize(("size", "reason"), [(1.0, "aligned"), (0.3, "weak")])
def test_four_corners_in_common_suffice_where_long_walls_agree(size: float, reason: str) -> None:
    shared = [(0.0, 0.0), (8.0, 0.0), (8.0, 5.0), (20.0, 5.0), (20.0, 9.0), (26.0, 9.0)]
    mine = [(-30.0, 0.0), (-30.0, 3.0), (-33.0, 3.0), (-33.0, 4.0)]
    theirs = [(50.0, 20.0), (52.0, 20.0), (52.0, 27.0), (53.0, 27.0)]
    maps = (chain([(size * x, size * y) for x, y in shared], other) for other in (mine, theirs))
    said = found(next(maps), moved(next(maps), (3.0, -2.0, 0.7)), min_corners=6)
    assert (said.reason, said.inliers) == (reason, 4)


def test_what_a_map_has_from_others_is_not_aligned() -> None:
    whole = maze(1)
    heard = replace(whole, own=np.zeros(len(whole.edges), np.bool_))
    assert found(whole, heard).reason == "small"


def test_an_encounter_allows_no_transform_that_puts_robots_out_of_range_or_into_walls() -> None:
    whole = maze(3)
    frame = np.array([4.0, -2.0, 1.2])
    theirs = moved(whole, frame)
    ring = whole.points[whole.edges[:, 0]]
    spot = np.array([ring[:, 0].min() + 0.5, ring[:, 1].min() + 0.5])
    there = apply(frame, spot[None])[0]

    said, maps = found(whole, theirs), [prepare(one, AlignmentConfig()) for one in (whole, theirs)]
    spaces = [one.free_space for one in maps if one is not None]

    def allowed(x: float, y: float, range_m: float) -> bool:
        encounter = Encounter((x, y, 0.0), (float(there[0]), float(there[1]), 0.0))
        return bool(encounter.allows(np.array([said.transform]), *spaces, range_m, 0.1)[0])

    assert allowed(spot[0] + 0.4, spot[1], 4.0)
    assert not allowed(spot[0] + 0.4, spot[1], 0.05)
    assert not allowed(-5.0, -5.0, 40.0)


def test_a_place_is_inside_outer_rings_and_outside_pillars() -> None:
    room = chain([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0)], [(1, 1), (1, 2), (2, 2), (2, 1), (1, 1)])
    made = corners(room)
    ground = free_space_of(made.points, made.parent, made.child, made.walls)
    spots = np.array([(0.5, 0.5), (1.5, 1.5), (-1.0, 1.0), (0.05, 2.0), (3.0, 3.0)])
    assert ground.holds(spots, 0.1).tolist() == [True, False, False, False, True]


def test_the_same_maps_and_generator_give_the_same_alignment() -> None:
    whole, theirs = maze(0), moved(maze(0), np.array([1.0, 2.0, 3.0]), 0.01)
    assert found(whole, theirs) == found(whole, theirs)


def test_entries_beyond_the_end_of_a_chain_are_unknown_and_cut_walls_lower_bounds() -> None:
    made = corners(chain([(0, 0), (2, 0), (2, 3), (5, 3)]))
    assert made.kinds[1].tolist() == [UNKNOWN, AT_LEAST, EXACT, AT_LEAST, UNKNOWN, EXACT, EXACT]
    assert made.values[1, [1, 2, 3]] == pytest.approx([2.0, 3.0, 3.0])
    assert made.values[1, [5, 6]] == pytest.approx([math.pi / 2, -math.pi / 2])


def test_a_wall_seen_longer_than_it_can_be_counts_hard() -> None:
    whole = corners(chain([(0, 0), (4, 0), (4, 3), (0, 3), (0, 0)]))
    short, long = (corners(chain([(5.0 - x, 0), (5, 0), (5, 3), (1, 3)])) for x in (3.5, 4.6))
    corner = 1  # of both: a wall of 4 m before it, seen for 3.5 and for 4.6 m
    fits, fails = likeness(whole, short)[corner, 1], likeness(whole, long)[corner, 1]
    assert fits > fails + 3.0


def test_agreement_and_conflict_are_metres_of_wall_and_the_other_face_is_neither() -> None:
    def walls(*lines: tuple[float, float, float, float]):
        segments = np.array(lines, np.float64)
        return index_walls(segments, np.zeros((len(lines), 2), np.bool_))

    still = np.zeros(3)
    mine = walls((0, 0, 4, 0))
    assert agreement(mine, walls((0, 0.02, 4, 0.02)), still) == pytest.approx((4.0, 0.0))
    assert agreement(mine, walls((4, -0.1, 0, -0.1)), still) == pytest.approx((0.0, 0.0))  # the other face
    assert beside(mine, walls((0, 0.02, 4, 0.02)), still) == 0.0
    assert beside(mine, walls((0, 0.0, 2, 0.0), (2, 0.05, 4, 0.05)), still) == pytest.approx(0.5, abs=0.05)
    agreed, conflict = agreement(mine, walls((1, 0.3, 3, 0.3)), still)
    assert agreed == 0.0 and conflict == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(10))
def test_maps_without_sense_are_not_aligned(seed: int) -> None:
    """Random chains and rings, as a hostile or broken peer may send them."""
    rng = np.random.default_rng(seed)
    n = 60
    order = rng.permutation(n)
    keep = rng.random(n) < 0.9
    edges = np.column_stack([np.arange(n), order])[(order != np.arange(n)) & keep].astype(np.int32)
    m = len(edges)
    junk = Wireframe(
        rng.uniform(-5, 5, (n, 2)), rng.integers(0, 3, n).astype(np.uint8), edges, np.ones(m, np.float32),
        np.ones(m, np.bool_),
    )  # fmt: skip
    junk.check()
    assert found(maze(seed), junk).transform is None
    far = replace(junk, points=junk.points * 1e3)
    assert found(maze(seed), far).transform is None
