"""Thresholds of verification, merging and division. All ours; the paper gives none."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from protocol.settings import Config, Positive

Nats = Annotated[float, Field(ge=0)]


class VerificationConfig(Config):
    """The sequential test of a proposal. Evidence in nats, log-odds of right against wrong; each kind may be off."""

    ground: bool = True
    """Ground newly seen: walls that the received map predicts where the robot had not looked (paper IV)."""
    discs: bool = True
    """The teammate's disc, seen or not seen where the transform puts it."""
    heard: bool = True
    """Messages come from within the radio's range: places of both robots at each of them."""
    later_maps: bool = True
    """Alignments of later maps, which must give the same transform."""

    accept: Positive = 5.0
    """Wald's bound for one wrong acceptance among 150 wrong proposals; they are a few in a hundred to begin with."""
    reject: Positive = 4.0
    """The same for giving a right one up, which costs only a second try."""
    ground_nats_per_m: Nats = 0.6
    """Newly seen wall as predicted: little, as rooms are alike."""
    ground_most: Nats = 3.0
    """Never more than this, as a twin agrees everywhere: the drive alone accepts nothing by default."""
    ground_against_per_m: Nats = 4.0
    """Predicted wall that is not there: right maps have 0.2 m of it at the median, twins of a room several metres."""
    disc_nats: Nats = 2.5
    """A disc where it must be: one chance disc in twelve such looks at most."""
    disc_against: Nats = 2.5
    """No disc where it must be in view: perception misses one of ten."""
    later_nats: Nats = 2.5
    """An alignment of maps that have grown gives the same transform, unambiguously."""
    later_against: Nats = 6.0
    """It gives another one: decides."""
    heard_against: Nats = 10.0
    """Heard from beyond the radio's range: decides."""

    fresh_looks: Annotated[int, Field(ge=1)] = 2
    """Scans that must say the same of a piece of ground before it counts."""
    wall_margin_m: Positive = 0.12
    """A wall this near to where it is predicted is the predicted one: two maps' and the transform's errors, 3 sigma."""
    disc_gate_m: Positive = 0.15
    """A disc this near to where it is predicted is the teammate: 0.05 m that it drives in a tick, and the transform's
    error and the fit's of 0.03 m, 3 sigma."""
    disc_far_m: Positive = 2.5
    """A teammate farther off may be missed: it has five beams there."""
    disc_moved_m: Positive = 0.3
    """Looks at a teammate count as independent once it or the robot has moved this far."""
    sightings: Annotated[int, Field(ge=3)] = 4
    """Places of a peer at which one transform must explain a disc, to be proposed by sight. Measured with the two
    below: of 1,636 such fits in 14 runs none was wrong; of 103 that fail one of them 65 were."""
    sightings_ahead: Annotated[int, Field(ge=1)] = 2
    """... and as many more than the best distinct transform explains."""
    sighting_spread_m: Positive = 0.2
    """Standard deviation of these places across the line through them; of the wrong fits above, 63 have below 0.17."""
    sighting_base_m: Positive = 0.6
    """Two places of a peer this far apart give a turn, to 5 degrees by discs of 5 cm."""
    least_corners: Annotated[int, Field(ge=2)] = 4
    """Corners of both maps that match where sightings give the transform, and whenever one is accepted: fewer than for
    an alignment by maps, as young maps of robots that look at each other have few."""
    growth: Positive = 0.15
    """Later maps are aligned once one of them has gained this share of its corners."""
    time_out_s: Positive = 120.0
    """Simulated seconds from setting out to giving up: a drive of 20 m there, and as long to look around."""
    near_m: Positive = 0.6
    """This near to the place where the teammate was, the robot has arrived."""
    return_s: Positive = 20.0
    """A peer counts as a stranger for this long after it was merged: it may not know the robot's frame yet."""
    still_heard_s: Positive = 10.0
    """A peer heard this lately is gone to itself: it drives 2.2 m in the time."""
    detours: Annotated[int, Field(ge=0)] = 4
    """Places where the maps differ that are gone to when the contact place decided nothing."""


class CooperationConfig(Config):
    """What a robot does with the maps of others."""

    sharing: bool = True
    """Align, verify and merge; without, every robot maps for itself."""
    division: bool = True
    """Leave frontiers to a teammate with a known transform that is nearer; without, cooperation is the paper's."""
    retry_growth: Positive = 0.2
    """A pair is aligned again once one map has gained this share of its corners since the last attempt."""
    retry_corners: Annotated[int, Field(ge=1)] = 4
    """... and at least so many."""
    rejected_growth: Positive = 0.3
    """The same share after a proposal was rejected."""
    off_map_m: Positive = 8.0
    """A teammate farther from all walls of its own map than this is not believed: twice what its lidar reaches."""
    places_kept: Annotated[int, Field(ge=1)] = 60
    """Pairs of places at which a peer was heard, for the radio's range; two minutes of beacons and more."""

    merge_offset_m: Positive = 0.06
    """A received wall this near to an own one is the same: the transform's error and both walls'."""
    merge_hits_per_m: Positive = 3.0
    """Weight of a received wall against own hits, of which a wall seen once has 20 and more a metre."""
    hidden_after: Annotated[int, Field(ge=1)] = 3
    """Own scans that see through a piece of a received wall before it is not shown: as map.cut_after."""
    unmerge_m: Positive = 2.0
    """Received wall that own scans contradict before a merge is undone: no right merge measured has more than 1 m."""
    unmerge_share: Positive = 0.2
    """... and this share of what they looked at."""
    refused_maps: Annotated[int, Field(ge=1)] = 5
    """Messages in a row that contradict a merged map before it is undone."""
    refine_s: Positive = 4.0
    """The transform is refined with a later map at most this often: simulated seconds."""
    known_s: Positive = 60.0
    """A teammate's place counts for division this long after it was heard: it drives 13 m in the time."""
    nearer_m: Positive = 1.0
    """A frontier is left to a teammate that is nearer by this much, and by half the way that it may have gone."""
    verification: VerificationConfig = VerificationConfig()
