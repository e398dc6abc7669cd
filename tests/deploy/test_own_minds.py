"""Minds of one's own, by name: in processes and in one process, for all robots or one."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import wireswarm
from agent.config import AgentConfig
from agent.shell.mind import minds_of
from deploy.launch.launcher import launch
from deploy.revision import ROOT
from deploy.sensing import IDEAL
from protocol.errors import InputError
from protocol.messages import Observation, RobotSpec
from tests.tiny import digests, tiny_config

pytestmark = pytest.mark.system

FOLLOWER, GRID = "examples.wall_follower:WallFollower", "examples.grid_explorer:GridExplorer"


def test_examples_run_in_processes_and_in_one_with_the_same_bytes(tmp_path: Path) -> None:
    config = tiny_config(tmp_path, until=10.0, mind={"*": GRID, "r2": FOLLOWER})
    assert launch(config, tmp_path / "many").status == 0
    settings = {"mind": config.mind}
    run = wireswarm.run(config.world, 3, until=10.0, settings=settings, out=tmp_path / "one")
    assert digests(tmp_path / "many") == digests(tmp_path / "one")
    kinds = {robot: set(books["offered"]) for robot, books in run.bandwidth["robots"].items()}
    assert kinds == {"r1": {"hello", "grid"}, "r2": {"hello"}, "r3": {"hello", "grid"}}
    assert all(fields["coverage"] > 0.2 and fields["path_m"] > 0.3 for fields in run.summary["robots"].values())


@pytest.mark.parametrize(("mind", "coverage"), [(FOLLOWER, 0.5), (GRID, 0.9)])
def test_examples_explore_a_flat(mind: str, coverage: float) -> None:
    settings = {"max_time_s": 150, "mind": {"*": mind}, "spec": IDEAL}
    assert wireswarm.run("apartment", 2, settings=settings).summary["team"]["coverage"] > coverage


def test_a_mind_of_ones_own_looks_at_nothing_while_it_must_stand_unless_that_is_written() -> None:
    follower = minds_of({"*": FOLLOWER})("r1", RobotSpec(), AgentConfig(), 0)
    before = dict(vars(follower))
    assert follower.look(Observation(tick=0, ranges=b"", odometry=(1.0, 2.0, 3.0))) == (1.0, 2.0, 3.0)
    assert vars(follower) == before


@pytest.mark.parametrize("file", sorted((ROOT / "examples").glob("*.py")), ids=lambda file: file.name)
def test_an_example_is_short_and_knows_the_base_and_messages_only(file: Path) -> None:
    lines = file.read_text().splitlines()
    assert len(lines) < 150
    ours = {line.split()[1] for line in lines if line.startswith(("from agent", "from protocol", "import agent"))}
    assert ours <= {"agent.shell.mind", "agent.config", "protocol.messages"}


def test_the_command_takes_a_mind_for_one_robot_from_the_working_directory(tmp_path: Path) -> None:
    (tmp_path / "still.py").write_text(
        "from agent.shell.mind import OwnMind\n\nclass Still(OwnMind):\n"
        "    def drive(self, observation, heard):\n        self.complete = True\n        return 0.0, 0.0\n"
    )
    config = tiny_config(tmp_path)
    command = [sys.executable, "-m", "wireswarm", "run", "--world", config.world, "--until", "2", "--robots", "2"]
    command += ["--mind", "r1=still:Still", "--mind", FOLLOWER, "--out", "run", "--quiet"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "run/summary.json").read_text())["robots"]
    assert summary["r1"]["path_m"] == 0 and summary["r1"]["ended"] == "complete" and summary["r2"]["path_m"] > 0


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("no_such:Mind", "No module named"), ("json:Mind", "no attribute 'Mind'"), ("json:JSONDecoder", "method `step`")],
)
def test_a_mind_that_is_not_there_is_a_sentence(name: str, sentence: str) -> None:
    with pytest.raises(InputError, match=f"--mind {name}: .*{sentence}"):
        minds_of({"*": name})


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("class Mind(", r"SyntaxError: .* \(broken_1.py, line 1\)"),
        ("raise ValueError('of wings')", "ValueError: of wings"),
        ("import sys; sys.exit(0)", "SystemExit: 0"),
        ("import json; json.wings", "broken_1 fails on import: AttributeError: .* 'wings'"),
    ],
)
def test_a_mind_whose_module_fails_on_import_is_a_sentence(
    source: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "broken_1.py").write_text(source)
    with pytest.raises(InputError, match=f"--mind broken_1:Mind: .*{sentence}"):
        minds_of({"*": "broken_1:Mind"})
