"""Results are kept by the sources that decide them."""

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


def test_all_sources_are_there() -> None:
    assert all((revision.ROOT / name).exists() for name in revision.SOURCES)
