"""Thresholds of exploration: goals, paths and driving. All ours; the paper gives none."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from protocol.settings import Config

Positive = Annotated[float, Field(gt=0)]

DefaultState = Literal["ours", "least-likely", "random-vertex", "interior-sweep", "perimeter"]
"""What a robot does when no frontier is left: the four of the paper (IV-B), and ours: sweep, then least likely."""


class ExplorationConfig(Config):
    """Which goals a robot pursues, and when it gives one up."""

    default_state: DefaultState = "ours"
    look_ticks: Annotated[int, Field(ge=1)] = 4
    """Scans taken at a standing point before the goal counts as unresolved: the map needs three to change its mind."""
    arrive_m: Positive = 0.08
    """Closer than this is there; half the distance driven in two ticks at full speed, so that none overshoots."""
    same_place_m: Positive = 0.2
    """Goals closer than this are the same one (facts/mapping.md, rule 10)."""
    same_direction_rad: Positive = 0.8
    """... if their walls go on in like directions: 45 degrees, as opposite faces and corners differ by 90."""
    other_stand_m: Positive = 0.25
    """A standing point nearer than this to one that did not help will not either."""
    standing_points: Annotated[int, Field(ge=1)] = 3
    """Standing points tried in one attempt at a goal."""
    attempts: Annotated[int, Field(ge=1)] = 2
    """Attempts at a goal, the later ones when nothing else is left and the map has changed; then it is unreachable."""
    patience_s: Positive = 15.0
    """A goal is given up when it takes this long beyond twice the time its path needs."""
    remembered: Annotated[int, Field(ge=10)] = 400
    """Most goals kept in memory; a building of 600 m2 brings about 100."""
    switch_gain_m: Positive = 1.5
    """A tour that begins with another goal must be better than one with the present one by this much, or a robot
    between two turns for ever."""
    reconsider_ticks: Annotated[int, Field(ge=1)] = 10
    """Goals are compared anew every 2 s if the map changed: in this time a robot drives 0.4 m, less than a doorway."""
    refresh_ticks: Annotated[int, Field(ge=1)] = 3
    """Open ends are read from the map this often besides at changes of structure, as they move with each scan."""
    stare_cost: Positive = 0.5
    """Metres of path that a metre of distance between standing point and goal is worth: nearer sees better."""
    grazing_rad: Positive = 0.35
    """Flattest view of a hidden wall that is expected to show it: 20 degrees; 8 are seen in principle."""
    close_grazing_rad: Positive = 0.05
    """The same at the mouth of a slot that nothing else shows, 3 degrees: 0.04 m aside and 0.25 m off a cabinet's
    corner, as the tight clearance allows beside a wall 0.17 m away, five beams meet the first 0.3 m of its side. With
    such views recall in hurtado_apartment is 0.972-0.978 instead of 0.958-0.966, for a fifth more time (five starts).
    """
    pose_spacing_m: Positive = 0.5
    """Distance between kept poses: half of what would leave gaps in a swept corridor 1.9 m to either side."""
    kept_poses: Annotated[int, Field(ge=10)] = 3000
    """Most kept poses (24 bytes each); 1.5 km of path."""
    smallest_object_m: Positive = 0.1
    """Width of the smallest object that the sweep must find (a post)."""
    object_beams: Annotated[float, Field(ge=1)] = 2.4
    """Beams that an object gets on average where it counts as seen: 0.1 m at 2.4 m. Three make a wall, which two of
    five scans then have, and between two kept poses there are eleven; every scan has three at 1.9 m (facts/mapping.md,
    rule 12), for which maze-15 takes 589 s instead of 556 (medians of five starts)."""
    sweep_lattice_m: Positive = 0.6
    """Distance between standing points considered by the sweep; a third of its radius."""
    sweep_least_samples: Annotated[int, Field(ge=1)] = 3
    """Unseen samples, one per square of the smallest object's width, that a standing point must show: less is a sliver
    that hides no such object but for its edge."""
    pockets: bool = True
    """Sweep, while there are frontiers, what was seen from too far, where the detour is short: in maze-15 this takes
    a third off the time until complete, and adds an eighth to the path until 99 % (medians of five starts)."""
    pocket_reach_m: Positive = 5.0
    """Distance to either side within which such pockets are looked for; two rooms."""
    pocket_detour_m: Positive = 4.0
    """Longest detour for a pocket, metres of path. In maze-15, five starts: 104 m until 99 % and 609 s until complete;
    with 8 m 109 m and 637 s."""
    team_detour_m: Annotated[float, Field(ge=0)] = 2.0
    """The same beside teammates, who share the frontiers. With 0, 2 and 8 m the team has 99 % after 359, 287 and 324 s
    and is complete after 505, 566 and 581 s (means of three seeds in maze-15, within their spread)."""
    tour: Annotated[int, Field(ge=2)] = 40
    """Nearest tasks that are put in the best order. All that there are: 8 in the median and 15 at most in maze-15, 21
    and 34 in gbeltramo_building. With 12 of 20 and no haste a robot may turn for ever, as those behind it drop out of
    the twelve on its way to those ahead."""
    haste: Annotated[float, Field(ge=0, lt=1)] = 0.25
    """How much an order is judged by the mean way to the open ends rather than by its length. With 0 and 0.25, five
    starts in each of seven worlds: 269 and 248 m until 99 % in gbeltramo_building and as good as no difference
    elsewhere; with 0.5 all take 4 % longer until complete."""
    least_likelihood: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Edges below this are looked at again."""
    vertex_visits: Annotated[int, Field(ge=1)] = 10
    """Random vertices visited in a row without a new goal: the policy's end."""
    park_clearance_m: Positive = 0.45
    """Distance from walls of a parked robot: another (0.21 m wide) passes on either side, and no doorway is blocked."""
    park_room_m: Positive = 1.0
    """More room than this is no better for parking: half the width of a corridor of the mazes."""
    park_gain: Positive = 4.0
    """Metres of way that a metre of room is worth: out of a doorway of 1 m into the room behind it."""
    persist_ticks: Annotated[int, Field(ge=1)] = 4
    """A goal must last this long to wake a complete robot: single scans flicker."""
    stuck_s: Positive = 4.0
    """Without progress on the path for this long a robot is stuck; a right-angle turn takes 0.6 s."""
    stuck_progress_m: Positive = 0.06
    """Less than this is no progress: one tick and a half of driving."""
    teammate_room_m: Positive = 0.15
    """Radius of a standing teammate in paths: with the tight clearance just more than driving allows (0.27 m)."""
    push_ticks: Annotated[int, Field(ge=1)] = 5
    """Commands in a row that moved nothing before a stuck robot takes it for an unseen wall: a second of pushing."""
    barriers: Annotated[int, Field(ge=1)] = 50
    """Most unseen walls kept in memory (32 bytes each): 12 m of glass."""
    back_off_m: Positive = 0.2
    """How far a stuck robot moves away from what it is close to."""
    back_off_s: Positive = 3.0
    """... or how long at most."""
    wait_s: Positive = 4.0
    """Mean wait for a teammate to clear the way; drawn between half and one and a half of it, so that of two
    robots one gives way first."""
    waits: Annotated[int, Field(ge=0)] = 6
    """Times that a robot waits for a teammate that bars a goal, or all of them, before it counts as unreachable."""
    blocked_m: Positive = 0.6
    """A teammate within this, and the robot held back, is in the way; discs keep 0.27 m from each other."""
    avoid_s: Positive = 10.0
    """A teammate that did not clear the way is planned around for so long: it passes 2 m in the time."""
    retreat_m: Positive = 1.2
    """A robot that makes room goes at least this far from the teammate: it can turn off in between."""
    still_s: Positive = 2.0
    """A teammate that has not moved for so long is planned around like a wall."""
    teammate_memory_s: Positive = 3.0
    """How long a teammate seen is planned around after it was seen last."""


class PlanningConfig(Config):
    """Paths around known walls."""

    clearance_m: Positive = 0.18
    """Distance of paths from walls where there is room: 7.5 cm of air; passes doorways of 0.5 m with 7 cm to spare."""
    tight_clearance_m: Positive = 0.13
    """Distance where there is not: 2.5 cm of air, five times the error of a wall in the map."""
    node_offset_m: Positive = 0.01
    """Corners are passed this much wider than the clearance, so that walls may move a little with the next scans."""
    give_m: Positive = 0.03
    """A path stays good while walls come this much nearer than its clearance; it may be cut by as much."""
    frontier_reach_m: Positive = 0.5
    """A wall probably goes on at least this far beyond its frontier end."""
    frontier_cost_m: Positive = 3.0
    """What crossing that stretch costs, in metres of path."""


class DrivingConfig(Config):
    """Following a path at the speed of the robot without touching anything."""

    tick_s: Positive = 0.2
    """Duration of a command: one period of the lidar."""
    lookahead_m: Positive = 0.6
    """Distance of the point steered for; less wiggles, more leaves the path."""
    turn_in_place_rad: Positive = 0.5
    """Heading error beyond which the robot turns on the spot."""
    turn_gain: Annotated[float, Field(gt=0, le=1)] = 0.6
    """Share of the heading error corrected in a tick; 1 would overshoot at the slightest delay."""
    wall_margin_m: Positive = 0.015
    """Air left to walls in every predicted motion: 1.5 sigma of a range, and three of a fitted wall."""
    slow_margin_m: Positive = 0.05
    """Air below which the robot drives slowly."""
    slow_share: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Share of full speed when slow."""
    teammate_margin_m: Positive = 0.06
    """Air left to a teammate: it may come 0.044 m nearer in the same tick."""
    horizon_ticks: Annotated[int, Field(ge=1)] = 2
    """Ticks ahead that must be free: this one, and the next in case the answer comes late."""
    meet_m: Positive = 1.2
    """A teammate in the way nearer than this is passed on the right: time for both to move over (2.7 s)."""
    pass_margin_m: Positive = 0.03
    """Air when passing, beyond what a held robot keeps."""
    clear_side_m: Positive = 0.15
    """A teammate this far to the right of the way is passed on the left: it sees the robot on its right, too."""
