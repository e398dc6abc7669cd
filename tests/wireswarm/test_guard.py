"""A user who has another package of one of our names in the way is told so in one sentence."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wireswarm.guard import HOME, PACKAGES, ForeignPackageError, check_packages

SCRIPT = "import sys\nfrom wireswarm.__main__ import main\nsys.exit(main())\n"
"""What an installer makes of the entry point in pyproject.toml."""


def python(*arguments: str, first: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with a folder that it searches before our packages."""
    path = os.pathsep.join([str(first), str(HOME)])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *arguments], env=environment, cwd=first, capture_output=True, text=True, check=False
    )


def test_our_own_packages_pass() -> None:
    check_packages()
    assert all((HOME / name / "__init__.py").exists() for name in PACKAGES)


@pytest.mark.parametrize("name", PACKAGES)
@pytest.mark.parametrize("form", ["package", "module"])
def test_the_sentence_says_what_is_wrong_where_it_lies_and_what_to_do(tmp_path: Path, name: str, form: str) -> None:
    other = tmp_path / "other" / (name if form == "package" else f"{name}.py")
    other.parent.mkdir()
    if form == "package":
        other.mkdir()
        (other / "__init__.py").touch()
    else:
        other.touch()
    script = tmp_path / "bin" / "wireswarm"
    script.parent.mkdir()
    script.write_text(SCRIPT)
    sentence = f"another package `{name}` at {other} hides wireswarm's own at {HOME / name}: rename it, "
    for called in ([str(script)], ["-m", "wireswarm"]):
        command = python(*called, "--version", first=other.parent)
        assert command.returncode == 2 and command.stdout == ""
        assert command.stderr.startswith(f"wireswarm: {sentence}") and command.stderr.count("\n") == 1
    imported = python("-c", "import wireswarm", first=other.parent)
    assert imported.returncode == 1
    assert imported.stderr.splitlines()[-1].startswith(f"wireswarm.guard.ForeignPackageError: {sentence}")


def test_a_folder_of_that_name_that_is_no_package_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "world").mkdir()
    assert python("-m", "wireswarm", "--version", first=tmp_path).stdout == "wireswarm 0.1.0\n"


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wireswarm.guard.find_spec", lambda name: None)
    with pytest.raises(ForeignPackageError, match=r"^its package `protocol` is missing from .*: install"):
        check_packages()
