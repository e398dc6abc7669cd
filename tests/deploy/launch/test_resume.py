"""A world whose process is killed goes on with its robots, or is finished; nothing of the run is lost."""

import json
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from agent.config import AgentConfig, JoinConfig
from agent.shell.process import run_agent
from deploy import cli, inprocess, manifest
from deploy.bandwidth.books import NoRunError, read_books
from deploy.commands import results
from deploy.commands.world import _resumed
from deploy.finish import finish
from protocol.errors import LinkError
from protocol.settings import Config
from tests.tiny import digests, tiny_config
from tests.wanderer import Wanderer, endless
from world.worldfile import load

pytestmark = pytest.mark.system

REPO = Path(__file__).parents[3]
WORLD = """
import sys
from pathlib import Path
from deploy.config import RunConfig
from world.shell.server import serve
config, out = RunConfig.model_validate_json(sys.argv[1]), Path(sys.argv[2])
say = lambda what: print(what, flush=True)
tell = {"listening": say, "progress": lambda progress: say(progress.clock.tick)}
say(serve(config, config.server, out, resume=sys.argv[3] == "resume", **tell))
"""


class World:
    """A world in a process of its own."""

    def __init__(self, config: Any, out: Path, mode: str) -> None:
        command = [sys.executable, "-c", WORLD, config.model_dump_json(), str(out), mode]
        self.process = subprocess.Popen(command, cwd=REPO, stdout=subprocess.PIPE, text=True)
        self.endpoint = self.word()

    def word(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def kill_after(self, tick: int) -> int:
        while (now := int(self.word())) < tick:
            pass
        self.process.kill()
        self.process.wait()
        return now


@pytest.mark.parametrize("kills", [1, pytest.param(20, marks=[pytest.mark.slow, pytest.mark.timeout(600)])])
def test_a_world_that_is_killed_and_resumed_ends_with_the_bytes_of_one_that_is_not(tmp_path: Path, kills: int) -> None:
    config = tiny_config(tmp_path, until=60.0 * kills, seed=1)
    world = World(config, tmp_path / "run", "begin")
    listen = config.server.model_copy(update={"listen": world.endpoint})
    config = config.model_copy(update={"server": listen})

    def agent(robot: str) -> str:
        patience = JoinConfig(join_timeout_s=60, reconnect_s=60)
        return run_agent(robot, world.endpoint, AgentConfig(), patience=patience, make_mind=Wanderer)

    with ThreadPoolExecutor() as pool:
        agents = [pool.submit(agent, robot) for robot in config.robot_ids]
        last = 0
        for _ in range(kills):
            last = world.kill_after(last + 50)
            world = World(config, tmp_path / "run", "resume")
        assert world.endpoint == listen.listen
        assert [one.result(60) for one in agents] == ["time"] * 3
    assert world.process.wait(10) == 0
    inprocess.run(config, config.agent, tmp_path / "alone", make_mind=Wanderer)
    assert digests(tmp_path / "run") == digests(tmp_path / "alone")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["team"]["coverage"] > 0.5


@pytest.mark.slow
def test_in_real_time_a_killed_world_goes_on_and_so_do_its_robots(tmp_path: Path) -> None:
    config, run = tiny_config(tmp_path, until=100.0, server={"real_time": 20.0}), tmp_path / "run"
    world = World(config, run, "begin")
    config = config.model_copy(update={"server": config.server.model_copy(update={"listen": world.endpoint})})

    def agent(robot: str) -> str:
        return run_agent(robot, world.endpoint, AgentConfig(), patience=JoinConfig(), make_mind=endless)

    with ThreadPoolExecutor() as pool:
        agents = [pool.submit(agent, robot) for robot in config.robot_ids]
        killed_at = world.kill_after(100)
        world = World(config, run, "resume")
        assert [one.result(60) for one in agents] == ["time"] * 3
    assert world.process.wait(10) == 0
    read_books(run)  # raises where they do not balance
    assert {robot["ended"] for robot in json.loads((run / "summary.json").read_text())["robots"].values()} == {"time"}
    for robot in config.robot_ids:
        poses = [line.split()[1:] for line in (run / "trajectories" / f"{robot}.tum").read_text().splitlines()]
        assert len(poses) == 501
        assert len({tuple(pose) for pose in poses[killed_at + 100 :]}) > 50  # it drives on, 5 s after the kill


def test_a_world_that_goes_on_at_another_address_is_not_open_to_all_because_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tiny_config(tmp_path, server={"insecure": True, "listen": "tcp/127.0.0.1:0"})
    manifest.begin(tmp_path, manifest.begun(config, load(config.world)))
    shutil.copy(config.world, tmp_path / "world.yaml")
    monkeypatch.setattr(sys, "argv", ["wireswarm", "world", "--resume", str(tmp_path), "--listen", "tcp/0.0.0.0:7447"])
    with pytest.raises(SystemExit, match="2"):
        cli.main()
    assert "whoever reaches this address could take part" in capsys.readouterr().err


def test_a_run_that_goes_on_has_not_ended_and_has_no_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It looked ended while it ran, and kept the error for which its world had ended."""
    config = tiny_config(tmp_path)
    manifest.begin(tmp_path, begun := manifest.begun(config, load(config.world)))
    manifest.finish(tmp_path, ended="interrupted", exit_status=1, errors=["No space left on device"])
    shutil.copy(config.world, tmp_path / "world.yaml")
    (tmp_path / ".checkpoint.msgpack.1-0123abcd").write_bytes(b"half of a file")

    def serve(*_: Any, listening: Any, **__: Any) -> str:
        listening("tcp/127.0.0.1:7447")
        assert manifest.read(tmp_path) == begun | {"end": None, "ended": None}
        return "interrupted"

    monkeypatch.setattr("world.shell.server.serve", serve)
    monkeypatch.setattr(sys, "argv", ["wireswarm", "world", "--resume", str(tmp_path)])
    with pytest.raises(SystemExit, match="130"):
        cli.main()
    assert "errors" not in manifest.read(tmp_path) and not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_world_that_did_not_take_a_run_over_does_not_tell_that_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interrupted: bool
) -> None:
    """`finish` took it for one that had ended, once its checkpoint was gone."""
    config = tiny_config(tmp_path)
    manifest.begin(tmp_path, manifest.begun(config, load(config.world)))
    shutil.copy(config.world, tmp_path / "world.yaml")

    def serve(*_: Any, written: Any, **__: Any) -> str:
        if not interrupted:
            raise LinkError("no router answers")
        written("interrupted")
        return "interrupted"

    monkeypatch.setattr("world.shell.server.serve", serve)
    monkeypatch.setattr(sys, "argv", ["wireswarm", "world", "--resume", str(tmp_path)])
    with pytest.raises(SystemExit, match="130" if interrupted else "1"):
        cli.main()
    assert manifest.ended(tmp_path) is None


@pytest.mark.parametrize(("before", "option"), [("connect", "--listen"), ("listen", "--connect")])
def test_a_world_that_goes_on_is_reached_as_it_is_told_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str, option: str
) -> None:
    """With a router before, --listen did nothing."""
    config = tiny_config(tmp_path, server={before: "tcp/10.0.0.1:7447"})
    monkeypatch.setattr("deploy.finish.left_by", lambda run: config)
    command: Any = get_command(cli.app)
    context = command.commands["world"].make_context("world", ["--resume", str(tmp_path), option, "tcp/127.0.0.1:7447"])
    server = _resumed(context, tmp_path).server
    reached = {"listen": server.listen, "connect": server.connect}
    assert reached == {before: None, option.removeprefix("--"): "tcp/127.0.0.1:7447"}


def killed(folder: Path, until: float = 120.0) -> Path:
    """The directory of a run whose world was killed after 10 s; its robots are gone, too."""
    config, run = tiny_config(folder, until=until), folder / "run"
    world = World(config, run, "begin")
    manifest.begin(run, manifest.begun(config, load(config.world)))

    def agent(robot: str) -> None:
        with pytest.raises(LinkError):
            run_agent(robot, world.endpoint, AgentConfig(), patience=JoinConfig(reconnect_s=0), make_mind=endless)

    with ThreadPoolExecutor() as pool:
        agents = [pool.submit(agent, robot) for robot in config.robot_ids]
        world.kill_after(50)
        for one in agents:
            one.result(30)
    return run


def test_of_a_run_that_ended_before_it_began_nothing_is_left_to_finish(tmp_path: Path) -> None:
    """Its world was asked for, which is written as the run begins."""
    config = tiny_config(tmp_path)
    manifest.begin(tmp_path, manifest.begun(config, load(config.world)))
    manifest.finish(tmp_path, ended="interrupted")
    assert not finish(tmp_path)


def test_mapped_logs_are_no_run_to_finish(tmp_path: Path) -> None:
    manifest.begin(tmp_path, manifest.of_logs(Config(), ["maze.log"]))
    manifest.finish(tmp_path, ended="complete")
    with pytest.raises(NoRunError, match="recorded logs"):
        finish(tmp_path)


def test_what_a_killed_world_left_is_finished_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = killed(tmp_path)
    (run / ".checkpoint.msgpack.1-0123abcd").write_bytes(b"half of a file")

    def command(*words: str) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["wireswarm", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    monkeypatch.setattr(results, "write_results", lambda run: 0)
    assert command("finish", str(run))[0] == 0
    summary, fields = (json.loads((run / name).read_text()) for name in ("summary.json", "manifest.json"))
    assert {robot["ended"] for robot in summary["robots"].values()} == {fields["ended"]} == {"interrupted"}
    read_books(run)  # raises where they do not balance
    lines = (run / "trajectories" / "r1.tum").read_text().splitlines()
    assert len(lines) > 50
    assert not list(run.glob("*checkpoint*")) + list(run.glob(".*"))
    inprocess.run(tiny_config(tmp_path, until=120.0), AgentConfig(), tmp_path / "alone", make_mind=endless)
    undisturbed = (tmp_path / "alone" / "trajectories" / "r1.tum").read_text().splitlines()
    assert lines == undisturbed[: len(lines)]
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    assert command("finish", str(run)) == (0, f"{run} is finished already\n", "")
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before
    for words in (("finish", str(tmp_path)), ("world", "--resume", str(tmp_path)), ("world", "--resume", str(run))):
        status, _, said = command(*words)
        assert status == 2 and len(said.splitlines()) == 1, said
    for seed in ("0", "1"):
        assert "leave out --seed" in command("world", "--resume", str(run), "--seed", seed)[2]
