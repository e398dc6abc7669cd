"""The command: options of the contract, exit statuses, and one sentence for what a user can act on."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.main import get_command

from deploy import cli, manifest
from deploy.commands.results import leave
from deploy.commands.run import _as_called
from deploy.config import RunConfig, load
from deploy.launch import forks
from deploy.launch.launcher import run_directory
from deploy.sensing import named
from protocol.configuration import OF_A_RUN, ConfigError
from protocol.session import open_router
from protocol.settings import RAN
from tests.tiny import ROOM

REPO = Path(__file__).parents[2]

Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def wireswarm(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Iterator[Command]:
    """Run the command in this process, in an empty folder; returns exit status, stdout and stderr."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["wireswarm", *arguments])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        code = end.value.code
        return code if isinstance(code, int) else 0, out, err

    yield run
    signal.set_wakeup_fd(-1)  # a robot's command heeds signals until its process ends, and this one goes on
    for number, handler in handlers.items():
        signal.signal(number, handler)


def test_version_and_help(wireswarm: Command) -> None:
    assert wireswarm("--version") == (0, "wireswarm 0.1.0\n", "")
    for command in ("run", "world", "agent", "bench"):
        status, out, _ = wireswarm(command, "--help")
        assert status == 0 and f"wireswarm {command}" in out
    assert wireswarm("-h")[1] == wireswarm("--help")[1]
    assert wireswarm("fly")[0] == 2
    assert wireswarm("run", "--robots", "many")[0] == 2
    assert wireswarm("agent", "--id", "r1")[0] == 2


def examples(group: Any, words: str = "wireswarm") -> Iterator[tuple[str, str]]:
    """The words of each command, and its example."""
    yield words, str(group.epilog).removeprefix("Example: ")
    for name, command in getattr(group, "commands", {}).items():
        yield from examples(command, f"{words} {name}")


@pytest.mark.parametrize(("words", "example"), list(examples(get_command(cli.app))))
def test_the_help_of_each_command_ends_with_an_example_that_it_takes(words: str, example: str) -> None:
    assert example.startswith(words)
    command: Any = get_command(cli.app)
    _, *rest = example.split()
    while hasattr(command, "commands"):
        command, rest = command.commands[rest[0]], rest[1:]
    command.make_context(words, rest)  # parses the options, and raises where one is wrong


@pytest.mark.parametrize(
    ("called", "named"),
    [
        ("/x/wireswarm/__main__.py", "python -m wireswarm"),
        (".venv/bin/wireswarm", ".venv/bin/wireswarm"),
        ("my venv/bin/wireswarm", "'my venv/bin/wireswarm'"),
    ],
)
def test_a_hint_names_the_command_as_it_was_called(called: str, named: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", [called])
    monkeypatch.setenv("PATH", "")
    assert _as_called() == named


def test_shells_complete_commands() -> None:
    words = {"_WIRESWARM_COMPLETE": "complete_bash", "COMP_WORDS": "wireswarm ex", "COMP_CWORD": "1"}
    code = "import sys; sys.argv = ['wireswarm']; from deploy.cli import main; main()"
    asked = {"PYTHONPATH": str(REPO), **words}
    done = subprocess.run(
        [sys.executable, "-c", code], env=asked, capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == ["export"]


@pytest.mark.parametrize("command", ["--help", "worlds", "config"])
def test_what_only_prints_compiles_no_kernels(command: str) -> None:
    code = f"""
import sys
from deploy.cli import main
sys.argv = ["wireswarm", {command!r}]
try:
    main()
finally:
    assert not {{"numba", "llvmlite"}} & set(sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=REPO, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "--world", "nowhere"], "nowhere"),
        (["run", "--robots", "0"], "wireswarm: robots: at least 1, not 0\n"),
        (["run", "--until", "soon"], "wireswarm: until: 'complete' or a number, not 'soon'\n"),
        (["run", "--set", "radio.rnge_m=2"], "radio.rnge_m: there is no such setting; did you mean radio.range_m?\n"),
        (["run", "--set", "range_m=2"], "range_m: there is no such setting; did you mean radio.range_m or ros2."),
        (["run", "--set", "silence_s=2"], "did you mean agent.radio.silence_s or server.silence_s or ros2."),
        (["run", "--robots", "many"], "wireswarm: --robots: a whole number\n"),
        (["run", "--set", "restart=flase"], "wireswarm: restart: true or false, not 'flase'\n"),
        (
            ["run", "--set", "radio.models=[{kind: magic}]"],
            "wireswarm: radio.models.0: its kind is one of 'line_of_sight'",
        ),
        (["run", "--config", "tiny.yaml"], "tiny.yaml: this is a world: run it by --world tiny.yaml"),
        (
            ["sweep", "tiny.yaml", "--out", "swept"],
            "tiny.yaml: this is a world: a sweep's file names it, as `worlds: [tiny.yaml]`",
        ),
        (["export", "full", "--to", "foo"], "wireswarm: --to: 'foo' is not one of 'map_server', "),
        (["run", "--range", "-1"], "radio.range_m: "),
        (["map", "some.log", "--out", "mapped", "--range", "inf"], "wireswarm: --range: at most 1000000000\n"),
        (["run", "--set", "starts=anywhere"], "wireswarm: starts: 'file' or 'random', not 'anywhere'\n"),
        (["run", "--set", "agent.wings=2"], "agent.wings: there is no such setting"),
        (["run", "--set", "robots.x=2"], "robots"),
        (["run", "--mind", "Mapper"], "wireswarm: mind: MODULE:CLASS, such as my_robot:Mapper, not 'Mapper'\n"),
        (["run", "--set", "faults=[r2@0]"], "wireswarm: faults.0: ROBOT@TICK, such as r2@100, not 'r2@0'\n"),
        (
            ["run", "--set", "radio.models=[{kind: blackout, begin_s: 0, end_s: 1, robots: [R2]}]"],
            "robots.0: a robot's name, such as r2, not 'R2'\n",
        ),
        (["run", "--set", "ros2.scan_topic=/"], "ros2.scan_topic: a topic, such as scan or /r1/scan, not '/'\n"),
        (["run", "--robots", "2", "--mind", "r9=a:B"], "wireswarm: mind: r9 is no robot that takes part\n"),
        (["run", "--set", "faults=[r9@3]"], "wireswarm: faults: r9@3 is of no robot that takes part\n"),
        (["run", "--until", "10", "--max-time", "3"], "wireswarm: until: 10 s are more than max_time_s, 3: raise that"),
        (
            ["run", "--set", "agent.driving.wall_air_m=0.03"],
            "wireswarm: agent.driving: wall_air_m 0.03 is more than tight_path_air_m, 0.025: no command may drive such "
            "paths; lower it, or raise tight_path_air_m\n",
        ),
        (
            ["run", "--set", "agent.driving={path_air_m: 0.01, tight_path_air_m: 0.02}"],
            "is more than path_air_m, 0.01: ",
        ),
        (
            ["run", "--set", "radio.models=[{kind: blackout, begin_s: 1, end_s: 2, robots: [r9]}]"],
            "wireswarm: radio.models: r9 is no robot that takes part\n",
        ),
        (
            ["run", "--robots", "2", "--set", "radio.models=[{kind: asymmetric, links: {r1>r3: 1}}]"],
            "wireswarm: radio.models: r3 is no robot that takes part\n",
        ),
        (["run", "--set", "radio.models=[{kind: asymmetric, links: {r1>r1: 1}}]"], "r1>r1 is from a robot to itself"),
        (["run", "--set", "seed"], "KEY=VALUE"),
        (["run", "--set", "seed=[1"], "is no value"),
        (["run", "--config", "absent.yaml"], "absent.yaml: there is no such file"),
        (["run", "--config", "broken.yaml"], "broken.yaml: no YAML: "),
        (["run", "--config", "list.yaml"], "KEY: VALUE, not list"),
        (["run", "--world", "tiny.yaml", "--out", "full"], "something is there already"),
        (["run", "--world", "tiny.yaml", "--robots", "400", "--out", "crowd"], "no room for 400 robots"),
        (
            ["agent", "--id", "r1", "--connect", "tcp/127.0.0.1:1", "--config", "typo.yaml"],
            "wireswarm: agnet: there is no such setting\n",
        ),
        (["agent", "--ros2", "r1", "--config", "typo.yaml"], "wireswarm: agnet: there is no such setting\n"),
        (["map", "log", "--out", "mapped", "--config", "typo.yaml"], "wireswarm: agnet: there is no such setting\n"),
        (["run", "--ros2", "--mind", "x:Y"], "wireswarm: --ros2: it goes without --mind, as what drives"),
        (["run", "--ros2", "--real-time", "2"], "wireswarm: server.real_time=2: robots of ROS 2 have stamps and"),
        (["agent", "--id", "r1", "--connect", "nowhere"], "write it like tcp/127.0.0.1:7447"),
        (["world", "--resume", "full", "--range", "6"], "of its beginning, leave out --range\n"),
        (["world", "--listen", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:1"], "listen goes without connect: "),
        (["view", "full", "--connect", "tcp/127.0.0.1:1"], "--connect and DIR: one shows a world elsewhere"),
        (["view", "--connect", "tcp/127.0.0.1:1", "--save", "run.rrd"], "--connect and --save: "),
        (["view", "full", "--secrets", "secrets"], "--secrets: it is for --connect"),
        (["view", "full", "--certs", "certs"], "--certs: it is for --connect"),
        (["view", "full", "--save", "no/run.rrd"], "--save no/run.rrd: no is no folder that can be written\n"),
        (["import", "house.svg", "--out", "tiny.yaml/w.yaml"], "w.yaml: tiny.yaml is no folder that can be written\n"),
        (["router", "--listen", "tcp/127.0.0.1:1", "--write", "no/r"], "--write no/r: no is no folder that can be"),
        (["bench", "lidar", "--results", "tiny.yaml"], "--results tiny.yaml/lidar: Not a directory; name a directory"),
        (["view", "full", "--save", ""], "--save .: this is a folder; name a file\n"),
        (["import", "house.svg", "--out", "full"], "--out full: this is a folder; name a file\n"),
        (["router", "--listen", "tcp/127.0.0.1:1", "--write", "full"], "--write full: this is a folder; name a file\n"),
        (
            ["bench", "lidar", "--quick", "--results", "full"],
            "--results full/lidar-quick.json: this is a folder; name a file\n",
        ),
        (
            ["bench", "alignment", "--part", "live", "--quick", "--results", "full"],
            "--results full/alignment-quick-live-range.png: this is a folder; name a file\n",
        ),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_a_user_can_act_on_is_one_sentence(
    wireswarm: Command, tmp_path: Path, arguments: list[str], words: str
) -> None:
    (tmp_path / "broken.yaml").write_text("a: [1")
    (tmp_path / "list.yaml").write_text("- 1")
    (tmp_path / "typo.yaml").write_text("robots: 2\nagnet: {}")
    (tmp_path / "tiny.yaml").write_text(ROOM)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    for name in ("lidar-quick.json", "alignment-quick-live-range.png"):
        (tmp_path / "full" / name).mkdir()
    status, out, err = wireswarm(*arguments)
    assert status == 2
    assert out == "" and words in err
    assert err.count("\n") == 1 and "Traceback" not in err


def test_a_world_doubts_its_robots_before_they_come(wireswarm: Command, tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    status, _, err = wireswarm("world", "--world", "tiny.yaml", "--certs", "absent", "--set", "spec.lidar.beams=90")
    assert status == 2
    assert err.startswith("wireswarm: a complete map is not to be expected: the lidar has 90 beams a revolution: ")


def test_a_world_with_the_papers_sensing_is_asked_for_as_a_run_is(wireswarm: Command, tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    out = tmp_path / "run"
    ends = ("--listen", "tcp/127.0.0.1:0", "--set", "server.join_timeout_s=0.1", "--out", str(out), "--ideal")
    wireswarm("world", "--world", "tiny.yaml", *ends)
    assert named(RunConfig.model_validate(manifest.read(out)["config"], context=RAN).spec) == "ideal"


def test_a_world_that_finds_no_router_leaves_nothing_behind(wireswarm: Command, tmp_path: Path) -> None:
    """It left its manifest, so no restart with the same --out began."""
    (tmp_path / "tiny.yaml").write_text(ROOM)
    for _ in range(2):
        router = ("--connect", "tcp/127.0.0.1:1", "--set", "server.join_timeout_s=0.1")
        status, _, err = wireswarm("world", "--world", "tiny.yaml", "--out", "run", *router)
        assert status == 1 and "no router answers at tcp/127.0.0.1:1" in err
    assert not (tmp_path / "run").exists()


def test_a_world_that_is_interrupted_before_its_run_begins_leaves_nothing_behind(
    wireswarm: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What it left while it counted robots, no command took for a run."""

    def serve(*_: object, written: Callable[[str], None], **__: object) -> str:
        written("interrupted")
        return "interrupted"

    monkeypatch.setattr("world.shell.server.serve", serve)
    (tmp_path / "tiny.yaml").write_text(ROOM)
    assert wireswarm("world", "--world", "tiny.yaml", "--out", "run") == (130, "ended: interrupted\n", "")
    assert not (tmp_path / "run").exists()


def test_an_agent_that_is_refused_or_finds_no_world(wireswarm: Command) -> None:
    with open_router() as (_, endpoint):
        pass
    status, _, err = wireswarm("agent", "--id", "r1", "--connect", endpoint, "--set", "join_timeout_s=0.2")
    assert status == 1 and f"no world answers at {endpoint}" in err


def test_a_missing_extra_is_named(wireswarm: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rich.console", None)
    monkeypatch.delitem(sys.modules, "deploy.terminal.live", raising=False)
    status, _, err = wireswarm("run")
    assert status == 2 and err == (
        "wireswarm: this command needs rich: install it with `pip install 'wireswarm[deploy]'`\n"
    )


@pytest.mark.parametrize(
    "says",
    [
        "from protocol.command import tell; tell('a'); tell('b')",
        "from deploy.terminal.live import print_summary; print_summary(folder)",
        "from deploy.recorded.words import print_mapped; print_mapped(folder, {'robots': {}})",
        "from deploy.sweep.tables import Sheet, show; show([Sheet('medians', ['runs'], [[1]])], folder)",
        "from deploy.bench.benchmark import report; report('lidar', {}, 'ideal', [], {}, folder / 'lidar.json')",
        "from deploy.bandwidth.tables import FORMS, print_tables; none = dict.fromkeys(FORMS, 0); "
        "print_tables(dict(run='run', updates=0, sensing='ideal', robots={}, links=[], explored_m2={}, beacon_bytes=0, "
        "full_by_default=True, frame_bytes=0, viewpoint_bytes=0, representations=none, delta_against=none))",
    ],
)
def test_words_that_nobody_reads_end_nothing(says: str, tmp_path: Path) -> None:
    """A world ended when `| head` had read enough, or at its end without a report; or well, and with status 1.

    What prints tables ended before it had written its files.
    """
    (tmp_path / "summary.json").write_text('{"robots": {"r1": {"ended": "complete"}}}')
    begin = "import sys; from pathlib import Path; folder = Path(sys.argv[1]); sys.stdin.read()"
    program = f"{begin}\n{says}\nprint('c')\nsys.exit(3)"
    command = [sys.executable, "-c", program, str(tmp_path)]
    process = subprocess.Popen(command, cwd=REPO, stdin=-1, stdout=-1, stderr=-1, text=True)
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None
    process.stdout.close()
    process.stdin.close()
    with process.stderr as errors:
        assert (errors.read(), process.wait(60)) == ("", 3)


def test_later_settings_win(tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("robots: 5\nseed: 1\nradio: {range_m: 2}\nspec: {lidar: {noise_m: 0}}\n")
    config = load(file, {"seed": 2, "until": "30", "robots": None}, ["seed=3", "spec.lidar.dropout=0.1"])
    assert (config.robots, config.seed, config.until, config.radio.range_m) == (5, 3, 30.0, 2.0)
    assert (config.spec.lidar.noise_m, config.spec.lidar.dropout) == (0.0, 0.1)
    assert load() == RunConfig()
    with pytest.raises(ConfigError, match="spec\\.lidar\\.noise_m"):
        load(None, {}, ["spec.lidar.noise_m=.nan"])


def test_programs_know_what_else_the_file_of_a_run_holds() -> None:
    assert RunConfig.model_fields.keys() == OF_A_RUN


def test_run_directories_are_numbered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    names = []
    for world in ("maze-15", "maze-15", "some/maze-15.yaml"):
        with run_directory(None, world, 4) as (out, _):
            (out / "manifest.json").touch()
            names.append(str(out))
    assert names == ["runs/maze-15-4", "runs/maze-15-4-2", "runs/maze-15-4-3"]


def test_a_link_to_nothing_is_no_run_directory(tmp_path: Path) -> None:
    (link := tmp_path / "out").symlink_to(tmp_path / "gone")
    with pytest.raises(ConfigError, match=r"--out .*out: File exists"), run_directory(link, "maze-15", 0):
        pass
    assert link.is_symlink()


def test_a_working_directory_that_is_gone_is_said(tmp_path: Path) -> None:
    code = """
import os, sys
os.rmdir(os.getcwd())
sys.argv = ["wireswarm", "run", "--until", "1"]
from deploy.cli import main
main()
"""
    (gone := tmp_path / "gone").mkdir()
    paths = {**os.environ, "PYTHONPATH": str(REPO)}
    done = subprocess.run([sys.executable, "-c", code], cwd=gone, env=paths, capture_output=True, text=True, timeout=60)
    said = "wireswarm: the working directory is gone: change into one that is there\n"
    assert (done.returncode, done.stdout, done.stderr) == (1, "", said)


def test_a_run_directory_that_stays_empty_is_removed_with_the_folders_made_for_it(tmp_path: Path) -> None:
    with run_directory(tmp_path / "a" / "b", "maze-15", 0) as (out, _):
        assert out.is_dir()
    assert list(tmp_path.iterdir()) == []
    with run_directory(tmp_path, "maze-15", 0):
        pass
    assert tmp_path.is_dir()


def test_a_run_directory_beyond_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """The empty folder was removed as one made for the run, and a full one taken."""
    for place in ("empty", "full/part"):
        (tmp_path / place).mkdir(parents=True)
    for name in ("empty", "full"):
        asked = tmp_path / "gone" / ".." / name
        with pytest.raises(ConfigError, match=r"gone/\.\./.*: No such file"), run_directory(asked, "maze-15", 0):
            pass
    assert sorted(file.name for file in tmp_path.iterdir()) == ["empty", "full"]
    with run_directory(tmp_path / "empty" / ".." / "new", "maze-15", 0):
        assert (tmp_path / "new").is_dir()
    assert not (tmp_path / "new").exists() and (tmp_path / "empty").is_dir()


def test_an_interrupted_command_that_had_not_begun_removes_what_it_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder above stayed, and one that had been there went."""
    monkeypatch.setattr(forks, "leave", lambda status: None)
    (out := tmp_path / "a" / "b").mkdir(parents=True)
    leave(out, [])
    assert out.is_dir()
    leave(out, [out, out.parent])
    assert list(tmp_path.iterdir()) == []


def test_world_and_agents_in_terminals_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    command = [sys.executable, "-c", "from deploy.cli import main; main()"]
    arguments = ["--world", "tiny.yaml", "--robots", "1", "--until", "1", "--out", "out"]
    world = subprocess.Popen(
        [*command, "world", *arguments], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert world.stdout is not None
    endpoint = world.stdout.readline().split()[-1]
    assert world.stdout.readline() == "radio: range 4 m, MTU 1,200 B\n"
    try:
        agent = subprocess.run(
            [*command, "agent", "--id", "r2", "--connect", endpoint],
            cwd=tmp_path, capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
        assert agent.returncode == 2 and agent.stderr == (
            "wireswarm: the world does not let r2 in: no r2 takes part, only r1\n"
        )
    finally:
        world.terminate()
    assert world.wait(10) == 130
    *waits, ended = world.stdout.read().splitlines()
    assert ended == "ended: interrupted; out" and set(waits) <= {"nobody is here yet, waiting for r1"}
    world.stdout.close()
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["robots"]["r1"]["ended"] == "interrupted"
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["ended"], manifest["exit_status"], "agent" in manifest["config"]) == ("interrupted", 130, False)


def test_the_compose_file_runs_commands_that_exist(wireswarm: Command) -> None:
    compose = yaml.safe_load((REPO / "deploy" / "compose.yaml").read_text())
    assert "name" not in compose  # docker-compose 1.29 refuses it
    assert {name for name, service in compose["services"].items() if "profiles" not in service} == {"world", "agent"}
    services = {name: compose["services"][name] for name in ("world", "agent")}
    targets = re.findall(r"^FROM .* AS (\S+)$", (REPO / "deploy" / "Dockerfile").read_text(), re.MULTILINE)
    for name, service in services.items():
        build = service["build"]
        assert (REPO / "deploy" / build["context"] / build["dockerfile"]).is_file() and build["target"] in targets
        known = wireswarm(name, "--help")[1]
        options = [word for word in service["command"] if word != "world"]
        assert all(option.split("=")[0] in known for option in options)
        assert service["read_only"] and service["cap_drop"] == ["ALL"] and service["image"] == f"wireswarm-{name}"
        assert service["mem_limit"] and service["cpus"] and service["healthcheck"]["test"][0] == "CMD"
    port = next(option for option in services["world"]["command"] if "--listen" in option).rsplit(":")[-1]
    assert f"--connect=tcp/world:{port}" in services["agent"]["command"]
    assert f":{int(port):04X} 01" in services["agent"]["healthcheck"]["test"]
    for file, expected in ((".dockerignore", "*"), ("deploy/compose.sh", "#!/bin/sh")):
        assert expected in (REPO / file).read_text().splitlines()


def test_the_dockerfile_builds_from_the_lock_file() -> None:
    lines = (REPO / "deploy" / "Dockerfile").read_text().splitlines()
    verbs = [line.split()[0] for line in lines if line and line[0].isupper()]
    assert verbs[:2] == ["ARG", "FROM"] and set(verbs) <= {
        "ARG",
        "FROM",
        "WORKDIR",
        "COPY",
        "RUN",
        "USER",
        "ENTRYPOINT",
        "ENV",
    }
    assert any("--require-hashes" in line for line in lines)
    for line in lines:
        if line.startswith("COPY") and "--from" not in line:
            for source in line.split()[1:-1]:
                assert (REPO / source).exists(), source
