"""The bandwidth measurement: books that balance or say where not, scans seen once more, and each form's bytes."""

import csv
import json
import os
import shutil
import time
import warnings
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from typer.testing import CliRunner

from agent.config import AgentConfig
from agent.robot import Robot, Step
from deploy import inprocess
from deploy.bandwidth import representations
from deploy.bandwidth.books import NoRunError, on_air, read_books, read_traffic
from deploy.bandwidth.plots import draw
from deploy.bandwidth.pool import processes
from deploy.bandwidth.replay import config_of, seen_again
from deploy.bandwidth.representations import NAMES, Measurement, _changed_cells, measure, write
from deploy.bandwidth.tables import document, print_tables
from deploy.cli import app
from deploy.config import RunConfig
from deploy.occupancy_grid import two_bits
from deploy.sensing import IDEAL
from protocol.files import UnwritableError
from protocol.messages import EVERYONE, Action, Heard, Observation, RobotSpec, Send
from tests.tiny import tiny_config
from world.checkpoint import Checkpoint
from world.episode import Episode
from world.radio.config import RadioConfig
from world.radio.gate import Radio
from world.tick import Outputs


class Kept:
    """A robot that keeps what it is shown."""

    seen: dict[str, list[bytes]]

    def __init__(self, robot: str, spec: RobotSpec, config: AgentConfig, seed: int) -> None:
        self.mind, self.mine = Robot(robot, spec, config, seed), self.seen.setdefault(robot, [])

    def step(self, observation: Observation, heard: Sequence[Heard]) -> Step:
        self.mine.append(observation.ranges)
        return self.mind.step(observation, heard)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunConfig, dict[str, list[bytes]]]:
    """A run of three robots in a room, one of which dies, over a radio that loses some.

    With this seed all merge before they have seen all: they tell from where they have looked, and of others' frames.
    """
    folder = tmp_path_factory.mktemp("bandwidth")
    models = [{"kind": "bernoulli", "loss": 0.2}, {"kind": "latency", "ticks": 2}]
    config = tiny_config(folder, seed=1, until=40.0, radio={"models": models}, spec=IDEAL)
    out = folder / "run"
    seen: dict[str, list[bytes]] = {}
    kept = type("KeptHere", (Kept,), {"seen": seen})

    def kill(episode: Episode) -> None:
        if episode.tick == 120:
            episode.kill("r3", "test")

    inprocess.run(config, config.agent, out, kill, kept)
    return out, config, seen


def test_the_scans_of_a_run_are_seen_once_more(recorded: tuple[Path, RunConfig, dict[str, list[bytes]]]) -> None:
    out, config, shown = recorded
    again = seen_again(out, config)
    assert [len(again[robot].ranges) for robot in ("r1", "r2", "r3")] == [201, 201, 120]  # and the poses at the end
    for robot, seen in again.items():
        first = np.stack([np.frombuffer(ranges, "<f4") for ranges in shown[robot]])[: len(seen.ranges)]
        both = np.isfinite(first) & np.isfinite(seen.ranges[: len(first)])
        assert (np.isfinite(first) == np.isfinite(seen.ranges[: len(first)])).mean() > 0.9999  # poses are kept to 1 nm
        assert np.abs(first[both] - seen.ranges[: len(first)][both]).max() < 1e-4
        assert np.abs(seen.poses[0]).max() < 1e-6


def test_every_form_is_charged_at_the_same_moments(recorded: tuple[Path, RunConfig, dict[str, list[bytes]]]) -> None:
    out, config, _ = recorded
    measured = measure(out, config)
    totals = measured.totals()
    lines = [json.loads(line) for line in (out / "updates.jsonl").read_text().splitlines()]
    with (out / "radio.csv").open() as file:
        rows = list(csv.DictReader(file))
    news = {(row["tick"], row["sender"], row["receiver"]) for row in rows if row["kind"] in ("map", "delta")}
    assert len(news) == len(measured.updates) == sum(len(line["told"]) for line in lines) > 4
    assert totals["delta"] == sum(int(row["bytes"]) for row in rows if row["kind"] not in ("beacon", "views", "frames"))
    assert measured.viewpoint_bytes == sum(int(row["bytes"]) for row in rows if row["kind"] == "views") > 0
    assert measured.frame_bytes == sum(int(row["bytes"]) for row in rows if row["kind"] == "frames") > 0
    said = [len(json.dumps(line["map"], separators=(",", ":"))) for line in lines for _ in line["told"]]
    assert totals["json"] == sum(said)
    ticks: dict[tuple[str, str], int] = {}
    scans = 0
    for tick, sender, receiver in sorted((int(t), a, b) for t, a, b in news):
        scans += tick + 1 - ticks.get((sender, receiver), 0)
        ticks[sender, receiver] = tick + 1
    assert totals["scans_raw"] == scans * 360 * 4
    assert totals["delta"] > 0 and 0 < totals["full"] < totals["json"]
    assert totals["grid_delta_zlib"] < totals["grid_zlib"] < totals["grid_raw"]
    assert totals["scans_zlib"] < totals["scans_raw"] and totals["points"] % 8 == 0
    sends = {(row["tick"], row["sender"]) for row in rows if row["kind"] == "beacon"}
    assert measured.beacon_bytes == 15 * len(sends)
    assert 5.0 < measured.explored_m2["r1"] < 11.2  # the room has 3.8 m x 2.8 m


def test_what_never_went_on_the_air_is_no_traffic(
    recorded: tuple[Path, RunConfig, dict[str, list[bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the sender's radio held back was part of `delta`."""
    out, config, _ = recorded
    books, ours = read_traffic(out, representations.OURS)
    held = [ours[0]._replace(outcome=outcome) for outcome in ("mtu", "capacity_out")]
    monkeypatch.setattr(representations, "read_traffic", lambda *_: (books, [*ours, *held]))
    assert measure(out, config).totals()["delta"] == sum(passage.bytes for passage in ours)


@pytest.mark.parametrize("to", [EVERYONE, "r3"])
def test_what_is_counted_apart_is_bytes_on_the_air_too(to: str) -> None:
    """Beacons, viewpoints and frames were those offered, beside a `delta` on the air."""
    robots, limits = ["r1", "r2", "r3"], {"models": [{"kind": "capacity", "bytes_per_s": 30}], "mtu_bytes": 64}
    radio = Radio(robots, RadioConfig.model_validate(limits))
    sends = [Send(tick=0, to=to, kind="beacon", payload=bytes(size)) for size in (10, 15, 20, 65)]
    radio.offer(0, {"r1": sends}, np.zeros((3, 2)))
    radio.deliver(1, robots, ended=True)
    books = radio.books.as_dict(robots)
    assert [on_air(books, kind) for kind in ("beacon", "views")] == [10 + 15, 0]


def test_divided_among_processes_it_is_the_same(recorded: tuple[Path, RunConfig, dict[str, list[bytes]]]) -> None:
    out, config, _ = recorded
    with processes() as pool:
        assert measure(out, config, pool) == measure(out, config)


def test_processes_end_where_something_is_raised() -> None:
    with pytest.raises(KeyError), processes() as pool:
        number = pool.submit(os.getpid).result()
        pool.submit(time.sleep, 60.0)
        raise KeyError
    assert not psutil.pid_exists(number) or psutil.Process(number).status() == psutil.STATUS_ZOMBIE


def test_full_is_coded_as_the_robots_code(recorded: tuple[Path, RunConfig, dict[str, list[bytes]]]) -> None:
    out, config, _ = recorded
    tree = config.model_dump(mode="json")
    fine = measure(out, config).totals()
    tree["agent"]["radio"] |= {"cell_mm": 100, "likelihoods": False}
    coarse = measure(out, RunConfig.model_validate(tree)).totals()
    assert coarse["full"] < 0.9 * fine["full"]
    assert {name: size for name, size in coarse.items() if name != "full"} == {
        name: size for name, size in fine.items() if name != "full"
    }


def test_the_books_balance_and_say_where_they_do_not(
    recorded: tuple[Path, RunConfig, dict[str, list[bytes]]], tmp_path: Path
) -> None:
    out, _, _ = recorded
    books = read_books(out)
    robots, kinds = books["robots"], ("messages", "bytes")
    for sender, counts in robots.items():
        for kind, tally in counts["addressed"].items():
            links = [
                link["kinds"][kind] for link in books["links"] if link["sender"] == sender and kind in link["kinds"]
            ]
            for unit in kinds:
                ends = sum(c["delivered"][unit] + sum(d[unit] for d in c["dropped"].values()) for c in links)
                assert tally[unit] == ends
        beacons = counts["offered"]["beacon"]["messages"]
        assert counts["addressed"]["beacon"]["messages"] == 2 * beacons
    assert {why for counts in robots.values() for d in counts["dropped"].values() for why in d} >= {"loss", "dead"}
    for change, words in (
        ("radio", "do not balance: r1 r2 beacon"),
        ("links", "balance"),
        ("addressed", "addressed"),
        ("offered", "addressed"),
    ):
        copy = tmp_path / change
        shutil.copytree(out, copy)
        if change == "radio":
            lines = (copy / "radio.csv").read_text().splitlines()
            lines.remove(next(line for line in lines if ",r1,r2,beacon," in line))
            (copy / "radio.csv").write_text("\n".join(lines) + "\n")
        else:
            changed: dict[str, Any] = json.loads((copy / "bandwidth.json").read_text())
            beacons_of_link = changed["links"][0]["kinds"]["beacon"]
            tally = {
                "links": beacons_of_link["delivered"],
                "offered": beacons_of_link["offered"],
                "addressed": changed["robots"]["r1"]["addressed"]["beacon"],
            }[change]
            tally["bytes"] += 1
            (copy / "bandwidth.json").write_text(json.dumps(changed))
        with pytest.raises(NoRunError, match=words):
            read_books(copy)
    (copy / "radio.csv").unlink()
    with pytest.raises(NoRunError, match=r"no finished run: it has no radio\.csv$"):
        read_books(copy)


def test_the_command_prints_and_keeps_the_figures(recorded: tuple[Path, RunConfig, dict[str, list[bytes]]]) -> None:
    out, _, _ = recorded
    printed = CliRunner().invoke(app, ["bandwidth", str(out), "--json"])
    (figures,) = json.loads(printed.stdout)
    kept = json.loads((out / "bandwidth.json").read_text())
    assert set(kept["representations"]) == set(NAMES) == set(figures["delta_against"])
    assert kept["representations"] == figures["representations"] and kept["updates"] == figures["updates"]
    assert kept["beacon_bytes"] > 0
    assert (out / "bandwidth.png").read_bytes().startswith(b"\x89PNG")
    table = CliRunner().invoke(app, ["bandwidth", str(out)]).stdout
    assert all(name in table for name in NAMES) and "beacon" in table and "coded as ours" in table
    read_books(out)  # still balanced


def test_a_run_that_cannot_be_measured_or_written_costs_no_other_its_figures(
    recorded: tuple[Path, RunConfig, dict[str, list[bytes]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(run: Path, measurement: Measurement) -> None:
        raise UnwritableError((run / "bandwidth.json", "Read-only file system"))

    out, _, _ = recorded
    monkeypatch.setattr(representations, "write", refuse)
    monkeypatch.setattr("deploy.commands.results._measured", measure)  # in this process
    done = CliRunner().invoke(app, ["bandwidth", str(tmp_path), str(out), "--json"])
    assert done.exit_code == 2 and [one["run"] for one in json.loads(done.stdout)] == [str(out)]
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == ["wireswarm"] * 2


def test_without_settings_of_the_robots_the_table_says_by_what_full_is_coded(
    recorded: tuple[Path, RunConfig, dict[str, list[bytes]]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, _, _ = recorded
    told = json.loads((out / "manifest.json").read_text())
    del told["config"]["agent"]  # as `wireswarm world` writes it
    (tmp_path / "manifest.json").write_text(json.dumps(told))
    print_tables(document(tmp_path, Measurement([], [], 0, 0, 0, {}, read_books(out))))
    assert "the whole map anew, by default settings" in capsys.readouterr().out


def test_each_file_is_read_once(
    recorded: tuple[Path, RunConfig, dict[str, list[bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command read radio.csv three times, and bandwidth.json as often."""
    out, _, _ = recorded
    opened, real = list[str](), Path.open

    def noted(path: Path, *arguments: Any, **named: Any) -> Any:
        opened.append(path.name)
        return real(path, *arguments, **named)

    monkeypatch.setattr(Path, "open", noted)
    CliRunner().invoke(app, ["bandwidth", str(out), "--json"])
    assert [opened.count(name) for name in ("radio.csv", "bandwidth.json")] == [1, 1]


def test_a_run_without_contact_has_no_map_traffic(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, robots=1, until=5.0)
    inprocess.run(config, config.agent, tmp_path / "run")
    measured = measure(tmp_path / "run", config)
    assert set(measured.totals().values()) == {0} and measured.beacon_bytes == 15
    write(tmp_path / "run", measured)
    draw(tmp_path / "run", measured)


def test_changed_cells_cost_what_changed() -> None:
    rng = np.random.default_rng(0)
    before = rng.integers(0, 3, (300, 200)).astype(np.uint8)
    after = before.copy()
    after[10, 20] = (after[10, 20] + 1) % 3
    assert _changed_cells(before, after) < 20
    assert _changed_cells(before, before) < 20
    everything = _changed_cells(np.zeros_like(before), before)
    assert everything <= len(zlib.compress(two_bits(before), 9)) * 1.35
    cells = np.array([[0, 1, 2], [2, 1, 0]], np.uint8)
    assert two_bits(cells) == bytes([0 | 1 << 2 | 2 << 4 | 2 << 6, 1])


def test_the_plots_of_thirty_robots_have_room(tmp_path: Path) -> None:
    sent = [(float(t), f"r{number}", 60) for number in range(30) for t in range(5)]
    (tmp_path / "metrics.csv").write_text(
        "t,robot,coverage,path_m,vertices,bytes_sent,bytes_received\n0.0,r1,0.0,0.0,,0,0\n"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib's, of axes that collapsed
        draw(tmp_path, Measurement([], sent, 0, 0, 0, {}, {}))


def test_the_settings_of_a_run_to_which_fewer_came_are_read_again(tmp_path: Path) -> None:
    models = [{"kind": "blackout", "begin_s": 1.0, "end_s": 2.0, "robots": ["r3"]}]
    config = tiny_config(tmp_path, radio={"models": models}, faults=["r3@5"], mind={"r3": "a:B"})
    config = config.model_copy(update={"robots": 1})  # as `wireswarm world --settle` does
    (tmp_path / "manifest.json").write_text(json.dumps({"config": config.model_dump(mode="json")}))
    assert config_of(tmp_path) == config


def test_settings_that_this_version_does_not_know_are_named(tmp_path: Path) -> None:
    """Such a run was told to have no manifest.json."""
    tree = tiny_config(tmp_path).model_dump(mode="json")
    tree["agent"]["cooperation"]["gone_setting"] = 3
    (tmp_path / "manifest.json").write_text(json.dumps({"config": tree}))
    words = r"of another version: agent\.cooperation\.gone_setting: there is no such setting"
    with pytest.raises(NoRunError, match=words):
        config_of(tmp_path)
    for damaged in ("{}", '{"config": null}', '{"config": []}', '{"config": 7}', "7"):
        (tmp_path / "manifest.json").write_text(damaged)
        with pytest.raises(NoRunError, match=r"it has no manifest\.json with its configuration$"):
            config_of(tmp_path)


def test_a_run_that_was_killed_is_told_how_to_end(tmp_path: Path) -> None:
    Checkpoint(tmp_path).begin({})
    with pytest.raises(NoRunError, match=r"is no finished run: its world was killed; `wireswarm finish .*` ends it$"):
        read_books(tmp_path)


def test_scans_of_a_robot_that_has_not_joined_are_no_part_of_its_map(tmp_path: Path) -> None:
    config, out = tiny_config(tmp_path, until=4.0, spec=IDEAL), tmp_path / "run"
    episode = Episode(config, out)
    episode.arrive("r1", "its process")  # and r3 never comes
    while episode.ended is None:
        if episode.tick == 10:
            episode.arrive("r2", "its process")
            episode.happened("r2", "joined", "its process is ready")
        still = Outputs([], Action(tick=episode.tick, speed_mps=0.0, turn_rps=0.0), None)
        episode.advance(dict.fromkeys(episode.live, still))
    episode.close()
    wall = {"vertices": [[0, 0], [1, 0]], "labels": ["nominal"] * 2, "edges": [[0, 1]], "edge_likelihood": [1.0]}
    line = {"t": 3.0, "tick": 15, "robot": "r2", "told": ["r1"], "map": wall}
    (out / "updates.jsonl").write_text(json.dumps(line) + "\n")
    assert [seen.begin for seen in seen_again(out, config).values()] == [0, 10, 21]
    measured = measure(out, config)
    summary = json.loads((out / "summary.json").read_text())
    summary["robots"]["r3"]["bytes_sent"] = 7  # of one that joined, and has seen no wall
    (out / "summary.json").write_text(json.dumps(summary))
    assert seen_again(out, config)["r3"].begin == 0
    assert measured.explored_m2["r1"] > 1.0 < measured.explored_m2["r2"] and measured.explored_m2["r3"] == 0.0
    assert measured.totals()["scans_raw"] == 6 * 360 * 4
    (out / "updates.jsonl").write_text(json.dumps(line | {"map": 7}) + "\n")
    with pytest.raises(NoRunError, match=r"no finished run: updates\.jsonl: map: Input should be"):
        measure(out, config)
