"""The public face: what it holds, that it stays light, and that the worked example runs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import wireswarm
from deploy.config import RunConfig
from deploy.inprocess import run as run_in_process
from protocol.configuration import ConfigError
from tests.tiny import ROOM
from wireswarm.settings import settings_of

REPO = Path(__file__).parents[2]

TELL_CTRL_C = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"


def test_the_public_names_are_these_and_all_exist() -> None:
    assert wireswarm.__all__ == [
        "ForeignPackageError", "Label", "Map", "Run", "load", "parallel_env", "run", "vector_env", "worlds",
    ]  # fmt: skip
    assert dir(wireswarm) == wireswarm.__all__
    for name in wireswarm.__all__:
        assert getattr(wireswarm, name).__doc__
    with pytest.raises(AttributeError, match="has no attribute 'fly'"):
        _ = wireswarm.fly


def test_importing_the_face_imports_nothing_heavy() -> None:
    code = "import wireswarm, sys; print(*{name.split('.')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], cwd=REPO, check=True, capture_output=True, text=True).stdout
    assert "wireswarm" in loaded.split()
    assert set(loaded.split()).isdisjoint(
        {"numpy", "numba", "shapely", "pymunk", "matplotlib", "pydantic", "zenoh", "agent", "world", "deploy"}
    )


def test_programs_of_others_keep_their_ctrl_c(tmp_path: Path) -> None:
    (tmp_path / "mylab").mkdir()
    (tmp_path / "mylab" / "__init__.py").write_text("import wireswarm")
    (tmp_path / "mylab" / "train.py").write_text(TELL_CTRL_C)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(REPO)])}
    command = [sys.executable, "-m", "mylab.train", "wireswarm"]
    assert subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout == "True\n"


@pytest.mark.parametrize(
    ("argv", "program"),
    [("/bin/wireswarm run", "/bin/wireswarm run"), ("-m run", "-m wireswarm run"), ("-m run", "-mwireswarm run")],
)
def test_the_command_takes_ctrl_c_while_it_is_imported(argv: str, program: str) -> None:
    code = f"import sys; sys.argv, sys.orig_argv = {argv.split()}, ['python', *{program.split()}]; import wireswarm\n"
    command = [sys.executable, "-c", code + TELL_CTRL_C]
    assert subprocess.run(command, cwd=REPO, capture_output=True, text=True, check=True).stdout == "False\n"


def test_the_worked_example_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (REPO / "docs" / "notebook.md").read_text(), re.S)
    made: dict[str, object] = {}
    with mpl.rc_context({"backend": "agg"}):
        exec("\n".join(blocks), made)
        mpl.pyplot.close("all")
    run, own, world = made["run"], made["own"], made["world"]
    assert isinstance(run, wireswarm.Run) and isinstance(own, wireswarm.Map) and isinstance(world, wireswarm.Map)
    assert repr(run) == "Run('runs/notebook': 2 robots, 20 s)" and run.robots == ["r1", "r2"]
    assert own.vertices.shape == world.vertices.shape and len(own.labels) == len(own.vertices) and len(own.edges) > 5
    x, y, theta = run.frames["r1"]
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    np.testing.assert_allclose(own.vertices @ turn.T + [x, y], world.vertices, atol=1e-9)
    assert (tmp_path / "all.png").stat().st_size > 10_000


def test_a_run_without_a_directory_leaves_nothing_and_equals_one_with(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    ticks = []
    settings = {"spec.lidar.noise_m": 0.0}
    run = wireswarm.run(
        tmp_path / "tiny.yaml", 1, until=3, settings=settings, progress=lambda episode: ticks.append(episode.tick)
    )
    assert ticks[-1] == 15 and not run.path.exists()
    config = RunConfig.model_validate(
        {"world": str(tmp_path / "tiny.yaml"), "robots": 1, "until": 3, "spec": {"lidar": {"noise_m": 0.0}}}
    )
    run_in_process(config, config.agent, tmp_path / "out")
    other = wireswarm.load(tmp_path / "out")
    assert run.events == other.events
    np.testing.assert_array_equal(run.map("r1").vertices, other.map("r1").vertices)


def test_what_no_argument_says_is_of_settings_then_of_the_file_then_the_default(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(ROOM)
    file = tmp_path / "run.yaml"
    file.write_text(f"world: {tmp_path / 'tiny.yaml'}\nrobots: 2\nseed: 7\nuntil: 1\nspec: {{radius_m: 0.1}}\n")
    for arguments, expected in (({}, [2, 7, 1.0]), ({"seed": 3, "settings": {"robots": 1, "until": 0.4}}, [1, 3, 0.4])):
        wireswarm.run(**arguments, file=file, out=(out := tmp_path / str(expected[0])))  # type: ignore[arg-type]
        config = json.loads((out / "manifest.json").read_text())["config"]
        assert [config[key] for key in ("robots", "seed", "until")] == expected
        assert config["spec"]["radius_m"] == 0.1
    assert settings_of({"world": None, "robots": None}, None) == RunConfig()


def test_what_is_asked_wrongly_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^wings: there is no such setting$"):
        wireswarm.run(settings={"wings": 2})
    with pytest.raises(ConfigError, match=r"^robots: given twice, as an argument and in settings$"):
        wireswarm.run(robots=3, settings={"robots": 5})
    with pytest.raises(ValueError, match="nowhere: neither a file nor a bundled world"):
        wireswarm.run("nowhere")
    with pytest.raises(ValueError, match=r"^frame: 'own' or 'world', not 'bogus'$"):
        wireswarm.Run(tmp_path).map("r1", frame="bogus")  # type: ignore[arg-type]
    with pytest.raises(NotADirectoryError, match="is no run directory"):
        wireswarm.load(tmp_path / "absent")
    with pytest.raises(ConfigError, match=r"^server\.begin_with: a run in one process has no use for it"):
        wireswarm.run(settings={"server.begin_with": 1})
    (tmp_path / "file").touch()
    for out in (tmp_path, tmp_path / "file"):
        with pytest.raises(FileExistsError, match="something is there already"):
            wireswarm.run(out=out)
