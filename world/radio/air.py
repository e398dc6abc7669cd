"""Models of the radio channel between two robots: each may lose a message or delay it.

Everything random is drawn from (seed, model, sender, receiver, tick, number on the link), so that one more robot or
message changes no draw of another link.
"""

import math
import zlib
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple, assert_never

import numpy as np

from protocol.arrays import Floats
from world.checkpoint import State
from world.radio.config import (
    Asymmetric,
    Bernoulli,
    Blackout,
    Capacity,
    GilbertElliott,
    Latency,
    LineOfSight,
    LogDistance,
    Model,
)


class Hop(NamedTuple):
    """One message on its way to one receiver."""

    tick: int
    sender: int
    receiver: int
    number: int
    """How many messages the same sender had for the same receiver before in this tick."""
    here: Floats
    """(2,) m, true place of the sender at the sending tick."""
    there: Floats
    """(2,) m, true place of the receiver at the sending tick."""


Loses = Callable[[Hop], bool]
"""Whether a model of the air loses a message."""


class Generators:
    """The random generators of one model."""

    def __init__(self, seed: int, model: str, place: int) -> None:
        """place: the index of the model among those of its kind."""
        self._words = [seed, zlib.crc32(b"radio"), zlib.crc32(model.encode()), place]

    def of_hop(self, hop: Hop) -> np.random.Generator:
        """For one message and receiver."""
        return np.random.default_rng([*self._words, hop.sender, hop.receiver, hop.tick, hop.number])

    def of_link(self, hop: Hop) -> np.random.Generator:
        """For a directed link, for a whole run."""
        return np.random.default_rng([*self._words, hop.sender, hop.receiver])

    def once_a_link(self, draw: Callable[[np.random.Generator], float]) -> Callable[[Hop], float]:
        """What is drawn for the link of a hop, the same for a whole run."""
        drawn: dict[tuple[int, int], float] = {}

        def value(hop: Hop) -> float:
            link = hop.sender, hop.receiver
            if link not in drawn:
                drawn[link] = draw(self.of_link(hop))
            return drawn[link]

        return value


def losses(
    models: list[Model], robots: list[str], seed: int, period_s: float, walls: Floats
) -> list[tuple[str, Loses]]:
    """The models that lose messages, in their order, with the reason that each gives.

    period_s: of a tick. walls: (n, 4) x1, y1, x2, y2 in metres, free space on their left.
    """
    made: list[tuple[str, Loses]] = []
    seen: Counter[str] = Counter()
    for model in models:
        rngs = Generators(seed, model.kind, seen[model.kind])
        seen[model.kind] += 1
        match model:
            case LineOfSight():
                made.append(("walls", lambda hop: walls_between(walls, hop.here, hop.there) > 0))
            case LogDistance():
                made.append(("fading", _log_distance(model, walls, rngs)))
            case Bernoulli():
                made.append(("loss", _bernoulli(model, rngs)))
            case GilbertElliott():
                made.append(("burst", _gilbert_elliott(model, period_s, rngs)))
            case Asymmetric():
                made.append(("asymmetric", _asymmetric(model, robots, rngs)))
            case Blackout():
                made.append(("blackout", _blackout(model, robots, period_s)))
            case Latency() | Capacity():
                pass  # they lose nothing here: see `delays`, and `Budget` as the gate asks it
            case _:
                assert_never(model)
    return made


def walls_between(walls: Floats, here: Floats, there: Floats) -> int:
    """How many walls (n, 4), free space on their left, the straight way from `here` to `there` enters."""
    along = walls[:, 2:] - walls[:, :2]
    before, after = here - walls[:, :2], there - walls[:, :2]
    near = along[:, 0] * before[:, 1] - along[:, 1] * before[:, 0]
    far = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    way = there - here
    start, end = walls[:, :2] - here, walls[:, 2:] - here
    left = way[0] * start[:, 1] - way[1] * start[:, 0]
    right = way[0] * end[:, 1] - way[1] * end[:, 0]
    # strict on one side only, so that a way through a shared corner enters just one of its walls
    return int(((near > 0) & (far <= 0) & ((left > 0) != (right > 0))).sum())


def _log_distance(model: LogDistance, walls: Floats, rngs: Generators) -> Loses:
    """Log-distance path loss, walls, and fading per message."""
    link_db = rngs.once_a_link(lambda rng: float(rng.normal(0, model.link_db)))

    def loses(hop: Hop) -> bool:
        away = max(math.dist(hop.here, hop.there), 0.01)
        margin_db = 10 * model.exponent * math.log10(model.reach_m / away) + link_db(hop)
        if model.wall_db:
            margin_db -= model.wall_db * walls_between(walls, hop.here, hop.there)
        return bool(margin_db + rngs.of_hop(hop).normal(0, model.fading_db) < 0)

    return loses


def _chance(loss: Callable[[Hop], float], rngs: Generators) -> Loses:
    """A probability of loss for each message."""
    return lambda hop: bool(rngs.of_hop(hop).random() < loss(hop))


def _bernoulli(model: Bernoulli, rngs: Generators) -> Loses:
    """The same probability of loss for all messages."""
    return _chance(lambda _: model.loss, rngs)


def _gilbert_elliott(model: GilbertElliott, period_s: float, rngs: Generators) -> Loses:
    """A Markov chain of two states per directed link, stepped once a tick."""
    by_state = model.loss_good, model.loss_bad
    leave = min(1.0, period_s / model.good_s), min(1.0, period_s / model.bad_s)
    often_bad = model.bad_s / (model.good_s + model.bad_s)
    links: dict[tuple[int, int], tuple[np.random.Generator, int, bool]] = {}

    def loss(hop: Hop) -> float:
        link = hop.sender, hop.receiver
        if link not in links:
            rng = rngs.of_link(hop)
            links[link] = rng, 0, bool(rng.random() < often_bad)
        rng, tick, bad = links[link]
        for chance in rng.random(hop.tick - tick).tolist():
            bad ^= chance < leave[bad]
        links[link] = rng, hop.tick, bad
        return by_state[bad]

    return _chance(loss, rngs)


def _asymmetric(model: Asymmetric, robots: list[str], rngs: Generators) -> Loses:
    """A probability of loss per directed link."""
    drawn = rngs.once_a_link(lambda rng: float(rng.uniform(0, model.most)))

    def loss(hop: Hop) -> float:
        given = model.links.get(f"{robots[hop.sender]}>{robots[hop.receiver]}")
        return drawn(hop) if given is None else given

    return _chance(loss, rngs)


def _blackout(model: Blackout, robots: list[str], period_s: float) -> Loses:
    """A window of time in which nothing passes."""
    mute = {i for i, robot in enumerate(robots) if not model.robots or robot in model.robots}
    # all times to the ns: by rounding, 111 times 1/15 s are less than 7.4 s
    begin_s, end_s = round(model.begin_s, 9), round(model.end_s, 9)

    def loses(hop: Hop) -> bool:
        in_time = begin_s <= round(hop.tick * period_s, 9) < end_s
        return in_time and not mute.isdisjoint((hop.sender, hop.receiver))

    return loses


def delays(models: list[Model], seed: int) -> Callable[[Hop], int]:
    """Ticks from sending to hearing: the sum of what the latency models say, at least one."""
    latencies = [model for model in models if isinstance(model, Latency)]
    jitters = [
        (model.jitter, Generators(seed, "latency", place)) for place, model in enumerate(latencies) if model.jitter
    ]

    def ticks(hop: Hop) -> int:
        late = sum(int(rngs.of_hop(hop).integers(jitter + 1)) for jitter, rngs in jitters)
        return max(1, sum(model.ticks for model in latencies) + late)

    return ticks


class Budget:
    """What each robot's radio may still carry in the time up to a tick; a limit of None allows everything."""

    def __init__(self, most: float | None, ticks: int) -> None:
        """most: bytes in so many ticks."""
        self._limit, self._ticks = most, ticks
        self._used: dict[int, dict[int, int]] = {}

    def takes(self, robot: int, tick: int, size: int) -> bool:
        """Whether a robot's radio takes a message at a tick; if so, it is counted."""
        if self._limit is None:
            return True
        before = self._used.get(robot, {})
        used = self._used[robot] = {t: size for t, size in before.items() if t > tick - self._ticks}
        if sum(used.values()) + size > self._limit:
            return False
        used[tick] = used.get(tick, 0) + size
        return True

    def state(self) -> State:
        """For a checkpoint."""
        return {"used": self._used}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._used = state["used"]
