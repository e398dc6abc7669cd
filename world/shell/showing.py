"""What viewers see of the truth, published only while somebody with their credential reads it."""

import time
from collections.abc import Mapping
from contextlib import ExitStack

import shapely
import zenoh

from protocol import keys
from protocol.codec import MAX_MESSAGE_BYTES, encode
from protocol.messages import Site, Whereabouts
from protocol.session import is_read
from world.episode import Episode
from world.tick import Inputs

SHOW_S = 0.1
"""Time between two ticks that are shown; a screen needs no more (ours)."""
SITE_S = 1.0
"""Time between two tellings of the walls, for which a viewer that has just come waits."""

MOST_BYTES = MAX_MESSAGE_BYTES // 2
"""Of the ranges of all robots, beside their poses; more of them are not shown: 360 robots of 360 beams."""


class Showing:
    """Publishes where robots are, and now and then among what."""

    def __init__(self, episode: Episode, session: zenoh.Session, declared: ExitStack) -> None:
        """declared: what closes the publishers."""
        self._episode = episode
        self._site, self._whereabouts = (
            declared.enter_context(session.declare_publisher(key)) for key in (keys.SITE, keys.WHEREABOUTS)
        )
        self._told = self._set = 0.0

    def show(self, inputs: Mapping[str, Inputs]) -> None:
        """Show a tick, unless the last one shown was a moment ago."""
        now = time.monotonic()
        if now - self._told < SHOW_S:
            return
        self._told = now
        if not is_read(self._whereabouts):
            return
        episode = self._episode
        if now - self._set >= SITE_S:
            self._set = now
            self._site.put(encode(_site_of(episode)))
        poses = dict(zip(episode.robots, episode.poses.tolist(), strict=True))
        ranges = {robot: given.observation.ranges for robot, given in inputs.items()}
        if sum(map(len, ranges.values())) > MOST_BYTES:
            ranges = {}
        self._whereabouts.put(encode(Whereabouts(tick=episode.tick, poses=poses, ranges=ranges)))


def _site_of(episode: Episode) -> Site:
    frames = dict(zip(episode.robots, episode.starts.tolist(), strict=True))
    solid = shapely.to_wkb(episode.world.solid)
    return Site(world=episode.world.name, solid=solid, spec=episode.config.spec, frames=frames)
