"""What others say of a peer's frame: two of them are worth a sighting, one alone nothing, and circles must close."""

import numpy as np
import pytest

from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.communication.exchange import News
from agent.communication.receiving import ReceivedMap
from agent.cooperation import thirds
from agent.cooperation.config import CooperationConfig
from agent.cooperation.evidence import WallEvidence
from agent.cooperation.peer import GIVEN_SD_M, Laid, Merged, PeerLog, Proposed, Unaligned
from agent.cooperation.peer_places import STRANGER_S
from agent.cooperation.team import CIRCLES_S, Team
from agent.cooperation.verification import THIRD_NATS
from agent.cooperation.wall_fit import PRIOR_SD, WallFit
from agent.mapping.layers import layer_of
from deploy.bench.alignment.pairs import moved
from protocol.arrays import Floats
from protocol.geometry import pose_of, relative
from protocol.messages import MAX_ROBOTS
from protocol.talk import Beacon
from protocol.wireframe import Wireframe
from tests.agent.alignment.test_by_sight import SCAN
from tests.ideal import ideal_spec
from world.worldfile import load

TRUE = {name: np.array(pose) for name, pose in {"a": (3, 1, 0.4), "b": (-2, 5, 2), "c": (7, -1, -2)}.items()}
"""Frames of three peers in the robot's own."""
PEER = np.array((4.0, 4.0, -1.0))
"""That of the peer whose frame they tell."""
WRONG = np.array((4.0, 6.5, -1.0))
SPEC = ideal_spec(radio_range_m=30.0)
WALLS = load("apartment").segments


def room() -> Wireframe:
    """A flat, in the robot's own frame."""
    count = len(WALLS)
    return Wireframe(
        WALLS.reshape(-1, 2),
        np.zeros(2 * count, np.uint8),
        np.arange(2 * count, dtype=np.int32).reshape(-1, 2),
        np.ones(count, np.float32),
        np.ones(count, np.bool_),
    )


def merged(name: str, transform: Floats, agreed_m: float = 0.0) -> Merged:
    """A merged peer that has mapped the flat, too."""
    received = ReceivedMap(moved(room(), pose_of(transform)), 0)
    layer = layer_of(received.wireframe, transform, np.zeros(len(WALLS), np.bool_), 3.0)
    laid = Laid(np.zeros(len(WALLS), np.bool_), layer, layer)
    log = PeerLog(name, map=received, encounters=[Encounter((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))])
    fit = WallFit(transform, np.zeros(2), np.diag(PRIOR_SD**2))
    return Merged(log, received, fit, WallEvidence(), laid, 0, 0, agreed_m)


def team_of(said: dict[str, Floats]) -> Team:
    """A team that has merged these peers, each of which says where it has the frame of p, in the robot's own."""
    team = Team(CooperationConfig(), AlignmentConfig(), SPEC, np.random.default_rng(0))
    for name, frame in said.items():
        team.peers[name] = peer = merged(name, TRUE[name])
        peer.log.take_frames({"p": relative(pose_of(TRUE[name]), pose_of(frame))})
    return team


def met(team: Team) -> Unaligned:
    """The peer p, heard, with its map."""
    peer = merged("p", PEER)
    team.peers["p"] = met = Unaligned(peer.log)
    return met


def test_who_is_merged_is_no_stranger_after_a_while_and_all_others_are() -> None:
    team, lately = team_of({"a": PEER}), round(STRANGER_S * SPEC.lidar.rate_hz)
    assert team.places.strangers_among(lately, ["a"])
    assert not team.places.strangers_among(lately + 1, ["a"])
    assert team.places.strangers_among(lately + 1, ["a", "never heard of"])
    met(team)
    assert team.places.strangers_among(lately + 1, ["a", "p"])


def test_the_place_of_who_was_silent_for_years_can_be_told() -> None:
    """Its variance was more than a PoseReport may hold, and the robot's process ended."""
    team = team_of({"a": PEER})
    team.peers["a"].log.pose_tick = 0
    (place,) = team.places.teammates(2**32 - 1)
    assert 1e6 < place.covariance[0] < 1e9


def test_who_has_merged_the_robots_map_says_so() -> None:
    team = team_of({"a": PEER})
    assert team.places.strange_to(["a"]) == ["a"] and not team.places.strange_to([])
    team.peers["a"].log.take_frame(0, (1.0, 2.0, 0.3))
    assert team.places.strange_to(["a"]) == [] and team.places.strange_to(["a", "never heard of"]) == ["never heard of"]


@pytest.mark.parametrize(
    ("later", "stranger"),
    [
        ({}, False),
        ({"x": 20.0}, True),  # it was started anew
        ({"since": 100}, False),  # it has some seconds to say so
        ({"since": 100, "tick": 200}, True),  # it has undone the merge
        ({"since": 100, "tick": 200, "frame": PEER}, False),
    ],
)
def test_who_no_longer_knows_the_robots_frame_is_a_stranger_again(later: dict[str, object], stranger: bool) -> None:
    """A complete robot no longer let itself be seen by one that had undone the merge, or begun anew."""
    team = Team(CooperationConfig(), AlignmentConfig(), SPEC, np.random.default_rng(0))

    def hear(tick: int = 100, since: int = 1, x: float = 1.0, frame: object = None) -> None:
        news = News("a", since, beacon=Beacon(tick, (x, 0.0, 0.0)), frame=frame)
        team.hear(tick, [news], (0.0, 0.0, 0.0), SCAN, Wireframe(), [news.peer])

    hear(tick=1, frame=PEER)
    log = team.peers["a"].log
    log.take_frames({"c": pose_of(TRUE["c"])})
    assert team.places.strange_to(["a"]) == []
    hear(**later)
    assert bool(team.places.strange_to(["a"])) is stranger
    anew = (
        "x" in later
    )  # else what it told holds until it is taken back: the robot may just not have heard it for a while
    assert (log.claim is None) is anew and (not log.frames) is anew


def test_the_word_of_most_is_taken() -> None:
    peer = merged("p", PEER)
    others = team_of({"a": PEER, "b": WRONG, "c": PEER + np.array((0.05, 0.0, 0.0))}).merged
    said = thirds.claims(thirds.words(peer, others))
    assert np.allclose(said[:2], [PEER, WRONG], atol=0.01)
    claim = thirds.best(said, peer.map.wireframe)
    assert claim is not None and claim.agree == 2
    assert np.allclose(claim.transform, PEER + np.array((0.025, 0.0, 0.0)), atol=0.01)
    assert thirds.best(said[:0], peer.map.wireframe) is None


def test_two_that_agree_outweigh_one_that_does_not() -> None:
    peer = merged("p", PEER)
    peer.log.take_frames({"p": (0.0, 0.0, 0.0)})  # of itself, which is nobody's word
    team = team_of({"a": PEER, "b": WRONG, "c": PEER + np.array((0.05, 0.0, 0.0))})
    assert thirds.balance(peer, [*team.merged, peer]) == 1


@pytest.mark.parametrize(
    ("said", "nats"),
    [
        ({}, 0.0),
        ({"a": PEER}, 0.0),
        ({"a": PEER, "b": PEER}, THIRD_NATS),
        ({"a": PEER, "b": PEER, "c": WRONG}, 0.0),
        ({"a": PEER, "c": WRONG}, 0.0),
        ({"c": WRONG}, -THIRD_NATS),
    ],
)
def test_one_alone_gives_no_weight_and_another_word_takes_some(said: dict[str, Floats], nats: float) -> None:
    team = team_of(said)
    assert team.propose(met(team), pose_of(PEER), room(), {}).trial.weight == pytest.approx(nats)


def test_three_that_agree_suffice_without_a_drive_even_where_the_peer_has_seen_other_rooms() -> None:
    team = team_of(dict.fromkeys("abc", PEER))
    met(team)
    half = room()
    half.own[: len(WALLS) // 2] = False
    team.align_maps(1, half)
    assert team.proposed[0].transform_sd_m == GIVEN_SD_M  # by no alignment
    team.judge(1, half, (0.0, 0.0, 0.0))
    peer = team.peers["p"]
    assert isinstance(peer, Merged) and np.allclose(peer.transform, PEER, atol=0.02)
    assert team.errand is None


def test_who_was_started_anew_must_have_walls_in_common_whatever_thirds_say() -> None:
    """They may tell of its frame before, in which its first few walls contradict nothing.

    On trial, that word used up the chance of theirs on its new frame, which no more of them told.
    """
    team = team_of(dict.fromkeys("abc", PEER))
    peer = met(team)
    peer.log.began_anew = True
    half = room()
    half.own[: len(WALLS) // 2] = False
    team.align_maps(1, half)
    assert not team.events and peer.log.thirds_on_trial == 0
    team.propose(peer, pose_of(PEER), half, {})
    team.judge(1, half, (0.0, 0.0, 0.0))
    assert [event.data["reason"] for event in team.events[1:]] == ["its walls do not fit"]


def test_thirds_are_asked_anew_about_who_was_started_anew() -> None:
    """As many of them had agreed on where its frame was before."""
    team = team_of(dict.fromkeys("abc", PEER))
    log = met(team).log
    log.pose_tick, log.thirds_on_trial = 0, 3
    news = News("p", 1, beacon=Beacon(1, (1.0, 0.0, 0.0)), map=log.map)
    team.hear(1, [news], (4.0, 4.0, 0.0), SCAN, room(), [news.peer])
    team.align_maps(1, room())
    assert [event.data["reason"] for event in team.events] == ["told by thirds"]


def test_the_open_circle_s_weakest_link_goes_on_trial_again_and_then_the_next() -> None:
    team = team_of({"a": PEER})
    team.peers["p"] = merged("p", WRONG, agreed_m=3.0)
    team.peers["p"].log.take_frames({"a": relative(pose_of(PEER), pose_of(TRUE["a"]))})
    team.peers["a"] = merged("a", TRUE["a"], agreed_m=9.0)
    team.peers["a"].log.take_frames({"p": relative(pose_of(TRUE["a"]), pose_of(PEER))})
    look = round(CIRCLES_S * SPEC.lidar.rate_hz)
    team.judge(look, room(), (0.0, 0.0, 0.0))
    peer = team.peers["p"]
    assert isinstance(peer, Proposed) and peer.trial.weight == -THIRD_NATS
    assert isinstance(team.peers["a"], Merged)
    team.merge(peer, look, room())  # its trial was passed once more, so it is the other link's turn
    team.judge(2 * look, room(), (0.0, 0.0, 0.0))
    assert isinstance(team.peers["p"], Merged) and isinstance(team.peers["a"], Proposed)


def test_a_link_with_who_was_started_anew_is_on_trial_again_no_sooner_than_its_place_and_map_are_there() -> None:
    """The trial drives to where the contact began: the robot's process ended with an AssertionError."""
    team = team_of({"a": WRONG})
    team.peers["p"] = merged("p", PEER)
    team.hear(1, [News("p", 0, anew=1)], (4.0, 4.0, 0.0), SCAN, room(), ["p"])
    look = round(CIRCLES_S * SPEC.lidar.rate_hz)
    team.judge(look, room(), (0.0, 0.0, 0.0))
    team.hear(look, [News("p", 0, beacon=Beacon(look, (0.0, 0.0, 0.0)))], (4.0, 4.0, 0.0), SCAN, room(), ["p"])
    team.judge(2 * look, room(), (0.0, 0.0, 0.0))
    assert isinstance(team.peers["p"], Merged)
    news = News("p", 0, map=ReceivedMap(moved(room(), pose_of(PEER)), 2 * look))
    team.hear(2 * look, [news], (4.0, 4.0, 0.0), SCAN, room(), [news.peer])
    team.judge(3 * look, room(), (0.0, 0.0, 0.0))
    assert isinstance(team.peers["p"], Proposed)


def test_a_peer_tells_of_so_many_and_no_more() -> None:
    log = PeerLog("x")
    log.take_frames({f"r{k}": (0.0, 0.0, 0.0) for k in range(2 * MAX_ROBOTS)})
    assert len(log.frames) == MAX_ROBOTS
    log.take_frames({"r1": None, "never told": None})
    assert len(log.frames) == MAX_ROBOTS - 1
