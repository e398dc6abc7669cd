"""What a robot cannot do with its body and lidar, said before it drives (ours)."""

import math

import numpy as np

from agent.exploration.config import HORIZON_COMMANDS
from agent.exploration.driving import horizon_m, sees_m
from protocol.geometry import wrapped
from protocol.messages import RobotSpec

INCOMPLETE = "a complete map is not to be expected"  # with each of `doubts`
LEAST_VIEW_DEG = 180.0  # with less, a robot does not see the place beside it that it turns into
AHEAD_DEG = 1.0
"""Degrees from straight ahead that a lidar may leave out there. One that looked at 180 degrees from 30 on touched walls
in 5 of 6 runs in `apartment` and `office`, and its maps were torn; from -15 on in 1, from -30 on in none."""
LEAST_BEAMS = 180  # of a whole revolution: a post of 0.1 m gets three beams from 1 m away, a wall of 0.25 m from 2.4 m
MOST_LOST = 0.9  # of the beams: alone in `apartment`, a robot touched nothing with 0.9, and walls with 0.97
MOST_BLIND_M = 0.3
"""Metres around the body in which a lidar may measure nothing. Alone in `apartment` for 150 s (two starts), a robot
mapped 0.88 and 0.93 of the wall with range_min_m 0.12, 0.88 and 0.93 with 0.4, 0.85 and 0.88 with 0.45, 0.86 and 0.79
with 0.5, and 0.70 and 0.50 with 0.8, where it touched walls, too."""
LEAST_SIGHT_M = 0.3
"""Metres around the body that the lidar must see: places to look from are so far apart. With a radius of 0.35 m and a
range of 0.6 m, and with 0.4 and 0.62, there was none for the end of a wall in the open."""
MOST_NOISE = 0.03
"""Standard deviation of a range, as a share of it. In the same runs 0.88 and 0.93 of the wall with 0.0175, 0.87 and
0.85 with 0.03, 0.72 and 0.56 with 0.04, 0.34 and 0.28 with 0.1."""
MOST_NOISE_M = 0.07
"""The same in metres, of near ranges. In such runs 0.97 and 0.92 of the wall with 0.01, 0.89 and 0.85 with 0.07, 0.64
and 0.58 with 0.1, where 0.94 and 0.92 of the map was wall, 0.14 and 0.16 with 0.2."""
MOST_TURN_DEG = 90.0  # of the robot in a scan: a quarter of the room is then seen twice, or not at all


def doubts(spec: RobotSpec) -> list[str]:
    """Why a complete map is not to be expected of a robot, a sentence each; none where it is.

    What they advise to set has an effect also on a ROS 2 robot, whose scans tell its beams and ranges.
    """
    lidar, found = spec.lidar, list[str]()
    if lidar.range_min_m >= lidar.range_max_m:
        found.append(f"the lidar measures nothing: range_min_m {lidar.range_min_m:g} is not below range_max_m")
    elif lidar.range_min_m > spec.radius_m + MOST_BLIND_M:
        blind = f"the lidar measures nothing nearer than {lidar.range_min_m:g} m"
        found.append(f"{blind}: more than {MOST_BLIND_M:g} m around the body a robot does not see where it drives")
    if (mount_m := math.hypot(lidar.mount_x_m, lidar.mount_y_m)) > spec.radius_m:
        beside = f"the lidar stands {mount_m:.2f} m from the middle of a body whose radius is {spec.radius_m:g} m"
        found.append(f"{beside}: it may be in a wall; correct spec.radius_m, or spec.lidar.mount_x_m and mount_y_m")
    if lidar.noise_share > MOST_NOISE:
        errs = f"the lidar errs by {100 * lidar.noise_share:.4g} % of a range"
        found.append(f"{errs}: with more than {100 * MOST_NOISE:g} % walls are missed")
    if lidar.noise_m > MOST_NOISE_M:
        found.append(f"the lidar errs by {lidar.noise_m:g} m: with more than {MOST_NOISE_M:g} m walls are missed")
    reach_m = sees_m(lidar)
    need_m = spec.radius_m + horizon_m(spec)
    if reach_m < need_m:
        found.append(
            f"the lidar sees {reach_m:.2f} m around the robot, which reaches {need_m:.2f} m within "
            f"{HORIZON_COMMANDS} scans: it drives into walls; lower spec.max_speed_mps or have the lidar see farther"
        )
    elif reach_m < spec.radius_m + LEAST_SIGHT_M:
        near = f"the lidar sees {reach_m:.2f} m around the robot, and the body is {spec.radius_m:g} m of it"
        found.append(f"{near}: with less than {LEAST_SIGHT_M:g} m more there may be no place to see a wall's end from")
    if lidar.dropout > MOST_LOST:
        lost = f"the lidar loses {100 * lidar.dropout:.4g} % of its beams"
        found.append(f"{lost}: with more than {100 * MOST_LOST:g} % a robot drives into walls")
    if lidar.field_of_view_deg < LEAST_VIEW_DEG:
        view = f"the lidar looks at {lidar.field_of_view_deg:g} degrees"
        found.append(f"{view}: with less than {LEAST_VIEW_DEG:g} a robot does not see what it turns into")
    off_deg = math.degrees(float(np.abs(wrapped(lidar.bearings())).min()))
    if off_deg > AHEAD_DEG + math.degrees(lidar.beam_step):
        ahead = f"the lidar looks no nearer than {off_deg:.0f} degrees to straight ahead, where the robot drives"
        found.append(f"{ahead}: turn it, and say so by spec.lidar.mount_yaw_deg")
    beams = round(lidar.beams * 360 / lidar.field_of_view_deg)
    if beams < LEAST_BEAMS:
        near_m = 0.1 / (3 * 2 * math.pi / beams)
        found.append(
            f"the lidar has {beams} beams a revolution: what is 0.1 m wide is seen from {near_m:.1f} m at most"
        )
    turn_deg = math.degrees(spec.max_turn_rps / lidar.rate_hz)
    if lidar.turning and turn_deg > MOST_TURN_DEG:
        found.append(f"the robot turns by {turn_deg:.0f} degrees during one scan: lower spec.max_turn_rps")
    return found
