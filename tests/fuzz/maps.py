"""Fuzz target of the map codec: any bytes are a map or one ProtocolError."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from protocol.errors import ProtocolError
from protocol.grid_map import GridMap, quantise
from protocol.map_codec import decode_map, encode_map
from protocol.wireframe import Wireframe


def some_map(seed: int, chains: int = 6) -> GridMap:
    """Chains and rings of a few random vertices each."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(2, 9, chains)
    edges, n = [], 0
    for size in sizes.tolist():
        rows = list(range(n, n + size))
        edges += list(pairwise(rows)) + ([(rows[-1], n)] if rng.random() < 0.4 else [])
        n += size
    m = len(edges)
    return quantise(
        Wireframe(
            rng.uniform(-9, 9, (n, 2)),
            rng.integers(0, 3, n).astype(np.uint8),
            np.array(edges, np.int32),
            rng.random(m).astype(np.float32),
            rng.random(m) < 0.8,
        ),
        10,
        int(rng.integers(4096)),
    )


BASE = encode_map(some_map(0)).map
"""What changes are told against."""


def fuzz_one(data: bytes) -> bool:
    """Decode hostile bytes, whole and as changes; whether they were a map. What they are is whole and comes back."""
    taken = False
    for base in (None, BASE):
        try:
            found = decode_map(data, base)
        except ProtocolError as error:
            assert "\n" not in str(error)
            continue
        taken = True
        found.wireframe().check()
        again = encode_map(found)
        assert decode_map(again.data) == again.map and again.map.alike(found)
    return taken


def changes(seed: int) -> bytes:
    """A map that has some chains of the base, one of them moved, and some of its own."""
    moved = BASE.of_chains([1])
    moved.cells[:2] += 3
    fresh = replace(some_map(seed, 2), axis=BASE.axis)
    return encode_map(BASE.of_chains([3, 0, 4]).joined(moved).joined(fresh), BASE).data


def seeds() -> list[bytes]:
    """Valid maps, and changes to BASE."""
    return [encode_map(some_map(seed)).data for seed in range(8)] + [changes(seed) for seed in range(8)]
