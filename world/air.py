"""Models of the radio channel between two robots: each may lose a message or delay it.

Everything random is drawn from (seed, model, sender, receiver, tick, number on the link), so that one more robot or
message changes no draw of another link.
"""

import math
import zlib
from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from protocol.arrays import Floats
from world.radio_config import Asymmetric, Bernoulli, Blackout, GilbertElliott, Latency, LineOfSight, LogDistance, Model


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


class Loss(Protocol):
    """A model that may lose messages."""

    reason: str

    def loses(self, hop: Hop) -> bool:
        """Whether the message is lost."""
        ...


class Luck:
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


def losses(models: list[Model], robots: list[str], seed: int, period_s: float, walls: Floats) -> list[Loss]:
    """The models that lose messages, in their order.

    period_s: of a tick. walls: (n, 4) x1, y1, x2, y2 in metres, free space on their left.
    """
    made: list[Loss] = []
    seen: dict[str, int] = {}
    for model in models:
        luck = Luck(seed, model.kind, seen.setdefault(model.kind, 0))
        seen[model.kind] += 1
        match model:
            case LineOfSight():
                made.append(_Sight(walls))
            case LogDistance():
                made.append(_Fading(model, walls, luck))
            case Bernoulli():
                made.append(_Chance(model.loss, luck))
            case GilbertElliott():
                made.append(_Bursts(model, period_s, luck))
            case Asymmetric():
                made.append(_OwnLosses(model, robots, luck))
            case Blackout():
                made.append(_Silence(model, robots, period_s))
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


class _Sight:
    """Any wall between blocks."""

    reason = "walls"

    def __init__(self, walls: Floats) -> None:
        self._walls = walls

    def loses(self, hop: Hop) -> bool:
        return walls_between(self._walls, hop.here, hop.there) > 0


class _Fading:
    """Log-distance path loss, walls, and fading per message."""

    reason = "fading"

    def __init__(self, model: LogDistance, walls: Floats, luck: Luck) -> None:
        self._model, self._walls, self._luck = model, walls, luck
        self._link_db: dict[tuple[int, int], float] = {}

    def loses(self, hop: Hop) -> bool:
        model, link = self._model, (hop.sender, hop.receiver)
        if link not in self._link_db:
            self._link_db[link] = float(self._luck.of_link(hop).normal(0, model.link_db))
        away = max(math.dist(hop.here, hop.there), 0.01)
        margin_db = 10 * model.exponent * math.log10(model.reach_m / away) + self._link_db[link]
        if model.wall_db:
            margin_db -= model.wall_db * walls_between(self._walls, hop.here, hop.there)
        return bool(margin_db + self._luck.of_hop(hop).normal(0, model.fading_db) < 0)


class _Chance:
    """The same chance of loss for all messages."""

    reason = "loss"

    def __init__(self, loss: float, luck: Luck) -> None:
        self._loss, self._luck = loss, luck

    def loses(self, hop: Hop) -> bool:
        return bool(self._luck.of_hop(hop).random() < self._loss)


class _Bursts:
    """A Markov chain of two states per directed link, stepped once a tick."""

    reason = "burst"

    def __init__(self, model: GilbertElliott, period_s: float, luck: Luck) -> None:
        self._luck = luck
        self._loss = (model.loss_good, model.loss_bad)
        self._leave = min(1.0, period_s / model.good_s), min(1.0, period_s / model.bad_s)
        self._often_bad = model.bad_s / (model.good_s + model.bad_s)
        self._links: dict[tuple[int, int], tuple[np.random.Generator, int, bool]] = {}

    def loses(self, hop: Hop) -> bool:
        link = hop.sender, hop.receiver
        if link not in self._links:
            rng = self._luck.of_link(hop)
            self._links[link] = rng, 0, bool(rng.random() < self._often_bad)
        rng, tick, bad = self._links[link]
        for chance in rng.random(hop.tick - tick).tolist():
            bad ^= chance < self._leave[bad]
        self._links[link] = rng, hop.tick, bad
        return bool(self._luck.of_hop(hop).random() < self._loss[bad])


class _OwnLosses:
    """A chance of loss per directed link."""

    reason = "asymmetric"

    def __init__(self, model: Asymmetric, robots: list[str], luck: Luck) -> None:
        self._most, self._luck = model.most, luck
        index = {robot: i for i, robot in enumerate(robots)}
        pairs = {tuple(link.split(">")): loss for link, loss in model.links.items()}
        self._loss = {(index[a], index[b]): loss for (a, b), loss in pairs.items() if a in index and b in index}

    def loses(self, hop: Hop) -> bool:
        link = hop.sender, hop.receiver
        if link not in self._loss:
            self._loss[link] = float(self._luck.of_link(hop).uniform(0, self._most))
        return bool(self._luck.of_hop(hop).random() < self._loss[link])


class _Silence:
    """A window of time in which nothing passes."""

    reason = "blackout"

    def __init__(self, model: Blackout, robots: list[str], period_s: float) -> None:
        self._model, self._period_s = model, period_s
        self._mute = {i for i, robot in enumerate(robots) if not model.robots or robot in model.robots}

    def loses(self, hop: Hop) -> bool:
        t = hop.tick * self._period_s
        return self._model.begin_s <= t < self._model.end_s and not self._mute.isdisjoint((hop.sender, hop.receiver))


class Delay:
    """Ticks from sending to hearing: the sum of what the latency models say, at least one."""

    def __init__(self, models: list[Model], seed: int) -> None:
        self._models = [model for model in models if isinstance(model, Latency)]
        self._lucks = [Luck(seed, "latency", place) for place in range(len(self._models))]

    def ticks(self, hop: Hop) -> int:
        """For one message and receiver."""
        return max(1, sum(
            model.ticks + (int(luck.of_hop(hop).integers(model.jitter + 1)) if model.jitter else 0)
            for model, luck in zip(self._models, self._lucks, strict=True)
        ))  # fmt: skip


class Budget:
    """What each robot's radio may still carry in the second up to a tick; a limit of None allows everything."""

    def __init__(self, bytes_per_s: float | None, ticks_per_s: int) -> None:
        self._limit, self._ticks = bytes_per_s, ticks_per_s
        self._used: dict[int, dict[int, int]] = {}

    def takes(self, robot: int, tick: int, size: int) -> bool:
        """Whether a robot's radio takes a message at a tick; if so, it is counted."""
        if self._limit is None:
            return True
        used = self._recent(robot, tick)
        if sum(used.values()) + size > self._limit:
            return False
        used[tick] = used.get(tick, 0) + size
        return True

    def _recent(self, robot: int, tick: int) -> dict[int, int]:
        used: Mapping[int, int] = self._used.get(robot, {})
        self._used[robot] = {t: size for t, size in used.items() if t > tick - self._ticks}
        return self._used[robot]
