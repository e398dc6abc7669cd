"""Settings of exploration and driving. All ours; the paper gives none."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from protocol.settings import Chance, Config, Positive

DefaultState = Literal["ours", "least-likely", "random-vertex", "interior-sweep", "perimeter"]
"""What a robot does when no frontier is left: the four of the paper (IV-B), and ours: sweep, then least likely."""
HORIZON_COMMANDS = 2  # commands for which a motion must be free: this one, and the next if the answer to a scan is late


class ExplorationConfig(Config):
    """Where a robot goes, and when it gives a goal up."""

    default_state: DefaultState = "ours"
    """What a robot does when no frontier is left. `ours` is interior-sweep followed by least-likely."""
    pockets: bool = True
    """Whether a robot sweeps what it saw from too far while there are still frontiers, where the detour is short.

    In maze-15 it is complete after 388 s instead of 594, and has seen 99 % as soon (medians of five starts)."""
    pocket_detour_m: Positive = 8.0
    """Longest detour for such a pocket, metres of path. In 32 runs in eight layouts, with 4 and 8 m: 99 % after 10,037
    and 10,061 s in all, complete after 11,950 and 11,476 s. A team that made detours of 2 m only left pockets behind,
    to which all drove at the end: 44 runs of three and six robots in three layouts are complete after 257 s instead of
    266 s (means)."""
    smallest_object_m: Annotated[float, Field(ge=0.02, le=10)] = 0.1
    """Width in metres of the smallest object that the interior sweep must find: a post."""
    least_likelihood: Chance = 0.5
    """Walls that are less likely than this (0 to 1) are looked at again by the least-likely state."""
    haste: Annotated[float, Field(ge=0, lt=1)] = 0.25
    """How much an order of goals is judged by the mean way to the open ends (1) rather than by its length (0).

    With 0 and 0.25, five starts in each of seven worlds: 269 and 248 m until 99 % in gbeltramo_building and no clear
    difference elsewhere; with 0.5 all take 4 % longer until complete."""
    attempts: Annotated[int, Field(ge=1, le=1000)] = 2
    """Attempts at a goal before it counts as unreachable. Later ones are made when nothing else is left and the map
    has changed."""
    patience_s: Positive = 15.0
    """A goal is given up after twice the time that its path takes at full speed, and so many seconds more; a robot that
    takes long to turn about has that time at each bend, too."""


Air = Annotated[float, Field(ge=1e-3, le=1)]
"""Metres between bodies; with more than 1 m no door of a building is passed."""


class DrivingConfig(Config):
    """How much air the body keeps."""

    path_air_m: Air = 0.075
    """Air in metres between the body and the walls beside a path, where there is room; doorways of 0.5 m are passed
    with 7 cm to spare."""
    tight_path_air_m: Air = 0.025
    """The same where there is less room: five times the error of a wall in the map."""
    wall_air_m: Air = 0.015
    """Air in metres left to walls by every command: 1.5 standard deviations of a range, three of a fitted wall."""
    teammate_air_m: Air = 0.06
    """Air in metres left to a teammate by every command: it may come 0.044 m nearer in the same tick."""

    @model_validator(mode="after")
    def _ways_can_be_driven(self) -> Self:
        for name in ("tight_path_air_m", "path_air_m"):
            if (air := getattr(self, name)) < self.wall_air_m:
                raise ValueError(
                    f"wall_air_m {self.wall_air_m:g} is more than {name}, {air:g}: no command may drive such paths; "
                    f"lower it, or raise {name}"
                )
        return self
