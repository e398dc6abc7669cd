"""Viewpoints of a team: passed on as far as walls are, known once by whoever tells them, taken back with a merge."""

from dataclasses import replace

import numpy as np
import pytest

from agent.communication import receiving
from agent.communication.receiving import Known, PeerViews, ReceivedMap
from agent.cooperation import team_views
from agent.cooperation.evidence import WallEvidence
from agent.cooperation.peer import Laid, Merged, PeerLog
from agent.cooperation.team_views import TOLD_A_TICK, TeamViews
from agent.cooperation.wall_fit import WallFit
from agent.mapping.layers import layer_of
from protocol.viewpoints import Looked, Views
from protocol.wireframe import Wireframe

FIT = WallFit(np.array([10.0, 0.0, 0.0]), np.zeros(2), np.zeros((3, 3)))
OWN = ([0, 3], [(0.0, 0.0), (0.5, 0.0)])


def merged(name: str, own: list[float], heard: list[float], need: int = 0, editions: int = 1) -> Merged:
    """A peer 10 m to the right that looked from (x, 0) of its frame; need: tick of the map that holds what it saw."""
    places = np.array([(x, 0.0) for x in own + heard]).reshape(-1, 2)
    is_heard = np.arange(len(places)) >= len(own)
    log = PeerLog(name, views=PeerViews(places, np.full(len(places), need), is_heard, editions=editions))
    empty, hidden = Wireframe(), np.zeros(0, np.bool_)
    layer = layer_of(empty, FIT.transform, hidden, 1.0)
    return Merged(log, ReceivedMap(empty, 5), FIT, WallEvidence(), Laid(hidden, layer, layer), 0, 0)


def told(views: TeamViews, asker: str, ticks: int = 20) -> set[float]:
    """Where the robot and others have looked from, as the asker hears it, m along the x axis."""
    looked = Looked.nowhere()
    for tick in range(100, 100 + ticks):
        looked = views.looked(tick, *OWN)
    said = looked.between(0, 200, 1200, asker)
    return set() if said is None else {round(x, 1) for x in said.points[:, 0].tolist()}


def test_peers_are_told_what_a_merged_peer_saw_itself_but_not_what_it_has_from_others() -> None:
    views = TeamViews()
    views.gather([merged("b", [1.0, 2.0], [7.0]), merged("c", [3.0], [])])
    assert sorted(views.places[:, 0].tolist()) == [11.0, 12.0, 13.0, 17.0]
    assert told(views, "d") == {0.0, 0.5, 11.0, 12.0, 13.0}
    assert told(views, "b") == {0.0, 0.5, 13.0}


def test_a_viewpoint_counts_once_the_merged_map_holds_what_was_seen_from_there() -> None:
    views = TeamViews()
    views.gather([merged("b", [1.0], [2.0], need=6)])
    assert not len(views.places) and told(views, "d") == {0.0, 0.5}


def test_what_several_peers_pass_on_counts_once() -> None:
    views = TeamViews()
    views.gather([merged("b", [1.0], [2.05, 1.05]), merged("c", [], [2.1, 4.0])])
    assert sorted(views.places[:, 0].round(2).tolist()) == [11.0, 12.05, 14.0]


def test_an_undone_merge_takes_its_viewpoints_back_from_those_that_were_told() -> None:
    views = TeamViews()
    views.gather([merged("b", [1.0], []), merged("c", [3.0], [4.0])])
    assert told(views, "d") == {0.0, 0.5, 11.0, 13.0}
    until = views.looked(120, *OWN).ticks[-1]
    views.gather([merged("b", [1.0], [])])
    assert views.places.tolist() == [[11.0, 0.0]]
    again = views.looked(121, *OWN).between(until, 121, 1200, "d")
    assert again is not None and again.since == 0  # forget all that was told before
    assert sorted(again.points[:, 0].tolist()) == [0.0, 0.5, 11.0]


def test_what_is_taken_back_is_said_though_others_tell_as_much_at_once() -> None:
    views = TeamViews()
    views.gather([merged("b", [1.0], []), merged("e", [], [])])
    views.gather([merged("b", [1.0, 2.0], [])])  # e had told of nothing
    assert views.withdrawn == 0
    views.gather([merged("c", [3.0, 4.0], [])])
    assert len(views.places) == 2 and views.withdrawn == 1


def test_who_tells_all_anew_is_believed_anew() -> None:
    views = TeamViews()
    views.gather([merged("b", [1.0], [5.0])])
    views.gather([merged("b", [1.0], [6.0], editions=2)])
    assert sorted(views.places[:, 0].tolist()) == [11.0, 16.0]


def test_what_is_told_anew_as_it_was_counts_all_the_while() -> None:
    """The merged map lags, and then holds nothing of what is told with a newer one; it may do so for long."""
    views = TeamViews()
    views.gather([merged("b", [1.0, 2.0], [])])
    for own in ([1.0], [1.0, 2.0, 3.0]):
        views.gather([later := merged("b", own, [], need=6, editions=2)])
        assert views.places[:, 0].tolist() == [11.0, 12.0]
    views.gather([replace(later, map=later.map._replace(tick=6))])
    assert views.places[:, 0].tolist() == [11.0, 12.0, 13.0] and views.withdrawn == 0


def test_a_tick_s_viewpoints_fit_the_shortest_message() -> None:
    views = TeamViews()
    views.gather([merged("b", [0.5 * k for k in range(300)], [])])
    looked = views.looked(100, *OWN)
    assert looked.ticks.count(100) == TOLD_A_TICK


def test_ends_that_a_peer_looked_at_in_vain_are_known_in_the_own_frame_and_taken_back_with_its_merge() -> None:
    peer = replace(merged("b", [1.0], []), fit=FIT._replace(transform=np.array((10.0, 0.0, 0.5 * np.pi))))
    peer.log.views = peer.log.views._replace(ends=np.array([(2.0, 0.0, 1.0, 0.0)]))
    views = TeamViews()
    views.gather([peer])
    assert np.allclose(views.ends, [(10.0, 2.0, 0.0, 1.0)])
    assert told(views, "d") == {0.0, 0.5, 10.0}  # they are told by who looked, and by nobody else
    views.gather([])
    assert not len(views.ends)


def test_own_ends_are_told_once_and_again_to_who_is_told_all_anew() -> None:
    views, ends = TeamViews(), [(1.0, 2.0, 3), (4.0, 5.0, 6)]
    views.gather([merged("b", [1.0], [])])
    for count in (1, 2, 2):
        looked = views.looked(100 + count, *OWN, ends[:count])
    assert [turn for turn in looked.turns if turn >= 0] == [3, 6]
    views.gather([])  # what b saw is taken back
    assert [turn for turn in views.looked(110, *OWN, ends).turns if turn >= 0] == [3, 6]


def test_a_peer_whose_list_is_full_is_listened_to_and_passed_on_all_the_same() -> None:
    """From 6000 viewpoints on, the oldest ones make room, and the list gets no longer."""
    views = TeamViews()
    peer = merged("a", [1.0, 2.0, 3.0], [21.0, 22.0, 23.0])
    views.gather([peer])
    assert told(views, "b") == {0.0, 0.5, 11.0, 12.0, 13.0}
    later = merged("a", [2.0, 3.0, 4.0], [22.0, 23.0, 24.0])
    later.log.views = later.log.views._replace(forgotten=(1, 1))
    views.gather([later])
    assert {14.0, 34.0} <= set(views.places[:, 0].tolist())
    assert 14.0 in told(views, "b")


def test_a_full_list_says_how_many_viewpoints_made_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receiving, "KEPT_VIEWS", 3)
    known = Known()
    for until, since in ((5, 0), (6, 5)):
        known.views_asked = True
        known.take_views(Views(since, until, np.zeros((1, 2), np.int64), np.zeros((2, 2), np.int64)))
    assert len(known.views.points) == 3 and known.views.forgotten == (1, 2)


def test_what_is_kept_of_a_peer_s_second_hand_viewpoints_has_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(team_views, "KEPT_VIEWS", 3)
    views, peer = TeamViews(), merged("b", [1.0], [])
    for k in range(4):
        peer.log.views = merged("b", [1.0], [20.0 + 2 * k, 21.0 + 2 * k]).log.views._replace(forgotten=(0, 2 * k))
        views.gather([peer])
    assert views.places[:, 0].tolist() == [11.0, 35.0, 36.0, 37.0]


def test_what_the_map_that_is_told_does_not_hold_yet_waits_for_that() -> None:
    views = TeamViews()
    views.gather([merged("b", [1.0], [])])
    assert len(views.looked(100, *OWN, is_laid=True).ticks) == 3
    views.gather([merged("b", [1.0, 2.0], [])])
    assert len(views.looked(101, *OWN, is_laid=False).ticks) == 3
    assert views.looked(102, *OWN, is_laid=True).ticks[3:] == [102]


def test_what_is_in_the_map_is_told_bit_by_bit_though_more_waits_for_it() -> None:
    views = TeamViews()
    views.gather([merged("b", [0.5 * k for k in range(20)], [])])
    views.looked(100, *OWN, is_laid=True)
    views.gather([merged("b", [0.5 * k for k in range(30)], [])])
    assert [len(views.looked(101 + k, *OWN, is_laid=False).ticks) for k in range(3)] == [20, 22, 22]


@pytest.mark.parametrize(("names", "moved"), [("cd", False), ("cd", True), ("cde", False)])
def test_who_is_told_all_anew_tells_all_anew_only_where_that_has_changed(names: str, moved: bool) -> None:
    """A robot whose torn map was mended told all anew; then its peers did so, then it did again, and so on for ever."""
    views, looked = {name: TeamViews() for name in names}, dict.fromkeys(names, Looked.nowhere())
    known = {(to, of): Known() for to in names for of in names if to != of}
    for tick in range(1, 100):
        if tick == 41:
            views["c"].mend()
        for name, one in views.items():
            bent = moved and name == "c" and tick > 40
            places = [(0.5 * k, 3.0 * names.index(name) + (bent and k > 12)) for k in range(24)]
            peers = [merged(of, [], []) for of in names if of != name]
            for peer in peers:
                peer.log.views = known[name, peer.log.name].views
            one.gather(peers)
            looked[name] = one.looked(tick, list(range(24)), places)
        for (to, of), told_so_far in known.items() if tick % 5 == 0 else ():
            told_so_far.views_asked = True
            if (said := looked[of].between(told_so_far.views_until, tick, 64, to)) is not None:
                told_so_far.take_views(said)
    assert all(one.views.editions == 1 + (of == "c" or moved) for (_, of), one in known.items())
    assert views["c"].withdrawn == 0 and views["d"].withdrawn == (moved or len(names) > 2)
    assert {0.5 * k + 10.0 for k in range(24)} <= set(views["d"].places[:, 0])
    assert (1.0 in views["d"].places[:, 1]) == moved
