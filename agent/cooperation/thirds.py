"""What merged peers say of the frame of another one: thirds to the pair of it and the robot (ours).

A third that has merged a peer tells where that peer's frame lies in its own, and so where it lies in the robot's. Where
that is not where the robot has it, the circle of the three does not close, and one of its links is wrong.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agent.cooperation.peer import Merged, Peer, Proposed
from agent.geometry.transform import DISTINCT_M, DISTINCT_RAD, compose
from protocol.arrays import Bools, Floats
from protocol.geometry import wrapped
from protocol.wireframe import Wireframe


class Majority(NamedTuple):
    """The transform of a peer that most thirds agree on."""

    transform: Floats
    """(3,) the peer's frame in the robot's own."""
    agree: int
    """Thirds that say so."""


def words(peer: Peer, merged: Sequence[Merged]) -> list[tuple[Floats, Floats]]:
    """Of each merged third that says it has merged the peer, too: where its frame lies in the robot's own, and where by
    its word the peer's lies in that; (3,) both. What the peer says itself does not count."""
    name = peer.log.name
    thirds = [third for third in merged if third is not peer and name in third.log.frames]
    return [(third.transform, third.log.frames[name]) for third in thirds]


def claims(said: Sequence[tuple[Floats, Floats]]) -> Floats:
    """(k, 3) transforms of a peer by these words."""
    return compose(*np.array(said).transpose(1, 0, 2)) if said else np.zeros((0, 3))


def are_same(said: Sequence[tuple[Floats, Floats]], before: Sequence[tuple[Floats, Floats]]) -> bool:
    """Whether nobody has said anything else, nor lies in another place, since these words were asked for before."""
    return len(said) == len(before) and all(
        one is two and its is others for (one, its), (two, others) in zip(said, before, strict=True)
    )


def balance(peer: Proposed | Merged, merged: Sequence[Merged]) -> int:
    """How many more of these others say the transform of a peer than say another one."""
    said, log = words(peer, merged), peer.log
    weighed = [*said, (peer.transform, peer.map.wireframe.points)]
    if log.balanced is None or not are_same(weighed, log.balanced[0]):
        middle = _middle_of(peer.map.wireframe)
        alike = _alike(compose(claims(said), middle), compose(peer.transform, middle))
        log.balanced = weighed, int(np.where(alike, 1, -1).sum())
    return log.balanced[1]


def best(said: Floats, wireframe: Wireframe) -> Majority | None:
    """The one of (k, 3) that most others are like, of these the median; None without any."""
    if not len(said):
        return None
    middle = _middle_of(wireframe)
    placed = compose(said, middle)  # claims lie together at the middle of the map, which may be far from its frame
    alike = _alike(placed[None], placed[:, None])
    like = alike[alike.sum(1).argmax()]
    first = placed[like][0]
    turn = first[2] + np.median(wrapped(placed[like, 2] - first[2]))
    return Majority(compose(np.array([*np.median(placed[like, :2], axis=0), turn]), -middle), int(like.sum()))


def _middle_of(wireframe: Wireframe) -> Floats:
    """(3,) the middle of a map's vertices as a pose."""
    return np.append(wireframe.points.mean(0) if len(wireframe.points) else np.zeros(2), 0.0)


def _alike(placed: Floats, others: Floats) -> Bools:
    """(...) which poses of the map's middle (..., 3) do not contradict others (..., 3)."""
    off = placed - others
    return np.asarray(
        (np.hypot(off[..., 0], off[..., 1]) <= DISTINCT_M) & (np.abs(wrapped(off[..., 2])) <= DISTINCT_RAD)
    )
