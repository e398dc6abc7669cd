"""What a lidar reports of true ranges: noise, lost beams, and readings between two surfaces at an edge."""

import math
from collections.abc import Sequence

import numpy as np

from protocol.arrays import Floats, Ints
from protocol.messages import LidarSpec


def readings(
    spec: LidarSpec,
    ranges: Floats,
    rngs: Sequence[np.random.Generator],
    met: Ints | None = None,
    sines: Floats | None = None,
) -> Floats:
    """Readings (k, beams) of true ranges (k, beams), with one generator a robot.

    met: (k, beams) what each beam met, as from `Lidar.trace`; None: there are no edges. sines: (k, beams) sine of the
    angle between beam and wall, inf where it met none; None: none grazes. Nothing came back, inf, from more than
    range_max_m; nothing was measured, NaN, by a beam that is lost, or whose range is less than range_min_m: the LDS-01
    reports 0 there.
    """
    noise = np.stack([rng.standard_normal(spec.beams) for rng in rngs])
    chance = np.stack([rng.random(spec.beams) for rng in rngs])
    out = ranges if met is None or spec.mixed == 0 else _mixed(spec, ranges, met, chance)
    sd = np.maximum(spec.noise_m, spec.noise_share * np.where(np.isfinite(out), out, 0.0))
    out = out + sd * noise
    out[out > spec.range_max_m] = np.inf
    lost = chance < spec.dropout
    if sines is not None:
        lost = chance < 1 - (1 - spec.dropout) * (1 - np.exp(-sines / math.sin(math.radians(spec.grazing_deg))))
    out[lost | (ranges < spec.range_min_m) | (out < spec.range_min_m)] = np.nan
    return out


def _mixed(spec: LidarSpec, ranges: Floats, met: Ints, chance: Floats) -> Floats:
    """Ranges where a beam's footprint falls on what its neighbour met, too; the larger the chance, the more of it.

    The same chance loses beams where it is small, so that no beam is both.
    """
    out = ranges.copy()
    for high, neighbour in ((1.0, 1), (1.0 - spec.mixed / 2, -1)):
        share = 1 - (high - chance) / (spec.mixed / 2)
        other, beside = np.roll(ranges, -neighbour, 1), np.roll(met, -neighbour, 1)
        edge = (share >= 0) & (share < 1) & (met != beside) & np.isfinite(ranges) & np.isfinite(other)
        if spec.field_of_view_deg < 360:
            edge[:, -1 if neighbour > 0 else 0] = False
        out[edge] += share[edge] * (other[edge] - ranges[edge])
    return out
