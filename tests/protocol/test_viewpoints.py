"""Where teammates have looked from: few bits, told to those who ask and have the map, and taken back with a merge."""

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.communication.exchange import Exchange
from agent.communication.receiving import Known, PeerViews
from protocol.errors import ProtocolError
from protocol.geometry import Pose
from protocol.grid_map import quantise
from protocol.map_codec import encode_map
from protocol.messages import MTU_BYTES, Heard, Send
from protocol.talk import Part
from protocol.viewpoints import CELL_M, TURNS, VIEWS, AskViews, Looked, Views, decode_views, turn_of_end
from tests.agent.communication.test_exchange import RATE_HZ, TalkConfig, comb

PLACE = st.tuples(st.integers(-90_000, 90_000), st.integers(-90_000, 90_000))


END = st.tuples(st.integers(-90_000, 90_000), st.integers(-90_000, 90_000), st.integers(0, TURNS - 1))


@given(
    st.lists(PLACE, max_size=60),
    st.lists(PLACE, max_size=60),
    st.lists(END, max_size=60),
    st.integers(0, 2**30),
    st.integers(1, 2**30),
)
def test_viewpoints_and_ends_arrive_as_they_were(cells, heard, ends, since, more) -> None:
    lists = [np.array(some, np.int64).reshape(-1, k) for some, k in ((cells, 2), (heard, 2), (ends, 3))]
    sent = Views(since, since + more, *lists)
    if not cells and not heard and not ends:
        with pytest.raises(ProtocolError, match="without any"):
            decode_views(sent.encode())
        return
    got = decode_views(sent.encode())
    assert sent.nbytes == len(sent.encode())
    assert isinstance(got, Views)
    assert (got.since, got.until) == (since, since + more)
    assert got.cells.tolist() == [list(cell) for cell in cells]
    assert got.heard.tolist() == [list(cell) for cell in heard]
    assert got.in_vain.tolist() == [list(end) for end in ends]
    assert decode_views(AskViews(since).encode()) == AskViews(since)


@given(st.integers(0, 2**30), st.floats(-900, 900), st.floats(-900, 900), st.floats(-3.14, 3.14))
def test_who_asks_may_tell_where_the_other_s_frame_lies(since: int, x: float, y: float, theta: float) -> None:
    got = decode_views(AskViews(since, (x, y, theta)).encode())
    assert isinstance(got, AskViews) and got.since == since and got.frame is not None
    assert np.abs(np.subtract(got.frame, (x, y, theta))).max() <= 0.00051


def test_a_frame_from_out_of_bounds_is_refused() -> None:
    with pytest.raises(ProtocolError, match="out of bounds"):
        decode_views(AskViews(0, (2e6, 0.0, 0.0)).encode())


@given(st.binary(max_size=200))
def test_anything_else_is_refused(data: bytes) -> None:
    try:
        decode_views(data)
    except ProtocolError:
        return
    assert data[0] >> 4 == 1


@pytest.mark.parametrize("turn_deg", [0.0, 44.0, 90.0, 179.0, -91.0])
def test_an_end_arrives_to_half_a_cell_and_eleven_degrees(turn_deg: float) -> None:
    along = np.array((np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))))
    looked = Looked.nowhere()
    looked.add(1, 3.04, -7.0)
    looked.add(2, -1.23, 4.56, turn=turn_of_end(along))
    told = looked.between(0, 9, MTU_BYTES)
    assert told is not None and len(told.encode()) == told.nbytes < 14
    got = decode_views(told.encode())
    assert isinstance(got, Views) and len(got.points) == 1
    (x, y, ux, uy) = got.ends[0].tolist()
    assert abs(x + 1.23) < 0.051 and abs(y - 4.56) < 0.051 and along @ (ux, uy) > np.cos(np.radians(11.3))


def driven(ticks: int) -> Looked:
    """A way with a turn every 5 m, looked from every half metre."""
    way, heading = [np.zeros(2)], np.array([0.5, 0.0])
    for k in range(1, ticks):
        if k % 10 == 0:
            heading = np.array([-heading[1], heading[0]])
        way.append(way[-1] + heading)
    return Looked([10 * k for k in range(ticks)], [(float(x), float(y)) for x, y in way], [""] * ticks, [-1] * ticks)


def test_a_viewpoint_costs_less_than_a_byte_and_long_ways_come_in_pieces() -> None:
    looked = driven(400)
    views = looked.between(0, 4000, 1200)
    assert views is not None and len(views.encode()) < 400 == len(views.cells)
    assert np.abs(views.points - looked.places).max() <= CELL_M / 2 + 1e-9
    first = looked.between(0, 4000, 64)
    assert first is not None and len(first.encode()) <= 64 and 0 < first.until < 3990
    rest = looked.between(first.until, 4000, 1200)
    assert rest is not None and len(first.cells) + len(rest.cells) == 400
    assert looked.between(3990, 4000, 1200) is None


def test_what_others_saw_is_passed_on_but_not_to_them_and_a_tick_comes_whole() -> None:
    looked = Looked.nowhere()
    for k in range(400):
        looked.add(10 + k // 10, 0.5 * k, 0.0, ("", "b", "c")[k % 3])
    told = looked.between(0, 100, 1200, "b")
    assert told is not None and len(told.cells) == 134 and len(told.heard) == 133
    assert {(5 * k, 0) for k in range(2, 400, 3)} == set(map(tuple, told.heard.tolist()))
    count, since = 0, 0
    while told := looked.between(since, 100, 64, "b"):
        assert len(told.encode()) <= 64
        count, since = count + len(told.points), told.until
    assert count == 267


FRAME = (1.0, 2.0, 0.5)
"""Of robot a in that of b."""
FRAMES: Mapping[str, Pose] = {"a": FRAME}


class Two:
    """Robot a maps and looks, robot b asks; messages take a tick, and some are lost."""

    def __init__(self, loss: float = 0.0) -> None:
        self.a, self.b = (Exchange(TalkConfig(), RATE_HZ, MTU_BYTES) for _ in "ab")
        self.tick, self.rooms = 0, 1
        self.flying: list[tuple[str, Send]] = []
        self.sent: list[tuple[str, Send]] = []
        self.rng, self.loss = np.random.default_rng(0), loss
        self.looked = Looked.nowhere()

    def run(
        self, ticks: int, ask: bool = True, kinds_lost: tuple[str, ...] = (), frames: Mapping[str, Pose] = FRAMES
    ) -> None:
        for _ in range(ticks):
            heard = self.flying
            self.flying = []
            if self.tick % 10 == 0:
                self.looked.add(self.tick, 0.05 * self.tick, 0.0, "")
            for name, robot in (("a", self.a), ("b", self.b)):
                mine = [
                    Heard(tick=self.tick, sender=sender, kind=send.kind, payload=send.payload)
                    for sender, send in heard
                    if sender != name
                ]
                assert not [event for event in robot.hear(self.tick, mine)[1] if event.event == "refused"]
                if name == "a":
                    sends = robot.talk(self.tick, (0, 0, 0), lambda _: comb(self.rooms), self.rooms, self.looked)
                else:
                    sends = robot.talk(self.tick, (0, 0, 0), lambda _: comb(0), 0, frames=frames, asks=ask)
                for send in sends:
                    self.sent.append((name, send))
                    if send.kind not in kinds_lost and self.rng.random() >= self.loss:
                        self.flying.append((name, send))
            self.tick += 1

    @property
    def seen(self) -> PeerViews:
        return self.b._known["a"].views if "a" in self.b._known else PeerViews()

    @property
    def known(self) -> int:
        return len(self.seen.points)


def test_the_question_tells_a_merged_peer_its_frame_at_once_and_ever_less_often() -> None:
    two = Two()
    two.run(500)
    asked = [decode_views(send.payload) for name, send in two.sent if name == "b" and send.kind == VIEWS]
    told = [one.frame for one in asked if isinstance(one, AskViews)]
    assert len(told) >= 15
    assert [k for k, frame in enumerate(told, 1) if frame is not None] == [1, 2, 4, 8, 16][: len(told).bit_length()]


def test_a_merged_peer_is_told_its_frame_at_once_where_the_merge_was_undone_before() -> None:
    two = Two()
    for frames in (FRAMES, {}, FRAMES):
        two.sent.clear()
        two.run(250, frames=frames)
        asked = [decode_views(send.payload) for name, send in two.sent if name == "b" and send.kind == VIEWS]
        told = [one.frame is not None for one in asked if isinstance(one, AskViews)]
        assert len(told) > 5 and told[1] == bool(frames)


def test_viewpoints_are_known_before_the_peer_is_merged() -> None:
    """Many a merge comes after the contact: the robot then swept all that the peer had swept."""
    two = Two()
    two.run(400, frames={})
    asked = [decode_views(send.payload) for name, send in two.sent if name == "b" and send.kind == VIEWS]
    assert asked and not any(one.frame for one in asked if isinstance(one, AskViews))
    assert two.known >= 30


def test_nobody_is_told_who_does_not_ask() -> None:
    two = Two()
    two.run(100, ask=False)
    assert not [send for _, send in two.sent if send.kind == VIEWS]
    assert not two.known


@pytest.mark.parametrize("loss", [0.0, 0.5])
def test_who_asks_knows_all_viewpoints_once(loss: float) -> None:
    two = Two(loss)
    two.run(800 if loss else 400)
    known = two.seen
    assert len(known.points) >= 30
    assert np.allclose(known.points, two.looked.places[: len(known.points)], atol=CELL_M)
    told = [decode_views(send.payload) for name, send in two.sent if name == "a" and send.kind == VIEWS]
    if not loss:
        assert sum(len(one.cells) for one in told if isinstance(one, Views)) == two.known


def test_no_viewpoint_is_told_before_the_map_of_what_was_seen_from_there() -> None:
    two = Two()
    two.run(100)
    before = two.known
    assert before
    two.rooms = 5
    two.run(200, kinds_lost=("map", "delta", "resend"))
    newest = two.b._known["a"].newest
    assert two.known - before <= 3  # those of the time when the map was still the old one
    two.run(100)
    assert two.b._known["a"].newest > newest
    assert two.known >= 28
    need = two.seen.need
    assert (np.diff(need) >= 0).all() and need[-1] > need[0]


def test_viewpoints_of_a_peer_whose_clock_is_ahead_are_of_the_map_that_came_before_them() -> None:
    known, body = Known(), encode_map(quantise(comb(1), 10, 0)).data
    _, received = known.take_part(100, Part(101, 0, 0, 1, body), 150, 25)
    known.views_asked = True
    views = known.take_views(Views(0, 102, np.array([(1, 1)])))
    assert received is not None and views is not None
    assert views.need.tolist() == [received.tick] == [100]


def test_no_viewpoint_is_told_while_the_map_of_what_was_seen_from_there_cannot_be() -> None:
    two = Two()
    two.run(100)
    before = two.known
    two.rooms = 760  # more vertices than travel
    two.run(150)
    assert before and two.known - before <= 3
    two.rooms = 5
    two.run(60)
    assert two.known >= 25


def test_a_robot_that_began_anew_tells_all_again() -> None:
    two = Two()
    two.run(200)
    two.a = Exchange(TalkConfig(), RATE_HZ, MTU_BYTES)
    two.looked = Looked.nowhere()
    two.run(100)
    born = 200
    assert len(two.looked.places) - 5 <= two.known <= 10
    assert two.seen.points[:, 0].min() >= 0.05 * born - CELL_M
