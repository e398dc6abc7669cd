"""CARMEN logs: what is read, and what is skipped, counted and said."""

import gzip
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deploy.recorded.carmen import read_carmen
from deploy.recorded.lidar_log import Given
from deploy.recorded.reading import read_logs
from deploy.recorded.team import cut
from protocol.errors import InputError
from protocol.geometry import Pose, relative
from protocol.wireframe import MAX_COORDINATE_M


def flaser(
    number: float,
    *,
    readings: list[str] | None = None,
    pose: str = "1 2 0.5",
    time: float | None = None,
    count: int = 0,
) -> str:
    values = readings or ["2.5"] * 180
    end = f"{pose} {pose} {number if time is None else time} host {number}"
    return f"FLASER {count or len(values)} {' '.join(values)} {end}"


def robotlaser(
    number: float,
    step: object = 0.0174,
    limit: object = 81.92,
    first: object = -1.57,
    readings: Sequence[str] = 180 * ("3",),
) -> str:
    head = f"ROBOTLASER1 0 {first} 3.14 {step} {limit} 0.01 0 180"
    return f"{head} {' '.join(readings)} 0 1 2 0 1 2 0 .1 0 .3 .2 9 {number} host {number}"


def log(tmp_path: Path, *lines: str) -> Path:
    file = tmp_path / "some.log"
    file.write_text("# a comment\nPARAM robot_length 0.5\nODOM 0 0 0 0 0 0 0 host 0\n" + "\n".join(lines) + "\n")
    return file


def test_a_flaser_line_is_a_scan_from_right_to_left(tmp_path: Path) -> None:
    read = read_carmen(log(tmp_path, *(flaser(k) for k in range(3))), Given())
    assert [scan.number for scan in read.scans] == [0, 1, 2]
    assert read.scans[0].odometry == pytest.approx((1.0, 2.0, 0.5))
    assert np.allclose(np.degrees(read.lidar.bearings()), np.arange(-90, 90))
    assert not read.skipped and not read.notes


def test_an_odd_number_of_readings_ends_on_both_sides(tmp_path: Path) -> None:
    lidar = read_carmen(log(tmp_path, flaser(0, readings=["1"] * 361)), Given()).lidar
    assert np.allclose(np.degrees(lidar.bearings()), np.linspace(-90, 90, 361))


def test_a_robotlaser_line_tells_its_lidar(tmp_path: Path) -> None:
    head, end = "ROBOTLASER1 0 -2.0 4.0 0.01 30.0 0.01 0 400", "30 2 7 7 1.1 2 0 1 2 0 .1 0 .3 .2 9 12.5 host 12.5"
    read = read_carmen(log(tmp_path, f"{head} {'3 ' * 399}{end}"), Given())
    assert read.lidar.range_max_m == 30 and read.lidar.beams == 400
    assert read.lidar.bearings()[[0, 399]] == pytest.approx((-2.0, 1.99))
    assert read.scans[0].time_s == 12.5 and read.scans[0].odometry == pytest.approx((1.1, 2, 0))
    assert np.isposinf(read.scans[0].ranges[399])


@pytest.mark.parametrize("step", ["0.017453293", "0.017453292519943295"])
def test_the_first_beam_that_comes_again_at_the_end_is_left_out(tmp_path: Path, step: str) -> None:
    """Nine decimals make 360 steps more than a revolution."""
    head, end = f"ROBOTLASER1 0 0.0 6.2832 {step} 30.0 0.01 0 361", "0 7 7 1.1 2 0 1 2 0 .1 0 .3 .2 9 12.5 host 12.5"
    read = read_carmen(log(tmp_path, f"{head} {'3 ' * 361}{end}"), Given())
    assert read.lidar.beams == 360 and len(read.scans[0].ranges) == 360
    assert read.lidar.bearings() == pytest.approx(np.radians(np.arange(360.0)), abs=1e-6)


def test_a_lidar_that_turns_clockwise_is_read(tmp_path: Path) -> None:
    head, end = "ROBOTLASER1 0 1.5 3.0 -0.01 30.0 0.01 0 300", "0 7 7 1.1 2 0 1 2 0 .1 0 .3 .2 9 12.5 host 12.5"
    read = read_carmen(log(tmp_path, f"{head} {'3 ' * 300}{end}"), Given())
    assert read.lidar.bearings()[[0, 299]] == pytest.approx((1.5, 1.5 - 2.99))


def test_readings_that_are_no_ranges_say_nothing_or_nothing_there(tmp_path: Path) -> None:
    values = ["nan", "0", "-1", "inf", "81.83", "80", "3.5", *["2"] * 173]
    ranges = read_carmen(log(tmp_path, flaser(0, readings=values)), Given()).scans[0].ranges
    assert np.isnan(ranges[:3]).all()
    assert np.isposinf(ranges[3:6]).all()
    assert ranges[6] == 3.5


@pytest.mark.parametrize("nothing", ["51.15", "32.767", "3.5"])
@pytest.mark.parametrize("line", [flaser, robotlaser])
def test_what_a_lidar_tells_where_nothing_came_back_is_no_hit(
    tmp_path: Path, nothing: str, line: Callable[..., str]
) -> None:
    """A FLASER line does not say what that is, and a ROBOTLASER1 line may tell a range that no reading has."""
    room = [f"{1 + 0.01 * k:.2f}" for k in range(170)]
    file = log(tmp_path, *(line(k, readings=[*room, *10 * [nothing]]) for k in range(3)))
    read = read_carmen(file, Given())
    ranges = read.scans[2].ranges
    assert np.isposinf(ranges[170:]).all() and np.isfinite(ranges[:170]).all()
    assert 2.6 < read.lidar.range_max_m < float(nothing)
    assert len(read.notes) == 1 and read.notes[0].startswith("30 readings of ")
    assert np.isfinite(read_carmen(file, Given(range_max_m=80.0)).scans[2].ranges).all()  # told by who knows it


@pytest.mark.parametrize("far", ["5", "6.1 6.2 6.3 6.4 6.5 6.6 6.7 6.8 6.9 7.0", "60 55.1 55.2 55.3"])
def test_the_farthest_wall_of_a_log_is_a_hit(tmp_path: Path, far: str) -> None:
    readings = (far.split() * 180)[:180]
    read = read_carmen(log(tmp_path, *(flaser(k, readings=readings) for k in range(3))), Given())
    assert all(np.isfinite(scan.ranges).all() for scan in read.scans) and not read.notes


def test_the_end_of_a_corridor_is_a_hit_and_no_end_of_the_range(tmp_path: Path) -> None:
    """Its readings pile up at the log's largest, too, but spread with noise."""
    bearings, lines = np.radians(np.arange(180) - 90.0), []
    with np.errstate(divide="ignore"):
        walls = np.minimum(20 / np.cos(bearings), 1 / np.abs(np.sin(bearings)))
    for k in range(20):
        noisy = walls + np.random.default_rng(k).normal(0, 0.01, 180)
        lines.append(flaser(k, readings=[f"{metres:.2f}" for metres in noisy]))
    read = read_carmen(log(tmp_path, *lines), Given())
    assert all(np.isfinite(scan.ranges).all() for scan in read.scans) and not read.notes


def test_what_is_not_used_is_counted_before_the_first_scan_and_of_another_kind(tmp_path: Path) -> None:
    lines = [flaser(0)[:300], flaser(0, count=3), *(flaser(k) for k in range(4)), robotlaser(4), robotlaser(5)]
    lines[4] = "\0" * 300_000 + lines[4]  # of which nothing is lost
    read = read_carmen(log(tmp_path, *lines), Given())
    assert [scan.number for scan in read.scans] == [2, 3, 4, 5]
    assert read.skipped == {
        "lines that are cut or hold no numbers": 1,
        "scans of fewer than 8 or more than 4096 beams": 1,
        "ROBOTLASER1 lines, as the first scan is a FLASER line": 2,
    }


@pytest.mark.parametrize(
    ("other", "others"),
    [
        ({"first": 1.57}, range(3)),
        ({"step": 0.0348}, range(3)),
        ({"step": -0.0174}, range(7, 10)),
        ({"first": 1.57}, range(1, 10, 2)),
    ],
    ids=["rear", "wider", "clockwise", "in turns"],
)
def test_a_log_of_two_lidars_is_read_as_of_the_one_that_has_most(
    tmp_path: Path, other: dict[str, object], others: range
) -> None:
    """Scans of as many beams were read at the bearings of the first one."""
    lines = [robotlaser(k, **other) if k in others else robotlaser(k, first=-1.57 + 1e-6 * k) for k in range(10)]
    read = read_carmen(log(tmp_path, *lines), Given())
    assert [scan.number for scan in read.scans] == [k for k in range(10) if k not in others]
    assert math.degrees(read.lidar.bearings()[0]) == pytest.approx(-90, abs=0.1)
    ((reason, count),) = read.skipped.items()
    assert reason.startswith("scans of another lidar than the one read") and count == len(others)


def test_a_log_of_ever_other_lidars_is_read_as_of_one_of_the_first(tmp_path: Path) -> None:
    lines = (robotlaser(k, first=-1.57 + 0.1 * k) for k in range(20))
    read = read_carmen(log(tmp_path, *lines), Given())
    assert len(read.scans) == 1 and sum(read.skipped.values()) == 19


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (robotlaser(0, step=1e300), "over more than 360 degrees"),
        (robotlaser(0, step="inf"), "over more than 360 degrees"),
        (robotlaser(0, step=-0.00001), "field_of_view_deg: at least 1"),
        (robotlaser(0, step=0.0001), "180 beams over 1.03132 degrees are 62832 a revolution"),
        (robotlaser(0, limit=0.01), "range_max_m: at least 0.05"),
        (flaser(0, readings=["1"] * 4097), "fewer than 8 or more than 4096 beams"),
        (flaser(0)[:300], "cut or hold no numbers"),
    ],
)
def test_why_no_scan_can_be_used_is_said(tmp_path: Path, line: str, said: str) -> None:
    with pytest.raises(InputError, match=f"none of its scans can be used: .*{said}"):
        read_carmen(log(tmp_path, line, line), Given())


@pytest.mark.parametrize("limit", ["1000", "inf", "0", "-1", "nan"])
def test_a_range_that_no_lidar_has_is_any(tmp_path: Path, limit: str) -> None:
    """All scans were skipped."""
    read = read_carmen(log(tmp_path, robotlaser(0, limit=limit)), Given())
    assert read.lidar.range_max_m == 100 and not read.skipped


@pytest.mark.parametrize(("begin", "end"), [("\ufeff", "\n"), ("", "\r"), ("", "\r\n")], ids=["BOM", "CR", "CRLF"])
@pytest.mark.parametrize("zipped", [False, True])
def test_text_of_any_editor_is_read_whole(tmp_path: Path, begin: str, end: str, zipped: bool) -> None:
    text = (begin + end.join(flaser(k) for k in range(5))).encode()
    (tmp_path / "some.log").write_bytes(gzip.compress(text) if zipped else text)
    read = read_carmen(tmp_path / "some.log", Given())
    assert [scan.number for scan in read.scans] == [0, 1, 2, 3, 4] and not read.skipped


def test_bad_records_are_counted_and_keep_their_numbers(tmp_path: Path) -> None:
    lines = [flaser(k) for k in range(10)]
    lines[2] = lines[2][:300]  # cut
    lines[3] = flaser(3, readings=["2", "x", *["2"] * 178])
    lines[4] = flaser(4, pose="nan 2 0.5")
    lines[5] = flaser(5, time=0.5)
    lines[6] = flaser(6, readings=["2"] * 90)
    lines[7] = flaser(7, count=10**12)
    lines[8] = flaser(8, pose="3e6 2 0.5")
    read = read_carmen(log(tmp_path, *lines), Given())
    assert [scan.number for scan in read.scans] == [0, 1, 9]
    assert read.skipped == {
        "lines that are cut or hold no numbers": 2,
        "scans of fewer than 8 or more than 4096 beams": 1,
        "scans whose odometry is no number": 1,
        "scans whose odometry is farther than 4900 m from the first": 1,
        "scans whose time jumps back": 1,
        "scans of another lidar than the one read, which has 180 beams over 180 degrees from -90 degrees on": 1,
    }


@pytest.mark.parametrize("time_s", [10.0, -1e9], ids=["in time", "by another clock"])
def test_no_scan_is_out_of_reach_of_the_first_of_its_part(tmp_path: Path, time_s: float) -> None:
    """In the frame of a first scan that is turned, odometry within 10 km of it was beyond, which was a traceback."""
    poses = 10 * ["0 0 0.785"] + 20 * ["9900 9900 0"] + 10 * ["-4000 0 0"] + 10 * ["4000 0 0"]
    lines = [flaser(k, pose=pose, time=k + (time_s if 10 <= k < 30 else 0)) for k, pose in enumerate(poses)]
    read = read_carmen(log(tmp_path, *lines), Given())
    assert len(read.scans) == 30 and sum(read.skipped.values()) == 20
    for part in cut([read], 3):
        told = [relative(part.scans[0].odometry, scan.odometry)[:2] for scan in part.scans]
        assert np.abs(told).max() <= MAX_COORDINATE_M


def test_scans_whose_stamps_jump_are_counted(tmp_path: Path) -> None:
    times = [-1e308, 0.0, 1.7e9, 0.2, float("inf")]
    read = read_carmen(log(tmp_path, *(flaser(k, time=time) for k, time in enumerate(times))), Given())
    assert [scan.time_s for scan in read.scans] == [0.0, 0.2]
    assert read.skipped == {"scans whose time is none": 2, "scans more than 200 days after the first": 1}


@pytest.mark.parametrize("at", [0, 5])
@pytest.mark.parametrize("wild", [{"time": 9e9}, {"pose": "3e6 2 0.5"}], ids=["stamp", "pose"])
def test_one_wild_scan_takes_no_other_along(tmp_path: Path, at: int, wild: dict[str, Any]) -> None:
    lines = [flaser(k) for k in range(10)]
    lines[at] = flaser(at, **wild)
    read = read_carmen(log(tmp_path, *lines), Given())
    assert [scan.number for scan in read.scans] == [k for k in range(10) if k != at]
    assert sum(read.skipped.values()) == 1 and not any("used" in note for note in read.notes)


def test_scans_that_come_late_or_once_more_move_no_other(tmp_path: Path) -> None:
    times = [0, 1, 2, 1.5, 1.7, 3, *range(20, 40), *range(10, 42)]
    read = read_carmen(log(tmp_path, *(flaser(k, time=time) for k, time in enumerate(times))), Given())
    assert [scan.time_s for scan in read.scans] == [0, 1, 2, 3, *range(20, 40), 39, 40, 41]
    assert read.skipped == {"scans whose time jumps back": 31}


@pytest.mark.parametrize("jump_s", [1.5e9, -1.5e9])
def test_a_clock_that_is_set_while_a_log_is_recorded_loses_nothing(tmp_path: Path, jump_s: float) -> None:
    """A robot without a battery for its clock finds the time by NTP, seconds after it has begun."""
    lines = [flaser(0.2 * k, time=2e9 + 0.2 * k + (jump_s if k >= 5 else 0)) for k in range(30)]
    read = read_carmen(log(tmp_path, *lines), Given())
    assert [scan.number for scan in read.scans] == list(range(30)) and not read.skipped
    assert [scan.time_s - 2e9 for scan in read.scans] == pytest.approx([0.2 * k for k in range(30)], abs=1e-3)
    assert read.notes == [f"its clock jumps by {jump_s:.3f} s before scan 5, and counts from there on"]


def test_a_log_of_which_most_is_skipped_says_so(tmp_path: Path) -> None:
    read = read_carmen(log(tmp_path, *(flaser(k, time=-k) for k in range(10))), Given())
    assert read.notes == ["only 1 of 10 scans are used"]


def test_gaps_are_told(tmp_path: Path) -> None:
    times = [0.2 * k for k in range(10)] + [0.2 * k + 0.5 for k in range(10, 20)]
    assert read_carmen(log(tmp_path, *map(flaser, times)), Given()).notes == ["1 gaps of 0.7 to 0.7 s between scans"]


def test_jumps_of_odometry_and_scans_of_nothing_are_told(tmp_path: Path) -> None:
    lines = [flaser(0.2 * k, readings=["81"] * 180, pose=f"{0.1 * k + 40 * (k > 5)} 0 0") for k in range(10)]
    assert read_carmen(log(tmp_path, *lines), Given()).notes == [
        "1 jumps of odometry, of up to 40.1 m and 0 degrees from scan to scan: there the robot is taken to go on "
        "as before",
        "no scan hits anything",
    ]


@pytest.mark.parametrize("revolution_s", [None, 0.2])
def test_a_way_whose_odometry_begins_anew_or_jumps_goes_on(tmp_path: Path, revolution_s: float | None) -> None:
    """The map was torn there."""
    true: list[Pose] = [(20 * math.sin(0.03 * k), 20 - 20 * math.cos(0.03 * k), 0.03 * k) for k in range(40)]
    told = [*true[:20], *(relative(true[20], pose) for pose in true[20:])]
    told[30] = 99.0, 99.0, 1.0  # one wrong pose
    lines = (flaser(0.2 * k, pose=" ".join(map(str, pose))) for k, pose in enumerate(told))
    read = read_carmen(log(tmp_path, *lines), Given(revolution_s=revolution_s))
    assert np.array([scan.odometry for scan in read.scans]) == pytest.approx(np.array(true), abs=1e-9)
    assert [note.split(",")[0] for note in read.notes if "jumps" in note] == ["3 jumps of odometry"]
    if revolution_s:
        assert all(scan.way is not None and np.ptp(scan.way, 0).max() < 1 for scan in read.scans)


@pytest.mark.parametrize("pause_s", [0.2, 5.0, 60.0])
@pytest.mark.parametrize("last", [(20.0, 0.0, 0.0), (0.3, 0.0, 1.9)], ids=["far", "turned"])
def test_a_way_goes_on_whose_base_begins_anew_after_silence_or_where_it_is(
    tmp_path: Path, last: Pose, pause_s: float
) -> None:
    """A minute of silence lets a robot come far, but hardly to where odometry begins."""
    times = [0.2 * k + (pause_s - 0.2) * (k >= 20) for k in range(40)]
    poses = [" ".join(str(k * full / 19) for full in last) for k in range(20)] + 20 * ["0 0 0"]
    read = read_carmen(log(tmp_path, *(flaser(t, pose=pose) for t, pose in zip(times, poses, strict=True))), Given())
    before, after = (read.scans[k].odometry for k in (18, 20))
    assert relative(read.scans[19].odometry, after) == pytest.approx(relative(before, last), abs=1e-6)


def test_a_way_that_goes_on_beyond_all_maps_ends_there(tmp_path: Path) -> None:
    places = [3 * k for k in range(1500)]
    lines = (flaser(k, pose=f"{x} 0 0") for k, x in enumerate(places + places))
    read = read_carmen(log(tmp_path, *lines), Given())
    assert 1630 < len(read.scans) == 3000 - read.skipped["scans whose odometry is farther than 4900 m from the first"]


@pytest.mark.parametrize(("moves", "notes"), [(0.1, ["its odometry never moves, but what it sees does"]), (0.0, [])])
def test_odometry_that_never_moves_is_told_where_scans_do(tmp_path: Path, moves: float, notes: list[str]) -> None:
    readings = [[f"{2 + moves * k + 0.01 * (n % 3) * (k % 2):.2f}" for n in range(180)] for k in range(5)]
    lines = (flaser(0.2 * k, readings=values, pose="0 0 0") for k, values in enumerate(readings))
    assert read_carmen(log(tmp_path, *lines), Given(range_max_m=80.0)).notes == notes


def test_a_gzip_that_was_broken_off_is_read_up_to_there(tmp_path: Path) -> None:
    """As a plain log is."""
    file, rng = tmp_path / "cut.log.gz", np.random.default_rng(0)
    lines = "\n".join(flaser(k, readings=[f"{r:.6f}" for r in rng.random(180)]) for k in range(200))
    file.write_bytes(gzip.compress(lines.encode())[:-5000])
    read = read_carmen(file, Given())
    assert 100 < len(read.scans) < 200 and not read.skipped
    assert read.notes[0].startswith(f"damaged after {len(read.scans)} scans, and what follows is left out: ")
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(InputError, match=r"cut\.log\.gz: it cannot be read"):
        read_carmen(file, Given())


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (Given(scan_topic="/scan"), "--scan-topic: it is for a bag, leave it out"),
        (Given(odometry_topic="/odom"), "--odometry-topic: it is for a bag, leave it out"),
        (Given(mount=(0.0, 0.0, 0.0)), "--mount: it is for a bag, leave it out"),
        (Given(upside_down=True), "--upside-down: it is for a bag, leave it out"),
    ],
)
def test_an_option_that_no_file_takes_is_refused(tmp_path: Path, given: Given, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_logs([log(tmp_path, flaser(0))], given)


def test_an_option_that_the_log_tells_itself_is_said_to_be_left_out(tmp_path: Path) -> None:
    file = log(tmp_path, *(robotlaser(k) for k in range(3)))
    (read,) = read_logs([file], Given(field_of_view_deg=90.0))
    assert read.notes == ["--field-of-view is left out: ROBOTLASER1 lines tell it"]


def test_much_text_without_a_scan_is_not_read_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.recorded.carmen.MAX_HEAD", 1 << 20)
    (tmp_path / "blank.log.gz").write_bytes(gzip.compress(b"\n" * (1 << 21) + flaser(0).encode()))
    with pytest.raises(InputError, match="its first 1 MB hold no scan"):
        read_carmen(tmp_path / "blank.log.gz", Given())


def test_more_readings_than_memory_holds_are_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.recorded.lidar_log.MAX_READINGS", 1_000_000)
    readings = ["2.5"] * 4000
    file = log(tmp_path, *(flaser(k, readings=readings) for k in range(260)))
    with pytest.raises(InputError, match=r"some\.log: more than 1 million readings; split it"):
        read_carmen(file, Given())


@pytest.mark.parametrize("content", [b"", b"hello\n", b"\x1f\x8b", b"\x00" * 500_000, b"FLASER\nFLASER x\n"])
def test_what_is_no_log_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "no.log"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"no\.log: "):
        read_carmen(file, Given())
    with pytest.raises(InputError, match="there is no such file"):
        read_carmen(tmp_path / "missing.log", Given())


def test_the_lidar_is_where_it_is_mounted_and_not_where_somebody_has_corrected_it_to(tmp_path: Path) -> None:
    lines = flaser(0).replace("1 2 0.5 1 2 0.5", "1.2 2 0 1 2 0"), flaser(1).replace("1 2 0.5 1 2 0.5", "7 7 7 1 3 0")
    assert read_carmen(log(tmp_path, *lines), Given()).scans[1].odometry == pytest.approx((1.2, 3, 0))


def test_a_mount_that_is_none_is_told(tmp_path: Path) -> None:
    lines = (flaser(k).replace("1 2 0.5 1 2 0.5", f"{k} 2 0 {k} -0.5 0") for k in range(3))
    read = read_carmen(log(tmp_path, *lines), Given())
    assert read.scans[2].odometry == (2, -0.5, 0)
    assert read.notes == ["its lidar is told to be 2.5 m from the robot: taken as in its middle"]
