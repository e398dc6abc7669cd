"""A proposal on trial: what each kind of evidence weighs, and when it decides."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from agent.alignment.config import AlignmentConfig
from agent.communication.exchange import News
from agent.cooperation.config import CooperationConfig, VerificationConfig
from agent.cooperation.evidence import MAX_PIECES, WALL_MARGIN_M, WallEvidence
from agent.cooperation.team import Team
from agent.cooperation.verification import Trial
from agent.mapping.views import sees_place, view_of
from protocol.geometry import seen_from
from protocol.messages import RobotSpec
from protocol.talk import Beacon
from protocol.wireframe import Wireframe, enclosed
from tests.agent.alignment.test_by_sight import SCAN
from tests.agent.mapping.test_layers import scan_at
from tests.agent.mapping.test_particle_filter import ROOM, ring


def trial(**config: object) -> Trial:
    return Trial(VerificationConfig.model_validate(config), np.zeros(3), WallEvidence())


def test_each_kind_of_evidence_counts_and_can_be_switched_off() -> None:
    def weighed(**config: object) -> float:
        one = trial(**config)
        one.nats.update(ground=1.0, discs=2.0, heard=-4.0, later_maps=1.5)
        return one.weight

    assert weighed() == 0.5
    assert weighed(ground=False) == -0.5
    assert weighed(discs=False) == -1.5
    assert weighed(heard=False) == 4.5
    assert weighed(later_maps=False) == -1.0


def test_the_bounds_decide() -> None:
    one = trial(discs=False)
    assert one.verdict is None
    one.align_again(True)
    assert one.verdict is None and one.agreed_again == 1
    one.align_again(True)
    assert one.verdict is True
    one.align_again(False)
    one.align_again(False)
    assert one.verdict is False


def test_walls_alone_accept_nothing_where_the_teammate_may_be_seen() -> None:
    one = trial()
    one.nats["ground"] = 3.0
    for _ in range(9):
        one.align_again(True)
    assert one.verdict is None
    one.nats["discs"] = 2.5
    assert one.verdict is True


def test_only_a_sighting_may_decide_where_the_most_that_walls_can_say_would_not_suffice() -> None:
    one = trial()
    assert one.asks_for_a_sighting
    one.nats["ground"] = 2.9
    one.align_again(True)
    assert one.asks_for_a_sighting and one.verdict is None
    seen = trial()
    seen.nats["discs"] = 2.5
    assert not seen.asks_for_a_sighting
    alone = trial(discs=False)
    alone.nats["ground"] = 3.0
    assert not alone.asks_for_a_sighting


def test_a_message_from_beyond_the_radio_s_range_decides_against() -> None:
    one = trial()
    one.hear((0.0, 0.0, 0.0), (3.9, 0.0, 0.0), 4.3)
    assert one.verdict is None
    one.hear((0.0, 0.0, 0.0), (4.4, 0.0, 0.0), 4.3)
    assert one.verdict is False


def test_a_disc_where_it_must_be_speaks_for_and_free_ground_there_against_and_a_hidden_place_not_at_all() -> None:
    here = (0.7, 0.7, 0.0)
    scan = scan_at(here, ROOM)

    def looks(theirs: tuple[float, float], discs: list[tuple[float, float]]) -> tuple[int, int]:
        one = trial()
        for shift in (0.0, 0.05, 0.4):  # the second is no independent look
            place = (theirs[0], theirs[1] - shift, 0.0)
            seen = np.array(discs, np.float64).reshape(-1, 2) - (0.0, shift)
            one.look_for_disc(here, place, scan, seen, 0.105)
        return one.discs_seen, one.discs_missed

    assert looks((1.0, 2.4), [(1.05, 2.35)]) == (2, 0)
    assert looks((1.0, 2.4), []) == (0, 2)
    assert looks((1.0, 2.4), [(0.5, 1.0)]) == (0, 2)
    assert looks((2.3, 2.3), []) == (0, 0)  # behind the pillar
    assert looks((4.8, 0.9), []) == (0, 0)  # too far to be sure
    assert looks((0.8, 0.75), []) == (0, 2)  # where the robot itself is


@pytest.mark.parametrize(("half", "pieces"), [(0.02, 5), (0.04, 6)])
def test_a_post_beyond_a_place_shows_that_nobody_is_there_large_or_small(half: float, pieces: int) -> None:
    low, high = 0.7 - half, 0.7 + half
    here, post = (0.7, 0.7, 0.0), ring((2.0, low), (2.0, high), (2.08, high), (2.08, low))
    scan = scan_at(here, ROOM + post)
    assert len(scan.pieces) == pieces
    view = view_of(scan, here, WALL_MARGIN_M)
    assert sees_place(1.5, 0.7, 0.105, view)
    assert not sees_place(2.04, 0.7, 0.105, view)
    assert not sees_place(2.5, 0.7, 0.105, view)


def test_pieces_on_own_walls_are_not_fresh_wherever_the_sender_s_frame_lies() -> None:
    """The peer has seen a pillar in the room, and the far side of its wall, which is as thin as paper."""
    room, pillar = [(0.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 4.0)], [(2.0, 1.0), (2.0, 2.0), (3.0, 2.0), (3.0, 1.0)]
    behind = [(5.01, 0.0), (9.0, 0.0), (9.0, 4.0), (5.01, 4.0)]
    own, theirs = (enclosed([np.array(ring) for ring in rings]) for rings in ([room], [room, pillar, behind]))
    for frame in ((0.0, 0.0, 0.0), (3.0, -7.0, 2.0)):
        walls = WallEvidence()
        walls.lay(replace(theirs, points=seen_from(frame, theirs.points)), np.array(frame), own)
        assert not walls.fresh[walls.wall < 4].any()
        assert walls.fresh[np.isin(walls.wall, (4, 5, 6, 7, 9, 11))].all()


@pytest.mark.parametrize("degrees", [0, 20, 45])
def test_what_is_known_of_walls_outlives_a_later_map_whose_corners_have_moved_by_millimetres(degrees: int) -> None:
    """At 45 degrees in the sender's frame 40 % of them were fresh again with each map, and phantoms shown again."""
    frame, rng = (3.0, -7.0, math.radians(degrees)), np.random.default_rng(1)
    room, pillar = [(0.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 4.0)], [(2.0, 1.0), (2.0, 2.0), (3.0, 2.0), (3.0, 1.0)]
    first, later = (enclosed([np.array(ring) for ring in rings]) for rings in ([room], [room, pillar]))
    walls = WallEvidence()
    walls.lay(replace(first, points=seen_from(frame, first.points)), np.array(frame), first)
    walls.through[:] = 3
    for _ in range(3):
        points = seen_from(frame, later.points) + rng.normal(0.0, 0.007, (8, 2))
        walls.lay(replace(later, points=points), np.array(frame), first)
        assert walls.hidden(3).tolist() == [True] * 4 + [False] * 4
        assert (walls.fresh == (walls.wall >= 4)).all()


def lined(*walls: tuple[float, float, float, float]) -> Wireframe:
    """Walls (x1, y1, x2, y2) that share no corner."""
    count = len(walls)
    edges = np.arange(2 * count, dtype=np.int32).reshape(-1, 2)
    points, labels = np.array(walls).reshape(-1, 2), np.zeros(2 * count, np.uint8)
    return Wireframe(points, labels, edges, np.ones(count, np.float32), np.ones(count, np.bool_))


@pytest.mark.parametrize("step", [0.03, 0.05, 0.09])
def test_no_more_of_a_wall_is_known_as_it_grows(step: float) -> None:
    """Of 2 m that scans had confirmed the newest end handed it on, map by map, to 4 m of which none saw more."""
    walls = WallEvidence()
    walls.lay(lined((0.0, 0.0, 2.0, 0.0)), np.zeros(3), Wireframe())
    walls.on[:] = 3
    for k in range(1, 41):
        walls.lay(lined((0.0, 0.0, 2.0 + k * step, 0.0)), np.zeros(3), Wireframe())
        assert 1.7 < walls.said(2)[0] < 2.05


def test_what_is_known_of_a_wall_is_known_of_one_of_its_copies() -> None:
    walls = WallEvidence()
    walls.lay(lined((0.0, 0.0, 2.0, 0.0)), np.zeros(3), Wireframe())
    walls.on[:] = 3
    walls.lay(lined(*((0.0, 0.008 * k, 2.0, 0.008 * k) for k in range(12))), np.zeros(3), Wireframe())
    assert walls.said(2) == (pytest.approx(2.0), 0.0)


@pytest.mark.parametrize(
    "crowded",
    [[(50.0, -1000.0, 50.0, 1000.0)], [(50.0 + 0.0002 * k, -2.0, 50.0 + 0.0002 * k, 2.0) for k in range(500)]],
    ids=["a wall of 2 km", "500 walls in one place"],
)
def test_no_map_takes_much_longer_to_lay_than_another_with_as_many_pieces(
    crowded: list[tuple[float, float, float, float]],
) -> None:
    """A wall of 2 km along y took 0.6 s of a tick, as all pieces of one x were compared with each other."""

    def laid_s(wireframe: Wireframe) -> float:
        walls = WallEvidence()
        walls.lay(wireframe, np.zeros(3), Wireframe())
        assert len(walls.pieces) == MAX_PIECES
        begin = time.process_time()
        walls.lay(wireframe, np.zeros(3), Wireframe())
        return time.process_time() - begin

    scattered = lined(*((k, 0.0, k, 4.0) for k in range(500)))
    least_s = [min(laid_s(wireframe) for _ in range(3)) for wireframe in (scattered, lined(*crowded))]
    assert least_s[1] < 10 * least_s[0]


@pytest.mark.parametrize(("late", "seen"), [
    (0, 100), (2, 100), (3, 97), (5, 95), (14, 86),  # of its own tick, or of now where that is as good
    (7, 94), (18, None), (40, None),  # a tick was left out; longer ago than scans are kept
    (-2, 100), (-3, None),  # a clock that is ahead
])  # fmt: skip
def test_where_a_peer_was_is_held_against_the_scan_of_then(late: int, seen: int | None) -> None:
    """By a radio that takes three ticks no peer was ever seen, and no two robots merged."""
    team = Team(CooperationConfig(), AlignmentConfig(), RobotSpec(), np.random.default_rng(0))
    for tick in range(1, 101):
        if tick != 93:
            beacon = Beacon(tick - late, (1.0, 0.0, 0.0)) if tick == 100 else None
            scan = replace(SCAN, discs=np.array([[2.0, 0.01 * tick]]))
            team.hear(tick, [News("r2", 100, beacon)], (tick, 0.0, 0.0), scan, Wireframe(), ["r2"])
    log = team.peers["r2"].log
    assert log.pose_tick == min(100 - late, 100) and log.first_encounter is not None
    kept = [(one.here[0], one.discs.tolist()) for one in log.sightings]
    assert kept == ([] if seen is None else [(seen, [[seen + 2.0, pytest.approx(0.01 * seen)]])])


@pytest.mark.parametrize("others", [[], ["q"]])
def test_who_is_heard_and_not_understood_may_be_the_disc_that_is_seen(others: list[str]) -> None:
    team = Team(CooperationConfig(), AlignmentConfig(), RobotSpec(), np.random.default_rng(0))
    scan = replace(SCAN, discs=np.array([[2.0, 0.0]]))
    for tick, senders in ((1, ["p", *others]), (2, ["p"])):
        news = News("p", 1, Beacon(tick, (1.0, 0.0, 0.0)))
        team.hear(tick, [news], (tick, 0.0, 0.0), scan, Wireframe(), senders)
    log = team.peers["p"].log
    assert len(log.sightings) == 2 and log.met_alone is not bool(others)
