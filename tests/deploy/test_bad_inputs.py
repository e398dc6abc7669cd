"""What a person may get wrong is one clear sentence and status 2, soon, and nothing is left behind."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy import cli
from protocol.session import open_router
from tests.bad_inputs import Bad, all_cases
from tests.tiny import ROOM

pytestmark = pytest.mark.system

CASES = all_cases()
REPO = Path(__file__).parents[2]


@pytest.fixture
def refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[[Bad], str]:
    """Run a bad command in this process; returns what it said."""
    from deploy.launch import launcher

    def accepted(*_: object, **__: object) -> None:
        raise AssertionError("the command was accepted")

    monkeypatch.setattr(launcher, "launch", accepted)
    monkeypatch.chdir(tmp_path)

    def run(case: Bad) -> str:
        for name, content in case.files.items():
            Path(name).write_bytes(content)
        monkeypatch.setattr(sys, "argv", ["wireswarm", *case.arguments])
        began = time.process_time()  # of the clock, a busy machine may take any time
        with pytest.raises(SystemExit) as end:
            cli.main()
        took = time.process_time() - began
        out, err = capsys.readouterr()
        assert (end.value.code, out) == (2, ""), err
        assert err.startswith("wireswarm: ") and err.endswith("\n") and err[:-1].isprintable(), err
        assert 20 < len(err) < 700, err
        assert sorted(path.name for path in Path().iterdir()) == sorted(case.files)
        assert took < 5
        for name in case.files:
            Path(name).unlink()
        return err

    return run


def test_a_sample_of_bad_inputs_is_refused_in_one_sentence_each(refused: Callable[[Bad], str]) -> None:
    for case in CASES[::20]:
        refused(case)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
def test_three_hundred_bad_inputs_are_refused_in_one_sentence_each(refused: Callable[[Bad], str], case: Bad) -> None:
    assert len(CASES) == 300
    refused(case)


def test_a_port_that_is_taken_leaves_nothing_behind(tmp_path: Path, refused: Callable[[Bad], str]) -> None:
    room = {"room.yaml": ROOM.encode()}
    with open_router() as (_, taken):
        words = f"cannot listen on {taken}"
        assert words in refused(Bad(["world", "--world", "room.yaml", "--secrets", "new", "--listen", taken], room))
        (tmp_path / "room.yaml").write_text(ROOM)
        options = ["--world", "room.yaml", "--set", f"server.listen={taken}"]
        done = subprocess.run(
            [sys.executable, "-c", "from deploy.cli import main; main()", "run", *options],
            cwd=tmp_path, env={"PYTHONPATH": str(REPO)}, capture_output=True, text=True, timeout=100, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1) and words in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["room.yaml"]
