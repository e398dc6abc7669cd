"""A peer that is started anew, perhaps in another frame, says so, or its place jumps: what may hold no more ends."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from agent.alignment.by_sight import Sighting
from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.communication.exchange import News
from agent.communication.receiving import ReceivedMap
from agent.cooperation.config import CooperationConfig
from agent.cooperation.merging import REFUSED_MAPS
from agent.cooperation.peer import Merged, Peer, PeerLog, Unaligned
from agent.cooperation.team import REFINE_S, RESTS, Team
from agent.cooperation.weight import Weight
from deploy.bench.alignment.pairs import moved
from protocol.geometry import Pose, inverted, relative
from protocol.talk import Beacon
from tests.agent.alignment.test_by_sight import SCAN
from tests.agent.cooperation.test_thirds import room
from tests.ideal import ideal_spec

SPEC = ideal_spec(radio_range_m=4.0)
HERE, THERE = (4.0, 4.0, 0.0), (5.0, 3.7, 0.0)
"""The robot, and the peer, in the robot's own frame."""
BEFORE, AFTER = (9.5, 1.0, 0.4), (5.0, 3.7, -1.2)
"""The peer's frames in it."""
HEARD, MET = 600, 500
"""Ticks of the last beacon in the frame before, and of the begin of its contact."""
WAITS = 5 * round(REFINE_S * SPEC.lidar.rate_hz)
OWN = room()


def of(frame: Pose, tick: int) -> ReceivedMap:
    """The map of a peer that has seen all, too."""
    return ReceivedMap(moved(OWN, inverted(frame)), tick)


def known(tick: int = MET) -> tuple[Team, PeerLog]:
    """A team, and what its peer has told in its frame before. tick: of its map."""
    team = Team(CooperationConfig(), AlignmentConfig(), SPEC, np.random.default_rng(0))
    log = PeerLog("p", pose=relative(BEFORE, THERE), pose_tick=HEARD, met=MET, circles_open=1, knows_me=True)
    log.map, log.encounters = of(BEFORE, tick), [Encounter(HERE, log.pose)]
    log.sightings.append(Sighting(HERE, log.pose, np.zeros((0, 2)), SCAN))
    team.peers["p"] = Unaligned(log)
    return team, log


def hear(team: Team, tick: int, frame: Pose, anew: int | None = None, received: ReceivedMap | None = None) -> Peer:
    """The peer after a beacon in a frame, and its map where that came."""
    news = News("p", MET, beacon=Beacon(tick, relative(frame, THERE)), map=received, anew=anew)
    team.hear(tick, [news], HERE, SCAN, OWN, [news.peer])
    team.align_maps(tick, OWN)
    return team.peers["p"]


def test_what_was_seen_of_it_in_its_frame_before_weighs_no_more() -> None:
    """After a minute of silence no jump tells: old sightings, out of the radio's range, ruled the right frame out."""
    team, log = known()
    later = HEARD + 300
    hear(team, later, AFTER)
    assert not log.began_anew  # it may have driven so far
    hear(team, later + 1, AFTER, anew=later)
    assert log.map_is_old and not log.knows_me and log.circles_open == 0
    assert [one.theirs for one in log.sightings] == [one.theirs for one in log.encounters] == [log.pose]
    log.map = of(AFTER, later + 2)
    assert team.propose(Unaligned(log), AFTER, OWN, {}).trial.nats["heard"] == 0.0


@pytest.mark.parametrize("jumps", [True, False])
@pytest.mark.parametrize("waits", [False, True])
@pytest.mark.parametrize(("tick", "holds"), [(HEARD, False), (HEARD + 200, True)])
def test_a_map_that_came_before_ends_and_one_that_came_since_is_of_the_new_frame(
    tick: int, holds: bool, waits: bool, jumps: bool
) -> None:
    """A beacon may be lost, and who is complete tells its map once."""
    team, log = known(tick)
    if waits:
        log.map, log.waiting, log.waiting_weight = None, log.map, Weight(10**6, 10**6)
    x, y, turn = relative(AFTER, THERE)
    log.pose = (x + 20.0 * jumps, y, turn)
    hear(team, HEARD + 210, AFTER, anew=None if jumps else HEARD + 100)
    assert not log.knows_me and (log.waiting is not None if waits else not log.map_is_old) is holds


@pytest.mark.parametrize("waits", [False, True])
def test_what_is_on_trial_ends_whether_the_robot_drives_for_it_or_it_waits(waits: bool) -> None:
    """The drive went on to where the peer was by its old frame."""
    team, log = known()
    proposed = team.propose(Unaligned(log), BEFORE, OWN, {})
    team.judge(HEARD, OWN, HERE)
    if waits:
        team.queue.remove(proposed)
        proposed.waits_since = log.first_encounter
    assert isinstance(hear(team, HEARD + 5, AFTER, anew=MET), Unaligned)
    team.judge(HEARD + 5, OWN, HERE)
    assert not team.proposed and team.errand is None
    assert [event.data["reason"] for event in team.events] == ["it was started anew"]


@pytest.mark.parametrize("frame", [BEFORE, AFTER])
def test_of_a_merged_peer_the_next_map_decides_and_until_then_it_is_a_stranger(frame: Pose) -> None:
    """Its teammate was mapped as a post, as it was told to be elsewhere. From a checkpoint its frame is the same."""
    team, log = known()
    team.merge(team.propose(Unaligned(log), BEFORE, OWN, {}), MET, OWN)
    began = HEARD + 5
    peer = hear(team, began, frame, anew=HEARD)
    assert isinstance(peer, Merged) and peer.since == began and peer.refused == REFUSED_MAPS - 1
    assert team.places.strangers_among(began + WAITS, ["p"])
    peer = hear(team, began + WAITS, frame, received=of(frame, began + WAITS))
    assert isinstance(peer, Merged) is (frame == BEFORE)
    assert not isinstance(peer, Merged) or peer.refused == 0


def test_at_the_end_a_peer_that_has_told_its_map_and_not_its_place_is_merged_no_more() -> None:
    """Its last map was aligned without a place, and the robot's process ended with an AssertionError."""
    team, log = known()
    team.merge(team.propose(Unaligned(log), BEFORE, OWN, {}), MET, OWN)
    news = News("p", MET, map=of(AFTER, HEARD + 4), anew=HEARD)
    team.hear(HEARD + 5, [news], HERE, SCAN, OWN, [news.peer])
    team.conclude(HEARD + 5, OWN)
    assert isinstance(team.peers["p"], Unaligned)


def test_a_map_of_the_frame_before_takes_the_doubt_about_a_merge_not_back() -> None:
    """It agreed with itself, and four more of the new frame had to contradict the merge."""
    team, log = known(HEARD - 2)
    team.merge(team.propose(Unaligned(log), BEFORE, OWN, {}), MET, OWN)
    peer = hear(team, HEARD + 15, AFTER, anew=MET)  # by its tick it may be of the new process, by its place it is not
    assert log.map_is_old and isinstance(peer, Merged) and peer.refused == REFUSED_MAPS - 1


def test_who_begins_anew_again_and_again_is_proposed_ever_less_often() -> None:
    """A hostile peer that said so every 5 s kept a robot driving, 60 times in five minutes."""
    team, log = known()
    later, proposed = range(HEARD + 25, HEARD + 1500, 25), []
    for tick in later:
        hear(team, tick, BEFORE, anew=tick, received=of(BEFORE, tick))
        proposed += [tick for event in team.events if event.event == "proposed"]
    waited = np.diff(proposed)
    assert (waited[:4] == 25).all() and (waited[4:] >= [150, 450]).all()
    merged = team.merge(team.propose(Unaligned(log), BEFORE, OWN, {}), later.stop, OWN)
    team.undo(merged, "", {})
    hear(team, later.stop, BEFORE, anew=later.stop, received=of(BEFORE, later.stop))
    assert team.proposed and log.rejections == 0


def test_one_map_is_not_aligned_for_each_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who tells places of long ago may have a map that is newer than each of them."""
    team, _ = known(HEARD + 1000)
    align = Mock(wraps=team.aligner.align)
    monkeypatch.setattr(team.aligner, "align", align)
    for k in range(1, 7):
        hear(team, HEARD + k, (BEFORE, AFTER)[k % 2])
    assert 1 <= align.call_count <= 2


def test_who_is_started_anew_twice_from_a_checkpoint_is_proposed_again_with_the_same_map() -> None:
    """A map that is complete does not grow by the 30 % for which a rejection waits."""
    team, _ = known()
    hear(team, HEARD + 5, BEFORE, received=of(BEFORE, HEARD + 4))
    for tick in (HEARD + 20, HEARD + 100):
        assert team.proposed
        hear(team, tick, BEFORE, anew=MET - 25)
    assert [event.data["reason"] for event in team.events] == ["it was started anew", "aligned"]


def test_who_never_begins_anew_has_no_rest() -> None:
    """Of most walls it heard only, so maps were never aligned: what it says of its frame itself was not proposed."""
    team, log = known()
    few = replace(OWN, own=np.arange(len(OWN.own)) < 7)
    for tick in range(HEARD + 25, HEARD + 25 * (len(RESTS) + 1), 25):
        received = ReceivedMap(moved(few, inverted(BEFORE)), tick)
        log.tried_claim = None
        place = Beacon(tick, relative(BEFORE, THERE))
        news = News("p", MET, beacon=place, map=received, frame=inverted(BEFORE))
        team.hear(tick, [news], HERE, SCAN, OWN, [news.peer])
        team.align_maps(tick, OWN)
        (peer,) = team.proposed
        team._reject(tick, peer, "the evidence decides")
    assert log.rejections == len(RESTS)
