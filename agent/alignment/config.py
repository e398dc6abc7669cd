"""Settings of the alignment. `measured` means by `wireswarm bench alignment`."""

from typing import Annotated, Literal

from pydantic import Field

from protocol.settings import Config, NotNegative, Positive


class AlignmentConfig(Config):
    """When two maps are compared, and how sure the result must be (paper III-C; thresholds ours)."""

    drawing: Literal["ranked", "random"] = "ranked"
    """Pairs of like corners are tried best first, or drawn by their likelihood as RANSAC draws."""
    repetition: bool = True
    """Whether a pattern that repeats within one map makes an alignment ambiguous."""
    min_corners: Annotated[int, Field(ge=2, le=20_000)] = 16
    """True corners that each map must have, as smaller maps fit anywhere. Measured: 86 % right at 12, 93 % at 16."""
    max_walls: Annotated[int, Field(ge=2, le=20_000)] = 1500
    """Walls of its own that a map may have. Larger ones are refused, as work grows with the square; a building of
    600 m2 has 200."""
    min_inliers: Annotated[int, Field(ge=2, le=20_000)] = 6
    """Corners of both maps that must match; four, where three times `min_score_m` of wall agree."""
    min_score_m: NotNegative = 4.0
    """Metres of wall that must agree; where maps alone are aligned, less the weighted metres in conflict."""
    conflict_weight: Positive = 20.0
    """Metres of agreement that a metre of conflict outweighs. Measured: 90 % of right transforms have less than 0.3 m
    of conflict, and the best one is right in 94, 98, 100, 100 % at weights 2, 5, 10, 20."""
    max_conflict: Positive = 0.15
    """Metres in conflict per metre of wall that agrees, at most."""
    max_beside: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Share of the wall that both maps have that may lie centimetres beside itself. Right transforms have at most 0.05;
    half turns of a hall that looks nearly the same after one have 0.15 and more in most cases."""
    margin: Annotated[float, Field(ge=0, lt=1)] = 0.45
    """Share of the best score by which it must exceed that of the second-best distinct transform."""
