"""Bags of ROS: what is read from each kind, and what is skipped, counted and said."""

import bz2
import math
import os
import sqlite3
import sys
from collections.abc import Callable
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer as Mcap
from rosbags.rosbag1 import Writer

from deploy import cli
from deploy.recorded import frames
from deploy.recorded.bag_bounds import zstd
from deploy.recorded.bags import ODOMETRY, SCAN
from deploy.recorded.frames import Frames
from deploy.recorded.lidar_log import Given, LidarLog
from deploy.recorded.reading import read_logs
from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.geometry import Pose, compose, relative
from tests.deploy.recorded.bag_files import KINDS, Said, Speaker, write_bag, yawed

NOTHING = Given()
ROS2 = Speaker("mcap")
FIVES = np.full(180, 5.0)


def pose_at(t: float) -> Pose:
    """A drive along a bend."""
    return 0.5 * (t - 100), 0.1 * (t - 100), 0.3 * (t - 100)


def drive(speaker: Speaker, count: int = 10, odometry: bool = True) -> list[Said]:
    """Scans at 5 Hz and odometry at 20 Hz of that drive, from second 100 on."""
    said = [speaker.scan(100 + 0.2 * k, FIVES + 0.01 * k) for k in range(count)]
    if odometry:
        said += [speaker.odometry(99.9 + 0.05 * k, pose_at(99.9 + 0.05 * k)) for k in range(4 * count + 4)]
    return sorted(said, key=lambda one: one.t)


def read(path: Path, given: Given = NOTHING) -> LidarLog:
    (log,) = read_logs([path], given)
    return log


@pytest.mark.parametrize("kind", KINDS)
def test_scans_and_odometry_are_read_from_every_kind(tmp_path: Path, kind: str) -> None:
    log = read(write_bag(tmp_path, kind, drive(Speaker(kind))))
    assert [scan.number for scan in log.scans] == list(range(10)) and not log.skipped
    assert log.notes == ["nothing tells where laser is on base_link: taken as the same (--mount tells it)"]
    for k, scan in enumerate(log.scans):
        assert scan.time_s == pytest.approx(100 + 0.2 * k)
        assert scan.odometry == pytest.approx(pose_at(100 + 0.2 * k), abs=1e-6)
        assert scan.ranges == pytest.approx(5.0 + 0.01 * k)
    assert log.lidar.bearings() == pytest.approx(math.pi * (np.arange(180) / 180 - 0.5), abs=1e-6)
    assert (log.lidar.range_min_m, log.lidar.range_max_m) == pytest.approx((0.1, 10.0))
    assert not log.lidar.turning and not log.lidar.clockwise


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["drive", "DRIVE.MCAP", "x.bag.active", "lone/drive.data"])
def test_a_bag_is_known_by_what_it_begins_with(tmp_path: Path, kind: str, name: str) -> None:
    path = write_bag(tmp_path, kind, drive(Speaker(kind)), "bag")
    file = path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")
    (tmp_path / "lone").mkdir()
    renamed = file.rename(tmp_path / name)
    assert len(read(renamed.parent if "/" in name else renamed).scans) == 10


def test_files_of_a_bag_without_its_metadata_are_a_sentence(tmp_path: Path) -> None:
    folder = write_bag(tmp_path, "mcap", drive(ROS2))
    (folder / "metadata.yaml").rename(tmp_path / "elsewhere")
    (folder / "more.mcap").write_bytes((folder / "drive.mcap").read_bytes())
    with pytest.raises(
        InputError, match=r"its 2 files are of a bag without metadata\.yaml; `ros2 bag reindex` makes it"
    ):
        read(folder)


@pytest.mark.parametrize(("kind", "mender"), [("rosbag1", "rosbag reindex"), ("mcap", "mcap recover")])
def test_of_a_recording_that_was_broken_off_the_sentence_tells_what_mends_it(
    tmp_path: Path, kind: str, mender: str
) -> None:
    path = write_bag(tmp_path, kind, drive(Speaker(kind)))
    file = path if path.is_file() else path / "drive.mcap"
    file.write_bytes(file.read_bytes()[:-3000])
    with pytest.raises(InputError, match=f"; if its recording was broken off, `{mender}` mends it$") as error:
        read(file)
    assert "(" not in str(error.value)


def test_an_mcap_file_of_another_program_is_not_called_broken(tmp_path: Path) -> None:
    """It was told to be mended, which it needs not."""
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = Mcap(stream)
        writer.start(profile="", library="another")
        writer.finish()
    with pytest.raises(InputError, match=r"run\.mcap: an MCAP file that does not say that it is of ROS 2 \("):
        read(tmp_path / "run.mcap")


def test_options_that_do_not_apply_are_not_left_out_in_silence(tmp_path: Path) -> None:
    bag = write_bag(tmp_path, "mcap", drive(ROS2))
    with pytest.raises(InputError, match="--field-of-view: it is for CARMEN text, leave it out"):
        read(bag, Given(field_of_view_deg=90.0))


@pytest.mark.parametrize("name", ["*.mcap", "*.db3"])
def test_the_file_in_a_folder_is_read_alone(tmp_path: Path, name: str) -> None:
    folder = write_bag(tmp_path, "mcap" if name == "*.mcap" else "sqlite3", drive(ROS2))
    assert len(read(next(folder.glob(name))).scans) == 10


@pytest.mark.parametrize("kind", ["rosbag1", "mcap"])
def test_tf_tells_the_odometry_and_where_the_lidar_is(tmp_path: Path, kind: str) -> None:
    """A map frame above that of odometry is somebody else's SLAM, and is not asked."""
    speaker = Speaker(kind)
    said = drive(speaker, odometry=False)
    for k in range(44):
        t = 99.9 + 0.05 * k
        x, y, theta = pose_at(t)
        said.append(speaker.transform(t, "odom", "/base_link", (x, y, 0.0), yawed(theta)))
        said.append(speaker.transform(t, "map", "odom", (7.0, k, 0.0), yawed(0.1 * k)))
    said.append(speaker.transform(99.0, "base_link", "laser", (0.2, 0.0, 0.5), yawed(math.pi), "/tf_static"))
    log = read(write_bag(tmp_path, kind, sorted(said, key=lambda one: one.t)))
    assert len(log.scans) == 10 and not log.notes
    for scan in log.scans:
        assert scan.odometry == pytest.approx(compose(pose_at(scan.time_s), (0.2, 0.0, math.pi)), abs=1e-4)


@pytest.mark.parametrize("mount", [None, (0.3, 0.0, 0.5)], ids=["by tf", "told"])
@pytest.mark.parametrize(("by_tf", "told"), [(True, None), (False, True), (True, True)])
def test_a_lidar_upside_down_looks_the_other_way_round(
    tmp_path: Path, by_tf: bool, told: bool | None, mount: Pose | None
) -> None:
    """With --mount its map was mirrored."""
    hanging = ROS2.transform(99.0, "base_link", "laser", (0.3, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0), "/tf_static")
    said = [hanging] if by_tf else []
    log = read(write_bag(tmp_path, "mcap", [*said, *drive(ROS2)]), Given(mount=mount, upside_down=told))
    assert log.lidar.clockwise and log.lidar.bearings()[[0, 90]] == pytest.approx((math.pi / 2, 0.0), abs=1e-6)
    place = mount or ((0.3, 0.0, 0.0) if by_tf else (0.0, 0.0, 0.0))
    for scan in log.scans:
        assert scan.odometry == pytest.approx(compose(pose_at(scan.time_s), place), abs=1e-4)


@pytest.mark.parametrize("mount", [None, (0.0, 0.0, 0.0)], ids=["by tf", "told"])
def test_a_lidar_upside_down_on_a_part_that_nothing_puts_on_the_robot_looks_so_too(
    tmp_path: Path, mount: Pose | None
) -> None:
    """With --mount, as the note asks for, its map was mirrored."""
    hanging = ROS2.transform(99.0, "base_link", "laser", (0.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0), "/tf_static")
    said = [
        ROS2.odometry(one.t, pose_at(one.t), "base_footprint") if one.kind == ODOMETRY else one for one in drive(ROS2)
    ]
    assert read(write_bag(tmp_path, "mcap", [hanging, *said]), Given(mount=mount)).lidar.clockwise


def test_a_lidar_on_its_side_is_refused(tmp_path: Path) -> None:
    side = ROS2.transform(99.0, "base_link", "laser", (0.0, 0.0, 0.5), (0.5, 0.5, 0.5, 0.5), "/tf_static")
    bag = write_bag(tmp_path, "mcap", [side, *drive(ROS2)])
    with pytest.raises(InputError, match="laser is not level in odom"):
        read(bag)
    assert len(read(bag, Given(mount=(0.0, 0.0, 0.0))).scans) == 10


@pytest.mark.parametrize(("more", "end_s"), [({}, 102.1), ({"stamp": 0.0}, 102.0)], ids=["stamped", "unstamped"])
def test_a_lidar_that_turns_is_where_it_was_at_each_beam(tmp_path: Path, more: dict[str, float], end_s: float) -> None:
    """A scan without a stamp comes when it is over."""
    said = [one for one in drive(ROS2) if one.kind == ODOMETRY]
    said += [
        ROS2.scan(100 + 0.2 * k, FIVES, time_increment=0.1 / 180, **more) for k in range(11)
    ]  # half a turn in 0.1 s
    log = read(write_bag(tmp_path, "mcap", sorted(said, key=lambda one: one.t)))
    assert log.lidar.turning
    last = log.scans[-1]
    assert last.time_s == pytest.approx(end_s, abs=1e-3) and last.way is not None
    assert last.way[-1] == pytest.approx(last.odometry)
    assert last.way[0] == pytest.approx(pose_at(last.time_s - 0.2), abs=1e-3)


def test_the_user_knows_better_than_time_increment_how_long_a_scan_takes(tmp_path: Path) -> None:
    """As of an LDS-01, whose driver told 0.01 s of its 0.2 s. Half of a revolution is over after half of them."""
    said = [one for one in drive(ROS2) if one.kind == ODOMETRY]
    said += [ROS2.scan(100 + 0.2 * k, FIVES, time_increment=0.005 / 180) for k in range(9)]
    bag = write_bag(tmp_path, "mcap", in_order(said))
    told, given = read(bag), read(bag, Given(revolution_s=0.2))
    assert told.scans[-1].time_s == pytest.approx(101.605, abs=1e-3)
    assert given.lidar.turning and given.scans[-1].time_s == pytest.approx(101.7, abs=1e-3)
    assert not read(bag, Given(revolution_s=0.0)).lidar.turning


def test_the_user_tells_topics_mount_and_range(tmp_path: Path) -> None:
    other = [ROS2.scan(100.05, np.full(90, 2.0))._replace(topic="/rear")]
    path = write_bag(tmp_path, "mcap", sorted(drive(ROS2) + other, key=lambda one: one.t))
    assert "/scan was read, and not /rear" in read(path).notes
    told = read(path, Given(scan_topic="/rear", odometry_topic="/odom", mount=(0.3, 0.0, 0.5), range_max_m=1.5))
    (scan,) = told.scans
    assert np.isposinf(scan.ranges).all() and len(scan.ranges) == 90
    assert scan.odometry == pytest.approx(compose(pose_at(100.05), (0.3, 0.0, 0.5)), abs=1e-4)
    assert told.notes == ["no scan hits anything"]
    with pytest.raises(InputError, match=r"/front is no topic of .*/LaserScan in it; there is /rear, /scan"):
        read(path, Given(scan_topic="/front"))


def of_robot(said: list[Said], robot: str) -> list[Said]:
    """The same messages in a robot's namespace."""
    return [one._replace(topic=f"/{robot}{one.topic}") for one in said]


def by_tf(place: tuple[float, float, float], away: float = 0.0) -> list[Said]:
    """The drive with odometry by tf, moved aside, and a lidar at this place."""
    said = drive(ROS2, odometry=False)
    for k in range(44):
        x, y, theta = pose_at(99.9 + 0.05 * k)
        said.append(ROS2.transform(99.9 + 0.05 * k, "odom", "base_link", (x, y + away, 0.0), yawed(theta)))
    return [*said, ROS2.transform(99.0, "base_link", "laser", place, yawed(0.0), "/tf_static")]


def in_order(said: list[Said]) -> list[Said]:
    return sorted(said, key=lambda one: one.t)


@pytest.mark.parametrize("robot", ["r1", "r2"])
def test_of_several_robots_tf_of_the_scans_own_is_read(tmp_path: Path, robot: str) -> None:
    """Merged, they were a path that jumps between two robots, without a word."""
    said = of_robot(by_tf((0.2, 0.0, 0.0)), "r1") + of_robot(by_tf((0.0, 0.3, 0.0), away=9.0), "r2")
    log = read(write_bag(tmp_path, "mcap", in_order(said)), Given(scan_topic=f"/{robot}/scan"))
    place, away = ((0.2, 0.0, 0.0), 0.0) if robot == "r1" else ((0.0, 0.3, 0.0), 9.0)
    for scan in log.scans:
        x, y, theta = pose_at(scan.time_s)
        assert scan.odometry == pytest.approx(compose((x, y + away, theta), place), abs=1e-3)
    other = "r2" if robot == "r1" else "r1"
    assert log.notes == [f"/{robot}/tf, /{robot}/tf_static were read, and not /{other}/tf, /{other}/tf_static"]


def test_of_several_robots_the_odometry_of_the_scans_own_is_read(tmp_path: Path) -> None:
    said = of_robot(drive(ROS2), "r2") + [one._replace(topic="/r1/odom") for one in drive(ROS2, 30)]
    said = [
        ROS2.odometry(one.t, (7.0, 7.0, 0.0))._replace(topic=one.topic) if "r1" in one.topic else one for one in said
    ]
    log = read(write_bag(tmp_path, "mcap", in_order(said)))
    assert "/r2/odom was read, and not /r1/odom" in log.notes
    assert log.scans[5].odometry == pytest.approx(pose_at(101.0), abs=1e-6)


@pytest.mark.parametrize(("y", "notes"), [(0.0, 0), (0.3, 1)], ids=["alike", "contradicting"])
def test_two_topics_that_tell_of_one_frame_are_not_mixed(tmp_path: Path, y: float, notes: int) -> None:
    other = ROS2.transform(99.5, "base_link", "laser", (0.2, y, 0.0), yawed(0.0), "/more/tf_static")
    log = read(write_bag(tmp_path, "mcap", in_order([*by_tf((0.2, 0.0, 0.0)), other])))
    assert log.scans[0].odometry == pytest.approx((0.2, 0.0, 0.0), abs=1e-3)
    assert log.notes == notes * ["/more/tf_static tells otherwise than /tf_static where laser is, and is left out"]


def test_of_two_lidars_on_one_topic_the_one_that_has_most_is_read(tmp_path: Path) -> None:
    said = [ROS2.scan(one.t + 0.05, FIVES + 1, frame="rear") for one in drive(ROS2) if one.kind == SCAN][:-1]
    said += [
        ROS2.transform(99.0, "base_link", "rear", (-0.2, 0.0, 0.0), yawed(math.pi), "/tf_static"),
        ROS2.transform(99.0, "base_link", "laser", (0.2, 0.0, 0.0), yawed(0.0), "/tf_static"),
    ]
    said[0] = ROS2.scan(99.95, FIVES + 1, frame="rear")
    log = read(write_bag(tmp_path, "mcap", in_order(said + drive(ROS2))))
    assert log.skipped == {"scans of another lidar than the one read, whose frame is 'laser'": 9}
    assert len(log.scans) == 10 and all(scan.ranges[0] < 5.5 for scan in log.scans)
    assert log.scans[0].odometry == pytest.approx((0.2, 0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize(
    ("odd", "note"),
    [
        ({"angle_min": 0.0, "angle_increment": math.radians(1)}, "1 scans have another field of view than most"),
        ({"range_max": 4.0}, "1 scans have other limits of the range than most"),
        ({"time_increment": 0.001}, None),
    ],
    ids=["half", "limits", "turning"],
)
def test_a_first_scan_that_is_odd_does_not_tell_the_lidar(
    tmp_path: Path, odd: dict[str, float], note: str | None
) -> None:
    around = {"angle_min": -math.pi, "angle_increment": math.radians(2)}
    said = [one for one in drive(ROS2) if one.kind == ODOMETRY]
    said += [ROS2.scan(100 + 0.2 * k, FIVES, **(around | odd if k == 0 else around)) for k in range(10)]
    log = read(write_bag(tmp_path, "mcap", in_order(said)))
    assert log.lidar.field_of_view_deg == pytest.approx(360) and log.lidar.range_max_m == 10 and not log.lidar.turning
    assert len(log.scans) == 10 and all(np.isfinite(scan.ranges).all() for scan in log.scans[1:])
    assert [one for one in log.notes if "most" in one] == ([f"{note}, and are read as most are"] if note else [])


@pytest.mark.parametrize("tf", [False, True])
def test_a_drive_ends_where_the_clock_is_set_back(tmp_path: Path, tf: bool) -> None:
    """The second drive of a simulation that was reset has the stamps of the first one, and was mixed with it."""
    said = by_tf((0.0, 0.0, 0.0)) if tf else drive(ROS2)
    again = [ROS2.scan(200 + 0.2 * k, FIVES, stamp=100 + 0.2 * k) for k in range(30)]
    for k in range(124):
        t = 99.91 + 0.05 * k
        told = (
            ROS2.transform(t, "odom", "base_link", (0.0, 9.0, 0.0), yawed(0.0)) if tf else ROS2.odometry(t, (0, 9, 0))
        )
        again.append(told._replace(t=t + 100))
    late = ROS2.odometry(9e5, (50.0, 0.0, 0.0))._replace(t=100.52)  # one stamp that is wrong sets nothing back
    log = read(write_bag(tmp_path, "mcap", in_order(said + again + ([] if tf else [late]))))
    assert log.skipped == {"scans after the clock of the odometry jumped back": 30}
    assert [scan.odometry for scan in log.scans] == [pytest.approx(pose_at(100 + 0.2 * k), abs=1e-3) for k in range(10)]


def test_odometry_that_begins_anew_goes_on(tmp_path: Path) -> None:
    """A scan between two messages that jump was put between the two places, and the map was torn."""
    said = []
    for one in drive(ROS2, 20):
        x, y, theta = pose_at(one.t)
        anew = (x + 60.0, y - 30.0, theta) if one.t > 101.99 else (x, y, theta)
        said.append(ROS2.odometry(one.t, anew) if one.kind == ODOMETRY else one)
    said += [ROS2.scan(100.18 + 0.2 * k, FIVES) for k in range(20)]  # one of them after the jump's half
    log = read(write_bag(tmp_path, "mcap", in_order(said)))
    assert len(log.scans) == 40 and any(note.startswith("1 jumps of odometry") for note in log.notes)
    for scan in log.scans:
        assert scan.odometry == pytest.approx(pose_at(scan.time_s), abs=0.15), scan.time_s


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.3, 0.0, 0.5)])
@pytest.mark.parametrize("near", [True, False])
def test_odometry_that_begins_anew_after_silence_goes_on(tmp_path: Path, near: bool, mount: Pose) -> None:
    """Scans beside the silence were put on a line between both ways. By a few metres, it may come from driving."""
    said = []
    for one in drive(ROS2, 60):
        x, y, theta = pose_at(one.t)
        anew = relative(pose_at(108.0), (x, y, theta)) if near else (x - 20.0, y, theta)
        if one.kind != ODOMETRY:
            said.append(one)
        elif not 105 < one.t < 107.99:
            said.append(ROS2.odometry(one.t, anew if one.t > 106 else (x, y, theta)))
    log = read(write_bag(tmp_path, "mcap", said), Given(mount=mount))
    steps = [relative(a.odometry, b.odometry) for a, b in pairwise(log.scans)]
    assert len(log.scans) == 50 and np.abs(steps).max() < 0.15


def test_one_wrong_message_of_odometry_is_left_out(tmp_path: Path) -> None:
    """It was in the way of a revolution, between whose ends nothing jumps."""
    said = [ROS2.scan(one.t, FIVES, time_increment=0.19 / 180) for one in drive(ROS2) if one.kind == SCAN]
    said += [one for one in drive(ROS2) if one.kind == ODOMETRY and abs(one.t - 101.5) > 0.01]
    log = read(write_bag(tmp_path, "mcap", in_order([*said, ROS2.odometry(101.5, (99.0, 99.0, 1.0))])))
    assert all(scan.way is not None and np.ptp(scan.way, 0).max() < 0.5 for scan in log.scans)
    assert log.notes[1:] == ["1 messages jump away for a moment with base_link, and are left out"]


def test_odometry_that_is_told_once_a_second_brings_a_robot_home(tmp_path: Path) -> None:
    """Its last metre was taken for odometry that began anew, and scans there were where the nearest message was."""

    def homewards(t: float) -> Pose:
        return max(5.0 - 0.5 * (t - 100), 0.0), 0.0, 0.0

    said = [ROS2.scan(100 + 0.2 * k, FIVES) for k in range(60)]
    said += [ROS2.odometry(float(t), homewards(t)) for t in range(100, 115)]
    for scan in read(write_bag(tmp_path, "mcap", in_order(said))).scans:
        assert scan.odometry == pytest.approx(homewards(scan.time_s), abs=1e-6)


def test_wrong_messages_of_a_link_are_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For each place of a revolution they took 6 s of two million messages."""
    tree, looked = Frames(), list[int]()
    for k in range(100):
        tree.add("odom", "base_link", 0.1 * k, (0.1 * k, 0, 0, 0, 0, 0, 1))
    asked = frames.are_jumps

    def counted(before: Floats, *rest: Any) -> Any:
        looked.append(len(before))
        return asked(before, *rest)

    monkeypatch.setattr(frames, "are_jumps", counted)
    for _ in range(3):
        tree.placed("base_link", "odom", np.array([1.0, 2.0]))
    assert looked.count(99) == 1
    tree.add("odom", "base_link", 20.0, (20.0, 0, 0, 0, 0, 0, 1))
    assert tree.placed("base_link", "odom", np.array([20.0])).poses[0, 0] == 20.0


@pytest.mark.parametrize("range_max", [0.0, math.inf, math.nan, 90.0])
def test_what_a_lidar_tells_where_nothing_came_back_is_no_hit(tmp_path: Path, range_max: float) -> None:
    """Where its messages tell another range, or none, it was an arc of wall."""
    room = np.append(np.linspace(1.0, 3.0, 170), 10 * [81.83])
    said = [ROS2.scan(one.t, room, range_max=range_max) if one.kind == SCAN else one for one in drive(ROS2)]
    log = read(write_bag(tmp_path, "mcap", said))
    assert log.lidar.range_max_m == pytest.approx(81.63, abs=1e-3)
    assert all(np.isposinf(scan.ranges[170:]).all() and np.isfinite(scan.ranges[:170]).all() for scan in log.scans)


@pytest.mark.parametrize("told_at", [[100.0], [100.0, 100.9, 101.8]], ids=["once", "rarely"])
@pytest.mark.parametrize("odometry", ["topic", "tf"])
def test_a_mount_that_tf_tells_rarely_holds_throughout(tmp_path: Path, told_at: list[float], odometry: str) -> None:
    """Most scans were skipped, as without odometry."""
    said = drive(ROS2) if odometry == "topic" else by_tf((0.2, 0.0, 0.0))[:-1]
    said += [ROS2.transform(t, "base_link", "laser", (0.2, 0.0, 0.1), yawed(0.5)) for t in told_at]
    log = read(write_bag(tmp_path, "mcap", in_order(said)))
    assert len(log.scans) == 10 and not log.skipped and not log.notes
    for scan in log.scans:
        assert scan.odometry == pytest.approx(compose(pose_at(scan.time_s), (0.2, 0.0, 0.5)), abs=1e-3)


def test_a_part_that_moves_and_is_told_rarely_is_named(tmp_path: Path) -> None:
    said = [*drive(ROS2), *(ROS2.transform(t, "base_link", "laser", (0.2, 0, 0), yawed(t)) for t in (100.0, 100.1))]
    log = read(write_bag(tmp_path, "mcap", in_order(said)))
    assert log.skipped == {"scans without tf of 'laser' within 0.5 s": 6}


@pytest.mark.parametrize("child", ["", "odom", "/odom"])
def test_odometry_that_names_no_other_frame_is_that_of_the_robot(tmp_path: Path, child: str) -> None:
    """Where it named its own one, the robot stood, without a word."""
    said = [ROS2.odometry(one.t, pose_at(one.t), child) if one.kind == ODOMETRY else one for one in drive(ROS2)]
    log = read(write_bag(tmp_path, "mcap", said))
    assert log.scans[-1].odometry == pytest.approx(pose_at(log.scans[-1].time_s), abs=1e-3)
    assert log.notes == ["nothing tells where laser is on the robot: taken as the same (--mount tells it)"]


@pytest.mark.parametrize("mount", ["/tf_static", "/tf"])
@pytest.mark.parametrize(("frame", "child"), [("base_link", "base_link"), ("base_link", ""), ("odom", "odom")])
def test_a_mount_by_tf_holds_where_odometry_names_no_robot(tmp_path: Path, frame: str, child: str, mount: str) -> None:
    """The robot stood, or its lidar was taken to be in its middle."""
    said = [ROS2.transform(99.0, "base_link", "laser", (0.2, 0.0, 0.1), yawed(0.5), mount), *drive(ROS2)]
    for one in said:
        if one.kind == ODOMETRY:
            one.message.header.frame_id, one.message.child_frame_id = frame, child
    if frame == "odom":
        said += [one for one in by_tf((0.2, 0.0, 0.0)) if one.topic == "/tf"]
    for scan in read(write_bag(tmp_path, "mcap", in_order(said))).scans:
        assert scan.odometry == pytest.approx(compose(pose_at(scan.time_s), (0.2, 0.0, 0.5)), abs=1e-4)


def test_odometry_of_a_camera_that_looks_ahead_places_a_level_lidar(tmp_path: Path) -> None:
    """Where the lidar is on the robot, as seen from above, nothing tells: the bag was refused for that."""
    said = [ROS2.transform(99.0, "camera", "laser", (0, 0, 0.2), (-0.5, 0.5, -0.5, -0.5), "/tf_static"), *drive(ROS2)]
    for one in said:
        if one.kind == ODOMETRY:
            one.message.child_frame_id, (s, c) = "camera", yawed(pose_at(one.t)[2] - 0.5 * math.pi)[2:]
            turn, half = one.message.pose.pose.orientation, math.sqrt(0.5)
            turn.x, turn.y, turn.z, turn.w = -half * c, -half * s, half * s, half * c
    for scan in read(write_bag(tmp_path, "mcap", in_order(said))).scans:
        assert scan.odometry == pytest.approx(compose(pose_at(scan.time_s), (0.2, 0.0, 0.0)), abs=1e-6)


@pytest.mark.parametrize("frame", ["base_link", "odom"])
def test_a_mount_holds_where_the_lidars_frame_is_the_robots_or_that_of_odometry(tmp_path: Path, frame: str) -> None:
    said = [ROS2.scan(one.t, FIVES, frame=frame) if one.kind == SCAN else one for one in drive(ROS2)]
    for scan in read(write_bag(tmp_path, "mcap", said), Given(mount=(0.3, 0.0, 0.5))).scans:
        assert scan.odometry == pytest.approx(compose(pose_at(scan.time_s), (0.3, 0.0, 0.5)), abs=1e-4)


def test_a_ring_of_frames_is_a_sentence() -> None:
    frames = Frames()
    frames.hang("laser", "base")
    frames.hang("base", "laser")
    with pytest.raises(InputError, match=r"laser does not hang in odom: .*ring"):
        frames.placed("laser", "odom", np.zeros(1))


def test_a_lidar_with_a_few_beams_more_is_read_at_the_bearings_of_the_first(tmp_path: Path) -> None:
    """Bearings of a full turn, from 0 on and from -pi on, with 3 beams more."""
    full = {"angle_min": 0.0, "angle_increment": 2 * math.pi / 180}
    said = [one for one in drive(ROS2, 2) if one.kind == ODOMETRY] + [ROS2.scan(100.0, FIVES, **full)]
    away = np.arange(183) / 183 * 2 * math.pi - math.pi
    shape = {"angle_min": -math.pi, "angle_increment": 2 * math.pi / 183}
    said.append(ROS2.scan(100.2, 5 + np.sin(away), **shape))
    log = read(write_bag(tmp_path, "mcap", sorted(said, key=lambda one: one.t)))
    assert log.scans[1].ranges == pytest.approx(5 + np.sin(log.lidar.bearings()), abs=0.02)


def test_readings_that_are_no_ranges(tmp_path: Path) -> None:
    readings = FIVES.copy()
    readings[:7] = math.nan, 0.0, math.inf, -math.inf, 10.0, 0.05, -1.0
    said = [ROS2.scan(100.0, readings), *drive(ROS2)[1:]]
    ranges = read(write_bag(tmp_path, "mcap", sorted(said, key=lambda one: one.t))).scans[0].ranges
    assert np.isnan(ranges[[0, 1, 3, 5, 6]]).all() and np.isposinf(ranges[[2, 4]]).all()


def test_what_cannot_be_used_is_counted(tmp_path: Path) -> None:
    said = [one for one in drive(ROS2, 20) if one.kind == ODOMETRY and abs(one.t - 101.75) > 0.01]
    said += [ROS2.scan(100 + 0.2 * k, FIVES) for k in range(5)]
    said += [
        ROS2.scan(101.0, FIVES, stamp=100.3),
        Said(101.2, "/scan", SCAN, b"\x00\x01\x00\x00abc"),
        ROS2.scan(101.4, FIVES[:5]),
        ROS2.scan(101.6, FIVES, angle_increment=math.nan),
        ROS2.odometry(101.75, (math.nan, 0.0, 0.0)),
        ROS2.scan(101.75, FIVES),
        ROS2.scan(101.9, FIVES),
        ROS2.scan(102.0, FIVES),
        ROS2.scan(102.5, FIVES),
        ROS2.scan(109.0, FIVES),
    ]
    log = read(write_bag(tmp_path, "mcap", sorted(said, key=lambda one: one.t)))
    assert [scan.number for scan in log.scans] == [0, 1, 2, 3, 4, 10, 11, 12]
    assert log.skipped == {
        "scans whose time jumps back": 1,
        "messages that cannot be decoded": 1,
        "scans of no possible lidar": 2,
        "scans whose odometry is no number": 1,
        "scans without odometry within 0.5 s": 1,
    }
    assert "2 gaps of 0.5 to 1.1 s between scans" in log.notes


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize("damage", [cut, emptied])
@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_bag_is_a_sentence(tmp_path: Path, kind: str, damage: Callable[[Path], None]) -> None:
    path = write_bag(tmp_path, kind, drive(Speaker(kind), 100))
    damage(path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml"))
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: it is no bag, or damaged: ") and "\n" not in str(error.value)


def test_a_small_bag_that_unpacks_to_gigabytes_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.recorded.bag_bounds.MORE_BYTES", 128 << 20)
    speaker, path = Speaker("rosbag1"), tmp_path / "small.bag"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    compress, zeros = writer.compressor, bz2.compress(bytes(64 << 20))
    writer.compressor = lambda chunk: compress(chunk) + 4 * zeros
    with writer as bag:
        one = speaker.scan(100.0, FIVES)
        connection = bag.add_connection(one.topic, one.kind, typestore=speaker.store)
        bag.write(connection, round(one.t * 1e9), speaker.encoded(one))
    assert path.stat().st_size < 10_000
    with pytest.raises(InputError, match="GB of memory; split it"):
        read(path)
    assert len(bytes(512 << 20)) == 512 << 20  # the bound has ended


def test_queries_and_aliases_without_an_end_are_refused(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "endless.db3")) as database:
        database.execute(
            "CREATE VIEW schema AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c"
        )
    with pytest.raises(InputError, match=r"endless\.db3 has a view, and a bag has tables only"):
        read(tmp_path / "endless.db3")
    folder = write_bag(tmp_path, "mcap", drive(ROS2))
    with (folder / "metadata.yaml").open("a") as metadata:
        metadata.write("a: &a [1, 2]\nb: [*a, *a]\n")
    with pytest.raises(InputError, match=r"metadata\.yaml has an alias"):
        read(folder)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_bag_whose_files_are_compressed_is_read_like_any_other(tmp_path: Path, kind: str) -> None:
    plain = read(write_bag(tmp_path, kind, drive(Speaker(kind))))
    packed = read(write_bag(tmp_path, kind, drive(Speaker(kind)), "packed", whole_files_compressed=True))
    assert len(packed.scans) == len(plain.scans) > 0
    assert all((one.ranges == two.ranges).all() for one, two in zip(packed.scans, plain.scans, strict=True))


@pytest.mark.parametrize("name", ["", "no_suffix.zstd"])
def test_files_that_unpack_to_gigabytes_or_to_an_endless_query_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folder = write_bag(tmp_path, "sqlite3", drive(ROS2), whole_files_compressed=True)
    packed = next(file for file in folder.iterdir() if file.suffix == ".zstd")
    if name:
        metadata = (folder / "metadata.yaml").read_text().replace(packed.name, name)
        (folder / "metadata.yaml").write_text(metadata)
        packed = packed.rename(folder / name)
    with closing(sqlite3.connect(tmp_path / "endless.db3")) as database:
        database.execute(
            "CREATE VIEW schema AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c"
        )
    packed.write_bytes(zstd.compress((tmp_path / "endless.db3").read_bytes()))
    with pytest.raises(InputError, match="has a view, and a bag has tables only"):
        read(folder)
    monkeypatch.setattr("deploy.recorded.bag_bounds.MORE_BYTES", 16 << 20)
    packed.write_bytes(zstd.compress(bytes(17 << 20)))
    with pytest.raises(InputError, match="it unpacks to more than"):
        read(folder)


def test_a_compressed_file_is_named_as_one(tmp_path: Path) -> None:
    """Others of the same stem would take its place."""
    folder = write_bag(tmp_path, "mcap", drive(ROS2), whole_files_compressed=True)
    file = folder / "metadata.yaml"
    file.write_text(file.read_text().replace(".zstd", ".zst"))
    with pytest.raises(InputError, match=r"does not end in \.zstd"):
        read(folder)


def test_of_a_folder_the_part_that_is_wrong_is_named(tmp_path: Path) -> None:
    folder = write_bag(tmp_path, "mcap", drive(ROS2, 1), whole_files_compressed=True)
    (folder / "plots").mkdir()
    assert len(read(folder).scans) == 1
    (part,) = folder.glob("*.zstd")
    part.unlink()
    with pytest.raises(InputError, match=rf"{folder}: {part.name}: there is no such file$"):
        read(folder)
    os.mkfifo(part)
    with pytest.raises(InputError, match=rf"{folder}: {part.name}: this is no file$"):
        read(folder)


def test_metadata_nested_without_an_end_are_refused(tmp_path: Path) -> None:
    folder = write_bag(tmp_path, "mcap", drive(ROS2))
    with (folder / "metadata.yaml").open("a") as metadata:
        metadata.write("a: " + 100_000 * "[")
    with pytest.raises(InputError, match="is nested deeper than"):
        read(folder)


@pytest.mark.parametrize("kind", KINDS)
def test_damage_within_a_bag_leaves_the_scans_before_it(tmp_path: Path, kind: str) -> None:
    """The first byte of a scan behind the middle is that of another message, or of none."""
    path = write_bag(tmp_path, kind, drive(Speaker(kind), 100))
    file = path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")
    content = bytearray(file.read_bytes())
    at = content.index(np.full(180, 5.7, np.float32).tobytes())
    content[at - 60 : at] = bytes(255 - byte for byte in content[at - 60 : at])
    file.write_bytes(content)
    log = read(path)
    assert 70 <= len(log.scans) < 100
    assert sum(log.skipped.values()) + sum("damaged after" in note for note in log.notes) > 0


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ("it has no topic of sensor_msgs/msg/LaserScan", [one for one in drive(ROS2) if one.kind == ODOMETRY]),
        ("it has no topic of nav_msgs/msg/Odometry, and no tf that moves 'laser'", drive(ROS2, odometry=False)),
        ("none of its 1 scans can be used: scans of no possible lidar", [ROS2.scan(100.0, FIVES[:3])]),
        (
            "none of its 1 scans can be used: scans without odometry",
            [ROS2.odometry(10.0, (0.0, 0.0, 0.0)), ROS2.scan(100.0, FIVES)],
        ),
    ],
)
def test_a_bag_without_what_is_needed_says_what(tmp_path: Path, wanted: str, said: list[Said]) -> None:
    with pytest.raises(InputError, match=wanted):
        read(write_bag(tmp_path, "mcap", said))


def test_more_readings_than_memory_holds_are_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.recorded.lidar_log.MAX_READINGS", 1_000)
    with pytest.raises(InputError, match="million readings; split it"):
        read(write_bag(tmp_path, "mcap", drive(ROS2)))


def test_a_missing_file_and_a_folder_without_bag_are_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("{")
    for path, words in (("none.bag", "no such file"), ("none.mcap", "no such file"), (".", "no bag, or damaged")):
        with pytest.raises(InputError, match=words):
            read(tmp_path / path)


def test_without_the_extra_a_sentence_tells_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags" or name == "deploy.recorded.bags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    monkeypatch.setattr(sys, "argv", ["wireswarm", "map", "some.bag", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2 and not (tmp_path / "out").exists()
    assert "needs rosbags: install it with `pip install 'wireswarm[bags]'`" in capsys.readouterr().err
