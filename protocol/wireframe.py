"""The wireframe: a labelled, embedded, directed graph of corners and walls (paper III-A), and its bytes."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Bools, Floats, Labels
from protocol.errors import ProtocolError

MAX_VERTICES = 20_000  # bounds memory (ours). A building of 600 m2 has 200 vertices
MAX_COORDINATE_M = 10_000.0  # no robot of 0.2 m/s gets farther (ours)

_HEADER = struct.Struct("<4sBII")
_MAGIC = b"WSWF"
_VERSION = 1


class Label(IntEnum):
    """What is known of a vertex (paper III-A)."""

    NOMINAL = 0  # a true corner of which both walls were seen
    OCCLUSION = 1  # a true corner at a jump in range: the wall turns away there and hides what lies behind
    FRONTIER = 2  # no corner: a wall goes on there, unseen

    @property
    def word(self) -> str:
        """The label in files: nominal, occlusion or frontier."""
        return self.name.lower()


LABELS = {label.word: label for label in Label}  # labels by their word in files


@dataclass(frozen=True, slots=True)
class Wireframe:
    """Corners and directed walls; free space lies on the left of every edge i to j.

    Each vertex has at most one edge out and one in, so the graph is a set of chains that close into rings.
    """

    points: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    """(n, 2) metres, usually in the own frame of the robot whose map it is."""
    labels: Labels = field(default_factory=lambda: np.zeros(0, np.uint8))  # (n,) of Label
    edges: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    """(m, 2) vertex indices, from and to."""
    likelihood: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    """(m,) in [0, 1]: how often the wall was seen, over how often it should have been."""
    own: Bools = field(default_factory=lambda: np.zeros(0, np.bool_))
    """(m,) whether the robot saw the wall itself; else it has the wall from a peer only."""

    def check(self) -> None:
        """Raise ProtocolError unless every array has its shape, all is finite, in bounds and degree <= 1."""
        n, m = len(self.points), len(self.edges)
        _check_count(n, m)
        if self.points.shape != (n, 2) or self.labels.shape != (n,) or self.edges.shape != (m, 2):
            raise ProtocolError("the arrays of a wireframe do not fit each other")
        if self.likelihood.shape != (m,) or self.own.shape != (m,):
            raise ProtocolError("a wireframe needs one likelihood and one origin per edge")
        if not np.isfinite(self.points).all() or (np.abs(self.points) > MAX_COORDINATE_M).any():
            raise ProtocolError("a vertex of the wireframe is not finite or out of bounds")
        if n and int(self.labels.max()) > max(Label):
            raise ProtocolError("a vertex of the wireframe has an unknown label")
        if not m:
            return
        if self.edges.min() < 0 or self.edges.max() >= n:
            raise ProtocolError("an edge of the wireframe names a vertex that is not there")
        if not np.isfinite(self.likelihood).all() or self.likelihood.min() < 0 or self.likelihood.max() > 1:
            raise ProtocolError("an edge likelihood is not in [0, 1]")
        if (self.edges[:, 0] == self.edges[:, 1]).any():
            raise ProtocolError("an edge of the wireframe joins a vertex to itself")
        for column, word in ((0, "out of"), (1, "into")):
            if np.bincount(self.edges[:, column]).max() > 1:
                raise ProtocolError(f"two edges lead {word} one vertex of the wireframe")

    def segments(self) -> Floats:
        """Walls as (m, 4) x1, y1, x2, y2 in metres."""
        return np.asarray(self.points[self.edges].reshape(-1, 4), np.float64)


def certain(points: NDArray[np.float64], edges: NDArray[np.signedinteger[Any]]) -> Wireframe:
    """A map without doubt: corners (n, 2), all nominal, and walls (m, 2) between them, all seen by its own robot."""
    n, m = len(points), len(edges)
    return Wireframe(points, np.zeros(n, np.uint8), edges.astype(np.int32), np.ones(m, np.float32), np.ones(m, bool))


def enclosed(rings: Sequence[NDArray[np.float64]]) -> Wireframe:
    """A map of the walls along closed rings of true corners (k, 2), each without the first one again at its end."""
    begins = np.cumsum([0, *map(len, rings)]).tolist()
    edges = [(b + k, b + (k + 1) % len(ring)) for b, ring in zip(begins, rings, strict=False) for k in range(len(ring))]
    return certain(np.vstack(rings), np.array(edges))


def _check_count(n: int, m: int) -> None:
    if n > MAX_VERTICES or m > MAX_VERTICES:
        raise ProtocolError(f"a wireframe of {n} vertices and {m} edges; at most {MAX_VERTICES} are taken")


_ARRAYS = (
    ("points", "<f4", np.float64, 2),
    ("labels", "u1", np.uint8, 1),
    ("edges", "<u2", np.int32, 2),
    ("likelihood", "<f4", np.float32, 1),
    ("own", "u1", np.bool_, 1),
)
"""Fields in the order of the bytes: name, type in the bytes, type in a Wireframe, number of columns."""


def encode_wireframe(wireframe: Wireframe) -> bytes:
    """Bytes of a wireframe: float32 positions (1 um at 10 m), labels, edges, likelihoods and origins."""
    head = _HEADER.pack(_MAGIC, _VERSION, len(wireframe.points), len(wireframe.edges))
    return head + b"".join(getattr(wireframe, name).astype(sent).tobytes() for name, sent, _, _ in _ARRAYS)


def decode_wireframe(data: bytes) -> Wireframe:
    """Wireframe of its bytes; raises ProtocolError on anything else than `encode_wireframe` makes."""
    if len(data) < _HEADER.size:
        raise ProtocolError("a wireframe is shorter than its header")
    magic, version, n, m = _HEADER.unpack_from(data)
    if magic != _MAGIC:
        raise ProtocolError("these bytes are no wireframe")
    if version != _VERSION:
        raise ProtocolError(f"a wireframe of version {version}; this program reads version {_VERSION}")
    _check_count(n, m)
    if len(data) != _HEADER.size + 9 * n + 9 * m:
        raise ProtocolError(f"a wireframe of {n} vertices and {m} edges is not {len(data)} bytes long")
    if m and max(data[-m:]) > 1:
        raise ProtocolError("an edge's origin is neither own nor heard")
    arrays: dict[str, Any] = {}
    at = _HEADER.size
    for (name, sent, kept, columns), rows in zip(_ARRAYS, (n, n, m, m, m), strict=True):
        array = np.frombuffer(data, sent, rows * columns, at)
        at += array.nbytes
        with np.errstate(invalid="ignore"):  # a NaN is refused below, without a warning on the terminal
            arrays[name] = array.astype(kept).reshape((rows, columns) if columns > 1 else rows)
    wireframe = Wireframe(**arrays)
    wireframe.check()
    return wireframe
