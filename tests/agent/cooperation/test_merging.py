"""What of a peer's map becomes part of the robot's own."""

import numpy as np

from agent.communication.receiving import ReceivedMap
from agent.cooperation.config import VerificationConfig
from agent.cooperation.evidence import WallEvidence
from agent.cooperation.merging import merge
from agent.cooperation.peer import PeerLog, Proposed
from agent.cooperation.verification import Trial
from protocol.wireframe import Wireframe


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
    trial.walls.lay(walls)
    peer = merge(Proposed(PeerLog("p"), ReceivedMap(walls, 0), trial, 0.01), 0, Wireframe())
    assert peer.laid.hidden.tolist() == [False, False, True]
    assert len(peer.laid.layer.pieces) == len(peer.laid.first_hand.pieces) == 2
