"""Settings of the particle filter."""

from typing import Annotated

from pydantic import Field

from protocol.settings import Config, NotNegative, Positive


class SubmapConfig(Config):
    """The way as a chain of submaps. Chosen on the recorded logs intel-drift, csail-drift and intel-raw, five seeds of
    drift each. Doubling or halving the standard deviations of loops changes the path's error by a tenth there."""

    length_m: Positive = 5.0
    """Metres of way in a submap: with 3 m one path of ten came out wrong, with 8 m errors were a tenth larger."""
    distance_sd: Positive = 0.06
    """What odometry is trusted with, metres per square root of a metre: twice the drift of those logs, as its scale is
    learned (`length_scale.py`). With 0.1 paths of intel-drift err by a sixth more, with 0.045 one of csail-drift by
    half as much again."""
    heading_sd_deg: Positive = 2.5
    """Degrees per square root of a metre. With 4 a lidar that sees 6 m follows the bends of a corridor's walls: 25
    degrees in 80 m of intel-drift."""
    turn_sd: Positive = 0.05
    """Radians per square root of a radian that the robot turns."""
    still_sd_m: Positive = 0.01
    """Metres that a scan may correct though the robot stood, as the last scan was not exact."""
    still_sd_deg: Positive = 0.3
    """The same in degrees."""
    way_share: Positive = 0.2
    """Share of the scans' covariances, summed along the way, by which a submap's end is unsure in its frame: scans of
    one place err alike, and walls hold each against several before. In halls, where walls hold all scans, loops then
    bend nothing; at doorways, where few do, they may. With 0.5 one way of twelve in made-up halls was bent."""
    way_sd_m: Positive = 0.03
    """Metres by which it is unsure beside. (With 0.06 m and 1 degree, and no share, one false loop bent a hall by
    metres.)"""
    way_sd_deg: Positive = 0.2
    """The same in degrees."""
    loop_sd_m: Positive = 0.05
    """Metres that a loop's pose may err beside its match: walls that are seen from elsewhere differ in clutter."""
    loop_sd_deg: Positive = 0.5
    """The same in degrees."""
    view_m: Positive = 12.0
    """Metres up to which a scan shows most walls: beams half a degree apart are 0.1 m apart there."""
    compared: Annotated[int, Field(ge=1, le=100)] = 4
    """Earlier submaps, the nearest, that a finished one is held against."""
    search_m: NotNegative = 6.0
    """Metres of error of the way up to which a loop is looked for."""
    search_deg: NotNegative = 30.0
    """The same in degrees."""


class FilterConfig(Config):
    """The set of particles."""

    particles: Annotated[int, Field(ge=1, le=1000)] = 1
    """Wireframes kept. One is best, as the sweep over 1, 5, 10, 30 and 100 shows (`wireswarm bench filter`): recall and
    precision under noise of ranges and odometry are the same to 0.001, and among parallel walls that are easily mixed
    up the map is no better along the run (F1 of walls 0.952 with one, 0.951 with more, of corners 0.69 and 0.68). Every
    wall carries its own evidence, and the next scans take a wrong decision back, while the update grows from 0.08 to
    5.3 ms (with ideal sensing), the bytes a hundredfold. More pay only where a fault strikes some of the particles."""
    correct_pose: bool = True
    """Correct the odometry by the shift between scan and map, where the odometry is not exact."""
    submaps: SubmapConfig = SubmapConfig()
    """Where odometry errs, the way is a chain of submaps whose loops are closed."""
