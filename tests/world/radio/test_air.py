"""The models of the air: what each loses and delays, alone and together, and whose luck moves whose."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from protocol.messages import Send
from world.radio.air import walls_between
from world.radio.config import RadioConfig
from world.radio.gate import Passage, Radio
from world.worldfile import load

NAMES = ["r1", "r2", "r3"]
ONE_ROOM = np.array([[0.0, 0.0], [3.0, 0.0], [6.0, 0.0]])
BOX = np.array([(1.0, 1, 1, -1), (1, -1, 2, -1), (2, -1, 2, 1), (2, 1, 1, 1)])
"""A pillar between the first two, free space on the left of its faces."""


def play(
    *models: dict[str, object],
    ticks: int = 400,
    places: NDArray[np.float64] = ONE_ROOM,
    names: list[str] = NAMES,
    size: int = 20,
    seed: int = 0,
    period_s: float = 0.2,
    **settings: object,
) -> list[Passage]:
    """Every robot broadcasts once a tick; all that was judged."""
    config = RadioConfig.model_validate({"range_m": None, "models": models, **settings})
    radio = Radio(names, config, seed, period_s, BOX)
    passages = []
    for tick in range(ticks):
        passages += radio.deliver(tick, names)[1]
        radio.offer(tick, {n: [Send(tick=tick, to="*", kind="m", payload=bytes(size))] for n in names}, places)
    return passages + radio.deliver(ticks, names, ended=True)[1]


def share(passages: list[Passage], outcome: str, link: tuple[str, str] | None = None) -> float:
    rows = [p for p in passages if p.outcome != "ended" and (link is None or (p.sender, p.receiver) == link)]
    return sum(p.outcome == outcome for p in rows) / len(rows)


def test_walls_are_counted_where_a_way_goes_into_them() -> None:
    far = np.array([[0.0, 0], [3, 0], [1.5, 0], [0, 3], [3, 3]])
    assert walls_between(BOX, far[0], far[1]) == walls_between(BOX, far[1], far[0]) == 1
    assert walls_between(BOX, far[0], far[3]) == walls_between(BOX, far[3], far[4]) == 0
    corner = walls_between(BOX, np.array([0.0, 0.0]), np.array([2.0, 2.0]))  # grazes the corner (1, 1)
    assert corner in (0, 1)
    assert walls_between(np.zeros((0, 4)), far[0], far[1]) == 0


def test_walls_between_rooms_of_a_world_agree_with_geometry() -> None:
    from shapely.geometry import LineString

    world = load("apartment")
    rng = np.random.default_rng(0)
    x0, y0, x1, y1 = world.solid.bounds
    tried = 0
    for _ in range(300):
        here, there = rng.uniform((x0, y0), (x1, y1), (2, 2))
        way = LineString([here, there])
        if not world.solid.intersects(LineString([here, here + 1e-6])) and not world.solid.covers(
            LineString([there, there + 1e-6])
        ):
            tried += 1
            parts = way.intersection(world.solid)
            assert walls_between(world.segments, here, there) == len(
                getattr(parts, "geoms", [parts] if parts.length else [])
            )
    assert tried > 100


def test_walls_block_sight() -> None:
    passages = play({"kind": "line_of_sight"}, ticks=5)
    assert {(p.sender, p.receiver) for p in passages if p.outcome == "walls"} == {
        ("r1", "r2"), ("r2", "r1"), ("r1", "r3"), ("r3", "r1"),
    }  # fmt: skip


def test_bernoulli_loses_its_share_on_every_link() -> None:
    passages = play({"kind": "bernoulli", "loss": 0.3}, ticks=1500)
    for link in {(p.sender, p.receiver) for p in passages}:
        assert share(passages, "loss", link) == pytest.approx(0.3, abs=0.045)  # 3.8 sigma


def test_bursts_have_their_lengths_and_share() -> None:
    passages = play({"kind": "gilbert_elliott", "good_s": 6.0, "bad_s": 2.0}, ticks=8000)
    row = np.array([p.outcome == "burst" for p in passages if (p.sender, p.receiver) == ("r1", "r2")][:-1])
    assert row.mean() == pytest.approx(0.25, abs=0.06)
    begins = np.flatnonzero(np.diff(row.astype(int)) == 1)
    assert row.sum() / len(begins) * 0.2 == pytest.approx(2.0, rel=0.2)


def test_a_burst_does_not_depend_on_who_talks() -> None:
    model = {"kind": "gilbert_elliott", "good_s": 3.0, "bad_s": 2.0}
    radio = Radio(NAMES, RadioConfig.model_validate({"range_m": None, "models": [model]}))
    seldom = []
    for tick in range(400):
        seldom += radio.deliver(tick, NAMES)[1]
        if tick % 7 == 0:
            radio.offer(tick, {"r1": [Send(tick=tick, to="r2", kind="m", payload=b"")]}, ONE_ROOM)
    often = {p.tick: p.outcome for p in play(model) if (p.sender, p.receiver) == ("r1", "r2")}
    assert [(p.tick, p.outcome) for p in seldom] == [(p.tick, often[p.tick]) for p in seldom]
    assert {"burst", "delivered"} == {p.outcome for p in seldom}


def test_fading_falls_with_distance_and_walls() -> None:
    model = {"kind": "log_distance", "reach_m": 6.0, "exponent": 3.0, "fading_db": 4.0, "wall_db": 6.0}
    passages = play(model, ticks=1500)
    near, through = share(passages, "delivered", ("r2", "r3")), share(passages, "delivered", ("r1", "r2"))
    far_through = share(passages, "delivered", ("r1", "r3"))
    # margins in dB: 9.03, 9.03 - 6 and 0 - 6, over 4
    assert near == pytest.approx(0.988, abs=0.02)
    assert through == pytest.approx(0.776, abs=0.045)
    assert far_through == pytest.approx(0.067, abs=0.03)


def test_links_can_differ_by_direction() -> None:
    passages = play({"kind": "asymmetric", "most": 0.0, "links": {"r1>r2": 1.0, "r2>r9": 1.0}})
    assert share(passages, "asymmetric", ("r1", "r2")) == 1.0
    assert share(passages, "asymmetric", ("r2", "r1")) == 0.0
    drawn = play({"kind": "asymmetric", "most": 0.8})
    links = [share(drawn, "asymmetric", (a, b)) for a in NAMES for b in NAMES if a != b]
    assert max(links) - min(links) > 0.1 and max(links) < 0.9
    fixed = play({"kind": "log_distance", "reach_m": 4.0, "fading_db": 0.0, "wall_db": 0.0, "link_db": 6.0}, ticks=20)
    by_link = {(p.sender, p.receiver): p.outcome for p in fixed if p.outcome != "ended"}
    assert all(by_link[p.sender, p.receiver] == p.outcome for p in fixed if p.outcome != "ended")


@pytest.mark.parametrize(
    ("rate_hz", "begin", "end"),
    # by rounding all but the first were a tick late: ticks that come before their time, edges that lie behind it
    [(5, 50, 100), (15, 111, 222), (30, 207, 222), (49, 98, 147), (15, 5, 10), (30, 10, 20), (7, 3, 5)],
)
def test_a_blackout_silences_whom_it_names_while_it_lasts(rate_hz: int, begin: int, end: int) -> None:
    model = {"kind": "blackout", "begin_s": begin / rate_hz, "end_s": end / rate_hz, "robots": ["r1"]}
    passages = play(model, ticks=end + 10, period_s=1 / rate_hz)
    dark = {(p.tick, p.sender, p.receiver) for p in passages if p.outcome == "blackout"}
    assert {tick for tick, _, _ in dark} == set(range(begin, end))
    assert {(a, b) for _, a, b in dark} == {("r1", "r2"), ("r2", "r1"), ("r1", "r3"), ("r3", "r1")}


def test_latency_and_jitter_are_within_their_ticks() -> None:
    config = RadioConfig.model_validate({"range_m": None, "models": [{"kind": "latency", "ticks": 5, "jitter": 3}]})
    radio = Radio(NAMES, config)
    waits: Counter[int] = Counter()
    for tick in range(600):
        for message in radio.deliver(tick, NAMES)[0]["r2"]:
            waits[tick - int.from_bytes(message.payload)] += 1
        said = Send(tick=tick, to="r2", kind="m", payload=tick.to_bytes(4))
        radio.offer(tick, {"r1": [said]}, ONE_ROOM)
    assert set(waits) == {5, 6, 7, 8} and min(waits.values()) > 100


def test_capacity_counts_what_is_sent_and_heard_in_a_second() -> None:
    # three robots, 20 B a tick each: 100 B/s sent and 200 heard; 150 in all are allowed
    passages = play({"kind": "capacity", "bytes_per_s": 150}, ticks=300)
    assert {p.outcome for p in passages} - {"ended"} == {"delivered", "capacity_in", "capacity_out"}
    for name in NAMES:
        sent = Counter({p.tick: p.bytes for p in passages if p.sender == name and p.outcome != "capacity_out"})
        heard = Counter({p.tick + 1: 0 for p in passages})
        for p in passages:
            if p.receiver == name and p.outcome == "delivered":
                heard[p.tick + 1] += p.bytes
        both = np.array([sent[t] + heard[t] for t in range(300)])
        assert np.convolve(both, np.ones(5), "valid").max() <= 150
        assert both.sum() > 0.6 * 150 * 60  # and it is used


def test_what_is_too_long_never_goes_on_the_air() -> None:
    assert {p.outcome for p in play(ticks=2, size=101, mtu_bytes=100)} == {"mtu"}
    assert {p.outcome for p in play(ticks=2, size=100, mtu_bytes=100)} == {"delivered", "ended"}


STORM: list[dict[str, object]] = [
    {"kind": "line_of_sight"},
    {"kind": "log_distance", "reach_m": 5.0, "link_db": 2.0},
    {"kind": "bernoulli", "loss": 0.1},
    {"kind": "bernoulli", "loss": 0.1},
    {"kind": "gilbert_elliott"},
    {"kind": "asymmetric"},
    {"kind": "blackout", "begin_s": 10, "end_s": 12},
    {"kind": "latency", "ticks": 2, "jitter": 4},
    {"kind": "capacity", "bytes_per_s": 250},
]


def test_all_models_together_balance_and_repeat() -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(-4, 6, (3, 2))
    first = play(*STORM, places=places, range_m=7.0)
    assert first == play(*STORM, places=places, range_m=7.0)
    assert first != play(*STORM, places=places, range_m=7.0, seed=1)
    assert len(first) == 400 * 3 * 2  # offered x receivers = delivered + every drop
    assert Counter((p.sender, p.receiver) for p in first) == {(a, b): 400 for a in NAMES for b in NAMES if a != b}
    assert len({p.outcome for p in first}) >= 6


def test_another_robot_moves_no_other_links_luck() -> None:
    models = [model for model in STORM if model["kind"] != "capacity"]  # which a further sender uses up, as it should
    places = np.array([[0.0, 0], [0, 2], [4, 2], [4, 4]])
    three = play(*models, places=places[:3])
    four = play(*models, places=places, names=[*NAMES, "r4"])
    assert sorted(three) == sorted(p for p in four if "r4" not in (p.sender, p.receiver))


def test_each_model_has_luck_of_its_own() -> None:
    alone = {p[:3]: p.outcome for p in play({"kind": "bernoulli", "loss": 0.3})}
    with_more = {
        p[:3]: p.outcome for p in play({"kind": "asymmetric", "most": 0.2}, {"kind": "bernoulli", "loss": 0.3})
    }
    assert all(alone[key] == "loss" for key, outcome in with_more.items() if outcome == "loss")
    twice = play({"kind": "bernoulli", "loss": 0.3}, {"kind": "bernoulli", "loss": 0.3}, ticks=1000)
    assert share(twice, "delivered") == pytest.approx(0.49, abs=0.03)


def test_the_link_table_says_who_hears_whom_and_nothing_of_places() -> None:
    config = RadioConfig.model_validate(
        {"range_m": 4.0, "models": [{"kind": "asymmetric", "most": 0.0, "links": {"r1>r2": 1.0}}]}
    )
    radio = Radio(NAMES, config)
    for tick in range(100):
        radio.deliver(tick, NAMES)
        radio.offer(tick, {n: [Send(tick=tick, to="*", kind="m", payload=b"abc")] for n in NAMES}, ONE_ROOM)
        if tick == 1:
            heard = [("r2", "r1"), ("r2", "r3"), ("r3", "r2")]  # not that r2 hears nothing of r1
            assert [(row.sender, row.receiver) for row in radio.table(tick).links] == heard
    rows = {(row.sender, row.receiver): (row.loss, row.bytes) for row in radio.table(100).links}
    assert rows == {("r2", "r1"): (0.0, 297), ("r2", "r3"): (0.0, 297), ("r3", "r2"): (0.0, 297)}
    assert set(radio.table(100).links[0].model_dump()) == {"sender", "receiver", "loss", "bytes"}
    assert radio.table(1000).links == []


@pytest.mark.parametrize(
    "settings",
    [
        {"models": [{"kind": "magic"}]},
        {"models": [{"kind": "bernoulli", "loss": 1.5}]},
        {"models": [{"kind": "bernoulli"}]},
        {"models": [{"kind": "asymmetric", "links": {"r1-r2": 0.5}}]},
        {"models": [{"kind": "latency", "ticks": 0}]},
        {"range_m": 0},
    ],
)
def test_wrong_models_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        RadioConfig.model_validate(settings)


def test_the_configuration_says_itself_in_a_line() -> None:
    text = str(RadioConfig.model_validate({"models": STORM}))
    assert "range 4 m, line of sight, log distance" in text and "capacity 250 B/s" in text and "\n" not in text


@pytest.mark.system
def test_no_delivery_beyond_the_range_over_50_runs(tmp_path: Path) -> None:
    """Read from trajectories and radio.csv alone: shares no code with the gate."""
    from deploy import inprocess
    from deploy.config import RunConfig
    from tests.wanderer import Wanderer

    delivered, farthest = 0, 0.0
    for seed in range(50):
        settings = {"world": "apartment", "robots": 3, "until": 12.0, "seed": seed, "starts": "random"}
        reach = 1.0 + seed % 5
        config = RunConfig.model_validate({**settings, "radio": {"range_m": reach, "models": STORM[7:8]}})
        out = tmp_path / str(seed)
        inprocess.run(config, config.agent, out, make_mind=Wanderer)
        tracks = {f"r{k}": np.loadtxt(out / "trajectories" / f"r{k}.tum")[:, 1:3] for k in (1, 2, 3)}
        for line in (out / "radio.csv").read_text().splitlines()[1:]:
            tick, sender, receiver, _, _, outcome = line.split(",")
            away = np.linalg.norm(tracks[sender][int(tick)] - tracks[receiver][int(tick)])
            if outcome == "delivered":
                assert away <= reach + 1e-6
                delivered, farthest = delivered + 1, max(farthest, away / reach)
            elif outcome == "range":
                assert away >= reach - 1e-6
    assert delivered > 500 and farthest > 0.95
