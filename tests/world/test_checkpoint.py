"""A killed world goes on from its checkpoint, and ends with the bytes of one that was never killed."""

import json
import os
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from agent.config import AgentConfig
from deploy.config import RunConfig
from protocol.checksum import sealed
from tests.scripted import Wanderer
from tests.tiny import digests, tiny_config
from world.checkpoint import CHECKPOINT_FILE, FORMAT, Checkpoint, CheckpointError, is_left
from world.episode import Episode
from world.tick import Outputs

AIR = [
    {"kind": "line_of_sight"},
    {"kind": "log_distance", "link_db": 2.0},
    {"kind": "bernoulli", "loss": 0.1},
    {"kind": "gilbert_elliott", "good_s": 2.0, "bad_s": 0.5},
    {"kind": "asymmetric"},
    {"kind": "blackout", "begin_s": 4.0, "end_s": 5.0},
    {"kind": "latency", "ticks": 2, "jitter": 9},
    {"kind": "capacity", "bytes_per_s": 200},
]
ALL = {
    "until": 20.0,
    "seed": 5,
    "people": 1,
    "spec": {
        "odometry": {"noisy": True},
        "lidar": {"dropout": 0.05, "turning": True, "range_min_m": 0.4},  # blind enough to touch things
    },
    "radio": {"models": AIR},
}


class Run:
    """Wanderers in one process, whose world may be dropped at any tick as if it was killed."""

    def __init__(self, config: RunConfig, out: Path) -> None:
        self.config, self.out = config, out
        self.episode = Episode(config, out)
        self.minds = {}
        for robot in self.episode.robots:
            welcome = self.episode.welcome(robot)
            self.minds[robot] = Wanderer(robot, welcome.spec, AgentConfig(), welcome.seed)

    def until(self, tick: int) -> None:
        while self.episode.ended is None and self.episode.tick < tick:
            steps = {r: self.minds[r].step(seen, heard) for r, (heard, seen) in self.episode.inputs().items()}
            if self.episode.tick == 40:
                self.episode.kill("r2", "on purpose")
                del steps["r2"]
            self.episode.advance({r: Outputs(step.sends, step.action, step.map) for r, step in steps.items()})

    def kill_and_resume(self) -> None:
        self.episode = None  # type: ignore[assignment]  # as a dead process, it holds no lock
        self.episode = Episode.resume(self.config, self.out)

    def end(self) -> dict[str, str]:
        self.until(1000)
        self.episode.close()
        assert not (self.out / CHECKPOINT_FILE).exists()
        return digests(self.out)


@pytest.mark.parametrize("models", [[], AIR], ids=["perfect-radio", "all-models"])
def test_a_world_that_is_killed_at_any_tick_ends_with_the_bytes_of_one_that_is_not(
    tmp_path: Path, models: list[object]
) -> None:
    config = tiny_config(tmp_path, **(ALL | {"radio": {"models": models}}))
    undisturbed = Run(config, tmp_path / "undisturbed").end()
    run = Run(config, tmp_path / "killed")
    for tick in (0, 1, 24, 25, 41, 60, 99, 100):
        run.until(tick)
        run.kill_and_resume()
        assert run.episode.tick == tick
    assert run.end() == undisturbed
    robots = json.loads((tmp_path / "killed" / "summary.json").read_text())["robots"]
    assert sum(figures["robot_contacts"] + figures["wall_contacts"] for figures in robots.values()) > 0


def test_a_long_log_begins_anew_and_changes_no_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that said too much filled the file beyond what is read again."""
    config = tiny_config(tmp_path, **(ALL | {"until": 8.0}))
    undisturbed = Run(config, tmp_path / "undisturbed").end()
    monkeypatch.setattr("world.checkpoint.LOG_BYTES", 1000, raising=False)
    run = Run(config, tmp_path / "killed")
    sizes = []
    for tick in range(24):
        run.until(tick)
        sizes.append((run.out / CHECKPOINT_FILE).stat().st_size)
        if tick % 5 == 3:
            run.kill_and_resume()
    assert sum(after < before for before, after in pairwise(sizes)) > 5
    assert run.end() == undisturbed


def test_ticks_that_are_told_again_are_not_counted_as_the_speed_of_the_run(tmp_path: Path) -> None:
    """Nobody waited for them, and they took no time of those in which the run went on."""
    run = Run(tiny_config(tmp_path, **ALL), tmp_path / "run")
    run.until(40)
    run.kill_and_resume()
    run.until(60)
    run.episode.wall_s = 1.0
    assert run.episode.summary()["real_time_factor"] == 4.0


def test_an_entry_of_the_log_that_was_cut_off_counts_as_never_told(tmp_path: Path) -> None:
    run = Run(tiny_config(tmp_path, **ALL), tmp_path / "run")
    run.until(30)
    file = run.out / CHECKPOINT_FILE
    for cut in (1, 2, 3):
        file.write_bytes(file.read_bytes()[:-cut])
        run.kill_and_resume()
        assert run.episode.tick == 30 - cut
    run.until(60)
    run.kill_and_resume()
    assert run.episode.tick == 60


@pytest.mark.parametrize("lost", [0, 5])
def test_zeros_at_the_end_count_as_never_told(tmp_path: Path, lost: int) -> None:
    """As a power cut leaves them, which cost the whole run."""
    run = Run(tiny_config(tmp_path, **ALL), tmp_path / "run")
    run.until(30)
    file = run.out / CHECKPOINT_FILE
    told = file.read_bytes()
    file.write_bytes(told[: len(told) - lost] + bytes(4096))
    run.kill_and_resume()
    assert run.episode.tick == (29 if lost else 30)
    run.until(35)
    run.kill_and_resume()
    assert run.episode.tick == 35


def test_a_damaged_checkpoint_is_refused_with_one_sentence(tmp_path: Path) -> None:
    run = Run(tiny_config(tmp_path, **ALL), tmp_path / "run")
    run.until(30)
    file, rng = run.out / CHECKPOINT_FILE, np.random.default_rng(0)
    whole, refused = file.read_bytes(), 0
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        file.write_bytes(damaged)
        try:
            run.kill_and_resume()
        except CheckpointError as error:
            refused += 1
            assert str(file) in str(error) and "\n" not in str(error)
    assert refused > 50  # the others hit the head of an entry, which then counts as cut off
    for content in (b"", b"\x80", b"\xc1", whole[:100], sealed({"format": FORMAT - 1})):
        file.write_bytes(content)
        with pytest.raises(CheckpointError, match=re.escape(str(file))):
            run.kill_and_resume()
    file.unlink()
    with pytest.raises(CheckpointError, match="holds no run that can go on"):
        run.kill_and_resume()


def test_nobody_goes_on_with_a_run_that_goes_on(tmp_path: Path) -> None:
    run = Run(tiny_config(tmp_path, **ALL), tmp_path / "run")
    for tick in (1, 30):  # before and after a checkpoint
        run.until(tick)
        with pytest.raises(CheckpointError, match="its run goes on, in another process"):
            Episode.resume(run.config, run.out)
        run.kill_and_resume()


def test_a_run_is_left_where_nobody_holds_its_checkpoint(tmp_path: Path) -> None:
    assert not is_left(tmp_path)
    checkpoint = Checkpoint(tmp_path)
    for _ in range(2):
        checkpoint.begin({})
        assert not is_left(tmp_path)
    del checkpoint
    assert is_left(tmp_path)


def test_a_checkpoint_of_another_run_is_not_taken(tmp_path: Path) -> None:
    """As one that was copied, or whose manifest somebody has edited: the results would be a mixture."""
    run = Run(tiny_config(tmp_path, **ALL), tmp_path / "run")
    run.until(30)
    before = digests(run.out)
    for other in ({"seed": 6}, {"until": 21.0}, {"people": 0}, {"robots": 2}):
        run.config = tiny_config(tmp_path, **(ALL | other))
        with pytest.raises(CheckpointError, match="with other settings or another world"):
            run.kill_and_resume()
        assert digests(run.out) == before


def test_what_a_half_copied_run_lacks_is_one_sentence(tmp_path: Path) -> None:
    run = Run(tiny_config(tmp_path, **ALL), tmp_path / "run")
    run.until(30)
    metrics = run.out / "metrics.csv"
    whole = metrics.read_bytes()
    for spoil in (metrics.unlink, lambda: metrics.write_bytes(whole[:50])):
        spoil()
        with pytest.raises(CheckpointError, match=r"run/metrics.csv is missing, or has less than the \d+ bytes"):
            run.kill_and_resume()
    (run.out / CHECKPOINT_FILE).unlink()
    os.mkfifo(run.out / CHECKPOINT_FILE)
    with pytest.raises(CheckpointError, match="is damaged"):
        run.kill_and_resume()
