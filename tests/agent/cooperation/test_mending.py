"""A loop that a robot closes moves its map: what it knows of peers moves along, or begins anew."""

from dataclasses import replace

import numpy as np
import pytest

from agent.alignment.by_sight import Sighting
from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.communication.config import TalkConfig
from agent.communication.exchange import Exchange
from agent.communication.receiving import PeerViews, ReceivedMap
from agent.cooperation.config import CooperationConfig
from agent.cooperation.peer import Merged, PeerLog, Proposed, Unaligned
from agent.cooperation.team import Team
from agent.mapping.submaps.segments import SEGMENT
from agent.mapping.submaps.settled import Settled
from agent.perception.disc_memory import POST_STILL_S, Posts
from protocol.messages import RobotSpec
from tests.agent.alignment.test_alignment import maze
from tests.agent.alignment.test_by_sight import SCAN

HERE = (0.0, 0.0, 0.0)
TORN = Settled(np.zeros(0, SEGMENT), HERE, np.array([0, 100]), np.array([HERE, (2.0, 1.0, 0.0)]))
"""What was seen from tick 100 on moves by 2 m and 1 m."""
MAP = maze(0)


def heard_of(tick: int, met: int) -> PeerLog:
    """A peer that was last heard at a tick, in a contact that began at another one."""
    log = PeerLog("r2", encounters=[Encounter(HERE, HERE), Encounter((1.0, 0.0, 0.0), HERE)], pose_tick=tick, met=met)
    log.map, log.claim = ReceivedMap(MAP, tick), np.zeros(3)
    log.sightings.append(Sighting(HERE, HERE, np.zeros((0, 2)), SCAN))
    return log


def team_with(tick: int, met: int = 50) -> tuple[Team, Proposed]:
    """A robot that has its peer's transform on trial, and drives to it."""
    team = Team(CooperationConfig(), AlignmentConfig(), RobotSpec(radio_range_m=4.0), np.random.default_rng(0))
    proposed = team.propose(Unaligned(heard_of(tick, met)), HERE, MAP, {})
    team.queue.set_out(tick, HERE)
    return team, proposed


@pytest.mark.parametrize(
    ("met", "tick", "begin_by", "by"),
    [(50, 60, (0.0, 0.0), (0.0, 0.0)), (50, 150, (0.0, 0.0), (2.0, 1.0)), (140, 150, (2.0, 1.0), (2.0, 1.0))],
)
def test_a_proposal_its_errand_and_its_encounter_move_each_with_its_submap(met, tick, begin_by, by) -> None:
    """The transform with that in which the peer was last heard, its place at contact with that where this began."""
    team, proposed = team_with(tick, met)
    proposed.waits_since = proposed.log.first_encounter
    team.mend(TORN)
    assert team.errand is not None
    assert team.errand.place == pytest.approx(by) and proposed.transform[:2] == pytest.approx(by)
    log = proposed.log
    assert [one.here for one in log.encounters] == [(*begin_by, 0.0)] and proposed.waits_since is log.first_encounter
    assert not log.sightings and log.claim is None


def test_a_merged_peer_moves_with_the_submap_in_which_it_was_met_and_is_fitted_to_the_own_walls_at_once() -> None:
    """A fit finds walls 0.2 m off at most: a map that had moved by more was torn from its team's for good."""
    team, proposed = team_with(150)
    merged = team.merge(proposed, 150, MAP)
    team.mend(TORN)
    peer = team.peers["r2"]
    assert isinstance(peer, Merged)
    assert peer.transform - merged.transform == pytest.approx((2.0, 1.0, 0.0))
    assert team.merged == [peer] and peer.laid is not merged.laid
    shifted = replace(MAP, points=MAP.points + np.array((2.1, 1.05)))
    peer.log.map_is_news = False
    team.align_maps(151, shifted)
    assert team.merged[0].transform[:2] == pytest.approx(merged.transform[:2] + np.array((2.1, 1.05)), abs=0.01)


def test_a_map_that_the_torn_one_contradicted_is_held_against_the_mended_one() -> None:
    """A peer that is complete tells no other one."""
    team, proposed = team_with(150)
    team.merge(proposed, 150, MAP)
    proposed.log.map = last = ReceivedMap(MAP, 160)
    team.align_maps(200, replace(MAP, points=MAP.points @ np.array(((1.0, 0.0), (0.3, 1.0)))))
    assert team.merged[0].refused == 1
    team.mend(TORN)
    team.align_maps(201, replace(MAP, points=MAP.points + np.array((2.0, 1.0))))
    assert team.merged[0].map is last and team.merged[0].refused == 0


@pytest.mark.parametrize(("by", "is_whole"), [((0.1, 0.05), True), ((0.5, 0.25), True), ((0.5, 0.25), False)])
def test_at_the_end_of_a_log_a_merged_map_is_where_its_walls_are_or_is_left_away(by, is_whole) -> None:
    """A loop that was closed after its peer was last heard left it where the torn map had been."""
    team, proposed = team_with(150)
    merged = team.merge(proposed, 150, MAP)
    merged.log.encounters = [Encounter((1.5, 3.5, 0.0), (1.5, 5.5, 0.0))]
    team._update(150, merged, MAP)
    few = np.arange(len(MAP.own)) < 10  # too few for an alignment
    last = replace(MAP, points=MAP.points + np.array(by), own=few | is_whole)
    team.conclude(200, last)
    assert [peer.transform[:2] for peer in team.merged] == ([pytest.approx(by, abs=0.01)] if is_whole else [])
    assert ("unmerged" in [event.event for event in team.events]) is not is_whole


def test_viewpoints_that_peers_know_already_are_told_again_where_they_are_now() -> None:
    team, proposed = team_with(150)
    team.merge(proposed, 150, MAP)
    eyes = np.array([(1.0, 1.0)])
    proposed.log.views = PeerViews(eyes, np.zeros(1, np.int64), np.ones(1, np.bool_), np.zeros((0, 4)), 1)
    team.views.gather(team.merged)
    before, places = team.views.looked(151, [3], [(5.0, 5.0)]), team.views.places.copy()
    assert before.between(151, 152, 1400) is None
    team.mend(TORN)
    assert team.views.places - places == pytest.approx(np.array([(2.0, 1.0)]))
    again = team.views.looked(152, [3], [(5.0, 7.0)]).between(151, 153, 1400)
    assert again is not None and again.since == 0 and again.points[0] == pytest.approx((5.0, 7.0), abs=0.2)


def test_frames_are_told_with_the_next_beacon_however_long_they_were_known() -> None:
    exchange = Exchange(TalkConfig(), 5.0, 1400)
    told, frames = exchange._told["r2"], {"r3": HERE}
    assert [len(told.take_due_frames(frames, frames)) for _ in range(3)] == [1, 1, 0]
    exchange.tell_frames_anew()
    assert told.take_due_frames(frames, frames) == ["r3"]


def test_posts_of_the_torn_map_are_forgotten() -> None:
    posts, disc = Posts(RobotSpec()), np.array([(3.0, 1.0)])
    for tick in range(round(POST_STILL_S * RobotSpec().lidar.rate_hz) + 2):
        posts.add(tick, disc, np.zeros((0, 3)))
    assert len(posts.places)
    posts.forget()
    assert not len(posts.places)
