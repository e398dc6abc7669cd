"""The map of an accepted peer as part of the robot's: merged, refined with later maps, and undone (paper IV; ours).

Every function returns the peer's new state. The merged map is a layer over the own one (agent.mapping.layers), so
undoing a merge is complete: the layer is left away.
"""

import math
from dataclasses import replace

import numpy as np

from agent.alignment.agreement import agreement, contradict
from agent.alignment.candidates import refine_near
from agent.alignment.config import AlignmentConfig
from agent.alignment.prepared import PreparedMap
from agent.communication.receiving import ReceivedMap
from agent.communication.telling import LONG_AGO
from agent.cooperation.evidence import WallEvidence
from agent.cooperation.peer import Figures, Laid, Merged, Proposed
from agent.cooperation.verification import Watch
from agent.cooperation.wall_fit import WallFit, fit_on_walls
from agent.geometry.transform import apart
from agent.mapping.layers import layer_of
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of
from protocol.wireframe import Wireframe

SAME_WALL_M = 0.06
"""A received wall this near to an own one is the same: the error of the transform and of both walls."""
HITS_PER_M = 20.0
"""Weight of a received wall against own hits: that of a wall that was seen once, which has 20 and more a metre.

Its hits tell how well its direction is known, too. With 3 a metre, a wall of 0.9 m was one with walls turned by 8
degrees: in 15 runs in halls of walls that turn so, merges had added more than 0.5 m of wrong wall to 15 of 80 maps
after 30 s, and to 3 of 74 with 20."""
HIDDEN_AFTER = 3
"""Own scans that see through a piece of a received wall before it is not shown."""
LIKELY = 0.7
"""Received walls that are less likely are not shown: their sender hit them in fewer than two of three scans. Another
robot's front, seen in parts, was told with 4/7, and its copies went round for long after it was gone: all of a crowd
went to look. Of 310 walls that single robots mapped in three furnished layouts, one had less than 0.8."""
UNMERGE_M = 2.0
"""Received wall that own scans contradict before a merge is undone: no right merge measured has more than 1 m."""
UNMERGE_SHARE = 0.2
"""... and its least share of what own scans looked at."""
REFUSED_MAPS = 5
"""Newer maps in a row that contradict the own map before a merge is undone; one where its peer was started anew."""
REJECTED_GROWTH = 0.3
"""After a rejection or an undone merge, one map must gain this share of its walls before the pair is aligned again.

It counts from when the pair was aligned last, or own scans contradicted the merge."""
REFINED_DEG = 5.0
"""A refinement that turns the transform by more than this is not believed."""
AGREED_SHARE = 0.6
"""A newer map must agree with the own one along this share of what the merged map agrees along."""
STALE_M, STALE_RAD = 0.01, math.radians(0.05)
"""A transform that fits no better by this is left: maps are told on a grid of 1 cm, as much as 0.05 degrees at 11 m."""


def merge(peer: Proposed, tick: int, own: Wireframe) -> Merged:
    """Accept a proposal: the map on trial becomes part of the robot's."""
    peer.log.map_is_news = True
    walls, fit = peer.trial.walls, fit_on_walls(own, peer.map.wireframe, peer.trial.transform)
    laid = _laid(peer.map, fit.transform, walls)
    return Merged(peer.log, peer.map, fit, walls, laid, tick, tick)


def hide_seen_through(peer: Merged) -> Merged:
    """Leave away at once what own scans have seen through: a phantom would go from map to map and come back for ever.

    The same peer, unchanged, where there is nothing new of it.
    """
    if not (peer.walls.hidden(HIDDEN_AFTER) & ~peer.laid.hidden).any():
        return peer
    return replace(peer, laid=_laid(peer.map, peer.transform, peer.walls))


def contradiction(peer: Merged) -> Figures | None:
    """Figures where own scans see through so much of a merged map that the merge must be wrong."""
    confirmed, against = peer.walls.said(HIDDEN_AFTER)
    if against < UNMERGE_M or against / max(confirmed + against, 1e-9) < UNMERGE_SHARE:
        return None
    return {"ground_confirmed_m": round(confirmed, 2), "ground_against_m": round(against, 2)}


def update(
    peer: Merged, tick: int, own: Wireframe, maps: tuple[PreparedMap, PreparedMap] | None, config: AlignmentConfig
) -> tuple[Merged, Figures]:
    """Take the newest map of a merged peer and fit the transform anew; refuse a map that contradicts the own one.

    maps: the own one and the peer's, made ready. Returns how well the two agree, too, in metres of wall.
    """
    newest = peer.log.map
    assert newest is not None
    peer.log.map_is_news = False
    peer = replace(peer, updated=tick)
    if maps is None or not all(len(prepared.corners.walls) for prepared in maps):
        return peer, {}
    mine, theirs = maps
    fit = fit_on_walls(own, newest.wireframe, _refined(peer.transform, mine, theirs, config.min_inliers))
    agreed, conflict = agreement(mine.walls, theirs.walls, fit.transform)
    figures = {"agreement": round(agreed, 2), "conflict": round(conflict, 2)}
    if contradict(agreed, conflict, config) or agreed < AGREED_SHARE * peer.agreed_m:
        return replace(peer, refused=peer.refused + 1), figures
    peer.walls.lay(newest.wireframe, fit.transform, own)
    return replace(_fitted(peer, newest, fit), agreed_m=agreed, refused=0), figures


def refit(peer: Merged, tick: int, own: Wireframe) -> Merged:
    """Fit the transform anew, as the own walls may have moved since it was fitted: the map that is merged stays.

    A robot whose wheels err turns its whole map as it learns how that lies in its frame, by 0.4 degrees in `hall` after
    its peer was last heard. The peer's walls then lay 5 to 10 cm beside its own ones, and went from there to others.
    """
    peer = replace(peer, updated=tick)
    fit = fit_on_walls(own, peer.map.wireframe, peer.transform)
    if not apart(fit.transform, peer.transform, fit.centre, STALE_M, STALE_RAD):
        return peer
    return _fitted(peer, peer.map, fit)


def moved(peer: Merged, by: Pose) -> Merged:
    """The peer with its map moved as the robot's own was, where both met; it is to be fitted anew as soon as may be.

    No fit would find that by itself: it is not believed where it moves a map by more than 0.2 m.
    by: the motion in the robot's own frame.
    """
    peer.log.map_is_news |= peer.map is not peer.log.map  # the torn map may be why that was refused
    transform = np.array(compose(by, pose_of(peer.transform)))
    laid = _laid(peer.map, transform, peer.walls)
    return replace(peer, fit=peer.fit._replace(transform=transform), laid=laid, updated=LONG_AGO, watch=Watch())


def doubted(peer: Merged, tick: int) -> Merged:
    """The peer as one that was merged just now, and on whose merge its next map decides: it was started anew.

    From a checkpoint it goes on in the same frame.
    """
    return replace(peer, since=tick, refused=REFUSED_MAPS - 1)


def _fitted(peer: Merged, received: ReceivedMap, fit: WallFit) -> Merged:
    """The peer with a map of it laid as the fit says."""
    laid = _laid(received, fit.transform, peer.walls)
    return replace(peer, map=received, fit=fit, laid=laid)


def _refined(transform: Floats, mine: PreparedMap, theirs: PreparedMap, min_inliers: int) -> Floats:
    """The transform put right on matched corners, unless that moves it too far."""
    new = refine_near(transform, mine.corners, theirs.corners, min_inliers, math.radians(REFINED_DEG))
    return transform if new is None else new


def _laid(received: ReceivedMap, transform: Floats, walls: WallEvidence) -> Laid:
    """A received map in the own frame, without what is unlikely, or own scans have seen through."""
    wireframe, transform = received.wireframe, np.asarray(transform)
    hidden = walls.hidden(HIDDEN_AFTER) | (wireframe.likelihood < LIKELY)
    layer = layer_of(wireframe, transform, hidden, HITS_PER_M)
    return Laid(hidden, layer, layer_of(wireframe, transform, hidden | ~wireframe.own, HITS_PER_M))
