"""Settings of mapping."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from protocol.settings import Config, Positive


class MapConfig(Config):
    """Corner scans to a wireframe."""

    offset_gate_m: Positive = 0.012
    """A wall and a piece of it may lie this far apart beside noise: walls are not straight (mapping.md rule 5)."""
    gate_sigmas: Positive = 3.5
    """Noise that an association allows for: 0.9995 of it."""
    angle_gate_deg: Positive = 3.0
    """As offset_gate_m, for directions."""
    bridge_m: Positive = 0.25
    """A piece may lie this far beyond a frontier of its wall; as far as perception claims wall between two hits."""
    end_margin_m: Positive = 0.04
    """Views of an end agree within this: 1 beam at 2.3 m, or 4 sigma."""
    patience: Positive = 3.0
    """Views against an end before it changes; one is a wrong label (6 % of ends), three in a row are not."""
    patience_growth: Positive = 0.3
    """More of them per view that confirmed it (facts/mapping.md rule 7)."""
    confirmations: Positive = 30.0
    """So many make an end or a wall as sure as it gets: a wrong one has to go within the 50 scans that see it."""
    max_direction_sd_deg: Positive = 5.0
    """A new wall's direction must be known this well: 3 sigma are 15 degrees; at 10, steps of 5 cm were so far off."""
    min_corner_deg: Positive = 20.0
    """Walls that meet flatter than this share no corner."""
    close_corner_m: Positive = 0.06
    """Open ends this near to where their walls meet are that corner."""
    prolonged_m: Positive = 0.1
    """A corner with no hit this near to it is a guess: beams are 6 cm apart at the lidar's range, and slots wider."""
    steady: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of the scans in view that must have hit a new wall: posts' faces 0.7 to 1, a smear over two of them 0.3."""
    smear_m: Positive = 0.3
    """Nothing longer is a smear over the faces of a post or over a step: twice what the widest showed."""
    straight_sigmas: Positive = 1.2
    """Hits of a short wall lie this near to its line, root mean square: those of a wall within 0.6 (three beams a scan)
    to 1.0 (many), of a smear over two faces of a post of 0.1 m, from 1.5 m, 1.3 to 1.8."""
    wall_hits: Positive = 12.0
    """Beams that a new wall must show, in one scan or over several: 0.25 m from 1.2 m, where no smear over a 0.1 m step
    fits a line. With 6, two far views of three beams, each across two faces of a turned post of 0.1 m, made a wall."""
    axis_trust: Positive = 0.8
    """Agreement of the walls' directions above which they count as rectilinear; furnished layouts have over 0.95."""
    off_axis_deg: Positive = 10.0
    """A new wall this oblique is suspect where walls are rectilinear; their true angles are within 2 degrees."""
    oblique_sd_deg: Positive = 3.0
    """A suspect wall's direction must be known this well, 3 sigma from the axis: 44 beams on 0.1 m, a face of a post,
    in 7 scans from 0.9 m; 180 on the smear over a step of 0.05 m, which are not seen before the step itself is."""
    view_step_m: Positive = 0.08
    """Samples along a wall when a scan is held against it: half the thickness of a usual wall."""
    view_margin_m: Positive = 0.035
    """A wall this near to what was seen is what was seen: 3.5 sigma of the default lidar."""
    end_skip_m: Positive = 0.05
    """Ends are not held against a scan: their place is known to about a beam."""
    cut_after: Positive = 3.0
    """Scans that see through the same part of a wall before it is cut (facts/mapping.md rule 8)."""
    drop_after: Positive = 8.0
    """Scans in view without a hit before a wall on probation is dropped (facts/mapping.md rule 8)."""
    drop_growth: Positive = 0.3
    """More of them per hit of a wall that left probation: as patience_growth, up to as many."""
    sure_after: Positive = 4.0
    """Scans that hit a wall before it leaves probation."""
    publish_after: Positive = 2.0
    """Scans that hit a wall before it is shown: one may be a false piece."""
    min_length_m: Positive = 0.05
    """What is left of a cut wall is dropped below this."""


class FilterConfig(Config):
    """The set of particles, and the odds by which a scan weighs them. Log-odds in nats; equations ours."""

    particles: Annotated[int, Field(ge=1, le=1000)] = 1
    """Wireframes kept. One is best, as the sweep over 1, 5, 10, 30 and 100 shows (results/filter.json): recall and
    precision under noise of ranges and odometry are the same to 0.001, and among parallel walls that are easily mixed
    up the map is no better along the run (walls F1 0.930 to 0.932, corners 0.62 with one, 0.60 with a hundred). Every
    wall carries its own evidence, and the next scans take a wrong decision back, while the update grows from 0.08 to
    5.3 ms and the bytes a hundredfold. More pay only where a fault strikes some of the particles."""
    temper: Positive = 0.2
    """Scans in a row share their errors, so each counts only as this part of an independent one."""
    resample_below: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Resample when the effective sample size falls below this share of the particles; the usual half."""
    match_odds: Positive = 2.0
    """A piece on its wall: e^2 for against a chance hit; its chi-square is taken off."""
    extra_odds: Positive = 1.0
    """A piece that no wall predicts: new ground brings many, alike for all particles."""
    missing_odds: Positive = 2.0
    """A wall in view that was not hit."""
    through_odds: Positive = 4.0
    """A wall seen through: strongest, as free space is seldom invented."""
    corner_odds: Positive = 1.0
    """A corner as predicted, or against the prediction."""
    label_odds: Positive = 1.0
    """An end as predicted, or against the prediction."""
    early_wall: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Probability that a suspect piece (map.wall_hits, map.oblique_sd_deg) is a wall: 1 of 10 lay on one in the eight
    layouts."""
    patience_spread: Annotated[float, Field(ge=0, lt=1)] = 0.5
    """Particles draw their patience (map.patience, cut_after) from 1 - this to 1 + this times the default."""
    correct_pose: bool = True
    """Correct the odometry by the shift between scan and map, where the odometry is not exact."""
    axis_sd_deg: Positive = 0.5
    """How well rectilinear walls keep their axis; the eight layouts' outer walls do within 0.3 degrees."""
    heading_trust: Positive = 0.95
    """Agreement of directions above which the axis holds the heading."""
    wall_floor_m: Positive = 0.003
    """What a mapped wall is good for, beside its covariance: as perception.noise_floor_m."""
    wall_floor_deg: Positive = 0.2
    """As wall_floor_m, for directions."""
