"""Results are kept by the sources that decide them."""

import subprocess
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest

from deploy import revision


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name in (*revision.SOURCES, "deploy/report"):
        file = tmp_path / name if name.endswith(".py") else tmp_path / name / "some.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("before")
    monkeypatch.setattr(revision, "ROOT", tmp_path)
    revision.sources.cache_clear()
    revision.with_imports.cache_clear()
    yield tmp_path
    revision.sources.cache_clear()


@pytest.mark.parametrize(
    ("name", "decides"),
    [
        ("agent/some.py", True),
        ("deploy/metrics.py", True),
        ("deploy/bench/explored.py", True),
        ("deploy/report/some.py", False),
    ],
)
def test_what_drives_and_judges_decides_and_what_shows_does_not(checkout: Path, name: str, decides: bool) -> None:
    before = revision.sources()
    (checkout / name).write_text("after")
    revision.sources.cache_clear()
    assert (revision.sources() != before) == decides


def test_without_a_git_that_reads_the_checkout_it_is_of_the_version(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = f"{version('wireswarm')}-{revision.sources()[:12]}"
    (checkout / ".git").touch()  # git calls it no repository, with status 128
    assert revision.revision() == expected
    monkeypatch.setenv("PATH", str(checkout))
    assert revision.revision() == expected


def test_a_changed_benchmark_is_of_no_clean_commit(checkout: Path) -> None:
    """Its JSON named the commit alone, as what drives and judges was as committed."""
    git = ["git", "-C", str(checkout), "-c", "user.name=a", "-c", "user.email=a"]
    for command in ("init -q", "add .", "commit -q -m all"):
        subprocess.run([*git, *command.split()], check=True)
    commit = revision.revision(revision.WITH_BENCHMARKS)
    assert "-" not in commit
    (checkout / "deploy/report/some.py").write_text("after")
    assert revision.revision(revision.WITH_BENCHMARKS).startswith(f"{commit}-") and revision.revision() == commit


@pytest.mark.parametrize(
    ("name", "decides"),
    [
        ("deploy/bench/measure.py", True),
        ("deploy/bench/pairs.py", True),
        ("deploy/launch/launcher.py", True),
        ("deploy/bench/cases.py", False),
        ("deploy/terminal/live.py", False),
        ("deploy/bench/other.py", False),
    ],
)
def test_what_a_measure_calls_decides_its_figures(checkout: Path, name: str, decides: bool) -> None:
    texts = {
        "deploy/bench/measure.py": "from deploy.bench import cases, pairs\nimport deploy.terminal.live",
        "deploy/bench/pairs.py": "def pair():\n    from deploy.launch.launcher import launch",
        "deploy/launch/launcher.py": "import deploy.bench.measure",
    }
    for other in ("deploy/bench/cases.py", "deploy/terminal/live.py", "deploy/bench/other.py"):
        texts[other] = ""
    for place, text in texts.items():
        (checkout / place).parent.mkdir(parents=True, exist_ok=True)
        (checkout / place).write_text(text)
    measure = checkout / "deploy/bench/measure.py"
    before = revision.with_imports(measure)
    (checkout / name).write_text(texts[name] + "\n# after")
    revision.with_imports.cache_clear()
    assert (revision.with_imports(measure) != before) == decides


def test_all_sources_are_there() -> None:
    assert all((revision.ROOT / name).exists() for name in revision.SOURCES)
    assert all((revision.ROOT / "deploy" / name).exists() for name in revision.NO_MATTER)
