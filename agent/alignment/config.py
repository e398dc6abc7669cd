"""Numbers of the alignment, with units and reasons. `measured` means `wireswarm bench alignment`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from protocol.settings import Config, Positive


class AlignmentConfig(Config):
    """How the frame of a peer's map is found in the robot's own (paper III-C; thresholds ours)."""

    method: Literal["features", "4pcs", "icp"] = "features"
    """Like features (the paper's), 4-point congruent sets (its baseline), or iterated closest points."""
    drawing: Literal["ranked", "random"] = "ranked"
    """Pairs of like features best first, or drawn with their likelihood as RANSAC draws."""
    min_corners: Annotated[int, Field(ge=2)] = 16
    """True corners that each map must have; smaller ones fit anywhere (facts/alignment.md: 12 gives 86, 16 93 %)."""
    max_vertices: Annotated[int, Field(ge=2)] = 1500
    """Larger maps are refused: seven times what a building of 600 m2 has, and work grows with the square."""

    min_wall_m: Positive = 0.03
    """Shorter walls have no direction; 3 sigma of a corner."""
    corner_sd_m: Positive = 0.02
    """Of a nominal corner, two of which bound an exact length; three times the noise together."""
    occlusion_sd_m: Positive = 0.04
    """Of an occlusion vertex: half the distance of two beams at 3.5 m more."""
    angle_sd_deg: Positive = 2.0
    """Between two walls; more for short ones."""
    discount: Annotated[float, Field(gt=0, le=1)] = 0.8
    """Weight of a difference a generation farther away (paper III-C, facts/alignment.md)."""
    wrong_entry: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Share of entries that differ though the corner is the same: a wrong label, a split wall."""
    wrong_bound: Annotated[float, Field(gt=0, lt=1)] = 0.01
    """The same for a wall that was seen longer than it is, which noise does not do."""

    max_pairs: Annotated[int, Field(ge=1)] = 4000
    """Pairs of corners whose transform is looked at, best first: the iteration budget."""
    max_candidates: Annotated[int, Field(ge=2)] = 80
    """Distinct transforms that are counted out on all corners; 50 hold the right one (facts/alignment.md)."""
    max_scored: Annotated[int, Field(ge=2)] = 20
    """Of these, as many with most inliers are held against all walls; 30 find the same on 1,612 pairs."""
    like_m: Positive = 0.3
    """Two candidates nearer than this at the map's centre are one: what refinement pulls in."""
    like_deg: Positive = 6.0
    """The same for their turn."""

    coarse_m: Positive = 0.25
    """Corners this near are the same in the first round of refinement (facts/alignment.md)."""
    fine_m: Positive = 0.12
    """The same in the second (facts/alignment.md)."""
    alike_deg: Positive = 20.0
    """Walls at matched corners, and walls that agree, differ by less in direction."""

    sample_m: Positive = 0.1
    """Distance of the samples at which walls are compared."""
    agree_m: Positive = 0.08
    """A wall this near to one that faces the same way is the same: two corners' errors of 3 sigma."""
    strip_near_m: Positive = 0.15
    """Free ground before a wall begins here: nearer things may be noise, or the other face of a thin wall."""
    strip_far_m: Positive = 0.5
    """And ends here: measured; farther away a map may not have looked."""
    strip_end_m: Positive = 0.1
    """Nothing is said of ground before the last piece of a wall, where others may begin."""
    conflict_weight: Positive = 20.0
    """Metres of agreement that a metre of conflict outweighs. Measured: of right transforms 90 % have less than
    0.3 m of it, and the best is right in 94, 98, 100, 100 % at weights 2, 5, 10, 20."""

    repetition: bool = True
    """Whether patterns that repeat within one map count as rivals of the best transform."""
    max_patterns: Annotated[int, Field(ge=0)] = 16
    """Of these, as many with most corners; 40 find the same ones, and take twice the time."""
    rival_conflict_weight: Positive = 3.0
    """As conflict_weight, for such rivals: less, as a rival stands for others farther on, which the maps do not
    reach. Measured on 1,612 pairs: 0.5 to 3 all hold the bars, 20 leaves 30 % of `symmetric` wrong."""

    min_inliers: Annotated[int, Field(ge=2)] = 6
    """Corners that must match."""
    min_score_m: float = 4.0
    """Agreement less weighted conflict, metres of wall."""
    max_conflict: Positive = 0.15
    """Conflict over agreement."""
    margin: Annotated[float, Field(ge=0, lt=1)] = 0.45
    """Share by which the best score exceeds that of the second-best distinct transform."""
    distinct_m: Positive = 0.5
    """Transforms farther apart at the map's centre are distinct: twice what counts as a wrong alignment."""
    distinct_deg: Positive = 10.0
    """The same for their turn."""

    range_slack_m: Positive = 0.3
    """A peer may be this much beyond the radio's range: both move while a message is under way."""
    body_slack_m: Positive = 0.03
    """Bodies may overlap walls by this: 3 sigma of a corner."""

    base_radius_m: Positive = 5.0
    """4PCS: four points lie within this of the first, as the paper has it; more seldom lie in the overlap."""
    base_side_m: Positive = 0.5
    """4PCS: and no two nearer than this, as a short side turns far with little noise."""
    bases: Annotated[int, Field(ge=1)] = 150
    """4PCS: sets of four points that are looked for: its iteration budget."""
    congruent_m: Positive = 0.06
    """4PCS: lengths and crossings that differ by less are the same: 3 sigma of two corners."""
    congruent_deg: Positive = 5.0
    """4PCS: the same for the angle of the diagonals."""
    max_congruent: Annotated[int, Field(ge=1)] = 400
    """4PCS: congruent sets looked at for one base."""
    baseline_inliers: Annotated[int, Field(ge=2)] = 12
    """4PCS and ICP: corners that must match; they have no other test."""
    icp_starts: Annotated[int, Field(ge=1)] = 24
    """ICP: evenly spread turns that it begins from; it turns by up to 10 degrees by itself."""
    icp_gate_m: Positive = 1.5
    """ICP: corners farther apart are no pair, as the maps overlap only in part."""
    icp_rounds: Annotated[int, Field(ge=1)] = 40
    """ICP: iterations at most."""
