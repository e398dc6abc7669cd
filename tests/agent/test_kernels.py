"""Compiled kernels: found by every user, compiled again only where what they depend on has changed."""

import os
import shutil
import stat
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from agent.kernels import kernel

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]

CALLEE = '''
"""A callee."""
from agent.kernels import kernel

FACTOR = 2.0

@kernel
def scaled(x):
    """Scale."""
    return FACTOR * x
'''

CALLER = '''
"""A caller, and a kernel that calls nothing."""
from typing import NamedTuple
import numpy as np
from agent.kernels import kernel
from callee import scaled

class Rules(NamedTuple):
    """Two numbers."""
    width: float
    height: float

STEP = 1.0

@kernel
def caller(x, rules):
    """Call."""
    return scaled(x) + rules.width + STEP  # a comment

@kernel
def other(x):
    """Call nothing."""
    out = np.zeros(2)
    out[:] = x
    return out

def plain():
    return 1

print(caller(1.0, Rules(1.0, 2.0)), other(np.arange(2.0))[1])
'''


def run(folder: Path, cache: Path, caller: str = CALLER, callee: str = CALLEE) -> tuple[str, set[str]]:
    """What the caller prints, and which kernels were compiled for it."""
    folder.mkdir(exist_ok=True)
    (folder / "caller.py").write_text(caller)
    (folder / "callee.py").write_text(callee)
    before = set(cache.iterdir()) if cache.exists() else set()
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": f"{ROOT}:{folder}"}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # edits within a second have the same time
    command = [sys.executable, "-c", "import caller"]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True, timeout=110)
    return done.stdout.strip(), {file.name.split("-")[0] for file in set(cache.iterdir()) - before}


def test_an_edit_compiles_what_depends_on_it_and_nothing_else(tmp_path: Path) -> None:
    here, cache = tmp_path / "here", tmp_path / "cache"
    everything = {"caller.caller", "caller.other", "callee.scaled"}
    assert run(here, cache) == ("4.0 1.0", everything)
    assert run(here, cache) == ("4.0 1.0", set())
    told = (
        CALLER.replace("# a comment", "# another")
        .replace("Call.", "Call\n    another.")
        .replace("return 1", "return 2")
    )
    assert run(here, cache, told, "\n\n" + CALLEE.replace("Scale.", "Scale it.")) == ("4.0 1.0", set())
    assert run(tmp_path / "elsewhere", cache) == ("4.0 1.0", set())  # another checkout
    assert run(here, cache, CALLER.replace("out[:] = x", "out[:] = x + x")) == ("4.0 2.0", {"caller.other"})
    callee = CALLEE.replace("FACTOR * x", "FACTOR * x * x + 1.0")
    assert run(here, cache, CALLER, callee)[1] == {"caller.caller", "callee.scaled", "caller.other"}
    assert run(here, cache, CALLER, CALLEE.replace("2.0", "3.0")) == ("5.0 1.0", {"caller.caller", "callee.scaled"})
    assert run(here, cache, CALLER, CALLEE) == ("4.0 1.0", {"caller.caller", "callee.scaled"})
    assert run(here, cache, CALLER.replace("STEP = 1.0", "STEP = 2.0")) == ("5.0 1.0", {"caller.caller"})
    swapped = CALLER.replace("    width: float\n    height: float", "    height: float\n    width: float")
    assert run(here, cache, swapped.replace("STEP = 1.0", "STEP = 2.0")) == ("6.0 1.0", {"caller.caller"})


def test_only_the_newest_version_of_a_kernel_is_kept(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    run(tmp_path / "here", cache)
    count = len(list(cache.iterdir()))
    run(tmp_path / "here", cache, CALLER, CALLEE.replace("2.0", "3.0"))
    assert len(list(cache.iterdir())) == count


def test_a_kernel_that_python_and_kernels_call_is_kept_in_both_forms(tmp_path: Path) -> None:
    here, cache, both = tmp_path / "here", tmp_path / "cache", CALLER + "print(scaled(1.0))\n"
    run(here, cache, both)
    assert run(here, cache, both) == ("4.0 1.0\n2.0", set())
    assert sum(file.name.startswith("callee.scaled-") for file in cache.iterdir()) == 2


def test_a_shared_kernel_has_one_form_for_python_and_kernels(tmp_path: Path) -> None:
    here, cache, both = tmp_path / "here", tmp_path / "cache", CALLER + "print(scaled(1.0))\n"
    callee = CALLEE.replace("kernel", "shared_kernel").replace("agent.shared_kernels", "agent.kernels")
    assert run(here, cache, both, callee)[0] == "4.0 1.0\n2.0"
    assert run(here, cache, both, callee) == ("4.0 1.0\n2.0", set())
    assert sum(file.name.startswith("callee.scaled-") for file in cache.iterdir()) == 1


def test_a_number_divided_by_zero_is_infinite_as_in_arrays(tmp_path: Path) -> None:
    divided = CALLER.replace("scaled(x) + rules.width", "x / (rules.width - 1.0)")
    assert run(tmp_path / "here", tmp_path / "cache", divided)[0] == "inf 1.0"


def test_a_file_cut_off_is_compiled_again(tmp_path: Path) -> None:
    here, cache = tmp_path / "here", tmp_path / "cache"
    run(here, cache)
    for file in cache.iterdir():
        file.write_bytes(file.read_bytes()[:100])
    assert run(here, cache)[0] == "4.0 1.0"
    assert all(file.stat().st_size > 100 for file in cache.iterdir())


def test_a_large_callee_is_loaded_with_its_caller_and_not_copied_into_it(tmp_path: Path) -> None:
    here, cache, sizes = tmp_path / "here", tmp_path / "cache", []
    for terms in (40, 80):
        waves = " + ".join(f"math.sin({k}.0 * x)" for k in range(terms))
        large = CALLEE.replace("from agent", "import math\nfrom agent").replace("FACTOR * x", waves)
        printed, _ = run(here, cache, callee=large)
        sizes.append({file.name.split("-")[0]: file.stat().st_size for file in cache.iterdir()})
    grown = {name: sizes[1][name] - sizes[0][name] for name in sizes[0]}
    assert abs(grown["caller.caller"]) < 100 < grown["callee.scaled"]
    assert run(here, cache, callee=large) == (printed, set())
    for file in cache.glob("callee.scaled-*"):
        file.unlink()
    assert run(here, cache, callee=large) == (printed, {"callee.scaled"})


def test_a_small_callee_is_kept_without_machine_code_where_python_does_not_call_it(tmp_path: Path) -> None:
    here, cache = tmp_path / "here", tmp_path / "cache"
    printed, _ = run(here, cache)
    without = {file.name.split("-")[0] for file in cache.iterdir() if b"bitcode" in zlib.decompress(file.read_bytes())}
    assert without == {"callee.scaled"}
    for file in cache.glob("caller.caller-*"):
        file.unlink()
    assert run(here, cache) == (printed, {"caller.caller"})


def test_a_literal_in_a_call_compiles_no_further_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    @kernel
    def times(x: float, factor: int) -> float:
        return x * factor

    @kernel
    def both(x: float) -> float:
        return times(x, 2) + times(x, 3)

    assert both(2.0) == 10.0
    assert times(2.0, 5) == 10.0
    assert len(times._for_kernels.signatures) == 1  # type: ignore[attr-defined]


INSTALLED = """
import sys
import numpy as np
from agent.geometry.clearance import distance_to_walls
print(distance_to_walls(0.0, 1.0, np.zeros((1, 4))), distance_to_walls.stats.cache_misses)
"""


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A copied installation with one kernel compiled in it, which may be read only."""
    tree = tmp_path / "tree"
    for package in ("agent", "protocol"):
        shutil.copytree(ROOT / package, tree / package, ignore=shutil.ignore_patterns("__pycache__"))
    return tree


def use(tree: Path, home: Path, cache_home: str = "") -> tuple[str, str]:
    """What a user of the installation prints and is told."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"HOME": str(home), "XDG_CACHE_HOME": cache_home, "PYTHONPATH": str(tree)}
    command = [*unprivileged(), sys.executable, "-c", INSTALLED]
    done = subprocess.run(command, env=environment, cwd=home, check=True, capture_output=True, text=True, timeout=110)
    return done.stdout.strip(), done.stderr.strip()


def unprivileged() -> list[str]:
    """A command before another, by which root obeys the modes of files."""
    return ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []


def read_only(folder: Path) -> None:
    for path in [folder, *folder.rglob("*")]:
        path.chmod(path.stat().st_mode & ~(stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH))


def test_another_user_finds_kernels_in_an_installation_that_cannot_be_written(installed: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    assert use(installed, home)[0].startswith("1.0 Counter({(")
    assert not list(home.iterdir())
    read_only(installed)
    assert use(installed, home) == ("1.0 Counter()", "")
    assert not list(home.iterdir())


@pytest.mark.parametrize("cache_home", [False, True])
def test_kernels_go_to_the_users_cache_where_the_installation_cannot_be_written(
    installed: Path, tmp_path: Path, cache_home: bool
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    read_only(installed)
    asked = tmp_path / "asked" if cache_home else home / ".cache"
    use(installed, home, str(asked) if cache_home else "")
    assert list((asked / "wireswarm" / "kernels").iterdir())
    assert use(installed, home, str(asked) if cache_home else "") == ("1.0 Counter()", "")


def test_one_sentence_says_that_nothing_can_be_written(installed: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    read_only(installed)
    read_only(home)
    printed, told = use(installed, home)
    assert printed.startswith("1.0 ")
    compiling, sentence = told.splitlines()
    assert "compiling kernels" in compiling
    assert "at every start" in sentence
    assert str(home) in sentence


@pytest.mark.timeout(600)
def test_a_run_after_warming_compiles_nothing(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for code in ("from agent.warmup import compile_kernels; compile_kernels()", RUN):
        done = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


RUN = """
from numba.core import event
class Compiled(event.Listener):
    names = []
    def on_start(self, event): self.names.append(event.data["dispatcher"].py_func.__qualname__)
    def on_end(self, event): pass
event.register("numba:compile", Compiled())
from agent.config import AgentConfig
from deploy.inprocess import run
from world.config import WorldConfig
run(WorldConfig(world="apartment", robots=3, until=150.0), AgentConfig(), None)
print(Compiled.names)
"""
