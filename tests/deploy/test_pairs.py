"""The table of pairs at the end of a run tells what the events say."""

import json
from pathlib import Path

from deploy.pairs import fates


def test_the_fate_of_each_pair_is_its_last_word(tmp_path: Path) -> None:
    said = [
        (1.0, "r1", "contact", {"peer": "r2"}),
        (1.0, "r1", "attempt", {"peer": "r2", "reason": "small"}),
        (5.0, "r1", "proposed", {"peer": "r2", "reason": "aligned", "transform": [1.0, 2.0, 3.0]}),
        (6.0, "r2", "contact", {"peer": "r1"}),
        (7.0, "r1", "stuck", {"reason": "no progress"}),
        (9.0, "r1", "accepted", {"peer": "r2", "reason": "the evidence decides", "transform": [1.0, 2.0, 3.1]}),
        (11.0, "r3", "accepted", {"peer": "r2", "reason": "the evidence decides", "transform": [0.0, 0.0, 0.0]}),
        (12.0, "r3", "unmerged", {"peer": "r2", "reason": "own scans contradict it", "transform": [0.0, 0.0, 0.0]}),
    ]
    lines = [json.dumps({"t": t, "tick": 0, "robot": robot, "event": event, **data}) for t, robot, event, data in said]
    (tmp_path / "events.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    first, second, third = fates(tmp_path)
    assert (first.robot, first.peer, first.contacts, first.attempts, first.proposed) == ("r1", "r2", 1, 1, 1)
    assert first.merged_at == 9.0 and first.transform == [1.0, 2.0, 3.1]
    assert first.last == "accepted: the evidence decides"
    assert second.last == "contact" and second.merged_at is None
    assert third.merged_at is None and third.transform is None and third.last.startswith("unmerged")
