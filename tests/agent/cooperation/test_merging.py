"""What of a peer's map becomes part of the robot's own."""

from dataclasses import replace

import numpy as np
import pytest

from agent.alignment.config import AlignmentConfig
from agent.communication.receiving import ReceivedMap
from agent.cooperation.config import CooperationConfig, VerificationConfig
from agent.cooperation.evidence import WallEvidence
from agent.cooperation.merging import UNMERGE_M, merge, refit
from agent.cooperation.peer import PeerLog, Peers, Proposed, Unaligned
from agent.cooperation.peer_places import PeerPlaces
from agent.cooperation.team import Team
from agent.cooperation.verification import Trial
from protocol.geometry import apply
from protocol.messages import RobotSpec
from protocol.wireframe import Wireframe, enclosed
from tests.agent.alignment.test_by_sight import SCAN
from tests.agent.cooperation.test_thirds import PEER, merged, room


def test_what_its_sender_is_not_sure_of_is_not_shown() -> None:
    walls = Wireframe(
        np.array([[0, 0], [4, 0], [4, 3], [0, 3], [2, 1], [2.1, 1]], np.float64),
        np.zeros(6, np.uint8),
        np.array([[0, 1], [2, 3], [4, 5]], np.int32),
        np.array([1, 3 / 4, 4 / 7], np.float32),  # hit in 2 of 2 scans, the last one in 3 of 5
        np.ones(3, np.bool_),
    )
    nowhere = np.zeros(3)
    trial = Trial(VerificationConfig(), nowhere, WallEvidence())
    trial.walls.lay(walls, trial.transform, Wireframe())
    peer = merge(Proposed(PeerLog("p"), ReceivedMap(walls, 0), trial, 0.01), 0, Wireframe())
    assert peer.laid.hidden.tolist() == [False, False, True]
    assert len(peer.laid.layer.pieces) == len(peer.laid.first_hand.pieces) == 2


@pytest.mark.parametrize("newer", [False, True])
def test_what_own_scans_contradict_is_not_proposed_again_by_the_same_maps(
    newer: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They had grown since they were aligned last, before the merge: the same transform was merged again at once.

    A newer map that was not merged yet may bring another one, as it closes a loop.
    """
    team = Team(CooperationConfig(), AlignmentConfig(), RobotSpec(), np.random.default_rng(0))
    team.peers["p"] = peer = merged("p", PEER)
    if newer:
        peer.log.map = ReceivedMap(peer.map.wireframe, 1)
    monkeypatch.setattr(WallEvidence, "take_doubt", lambda _: True)
    monkeypatch.setattr(WallEvidence, "said", lambda *_: (0.0, 2 * UNMERGE_M))
    team.hear(0, [], (4.0, 4.0, 0.0), SCAN, room(), [])
    assert [event.data["reason"] for event in team.events] == ["own scans contradict it"]
    for tick in (0, 1):
        team.align_maps(tick, room())
        assert isinstance(team.peers["p"], Unaligned) is not newer


def test_a_peer_far_from_the_walls_that_both_have_is_known_less_well() -> None:
    """The turn of its frame moves it by more, the farther off it is."""
    room = enclosed([np.array([(1.0, 1), (3, 1), (3, 3), (1, 3)])])
    trial = Trial(VerificationConfig(), np.zeros(3), WallEvidence())
    trial.walls.lay(room, trial.transform, Wireframe())
    peers = Peers()
    places = PeerPlaces(peers, RobotSpec(), CooperationConfig())
    spread = {}
    for x in (2.0, 17.0):
        log = PeerLog("p", pose=(x, 2.0, 0.0), pose_tick=0)
        peers["p"] = merge(Proposed(log, ReceivedMap(room, 0), trial, 0.01), 0, room)
        spread[x] = places.teammates(0)[0].covariance[0] ** 0.5
    assert spread[2.0] < 0.02 and spread[17.0] > 0.05


def test_a_merged_map_goes_along_when_the_own_one_turns_in_its_frame() -> None:
    """Its sender is out of reach for long, and no newer map comes."""
    corners = np.array([[0, 0], [12, 0], [12, 8], [0, 8]], np.float64)
    edges, turn = np.array([[0, 1], [1, 2], [2, 3], [3, 0]], np.int32), np.array([0.0, 0.0, 0.007])
    walls = Wireframe(corners, np.zeros(4, np.uint8), edges, np.ones(4, np.float32), np.ones(4, np.bool_))
    trial = Trial(VerificationConfig(), np.zeros(3), WallEvidence())
    trial.walls.lay(walls, trial.transform, Wireframe())
    peer = merge(Proposed(PeerLog("p"), ReceivedMap(walls, 0), trial, 0.01), 0, walls)
    assert refit(peer, 20, walls).laid is peer.laid
    turned = refit(peer, 40, replace(walls, points=apply(turn, corners)))
    assert turned.transform == pytest.approx(turn, abs=1e-3) and turned.updated == 40
    assert turned.laid.layer.pieces["uy"][0] == pytest.approx(0.007, abs=5e-4)
