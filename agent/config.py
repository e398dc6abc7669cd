"""All thresholds of a robot's mind, with units and reasons."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from agent.alignment.config import AlignmentConfig
from agent.base_config import Config, Positive
from agent.cooperation_config import CooperationConfig
from agent.exploration_config import DrivingConfig, ExplorationConfig, PlanningConfig


class PerceptionConfig(Config):
    """Scan to corners; chi-squares are in units of the lidar's noise."""

    method: Literal["piecewise", "split-and-merge"] = "piecewise"
    """Optimal piecewise fit (ours), or the paper's split and merge (its ref. 17)."""
    line_cost: Positive = 18.0
    """Chi-square that a wall piece must save: 0.999 of a line's 2 parameters plus its place (facts/mapping.md)."""
    stray_cost: Positive = 10.0
    """Chi-square of a beam that belongs to no wall: a hit at 3.2 sigma (facts/mapping.md)."""
    min_hits: Annotated[int, Field(ge=3)] = 3
    """Two beams fit any line; the third tells."""
    max_gap_m: Positive = 0.25
    """Wall is not claimed between two hits farther apart (facts/mapping.md)."""
    noise_floor_m: Positive = 0.003
    """Walls are not flatter than this; below it, chi-squares would see plaster."""
    min_corner_deg: Positive = 20.0
    """Lines that meet flatter than this have no usable intersection."""
    corner_slack_m: Positive = 0.1
    """A corner may lie this far outside its hits at most: three hits' direction excuses any place on the other line."""
    range_margin_sigmas: Positive = 3.5
    """How far a hit must be from its prediction to count as nearer or farther: 0.9995 of the noise."""
    disc_fit: Positive = 4.0
    """Mean chi-square a beam may have on a teammate's disc; leaves room for its motion within a turn."""
    disc_margin_m: Positive = 0.05
    """A beam this near to where a teammate was a moment ago is on it: 5 sigma of range."""
    disc_memory_scans: Annotated[int, Field(ge=1, le=100)] = 4
    """Scans for which a disc is remembered: one of ten is missed, so four in a row almost never are."""
    disc_in_wall_m: Positive = 0.08
    """A disc with its centre this near to a known wall is that wall's end: a teammate's is its radius away."""
    known_wall_m: Positive = 0.3
    """Walls shorter than this are no reason: one may be a teammate's own front."""
    post_still_s: Positive = 3.0
    """A disc that has not moved for so long while nobody is heard is a post; explorers stand for 0.8 s at a time."""
    post_near_m: Positive = 0.06
    """... nor by more than this: the spread of a disc's place from side to side; a teammate drives it in 0.3 s."""
    post_silence_s: Positive = 21.0
    """Nobody is heard where four beacons in a row did not come: one time in 120 at 30 % loss."""
    teammate_radius_m: Positive = 0.105
    """Radius of teammates, all of one kind."""


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


class TalkConfig(Config):
    """What a robot says, and when it counts a peer as met or lost."""

    beacon_s: Positive = 5.0
    """Between two beacons: two robots that pass at full speed are within 4 m of each other for 18 s."""
    sight_beacon_s: Positive = 1.0
    """The same while a disc is seen and a peer heard whose frame is not known: its places and the discs give it
    (agent.sightings), and two robots that pass are in sight of each other for some seconds only."""
    map_period_s: Positive = 5.0
    """A peer is told of a changed map at most this often: walls of some seconds cost little more than one."""
    silence_s: Positive = 5.0
    """A peer unheard for longer is lost; the next message from it is a new contact (contracts)."""
    retry_s: Positive = 3.0
    """Before what was not acknowledged is sent again, doubling: more than there and back at 1 s of latency."""
    reassembly_s: Positive = 30.0
    """Parts of a map wait this long for the next one: three retries."""
    mtu_bytes: Annotated[int, Field(ge=64, le=65_536)] = 1200
    """The longest message: what the radio takes (world.radio_config); 64 of them must hold the map."""
    cell_mm: Annotated[int, Field(ge=1, le=1000)] = 10
    """Of the grid that maps travel on: the noise of a range, a fifth of the scorer's 5 cm."""
    slack_cells: Annotated[float, Field(ge=0, le=10)] = 1.5
    """A corner that moved less is not news: most corners of a map still shift by some millimetres a minute."""
    level_slack: Annotated[int, Field(ge=0, le=7)] = 2
    """As slack_cells, for an edge's likelihood, in sevenths."""
    likelihoods: bool = True
    """Whether edge likelihoods travel: 0.14 bytes a vertex."""
    axis_slack_deg: Positive = 1.0
    """The grid is turned anew where the map's axis is off by more: 2 cells on a wall of 1.2 m, 3 bits each."""


class AgentConfig(Config):
    """One robot's mind."""

    perception: PerceptionConfig = PerceptionConfig()
    map: MapConfig = MapConfig()
    filter: FilterConfig = FilterConfig()
    exploration: ExplorationConfig = ExplorationConfig()
    planning: PlanningConfig = PlanningConfig()
    driving: DrivingConfig = DrivingConfig()
    radio: TalkConfig = TalkConfig()
    alignment: AlignmentConfig = AlignmentConfig()
    cooperation: CooperationConfig = CooperationConfig()
