"""The gate: who hears what, when, and what the books say."""

import math

import numpy as np
import pytest

from protocol.codec import decode, encode
from protocol.errors import ProtocolError
from protocol.messages import MAX_TICK, MOST_LINKS, Heard, LinkReport, LinkTable, Send
from world.radio.config import MAX_MTU_BYTES, RadioConfig
from world.radio.gate import Passage, Radio

NAMES = ["r1", "r2", "r3"]
LINE = np.array([[0.0, 0.0], [3.9, 0.0], [8.0, 0.0]])  # r2 is within 4 m of r1, r3 of nobody


def send(tick: int, payload: bytes, to: str = "*", kind: str = "map") -> Send:
    return Send(tick=tick, to=to, kind=kind, payload=payload)


def test_a_broadcast_reaches_those_in_range_one_tick_later() -> None:
    radio = Radio(NAMES, RadioConfig(range_m=4.0))
    heard, passages = radio.deliver(0, NAMES)
    assert heard == {"r1": [], "r2": [], "r3": []} and passages == []
    radio.offer(0, {"r1": [send(0, b"hello")]}, LINE)
    heard, passages = radio.deliver(1, NAMES)
    assert [(m.tick, m.sender, m.kind, m.payload) for m in heard["r2"]] == [(1, "r1", "map", b"hello")]
    assert heard["r1"] == [] and heard["r3"] == []
    assert passages == [Passage(0, "r1", "r2", "map", 5, "delivered"), Passage(0, "r1", "r3", "map", 5, "range")]
    assert radio.deliver(2, NAMES) == ({"r1": [], "r2": [], "r3": []}, [])  # once


def test_range_is_judged_where_the_sender_stood_when_it_sent() -> None:
    radio = Radio(NAMES, RadioConfig(range_m=4.0))
    radio.offer(0, {"r3": [send(0, b"a")]}, LINE)
    radio.offer(1, {"r3": [send(1, b"b")]}, np.zeros((3, 2)))
    heard, _ = radio.deliver(2, NAMES)
    assert [m.payload for m in heard["r1"]] == [b"b"]


def test_the_longest_message_on_the_air_fits_into_one_of_the_world() -> None:
    sent = Send(tick=MAX_TICK - 1, to="*", kind="k" * 16, payload=bytes(MAX_MTU_BYTES))
    radio = Radio(["r" * 16, "r2"], RadioConfig(mtu_bytes=MAX_MTU_BYTES))
    radio.offer(MAX_TICK - 1, {"r" * 16: [decode(Send, encode(sent))]}, LINE[:2])
    (heard,) = radio.deliver(MAX_TICK, ["r2"])[0]["r2"]
    assert decode(Heard, encode(heard)) == heard
    with pytest.raises(ValueError, match="less than or equal to 1044224"):
        RadioConfig(mtu_bytes=MAX_MTU_BYTES + 1)


def test_unicasts_go_to_one_and_order_is_by_sender_and_sequence() -> None:
    radio = Radio(NAMES, RadioConfig(range_m=100.0))
    sends = {
        "r3": [send(0, b"1", to="r1"), send(0, b"2")],
        "r2": [send(0, b"3", to="r1", kind="ack"), send(0, b"4", to="r3")],
    }
    radio.offer(0, sends, LINE)
    heard, _ = radio.deliver(1, NAMES)
    assert [(m.sender, m.payload) for m in heard["r1"]] == [("r2", b"3"), ("r3", b"1"), ("r3", b"2")]
    assert [m.payload for m in heard["r2"]] == [b"2"]
    assert [m.payload for m in heard["r3"]] == [b"4"]


def test_ten_robots_are_ordered_by_number() -> None:
    names = [f"r{i + 1}" for i in range(11)]
    radio = Radio(names, RadioConfig(range_m=1.0))
    radio.offer(0, {name: [send(0, b"x", to="r1")] for name in reversed(names[1:])}, np.zeros((11, 2)))
    assert [m.sender for m in radio.deliver(1, names)[0]["r1"]] == names[1:]


def test_the_dead_hear_nothing_and_the_end_is_no_delivery() -> None:
    radio = Radio(NAMES, RadioConfig(range_m=100.0))
    radio.offer(0, {"r1": [send(0, b"abc")]}, LINE)
    heard, passages = radio.deliver(1, ["r1", "r3"])
    assert "r2" not in heard
    assert [p.outcome for p in passages] == ["dead", "delivered"]
    radio.offer(1, {"r1": [send(1, b"abc", to="r3")]}, LINE)
    assert [p.outcome for p in radio.deliver(2, NAMES, ended=True)[1]] == ["ended"]


@pytest.mark.parametrize("to", ["r1", "r9"])
def test_messages_to_oneself_or_nobody_are_refused(to: str) -> None:
    with pytest.raises(ProtocolError, match=f"r1 sends to {to}"):
        Radio(NAMES, RadioConfig()).check("r1", [send(0, b"", to=to)])


def test_the_books_balance() -> None:
    rng = np.random.default_rng(0)
    radio = Radio(NAMES, RadioConfig(range_m=4.0))
    passages = []
    for tick in range(200):
        live = NAMES[: 2 + (tick < 150)]
        passages += radio.deliver(tick, live)[1]
        sends = {
            name: [
                send(tick, bytes(int(rng.integers(50))), str(rng.choice(["*", *others])), str(rng.choice(["a", "b"])))
                for _ in range(rng.integers(3))
            ]
            for name in live
            for others in [[other for other in NAMES if other != name]]
        }
        radio.offer(tick, sends, rng.uniform(0, 5, (3, 2)))
    passages += radio.deliver(200, NAMES, ended=True)[1]
    books = radio.books.as_dict(NAMES)
    assert {p.outcome for p in passages} == {"delivered", "range", "dead", "ended"}
    for link in books["links"]:
        for kind, counts in link["kinds"].items():
            rows = [p for p in passages if (p.sender, p.receiver, p.kind) == (link["sender"], link["receiver"], kind)]
            assert counts["offered"] == {"messages": len(rows), "bytes": sum(p.bytes for p in rows)}
            parts = [counts["delivered"], *counts["dropped"].values()]
            for unit in ("messages", "bytes"):
                assert sum(part[unit] for part in parts) == counts["offered"][unit]
    assert sum(len(link["kinds"]) for link in books["links"]) == 12
    for name in NAMES:
        got = [p for p in passages if p.receiver == name and p.outcome == "delivered"]
        assert radio.books.received[name] == sum(p.bytes for p in got)
        assert sum(t["bytes"] for t in books["robots"][name]["delivered"].values()) == radio.books.received[name]
        assert sum(t["bytes"] for t in books["robots"][name]["offered"].values()) == radio.books.sent[name]


def test_what_the_radio_holds_back_was_offered_and_not_sent() -> None:
    models = [{"kind": "capacity", "bytes_per_s": 100}, {"kind": "bernoulli", "loss": 1.0}]
    radio = Radio(NAMES, RadioConfig.model_validate({"range_m": None, "mtu_bytes": 64, "models": models}))
    radio.offer(0, {"r1": [send(0, bytes(size)) for size in (65, 60, 40, 1)]}, LINE)
    assert {(p.bytes, p.outcome) for p in radio.deliver(1, NAMES)[1]} == {
        (65, "mtu"), (60, "loss"), (40, "loss"), (1, "capacity_out")
    }  # fmt: skip
    assert radio.books.sent["r1"] == 100
    assert radio.books.offered["r1", "map"]["bytes"] == 166


@pytest.mark.parametrize("period_s", [0.01, 1 / 49, 0.2, 0.75, 1.0, 3.0])
def test_a_second_of_capacity_is_a_second_at_any_rate(period_s: float) -> None:
    config = RadioConfig.model_validate({"range_m": None, "models": [{"kind": "capacity", "bytes_per_s": 100}]})
    radio = Radio(NAMES, config, 0, period_s)
    for tick in range(300):
        radio.deliver(tick, NAMES)
        radio.offer(tick, {"r1": [send(tick, bytes(25), "r2")] * 20}, LINE)
    radio.deliver(300, NAMES)
    passed = sum(row.bytes for row in radio.table(300).links)
    assert passed == 100 * math.ceil(300 * period_s)


def test_the_link_table_of_a_large_team_is_a_message_of_the_busiest_links() -> None:
    names = [f"r{number + 1}" for number in range(160)]
    radio = Radio(names, RadioConfig(range_m=None))
    radio.offer(0, {name: [send(0, bytes(row), kind="beacon")] for row, name in enumerate(names)}, np.zeros((160, 2)))
    radio.deliver(1, names)
    table = radio.table(1)
    assert (len(table.links), table.left_out) == (MOST_LINKS, 160 * 159 - MOST_LINKS)
    assert min(link.bytes for link in table.links) == 160 - 1 - MOST_LINKS // 159  # who said less is left out
    assert decode(LinkTable, encode(table)) == table


def test_any_link_table_is_a_message() -> None:
    link = LinkReport(sender="s" * 16, receiver="r" * 16, loss=1 / 3, bytes=2**40)
    encode(LinkTable(tick=MAX_TICK, links=[link] * MOST_LINKS, left_out=500 * 499))
