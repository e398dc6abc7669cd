"""A proposal that walls alone can not decide waits for the next contact once the peer has gone: no drive is made."""

import numpy as np
import pytest

from agent.alignment.config import AlignmentConfig
from agent.alignment.encounter import Encounter
from agent.communication.receiving import ReceivedMap
from agent.cooperation.config import CooperationConfig
from agent.cooperation.peer import PeerLog, Proposed, Unaligned
from agent.cooperation.team import Team
from agent.cooperation.verification import DISC_NATS, GROUND_MOST_NATS
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe

HERE = (0.0, 0.0, 0.0)
EMPTY = Wireframe()
MET = 1000  # tick of the last message
LATER = 1100  # the peer has gone


def on_trial(ground: float = 0.0, discs: float = 0.0, at: int = MET) -> tuple[Team, Proposed]:
    """A team whose only peer is on trial since a tick, with evidence of walls and of sightings, in nats."""
    team = Team(CooperationConfig(), AlignmentConfig(), RobotSpec(radio_range_m=4.0), np.random.default_rng(0))
    peer = Unaligned(PeerLog("r2", contact=Encounter(HERE, (3.0, 0.0, 0.0)), pose_tick=MET))
    peer.log.map = ReceivedMap(EMPTY, 0)
    proposed = team.propose(peer, (0.0, 0.0, 0.0), EMPTY, {})
    proposed.trial.nats |= {"ground": ground, "discs": discs}
    team.judge(at, EMPTY, HERE, None)
    return team, proposed


@pytest.mark.parametrize(("ground", "arrived"), [(GROUND_MOST_NATS, True), (0.0, None), (0.0, True)])
def test_it_waits_without_a_drive_and_the_next_contact_takes_it_up_again(ground: float, arrived: bool | None) -> None:
    team, proposed = on_trial()
    assert team.errand is not None and team.errand.goal.tolist() == [3.0, 0.0]
    proposed.trial.nats["ground"] = ground
    team.judge(LATER, EMPTY, HERE, arrived)
    assert team.errand is None and not team.queue.proposals and team.proposed == [proposed]
    team.judge(LATER + 1, EMPTY, HERE, None)
    assert team.errand is None  # the same contact, long over
    proposed.log.contact, proposed.log.pose_tick = Encounter(HERE, (0.0, 2.0, 0.0)), LATER + 2
    team.judge(LATER + 2, EMPTY, HERE, None)
    assert team.queue.proposals == [proposed] and team.errand is not None and team.errand.goal.tolist() == [0.0, 2.0]


def test_no_drive_is_begun_to_a_peer_that_has_gone_before_it_was_seen() -> None:
    """In four of ten runs of maze-15 a robot drove 7 to 27 s after a peer that was far away by then."""
    team, proposed = on_trial(at=LATER)
    assert team.errand is None and team.proposed == [proposed]


def test_a_drive_is_begun_where_walls_may_still_decide() -> None:
    team, _ = on_trial(discs=DISC_NATS, at=LATER)
    assert team.errand is not None


@pytest.mark.parametrize("sighting", [DISC_NATS, -4 * DISC_NATS])
def test_a_sighting_decides_while_it_waits(sighting: float) -> None:
    team, proposed = on_trial(GROUND_MOST_NATS, at=LATER)
    proposed.trial.nats["discs"] = sighting
    team.judge(LATER + 1, EMPTY, HERE, None)
    # these maps have no wall: without the last check, which they cannot pass, the first one would be merged
    said = [event.data["reason"] for event in team.events if event.event == "rejected"]
    assert said == ["its walls do not fit" if sighting > 0 else "the evidence decides"]


def test_a_drive_that_has_shown_less_than_it_could_ends_in_a_rejection() -> None:
    team, _ = on_trial(0.5 * GROUND_MOST_NATS, DISC_NATS, at=LATER)
    team.judge(LATER + 1, EMPTY, HERE, True)
    assert [event.data["reason"] for event in team.events if event.event == "rejected"] == ["undecided"]
    assert not team.proposed
