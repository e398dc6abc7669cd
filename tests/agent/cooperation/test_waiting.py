"""A proposal that only seeing the peer can decide waits for the next contact, and no further drive is made for it."""

from collections.abc import Sequence

import numpy as np
import pytest

from agent.alignment.by_sight import Sighting
from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.communication.exchange import News
from agent.communication.receiving import ReceivedMap
from agent.cooperation.config import CooperationConfig
from agent.cooperation.peer import PeerLog, Proposed, Unaligned
from agent.cooperation.team import Team
from agent.cooperation.verification import DISC_NATS, GROUND_MOST_NATS
from protocol.geometry import Pose
from protocol.messages import RobotSpec
from protocol.talk import Beacon
from protocol.wireframe import Wireframe, enclosed
from tests.agent.alignment.test_alignment import maze
from tests.agent.alignment.test_by_sight import SCAN

HERE = (0.0, 0.0, 0.0)
EMPTY = Wireframe()
ROOM = enclosed([np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 3.0), (0.0, 3.0)])])
BESIDE = (1.5, 5.5, 0.0)  # free in the maze of seed 0, as (1.5, 3.5) is
LATER = 2000  # a tick, long after the last contact: a peer can have driven 80 m


def setting_out(theirs: Wireframe = EMPTY) -> tuple[Team, Proposed]:
    """A team whose only peer is on trial and silent, on the way to where it was; theirs: its map."""
    team = Team(CooperationConfig(), AlignmentConfig(), RobotSpec(radio_range_m=4.0), np.random.default_rng(0))
    peer = Unaligned(PeerLog("r2", encounters=[Encounter(HERE, (3.0, 0.0, 0.0))]))
    peer.log.map = ReceivedMap(theirs, 0)
    proposed = team.propose(peer, (0.0, 0.0, 0.0), EMPTY, {})
    team.judge(LATER - 1, EMPTY, HERE)
    return team, proposed


def on_trial(ground: float, discs: float = 0.0, theirs: Wireframe = EMPTY) -> tuple[Team, Proposed]:
    """The same at the end of the drive. ground, discs: what the peer's walls and sightings weigh, nats."""
    team, proposed = setting_out(theirs)
    assert team.errand is not None and team.errand.place.tolist() == [3.0, 0.0]
    proposed.trial.nats["ground"], proposed.trial.nats["discs"] = ground, discs
    team.errand.ended = "arrived"
    team.judge(LATER, EMPTY, HERE)
    return team, proposed


def test_a_robot_that_was_held_drives_on_to_verify() -> None:
    """Its mind takes no step meanwhile, and the ticks go on by the clock."""
    team, proposed = setting_out()
    team.judge(100 * LATER, EMPTY, HERE)
    assert team.queue.proposals == [proposed] and team.errand is not None


@pytest.mark.parametrize("ground", [0.0, GROUND_MOST_NATS])
def test_it_waits_without_a_drive_and_the_next_contact_takes_it_up_again(ground: float) -> None:
    team, proposed = on_trial(ground)
    assert team.errand is None and not team.queue.proposals and team.proposed == [proposed]
    team.judge(LATER + 1, EMPTY, HERE)
    assert team.errand is None  # the same contact, long over
    proposed.log.encounters, proposed.log.pose_tick = [Encounter(HERE, (0.0, 2.0, 0.0))], LATER + 2
    team.judge(LATER + 2, EMPTY, HERE)
    assert team.queue.proposals == [proposed] and team.errand is not None and team.errand.place.tolist() == [0.0, 2.0]


@pytest.mark.parametrize("ticks", [(10, 35, 60), (9, 34, 59), (1, 2, 3)])
def test_a_contact_has_one_first_encounter_whatever_ticks_its_beacons_tell(ticks: tuple[int, ...]) -> None:
    """Another one takes a waiting proposal up again, with a drive."""
    log = PeerLog("r2")
    for k, tick in enumerate(ticks):
        log.take_beacon(10, tick, Sighting(HERE, (float(k), 0.0, 0.0), np.zeros((0, 2)), SCAN), 1.0)
    assert [one.theirs[0] for one in log.encounters] == [0.0, 1.0, 2.0]
    log.take_beacon(100, 100, Sighting(HERE, (9.0, 0.0, 0.0), np.zeros((0, 2)), SCAN), 1.0)
    assert [one.theirs[0] for one in log.encounters] == [9.0]


@pytest.mark.parametrize("sighting", [DISC_NATS, -4 * DISC_NATS])
def test_a_sighting_decides_while_it_waits(sighting: float) -> None:
    team, proposed = on_trial(GROUND_MOST_NATS)
    proposed.trial.nats["discs"] = sighting
    team.judge(LATER + 1, EMPTY, HERE)
    # these maps have no wall: without the last check, which they cannot pass, the first one would be merged
    said = [event.data["reason"] for event in team.events if event.event == "rejected"]
    assert said == ["its walls do not fit" if sighting > 0 else "the evidence decides"]


def test_where_walls_may_still_decide_a_drive_that_has_shown_too_little_ends_in_a_rejection() -> None:
    team, _ = on_trial(0.5 * GROUND_MOST_NATS, DISC_NATS)
    assert [event.data["reason"] for event in team.events if event.event == "rejected"] == ["undecided"]
    assert not team.proposed


def test_a_silent_peer_is_driven_to_once_and_not_sought_by_its_walls() -> None:
    """In a maze a robot drove for 93 s to walls that the peer alone had seen; all of them would not have decided."""
    team, proposed = on_trial(0.0, theirs=ROOM)
    assert len(proposed.trial.walls.unseen())
    assert team.errand is None and team.proposed == [proposed]


def heard_by(
    beacons: dict[int, Pose], maps: Sequence[int] = (1,), begun: Sequence[int] | None = None
) -> list[tuple[int, str]]:
    """Ticks and reasons of what a team says of a peer whose map, like the own one, is whole when it comes.

    beacons: where the peer says that it is, by tick. maps: ticks at which its map comes. begun: those at which a
    contact begins; None: all.
    """
    team, said = Team(CooperationConfig(), AlignmentConfig(), RobotSpec(), np.random.default_rng(0)), []
    own = maze(0)
    for tick in sorted({*beacons, *maps}):
        beacon = Beacon(tick, beacons[tick]) if tick in beacons else None
        since = max(one for one in begun or [tick] if one <= tick)
        news = News("r2", since, beacon=beacon, map=ReceivedMap(own, tick) if tick in maps else None)
        team.hear(tick, [news], (1.5, 3.5, 0.0), SCAN, own, [news.peer])
        team.align_maps(tick, own)
        said += [(tick, str(event.data["reason"])) for event in team.events]
    return said


@pytest.mark.parametrize("first", [1, 4])
def test_a_map_that_comes_before_the_first_beacon_is_aligned_with_it(first: int) -> None:
    """Two robots with whole maps were never aligned, as neither map grew any more."""
    assert heard_by({first: BESIDE}) == [(first, "aligned")]


def test_who_is_off_its_own_map_is_aligned_when_it_is_back_and_that_is_said_once() -> None:
    off = (50.0, 50.0, 0.0)
    said = heard_by({1: off, 3: off, LATER: BESIDE})
    assert said == [(1, "its place is off its own map"), (LATER, "aligned")]


@pytest.mark.parametrize("begun", [(1,), (1, 3), (1, 5)])
def test_who_is_started_anew_is_aligned_once_its_map_is_of_the_new_frame(begun: Sequence[int]) -> None:
    """Places in both frames put some message out of the radio's range: no transform was possible in that contact.

    Its word that it has nothing begins another one, with its first beacon or soon after.
    """
    there = (300.0, 300.0, 0.0)
    said = heard_by({1: there, 3: BESIDE, 5: BESIDE}, maps=(1, 7), begun=begun)
    assert said == [(1, "its place is off its own map"), (7, "aligned")]
