"""The project as a whole: what is installed, how it is called, and who may know whom."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from typer.testing import CliRunner

from deploy.cli import app
from deploy.config import load
from world.worldfile import bundled, from_document

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
README = (ROOT / "README.md").read_text()


def run(*command: str) -> str:
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, timeout=60).stdout


def locked(file: str = "requirements.lock") -> dict[str, list[Requirement]]:
    """Requirements of the lock by name; there may be several versions for several Pythons."""
    lines = (ROOT / file).read_text().splitlines()
    found: dict[str, list[Requirement]] = {}
    for line in lines:
        if line and line[0] not in " #":
            requirement = Requirement(line.rstrip("\\ "))
            found.setdefault(canonicalize_name(requirement.name), []).append(requirement)
    return found


def test_a_robot_reaches_neither_truth_nor_pictures() -> None:
    code = "import agent.shell.process, agent.robot, sys; print(*{name.split('.')[0] for name in sys.modules})"
    loaded = set(run(sys.executable, "-c", code).split())
    assert "protocol" in loaded
    assert loaded.isdisjoint({"world", "deploy", "pymunk", "matplotlib", "rich", "psutil", "pytest"})


def test_the_lock_holds_what_the_project_asks_for() -> None:
    lock = locked()
    asked = PROJECT["dependencies"] + [one for extra in PROJECT["optional-dependencies"].values() for one in extra]
    for requirement in map(Requirement, asked):
        versions = lock[canonicalize_name(requirement.name)]
        for version in versions:
            (pin,) = version.specifier
            assert pin.operator == "==" and requirement.specifier.contains(pin.version), requirement


@pytest.mark.parametrize(
    ("image", "extras"), [("agent", []), ("world", ["world", "deploy"]), ("sweep", ["world", "deploy", "sweep"])]
)
def test_images_hold_what_the_project_asks_for_in_the_versions_of_the_lock(image: str, extras: list[str]) -> None:
    lean = {canonicalize_name(Requirement(line).name) for line in read("deploy/locks/lean.txt") if line[0] != "#"}
    taken, lock = locked(f"deploy/locks/{image}.lock"), locked()
    for requirement in map(Requirement, PROJECT["dependencies"]):
        assert canonicalize_name(requirement.name) in taken
    for extra in extras:
        for requirement in map(Requirement, PROJECT["optional-dependencies"][extra]):
            assert canonicalize_name(requirement.name) in taken
    for name in taken.keys() - lean:
        assert {str(one.specifier) for one in taken[name]} <= {str(one.specifier) for one in lock[name]}, name


def read(file: str) -> list[str]:
    return (ROOT / file).read_text().splitlines()


def test_the_lock_is_hashed_and_names_no_registry() -> None:
    text = (ROOT / "requirements.lock").read_text()
    entries = re.split(r"\n(?=[a-z0-9])", text.partition("make lock\n")[2])
    assert len(entries) == sum(map(len, locked().values())) > 30
    assert all("--hash=sha256:" in entry for entry in entries)
    assert "://" not in text and "--index" not in text and "--find-links" not in text


@pytest.mark.skipif(not shutil.which("make"), reason="needs make")
def test_make_has_what_the_readme_promises() -> None:
    promised = set(re.findall(r"\bmake (\w+)", README)) - {"lock"}
    assert {"run", "test", "check"} <= promised
    for target in sorted(promised | {"install", "format", "lock"}):
        run("make", "--dry-run", target)
    assert "wireswarm run --world maze-15 --robots 3 --seed 4" in run("make", "-n", "run", "ARGS=--seed 4")


def test_the_command_passes_the_guard_before_it_imports_a_package_of_a_generic_name() -> None:
    assert PROJECT["scripts"] == {"wireswarm": "wireswarm.__main__:main"}


def test_ci_ends_with_the_tests() -> None:
    script = ROOT / ".ci/run"
    assert script.stat().st_mode & 0o111
    steps = [line for line in script.read_text().splitlines() if line.startswith("make ")]
    assert steps == ["make install", "make check", "make test", "make system"]


def test_the_commands_of_the_readme_exist() -> None:
    options: dict[tuple[str, ...], set[str]] = {}
    for line in re.findall(r"^wireswarm (.*)$", README, re.M):
        words = line.split("#")[0].split()
        command = tuple(words[:2] if words[0] == "bench" else words[:1])
        options.setdefault(command, set()).update(re.findall(r"--[a-z-]+", line.split("#")[0]))
    assert {("run",), ("world",), ("agent",), ("bandwidth",)} <= set(options)
    for command, used in options.items():
        told = CliRunner().invoke(app, [*command, "--help"]).stdout
        assert used <= set(re.findall(r"--[a-z-]+", told)), command


def test_the_settings_in_the_docs_can_be_set() -> None:
    sets = set()
    for file in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        sets |= set(re.findall(r"--set (?:'([^']+)'|([\w.]+=\w+))", file.read_text()))
    assert len(sets) > 10
    for quoted, plain in sets:
        load(None, {}, [quoted or plain])


@pytest.mark.parametrize("file", ["README.md", "docs/formats.md"])
def test_the_worlds_in_the_docs_can_be_run(file: str) -> None:
    (text,) = re.findall(r"```yaml\n(.*?)```", (ROOT / file).read_text(), re.S)
    world = from_document(yaml.safe_load(text))
    assert any(len(part.interiors) for part in world.free)  # the frame around the walls; the rooms are inside
    assert len(world.free) == 2


def test_the_docs_name_the_bundled_worlds_and_real_files() -> None:
    text = (ROOT / "docs/formats.md").read_text()
    assert all(f"`{name}`" in text for name in bundled())
    for file in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for link in re.findall(r"\]\((?!https?:)([^)#]+)", file.read_text()):
            assert (file.parent / link).exists(), f"{file.name}: {link}"


def test_a_wheel_holds_the_packages_and_their_data(tmp_path: Path) -> None:
    run(sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path))
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info" not in name}
    assert tops == {"agent", "world", "protocol", "deploy", "wireswarm"}
    assert {
        "wireswarm/py.typed",
        "deploy/report/page.css",
        "deploy/report/page.js",
        "world/bundled/maze-15.yaml",
    } <= set(names)
    assert not [name for name in names if "__pycache__" in name]
