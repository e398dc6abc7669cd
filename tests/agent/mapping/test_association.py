"""Which walls are asked whether a piece is on them: all that could take it."""

import math

import numpy as np

from agent.corner_scan import PIECE
from agent.kernels import kernel
from agent.mapping.association import Gates, cost, is_off, lines_of, overlap, walls_near
from agent.mapping.edges import EDGE
from agent.mapping.layers import Layer, merged
from protocol.arrays import Bools, Records


def pieces_of(rng: np.random.Generator, count: int) -> Records:
    """Pieces (count,) of 0.1 to 6 m along two directions in a square of 12 m, of few hits and of many."""
    pieces = np.zeros(count, PIECE)
    length, angle = (
        rng.uniform(0.1, 6.0, count),
        0.5 * math.pi * rng.integers(4, size=count) + 0.05 * rng.normal(size=count),
    )
    pieces["hits"] = rng.choice([2.0, 8.0, 100.0], count)
    pieces["x"], pieces["y"] = rng.uniform(0.0, 12.0, (2, count)).round()
    pieces["x"] += 0.05 * rng.normal(size=count)
    pieces["y"] += 0.05 * rng.normal(size=count)
    pieces["ux"], pieces["uy"] = np.cos(angle), np.sin(angle)
    pieces["spread"] = pieces["hits"] * length**2 / 12.0
    pieces["end"] = np.column_stack([-0.5 * length, 0.5 * length])
    pieces["link"] = -1
    pieces["label"] = 1
    return pieces


@kernel
def asked(edges: Records, pieces: Records, gates: Gates) -> tuple[Bools, Bools]:
    """(k, n) which walls could take each piece, and which are asked."""
    lines, near = lines_of(edges, len(edges), 0, gates), np.empty(len(edges), np.int64)
    could, are = np.zeros((len(pieces), len(edges)), np.bool_), np.zeros((len(pieces), len(edges)), np.bool_)
    for k in range(len(pieces)):
        p = pieces[k]
        for j in near[: walls_near(lines, len(edges), p, gates, near)]:
            are[k, j] = not is_off(lines.rows[j], p, gates)
        for j in range(len(edges)):
            finite = math.isfinite(overlap(edges[j], p, gates)) and math.isfinite(cost(edges[j], p, gates))
            could[k, j] = edges[j].kind == 1 and finite
    return could, are


def test_every_wall_that_could_take_a_piece_is_asked() -> None:
    rng = np.random.default_rng(0)
    for noise in (0.01, 0.05):
        gates = Gates(noise, 0.06)
        walls = pieces_of(rng, 200)
        edges = merged(np.zeros(0, EDGE), [Layer(walls, np.ones(200), np.zeros((0, 3)))], gates)
        edges["relative"][::2] = (1e-4, 5e-5, 1e-4)  # as the walls that a robot knows together with its pose
        could, are = asked(edges, pieces_of(rng, 500), gates)
        assert could.sum() > 300 and not (could & ~are).any()
        assert are.sum() < 3 * could.sum()
