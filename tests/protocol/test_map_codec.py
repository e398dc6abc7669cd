"""The map as the radio carries it: exact to the cell, small, told as changes, and safe from any bytes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.bits import BitReader, BitWriter, packed
from protocol.errors import ProtocolError
from protocol.grid_map import AXIS_STEPS, MAX_REACH_M, MAX_TOLD, GridMap, main_axis, matched, quantise
from protocol.map_codec import decode_map, encode_map
from protocol.wireframe import Label, Wireframe
from tests.fuzz.maps import BASE, changes, fuzz_one, some_map


@st.composite
def grid_maps(draw: st.DrawFn, cell_mm: int = 10, axis: int = 77) -> GridMap:
    """Any chains and rings, single vertices and places that are shared included."""
    sizes = draw(st.lists(st.integers(1, 6), max_size=6))
    rings = [draw(st.booleans()) and size > 1 for size in sizes]
    n = sum(sizes)
    farthest = int(1000 * MAX_REACH_M / np.sqrt(2)) // cell_mm
    coordinate = st.integers(-40, 40) | st.integers(-farthest, farthest)
    starts = np.cumsum([0, *sizes])
    chains = GridMap(
        cell_mm,
        axis,
        np.array(draw(st.lists(st.tuples(coordinate, coordinate), min_size=n, max_size=n)), np.int32).reshape(n, 2),
        np.array(draw(st.lists(st.sampled_from(list(Label)), min_size=n, max_size=n)), np.uint8),
        np.array(draw(st.lists(st.booleans(), min_size=n, max_size=n)), np.bool_),
        np.array(draw(st.lists(st.integers(0, 7), min_size=n, max_size=n)), np.uint8),
        starts,
        np.array(rings, np.bool_),
    )
    leaves = chains.successors() >= 0
    return replace(chains, own=chains.own & leaves, level=np.where(leaves, chains.level, 0).astype(np.uint8))


def mixed(first: GridMap, second: GridMap, pick: list[int]) -> GridMap:
    """Some chains of the first, moved a little here and there, and all of the second."""
    kept = first.of_chains([chain for chain in pick if chain < len(first.rings)])
    kept.cells[::3] += 2
    return kept.joined(second)


@given(st.lists(st.tuples(st.integers(0, 2**20), st.integers(0, 15)), max_size=20))
def test_numbers_come_back_in_every_order(numbers: list[tuple[int, int]]) -> None:
    writer = BitWriter()
    for value, order in numbers:
        writer.number(value, order)
    reader = BitReader(writer.data())
    assert [reader.number(order) for _, order in numbers] == [value for value, _ in numbers]
    reader.finish()


@given(st.lists(st.tuples(st.integers(0, 2**20), st.integers(0, 49)), max_size=20))
def test_bits_packed_at_once_are_those_written_one_after_the_other(told: list[tuple[int, int]]) -> None:
    writer = BitWriter()
    for value, count in told:
        writer.bits(value, count)
    values, counts = np.array(told, np.int64).reshape(-1, 2).T
    assert packed(values, counts) == writer.data()


@given(grid_maps(), st.booleans())
def test_a_map_comes_back_exactly(grid_map: GridMap, likelihoods: bool) -> None:
    coded = encode_map(grid_map, likelihoods=likelihoods)
    assert decode_map(coded.data) == coded.map
    if likelihoods:
        assert coded.map.alike(grid_map)
    else:
        assert np.array_equal(np.sort(coded.map.cells, 0), np.sort(grid_map.cells, 0))


@given(grid_maps(), grid_maps(), st.lists(st.integers(0, 5), unique=True), st.booleans())
def test_changes_lead_to_the_map_that_they_tell(
    base: GridMap, other: GridMap, pick: list[int], likelihoods: bool
) -> None:
    new = mixed(base, other, pick)
    coded = encode_map(new, base, likelihoods=likelihoods)
    assert decode_map(coded.data, base) == coded.map
    if likelihoods:
        assert coded.map.alike(new)


@given(grid_maps(cell_mm=25, axis=4095))
def test_cells_of_any_size_travel(grid_map: GridMap) -> None:
    assert decode_map(encode_map(grid_map).data).alike(grid_map)


@given(st.floats(0, 2 * np.pi), st.integers(0, AXIS_STEPS - 1))
def test_a_map_is_as_large_by_whatever_axis(bearing: float, axis: int) -> None:
    def corner(reach_m: float) -> GridMap:
        cells = np.round(100 * reach_m * np.array([[0.0, 0.0], [np.cos(bearing), np.sin(bearing)]])).astype(np.int32)
        chain = np.array([0, 2]), np.zeros(1, np.bool_)
        return GridMap(10, axis, cells, np.zeros(2, np.uint8), np.zeros(2, np.bool_), np.zeros(2, np.uint8), *chain)

    decode_map(encode_map(corner(MAX_REACH_M - 0.1)).data).wireframe().check()
    with pytest.raises(ProtocolError, match="out of bounds"):
        encode_map(corner(MAX_REACH_M + 0.1))


@given(st.binary(max_size=60))
@settings(max_examples=300)
def test_any_bytes_are_a_map_or_one_error(data: bytes) -> None:
    fuzz_one(data)
    fuzz_one(bytes([0x10 | data[0] & 0xF]) + data[1:] if data else b"")  # of the right version
    fuzz_one(changes(0)[:3] + data)  # changes to the right map


@given(st.integers(0, 19), st.booleans(), st.data())
@settings(max_examples=300)
def test_a_broken_map_is_whole_or_one_error(seed: int, whole: bool, draw: st.DataObject) -> None:
    data = bytearray(encode_map(some_map(seed)).data if whole else changes(seed))
    for _ in range(draw.draw(st.integers(1, 4))):
        data[draw.draw(st.integers(0, len(data) - 1))] = draw.draw(st.integers(0, 255))
    fuzz_one(bytes(data))
    fuzz_one(bytes(data[: draw.draw(st.integers(0, len(data)))]))


def test_what_is_wrong_is_named() -> None:
    whole = encode_map(BASE).data
    told = changes(0)
    cases = [
        (bytes([whole[0] ^ 0x30]) + whole[1:], None, "version 2"),
        (whole[:-3], None, "ends in the middle|do not belong|larger than"),
        (whole + b"\0", None, "do not belong"),
        (whole[:-1] + bytes([whole[-1] | 1]), None, "do not belong|ends in the middle"),
        (told, None, "not here"),
        (told, some_map(1), "not here"),
        (b"", BASE, "ends in the middle"),
    ]
    for data, base, words in cases:
        with pytest.raises(ProtocolError, match=words):
            decode_map(data, base)
    with pytest.raises(ProtocolError, match="grid of its base"):
        encode_map(some_map(1), BASE)
    with pytest.raises(ProtocolError, match="out of bounds"):
        encode_map(replace(BASE, cells=BASE.cells * 100_000))
    with pytest.raises(ProtocolError, match=f"more than {MAX_TOLD}"):
        n = MAX_TOLD + 1
        none = np.zeros(n, np.uint8)
        far = GridMap(10, 0, np.zeros((n, 2), np.int32), none, none > 0, none, np.arange(n + 1), none > 0)
        encode_map(far)


def test_a_small_message_cannot_ask_for_much() -> None:
    writer = BitWriter()
    for value, count in ((1, 4), (0, 1), (0, 1), (0, 12), (0, 1), (0, 1)):
        writer.bits(value, count)
    writer.number(2**24)  # chains
    writer.bits(0, 2)
    writer.number(2**23, 1)  # vertices
    with pytest.raises(ProtocolError, match=f"more than {MAX_TOLD}"):
        decode_map(writer.data() + bytes(100))


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3]), st.sampled_from([1.5, 5.0, 64.0]))
@settings(max_examples=50)
def test_vertices_are_matched_as_by_trying_all_pairs(seed: int, noise: float, most: float) -> None:
    rng = np.random.default_rng(seed)
    n, m = rng.integers(0, 30, 2)
    mine, theirs = rng.integers(-30, 30, (n, 2)) + rng.normal(0, noise, (n, 2)), rng.integers(-30, 30, (m, 2))
    away = np.hypot(*(mine[:, None] - theirs[None]).transpose(2, 0, 1))
    match = np.full(n, -1)
    for d, row, column in sorted((away[i, j], i, j) for i in range(n) for j in range(m)):
        if d <= most and match[row] < 0 and column not in match:
            match[row] = column
    assert (matched(mine, theirs, most) == match).all()


def room(shift: float = 0.0, open_end: bool = True, turn: float = 0.3) -> Wireframe:
    points = np.array([[0, 0], [4 + shift, 0], [4 + shift, 3], [0, 3], [6, 1], [8, 1]])
    c, s = np.cos(turn), np.sin(turn)
    labels = np.array([0, 0, 0, 0, 2, 2 if open_end else 1], np.uint8)
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [4, 5]], np.int32)
    likelihood = np.array([1, 1, 0.9, 1, 0.7], np.float32)
    return Wireframe(points @ np.array([[c, s], [-s, c]]), labels, edges, likelihood, np.ones(5, np.bool_))


def test_the_grid_lies_along_the_walls() -> None:
    axis = main_axis(room())
    assert axis / AXIS_STEPS * 90 == pytest.approx(np.degrees(0.3), abs=0.02)
    grid_map = quantise(room(), 10, axis)
    steps = np.abs(np.diff(grid_map.cells[:2], axis=0))
    assert steps.min() <= 1 and steps.max() == 200
    assert np.abs(grid_map.wireframe().points[:, None] - room().points[None]).max(2).min(1).max() < 0.008
    assert main_axis(Wireframe()) == 0
    assert quantise(Wireframe(), 10, 5) == GridMap(10, 5)


def test_noise_is_no_news_and_a_move_is() -> None:
    axis = main_axis(room())
    said = quantise(room(), 10, axis)
    assert quantise(room(0.012), 10, axis, said, slack=1.5).alike(said)
    assert not quantise(room(0.03), 10, axis, said, slack=1.5).alike(said)
    assert not quantise(room(open_end=False), 10, axis, said, slack=1.5).alike(said)
    less = replace(room(), likelihood=np.array([0.8, 1, 0.9, 1, 0.7], np.float32))
    assert quantise(less, 10, axis, said, 1.5, level_slack=2).alike(said)
    assert not quantise(less, 10, axis, said, 1.5, level_slack=0).alike(said)


def test_changes_cost_what_changed() -> None:
    big = encode_map(some_map(3, 60)).map
    nothing = encode_map(big, big)
    assert len(nothing.data) <= 5 and nothing.map == big
    moved = replace(big, cells=big.cells.copy())
    moved.cells[7] += 2
    assert len(encode_map(moved, big).data) <= 14 < len(encode_map(big).data) / 20
    without = big.of_chains([chain for chain in range(60) if chain != 30])
    assert len(encode_map(without, big).data) <= 6


def test_a_maze_takes_two_and_a_half_bytes_a_vertex() -> None:
    """Rectilinear chains with noise; maps of the shared worlds are in `bench radio`."""
    rng = np.random.default_rng(0)
    size = total = 0
    for _ in range(20):
        points, edges, labels = [], [], []
        for _ in range(10):
            here, first = rng.uniform(-10, 10, 2), len(points)
            for k in range(int(rng.integers(3, 10))):
                here = here + np.roll([rng.choice([-1, 1]) * rng.uniform(0.2, 4), 0], k % 2)
                points.append(here + rng.normal(0, 0.005, 2))
            edges += [(v, v + 1) for v in range(first, len(points) - 1)]
            labels += [2, *[0] * (len(points) - first - 2), 1]
        m = len(edges)
        wireframe = Wireframe(
            np.array(points), np.array(labels, np.uint8), np.array(edges, np.int32), np.ones(m, np.float32),
            np.ones(m, np.bool_),
        )  # fmt: skip
        size += len(encode_map(quantise(wireframe, 10, main_axis(wireframe)), likelihoods=False).data)
        total += len(points)
    assert size / total <= 2.5


PAGE = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()


def test_the_documented_example_is_a_message() -> None:
    line = next(line for line in PAGE.splitlines() if line.startswith('`{"bytes"'))
    example = json.loads(line.strip("`"))
    assert decode_map(bytes.fromhex(example["bytes"])).cells.tolist() == example["cells"]
