"""What a run draws from its seed: generators, each for one purpose, and where robots start."""

import zlib

import numpy as np

from protocol.arrays import Floats
from world.config import WorldConfig
from world.worldfile import World


def starts_of(config: WorldConfig, world: World) -> Floats:
    """(k, 3) start poses of a run's robots in the world's frame. Raises WorldFileError where there is no room."""
    rng = generator(config.seed, "starts")
    return world.starts(config.robots, config.spec.radius_m, rng, drawn=config.starts == "random")


def generator(seed: int, purpose: str, robot: str = "") -> np.random.Generator:
    """The run's generator for one purpose and robot: a draw in one moves nothing in another."""
    words = [zlib.crc32(word.encode()) for word in (purpose, robot)]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))
