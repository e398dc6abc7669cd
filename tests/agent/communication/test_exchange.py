"""Maps between robots over a radio that loses, delays and doubles: they arrive, at the least cost, and only once."""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.communication import receiving, telling
from agent.communication.config import TalkConfig
from agent.communication.exchange import MOST_ANSWERS, MOST_FROM_PEER, Exchange
from agent.communication.receiving import CLOCK_S, KEPT_MAPS, Known, ReceivedMap
from protocol.errors import ProtocolError
from protocol.grid_map import GridMap, quantise
from protocol.map_codec import decode_map, encode_map
from protocol.messages import EVERYONE, MTU_BYTES, Heard, Send
from protocol.talk import ACK, BEACON, DELTA, HAS_NO_MAP, MAP, MAX_BODY, MAX_PARTS, Ack, Beacon, Part, in_parts
from protocol.wireframe import Wireframe

RATE_HZ = 5.0


def comb(rooms: int, shift: float = 0.0) -> Wireframe:
    """Square rooms in a row, the last one moved by `shift`."""
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    points = (
        np.concatenate([square + np.array((1.5 * room, 0)) for room in range(rooms)]) if rooms else np.zeros((0, 2))
    )
    points[-4:] += (shift, shift)
    ring = np.array([(0, 1), (1, 2), (2, 3), (3, 0)], np.int32)
    edges = np.concatenate([ring + 4 * room for room in range(rooms)]) if rooms else np.zeros((0, 2), np.int32)
    m = len(edges)
    return Wireframe(points, np.zeros(len(points), np.uint8), edges, np.ones(m, np.float32), np.ones(m, np.bool_))


class Pair:
    """Two exchanges and what is between them. Robot a has a map that changes, b has none."""

    def __init__(
        self,
        mtu_bytes: int = MTU_BYTES,
        seed: int = 0,
        loss: float = 0.0,
        latency: int = 1,
        wants_maps: bool = False,
        likelihoods: bool = True,
        silence_s: float = 5.0,
    ) -> None:
        self.config = TalkConfig(likelihoods=likelihoods, silence_s=silence_s)
        self.mtu_bytes, self.wants_maps = mtu_bytes, wants_maps
        self.rng, self.loss, self.latency = np.random.default_rng(seed), loss, latency
        self.tick = 0
        self.robots = {name: self.new() for name in "ab"}
        self.map, self.state = comb(0), 0
        self.flying: list[tuple[int, str, Send]] = []
        self.sent: list[tuple[int, str, Send]] = []
        self.events: list[tuple[int, str, str]] = []
        self.anew: list[tuple[int, str, int]] = []
        """Who was told when that the other has begun anew, and from which tick on its maps may be new."""
        self.maps: dict[tuple[str, str], ReceivedMap] = {}
        """The newest map that was received, by receiver and sender."""

    def new(self) -> Exchange:
        return Exchange(self.config, RATE_HZ, self.mtu_bytes, self.wants_maps)

    def show(self, wireframe: Wireframe) -> None:
        self.map, self.state = wireframe, self.state + 1

    def run(self, ticks: int, cut: bool = False) -> None:
        for _ in range(ticks):
            due = [one for one in self.flying if one[0] <= self.tick]
            self.flying = [one for one in self.flying if one[0] > self.tick]
            for name, robot in self.robots.items():
                heard = [
                    Heard(tick=self.tick, sender=sender, kind=send.kind, payload=send.payload)
                    for _, sender, send in due
                    if sender != name
                ]
                told, events = robot.hear(self.tick, heard)
                self.maps |= {(name, news.peer): news.map for news in told if news.map is not None}
                self.anew += [(self.tick, name, news.anew) for news in told if news.anew is not None]
                for event in events:
                    self.events.append((self.tick, name, event.event))
                mine = (self.map, self.state) if name == "a" else (comb(0), 0)
                for send in robot.talk(self.tick, (1.0, 2.0, 3.0), lambda _, own=mine[0]: own, mine[1]):
                    assert len(send.payload) <= self.mtu_bytes
                    self.sent.append((self.tick, name, send))
                    if not cut and self.rng.random() >= self.loss:
                        late = self.latency + int(self.rng.integers(3)) if self.latency > 1 else 1
                        self.flying.append((self.tick + late, name, send))
            self.tick += 1

    def kinds(self, name: str, since: int = 0) -> Counter[str]:
        return Counter(send.kind for tick, sender, send in self.sent if sender == name and tick >= since)

    def bytes(self, *kinds: str) -> int:
        return sum(len(send.payload) for _, _, send in self.sent if send.kind in kinds)

    def got(self) -> Wireframe | None:
        there = "a" in self.robots["b"].contacts and ("b", "a") in self.maps
        return self.maps["b", "a"].wireframe if there else None

    def agrees(self) -> bool:
        """Whether b has a's map to within cell and slack."""
        got = self.got()  # None where b has lost a, as it does again and again where much is lost
        if got is None or len(got.points) != len(self.map.points) or len(got.edges) != len(self.map.edges):
            return False
        away = np.abs(got.points[:, None] - self.map.points[None]).max(2)
        return bool(away.min(1).max() <= 0.021 and away.min(0).max() <= 0.021)

    def settle(self, ticks: int) -> None:
        """Run until b has the map, for at most so long."""
        end = self.tick + ticks
        while not self.agrees():
            assert self.tick < end
            self.run(1)


def test_the_map_comes_whole_once_then_in_changes_then_nothing() -> None:
    pair = Pair()
    pair.show(comb(20))
    pair.run(10)
    assert pair.agrees() and pair.kinds("a") == {"beacon": 2, "map": 1} and pair.kinds("b") == {"beacon": 2, "ack": 1}
    whole = pair.bytes("map")
    pair.show(comb(21))
    pair.run(40)
    assert pair.agrees() and pair.kinds("a")["delta"] == 1
    assert pair.bytes("delta", "ack") < whole / 5
    before = pair.tick
    pair.run(200)
    assert set(pair.kinds("a", before)) == set(pair.kinds("b", before)) == {"beacon"}


def test_noise_is_not_sent() -> None:
    pair = Pair()
    pair.show(comb(20))
    pair.run(10)
    for shift in (0.004, 0.009, -0.005):
        pair.show(comb(20, shift))
        pair.run(30)
    assert pair.kinds("a")["delta"] == 0
    pair.show(comb(20, 0.03))
    pair.run(30)
    assert pair.kinds("a")["delta"] == 1 and pair.agrees()


@pytest.mark.parametrize("likelihoods", [True, False])
def test_likelihoods_that_are_not_told_are_no_news(likelihoods: bool) -> None:
    pair = Pair(likelihoods=likelihoods)
    for k in range(4):
        pair.show(replace(comb(20), likelihood=np.full(80, 1.0 - 0.5 * (k % 2), np.float32)))
        pair.run(30)
    assert pair.kinds("a")["delta"] == (3 if likelihoods else 0)


def test_changes_are_told_at_most_every_period() -> None:
    pair = Pair()
    for rooms in range(1, 101):
        pair.show(comb(rooms))
        pair.run(1)
    news = [tick for tick, name, send in pair.sent if name == "a" and send.kind in ("map", "delta")]
    assert len(news) == 4 and min(np.diff(news)) >= 25


def test_a_map_is_put_on_its_grid_and_coded_once_for_peers_that_have_the_same_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, told = [0], Counter[str]()

    def counted(*given: Any) -> GridMap:
        made[0] += 1
        return quantise(*given)

    monkeypatch.setattr(telling, "quantise", counted)
    robots = {name: Exchange(TalkConfig(), RATE_HZ, MTU_BYTES) for name in "abc"}
    flying: list[tuple[str, Send]] = []
    for tick in range(100):
        maps, landed, flying = {"a": comb(1 + tick // 30)}, flying, []
        for name, robot in robots.items():
            own = maps.get(name, comb(0))
            mine = [(sender, send) for sender, send in landed if sender != name and send.to in (EVERYONE, name)]
            heard = [Heard(tick=tick, sender=sender, kind=send.kind, payload=send.payload) for sender, send in mine]
            robot.hear(tick, heard)
            sends = robot.talk(tick, (1.0, 2.0, 3.0), lambda _, own=own: own, tick // 30 if name == "a" else 0)
            flying += [(name, send) for send in sends]
            told += Counter(send.to for send in sends if send.kind in (MAP, DELTA))
    assert told["b"] == told["c"] == 4
    assert made[0] == 4 + 2  # b and c once each, to find that they have nothing to tell


@pytest.mark.parametrize(("others", "most"), [(2, 7), (5, 4), (8, 3)])
def test_in_a_crowd_each_is_told_less_often(others: int, most: int) -> None:
    pair = Pair()
    for k in range(300):
        pair.show(comb(8, shift=0.05 * k))
        for other in range(others):  # they have nothing to say but that they are there
            beacon = Heard(tick=k, sender=f"c{other}", kind="beacon", payload=Beacon(k, (0.0, 0.0, 0.0)).encode())
            pair.robots["a"].hear(k, [beacon])
        pair.run(1)
    told = [tick for tick, name, send in pair.sent if name == "a" and send.to == "b" and send.kind in ("map", "delta")]
    assert most - 1 <= sum(tick < 150 for tick in told) <= most and told[-1] > 200


@pytest.mark.parametrize("seed", range(8))
def test_losses_and_latency_are_made_good(seed: int) -> None:
    pair = Pair(seed=seed, loss=0.3, latency=5)
    for rooms in range(1, 30):
        pair.show(comb(rooms))
        pair.run(20)
    pair.settle(200)
    assert pair.kinds("a")["resend"] + pair.kinds("a")["delta"] > 5
    assert "refused" not in {what for _, _, what in pair.events}


def test_a_peer_that_was_away_gets_what_it_missed_only() -> None:
    pair = Pair()
    pair.show(comb(20))
    pair.run(20)
    pair.show(comb(21))
    pair.run(100, cut=True)
    assert [what for _, name, what in pair.events if name == "a"] == ["contact", "lost"]
    before = pair.tick
    pair.run(30)
    assert pair.agrees()
    assert pair.kinds("a", before) == {"beacon": 2, "resend": 1}
    pair.run(100, cut=True)
    pair.show(comb(22))
    before = pair.tick
    pair.run(30)
    assert pair.agrees()
    assert pair.kinds("a", before) == {"beacon": 3, "delta": 1}


def test_an_unchanged_map_is_not_told_again_after_an_absence() -> None:
    pair = Pair()
    pair.show(comb(20))
    pair.run(20)
    pair.run(100, cut=True)
    before = pair.tick
    pair.run(40)
    assert pair.agrees()
    assert set(pair.kinds("a", before)) == {"beacon"}


def test_a_map_that_is_known_is_no_news_when_its_peer_comes_back() -> None:
    """Five newer maps in a row that contradict the own one undo a merge: the same one counted in each contact."""
    pair = Pair()
    pair.show(comb(20))
    pair.run(20)
    assert pair.maps
    pair.run(100, cut=True)
    pair.maps.clear()
    pair.run(40)
    assert "a" in pair.robots["b"].contacts and not pair.maps


def test_a_peer_that_begins_anew_gets_all_again() -> None:
    pair = Pair()
    pair.show(comb(20))
    pair.run(20)
    pair.robots["b"] = pair.new()
    pair.show(comb(21))
    pair.run(80)
    assert pair.agrees() and pair.kinds("a")["map"] == 2


@pytest.mark.parametrize("away", [0, 100])
def test_a_peer_that_begins_anew_gets_a_map_that_does_not_change(away: int) -> None:
    pair = Pair(wants_maps=True)
    pair.show(comb(20))
    pair.run(20)
    pair.run(away, cut=True)
    pair.robots["b"] = pair.new()
    pair.maps.clear()
    before = pair.tick
    pair.run(200)
    assert pair.agrees() and pair.kinds("a", before)["map"] == 1
    assert pair.kinds("b", before)["ack"] == 2


@pytest.mark.parametrize("rooms", [20, 21])
@pytest.mark.parametrize("away", [0, 100])
def test_a_peer_that_begins_anew_is_met_anew(rooms: int, away: int) -> None:
    """Of two that had merged, one that was started anew within 5 s was told late, or never, of its frame."""
    pair = Pair(wants_maps=True)
    pair.show(comb(20))
    pair.run(30)
    pair.run(away, cut=True)
    pair.robots["b"] = pair.new()
    pair.show(comb(rooms))
    pair.run(100)
    began = [tick for tick, name, what in pair.events if (name, what) == ("a", "contact")]
    assert len(began) == (3 if away else 2) and 30 + away < began[-1] < 80 + away
    assert pair.robots["a"].contacts["b"].since == began[-1]
    silence = round(TalkConfig().silence_s * RATE_HZ)
    assert pair.anew == [(began[-1], "a", began[-2] - silence)]


def test_nobody_begins_anew_where_messages_are_lost_and_contact_breaks() -> None:
    pair = Pair(seed=1, loss=0.5, latency=5, wants_maps=True)
    for rooms in range(1, 20):
        pair.show(comb(rooms))
        pair.run(20, cut=rooms % 5 == 0)
    assert "lost" in {what for _, _, what in pair.events} and not pair.anew


@pytest.mark.parametrize("silence_s", [5.0, 30.0])
def test_a_late_word_of_who_had_no_map_yet_is_no_sign_that_it_has_begun_anew(silence_s: float) -> None:
    """An answer had overtaken it: in 10 of 60 runs with latencies of 5 to 20 ticks. A true one waited for 30 s."""
    pair = Pair(wants_maps=True, silence_s=silence_s)
    pair.show(comb(20))
    pair.run(10)
    for tick, begun in ((10, False), (50, True)):
        late = Heard(tick=tick, sender="b", kind=ACK, payload=HAS_NO_MAP.encode())
        news, _ = pair.robots["a"].hear(tick, [late])
        assert [one.anew is not None for one in news] == [begun]


def test_nobody_begins_anew_whose_answers_are_all_lost() -> None:
    """After eight versions it had dropped the one that changes were told to, and said that it had nothing."""
    first, known = encode_map(quantise(comb(9), 10, 0)), Known()
    changed = encode_map(quantise(comb(9, 0.5), 10, 0), first.map).data
    parts = [Part(1, 0, 0, 1, first.data), *(Part(2 + k, 1, 0, 1, changed) for k in range(2 * KEPT_MAPS))]
    for part in parts:
        ack, new = known.take_part(part.version, part, patience_ticks=100, period_ticks=0)
        assert ack == Ack(part.version) and new is not None
    assert len(known.maps) == KEPT_MAPS + 1


def test_who_is_told_a_whole_map_cannot_lack_its_base() -> None:
    """A hostile peer that said so of each map began anew each time, and was told it again."""
    pair = Pair()
    for rooms, kind in ((20, MAP), (21, DELTA)):
        pair.show(comb(rooms))
        pair.run(30)
        told = [Part.decode(send.payload) for _, _, send in pair.sent if send.kind == kind]
        lacks = Heard(tick=pair.tick, sender="b", kind=ACK, payload=Ack(told[-1].version, None).encode())
        news, _ = pair.robots["a"].hear(pair.tick, [lacks])
        assert [one.anew is not None for one in news] == [kind == DELTA]


def test_a_peer_that_begins_anew_is_known_by_its_answer_to_changes_that_newer_ones_have_overtaken() -> None:
    """At latencies of 4 s and more, of a map that went on changing, each answer was."""
    pair = Pair(silence_s=30.0)
    for rooms in range(20, 23):
        pair.show(comb(rooms))
        pair.run(30, cut=rooms > 20)
    first, _ = [Part.decode(send.payload) for _, _, send in pair.sent if send.kind == DELTA]
    lacks = Heard(tick=pair.tick, sender="b", kind=ACK, payload=Ack(first.version, None).encode())
    news, _ = pair.robots["a"].hear(pair.tick, [lacks])
    assert news[0].anew is not None


def test_who_has_no_map_of_a_peer_says_so_once_a_beacon_s_period_at_most_and_not_where_it_is_of_no_use() -> None:
    for wants_maps in (True, False):
        pair = Pair(wants_maps=wants_maps)  # neither has any wall
        pair.run(1000)
        assert all(pair.kinds(name)["ack"] == (39 if wants_maps else 0) for name in "ab")


def test_a_sender_that_begins_anew_is_believed() -> None:
    pair = Pair()
    pair.show(comb(20))
    pair.run(20)
    pair.robots["a"] = pair.new()
    pair.show(comb(3))
    pair.run(80)
    assert pair.agrees()


@pytest.mark.parametrize("ahead_s", [30.0, 1e6])
def test_a_sender_whose_clock_was_ahead_is_heard_again_once_that_is_put_right(ahead_s: float) -> None:
    """Its maps had lower versions than those before, and were never taken again."""
    robot, data, taken = Exchange(TalkConfig(), RATE_HZ, MTU_BYTES), encode_map(quantise(comb(3), 10, 0)).data, []
    for tick, ahead in ((100, round(ahead_s * RATE_HZ)), (200, 0), (300, 0), (400, 0)):
        theirs = tick + ahead
        said = [(BEACON, Beacon(theirs, (0.0, 0.0, 0.0)).encode()), (MAP, Part(theirs, 0, 0, 1, data).encode())]
        news, _ = robot.hear(tick, [Heard(tick=tick, sender="b", kind=kind, payload=one) for kind, one in said])
        taken += [one.map.tick for one in news if one.map is not None]
    assert taken == ([100, 300, 400] if ahead_s < CLOCK_S else [100, 200, 300, 400])


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 0), (0.3, 1), (0.3, 2), (0.5, 3)])
def test_a_large_map_travels_in_parts_and_only_missing_ones_again(loss: float, seed: int) -> None:
    pair = Pair(64, seed, loss, latency=5)
    pair.show(comb(200))
    pair.settle(500 if loss < 0.5 else 1500)
    parts = [Part.decode(send.payload) for _, _, send in pair.sent if send.kind in ("map", "resend")]
    assert parts[0].parts > 10
    most = {0.0: 1, 0.3: 3, 0.5: 8}[loss]  # all again and again until all came at once would be thousands
    assert len(parts) <= most * parts[0].parts


def test_a_large_map_arrives_though_it_changes() -> None:
    pair = Pair(64, 1, 0.3, latency=5)
    for rooms in range(200, 230):
        pair.show(comb(rooms))
        pair.run(20)
    got = pair.robots["b"]._known["a"].newest
    assert got > 300


def test_parts_wait_only_so_long() -> None:
    hear = Pair().robots["b"]
    body = bytes(100)
    early, late = Part(9, 0, 0, 2, body).encode(), Part(9, 0, 1, 2, body).encode()
    hear.hear(10, [Heard(tick=10, sender="a", kind="map", payload=early)])
    hear.hear(1000, [Heard(tick=1000, sender="a", kind="map", payload=late)])
    acks = [send for send in hear.talk(1000, (0, 0, 0), lambda _: comb(0), 0) if send.kind == "ack"]
    assert Ack.decode(acks[-1].payload).missing == {0}


def test_parts_that_were_given_up_are_sent_again() -> None:
    pair = Pair(64)
    pair.show(comb(60))
    pair.run(1)
    while not any(send.kind == "map" for _, _, send in pair.flying):
        pair.run(1)
    maps = [one for one in pair.flying if one[2].kind == "map"]
    lose = {id(one) for one in maps[::2]}
    pair.flying = [one for one in pair.flying if id(one) not in lose]  # half of the parts
    pair.run(2)
    arriving = pair.robots["b"]._known["a"].arriving
    assert arriving is not None and len(arriving.bodies) == len(maps) // 2
    pair.robots["b"]._known["a"].arriving = None
    pair.settle(200)


def test_parts_of_an_older_map_acknowledge_nothing() -> None:
    pair = Pair(64)
    pair.show(comb(60))
    while not any(send.kind == "map" for _, _, send in pair.flying):
        pair.run(1)
    told = pair.robots["a"]._told["b"]
    parts, version = told.whole, told.whole[0].version
    told.parts = []  # as if given up for a newer one
    some = Ack(version, frozenset({0})).encode(len(parts))
    pair.robots["a"].hear(pair.tick, [Heard(tick=pair.tick, sender="b", kind="ack", payload=some)])
    assert told.acked == 0 and told.parts == []


def test_a_flood_of_bad_messages_is_one_event_a_peer() -> None:
    hear = Pair().robots["b"]
    news, events = hear.hear(1, [Heard(tick=1, sender="a", kind="map", payload=bytes([k])) for k in range(200)])
    assert not news and [event.event for event in events] == ["refused"]


def test_what_another_program_says_is_passed_over_and_the_rest_is_read() -> None:
    foreign = [
        Heard(tick=1, sender=who, kind="gossip", payload=bytes([k])) for k in range(MOST_FROM_PEER + 1) for who in "ac"
    ]
    beacon = Heard(tick=1, sender="a", kind="beacon", payload=Beacon(1, (0.5, 0.0, 0.0)).encode())
    hear = Pair().robots["b"]
    news, events = hear.hear(1, [*foreign, beacon, foreign[0]])
    assert [(one.peer, one.beacon is not None) for one in news] == [("a", True)]
    assert [(event.event, event.data) for event in events] == [("contact", {"peer": "a"})]
    assert list(hear.contacts) == ["a"]


def test_of_two_beacons_in_a_tick_the_newer_one_counts() -> None:
    said = [Beacon(tick, (x, 0.0, 0.0)).encode() for tick, x in ((11, 2.0), (9, 1.0))]
    for payloads in (said, said[::-1]):
        heard = [Heard(tick=12, sender="a", kind="beacon", payload=payload) for payload in payloads]
        assert [one.beacon for one in Pair().robots["b"].hear(12, heard)[0]] == [Beacon(11, (2.0, 0.0, 0.0))]


def test_a_flood_of_changes_is_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[int] = []

    def counted(data: bytes, base: GridMap | None = None) -> GridMap:
        read.append(len(data))
        return decode_map(data, base)

    monkeypatch.setattr(receiving, "decode_map", counted)
    hear = Pair().robots["b"]
    first = encode_map(quantise(comb(9), 10, 0))
    changed = encode_map(quantise(comb(9, 0.5), 10, 0), first.map).data
    hear.hear(1, [Heard(tick=1, sender="a", kind="map", payload=Part(1, 0, 0, 1, first.data).encode())])
    acked = 0
    for tick in range(2, 52):
        flood = [Part(256 * tick + k, 1, 0, 1, changed).encode() for k in range(256)]
        hear.hear(tick, [Heard(tick=tick, sender="a", kind="delta", payload=payload) for payload in flood])
        sends = hear.talk(tick, (0.0, 0.0, 0.0), lambda _: Wireframe(), 0)
        acked += sum(send.kind == "ack" for send in sends)
        assert len(sends) <= MOST_ANSWERS + 1
    assert acked > 0 and len(read) <= 1 + 5 + 2 * 50 / 25


def test_a_flood_of_unknown_maps_does_not_have_a_robot_say_more_than_it_may() -> None:
    hear = Pair().robots["b"]
    flood = [Part(1000 + k, 7, 0, 1, b"").encode() for k in range(256)]
    hear.hear(1, [Heard(tick=1, sender="a", kind="delta", payload=payload) for payload in flood])
    assert len(hear.talk(1, (0.0, 0.0, 0.0), lambda _: Wireframe(), 0)) <= MOST_ANSWERS + 1


@given(st.integers(0, 2**32 - 1), *[st.floats(-9000, 9000)] * 2, st.floats(-7, 7))
def test_a_beacon_comes_back_to_a_millimetre(tick: int, x: float, y: float, theta: float) -> None:
    data = Beacon(tick, (x, y, theta)).encode()
    back = Beacon.decode(data)
    assert len(data) <= 32 and back.tick == tick
    assert back.pose[:2] == pytest.approx((x, y), abs=6e-4)
    assert np.exp(1j * back.pose[2]) == pytest.approx(np.exp(1j * theta), abs=1e-4)


@given(st.integers(1, 2**32), st.data(), st.binary(max_size=50))
def test_parts_and_acknowledgements_come_back(version: int, draw: st.DataObject, body: bytes) -> None:
    parts = draw.draw(st.integers(1, MAX_PARTS))
    base = draw.draw(st.integers(0, version - 1))
    part = Part(version, base, draw.draw(st.integers(0, parts - 1)), parts, body)
    assert Part.decode(part.encode()) == part
    missing = draw.draw(st.none() | st.frozensets(st.integers(0, parts - 1)))
    ack = Ack(version, missing)
    assert Ack.decode(ack.encode(parts)) == ack


@given(st.sampled_from([Beacon, Part, Ack]), st.binary(max_size=30))
def test_any_bytes_are_a_message_or_one_error(kind: type[Beacon | Part | Ack], data: bytes) -> None:
    for hostile in (data, bytes([0x10 | len(data) % 4]) + data):
        try:
            kind.decode(hostile)
        except ProtocolError as error:
            assert "\n" not in str(error)


@given(st.lists(st.tuples(st.sampled_from(["beacon", "map", "delta", "ack", "x"]), st.binary(max_size=20)), max_size=8))
def test_any_messages_leave_an_exchange_in_order(messages: list[tuple[str, bytes]]) -> None:
    pair = Pair()
    pair.show(comb(4))
    for kind, payload in messages:
        hostile = Heard(tick=pair.tick, sender="c", kind=kind, payload=bytes([0x10]) + payload)
        for robot in pair.robots.values():
            robot.hear(pair.tick, [hostile])
        pair.run(1)
    pair.run(10)
    assert pair.agrees()


def test_parts_fit_their_messages() -> None:
    body = bytes(range(256)) * 40
    parts = in_parts(500, 400, body, 1200)
    assert b"".join(part.body for part in parts) == body and max(len(part.encode()) for part in parts) <= 1200
    assert len(in_parts(500, 0, bytes(1190), 1200)) == 1
    for size, mtu in ((70_000, 1200), (10_000, 64)):
        with pytest.raises(ProtocolError, match="at most"):
            in_parts(1, 0, bytes(size), mtu)


def test_the_grid_is_turned_with_a_map_that_turned_out_otherwise() -> None:
    pair = Pair()
    pair.show(comb(20))
    pair.run(20)
    c, s = np.cos(0.05), np.sin(0.05)
    pair.show(replace(comb(20), points=comb(20).points @ np.array([[c, s], [-s, c]])))
    pair.run(40)
    assert pair.agrees() and pair.kinds("a")["map"] == 2


def test_a_map_that_is_too_large_to_travel_is_an_event_and_no_crash() -> None:
    pair = Pair(64)
    rng = np.random.default_rng(0)
    big = comb(900)
    pair.show(replace(big, points=big.points + rng.uniform(-0.2, 0.2, big.points.shape)))
    pair.run(60)
    pair.state += 1
    pair.run(60)
    assert [(name, what) for _, name, what in pair.events if what == "untold"] == [("a", "untold")]
    assert pair.kinds("a")["map"] == 0
    pair.show(comb(9))
    pair.settle(60)


def test_a_part_that_comes_twice_counts_once() -> None:
    hear = Pair().robots["b"]
    body = bytes(MAX_BODY // 2)
    messages = [Heard(tick=1, sender="a", kind="map", payload=Part(9, 0, k, 3, body).encode()) for k in (0, 1, 1)]
    assert [event.event for event in hear.hear(1, messages)[1]] == ["contact"]
    more = Heard(tick=2, sender="a", kind="map", payload=Part(9, 0, 2, 3, b"x").encode())
    assert [event.event for event in hear.hear(2, [more])[1]] == ["refused"]


def test_beacons_come_every_second_in_sight_of_a_stranger() -> None:
    one = Exchange(TalkConfig(), 5.0, MTU_BYTES)
    said = {
        sight: [
            t for t in range(1, 51) for send in one.talk(t, (0.0, 0.0, 0.0), lambda _: Wireframe(), 0, in_sight=sight)
        ]
        for sight in (False, True)
    }
    assert said == {False: [25, 50], True: list(range(5, 51, 5))}
