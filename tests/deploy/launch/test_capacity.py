"""A run that finds no room on the machine is refused before anything is started."""

import resource
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from deploy.launch import capacity
from protocol.configuration import ConfigError

pytestmark = pytest.mark.system


def test_a_run_with_too_few_files_is_refused_with_a_sentence(tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (150, 150))

    command = [sys.executable, "-m", "wireswarm", "run", "--robots", "100", "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, preexec_fn=limit)
    refusal = "robots: 100 need about 460 open files, and this machine has 150 left for them: take at most 22"
    assert (done.returncode, done.stderr) == (2, f"wireswarm: {refusal}\n")
    assert not (tmp_path / "out").exists()


def test_memory_and_threads_are_those_that_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    capacity.check(10)
    left = psutil.virtual_memory()._replace(available=1 << 30)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: left)
    with pytest.raises(ConfigError, match=r"100 need about 4400 MiB .* has 1024 left for them: take at most 15"):
        capacity.check(100)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: left._replace(available=1 << 20))
    with pytest.raises(ConfigError, match=r"1 need about 440 MiB of memory, .* has 1 left for them: make room"):
        capacity.check(1)
    monkeypatch.setattr(capacity, "_threads_left", lambda: iter([4000.0, 100.0]))
    with pytest.raises(ConfigError, match=r"10 need about 130 threads, .* has 100 left for them: take at most 6"):
        capacity.check(10)


@pytest.mark.parametrize(
    ("groups", "place", "names"),
    [
        ("0::/run\n", "", "memory.max memory.current inactive_file"),
        ("4:cpu:/x\n5:memory:/run\n", "memory", "memory.limit_in_bytes memory.usage_in_bytes total_inactive_file"),
    ],
)
def test_limits_of_all_control_groups_above_count(tmp_path: Path, groups: str, place: str, names: str) -> None:
    limit, usage, cached = names.split()
    (tmp_path / "groups").write_text(groups)
    for folder, most, used in ((tmp_path / "sys" / place / "run", "max", 5), (tmp_path / "sys" / place, "1000", 300)):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / limit).write_text(f"{most}\n")
        (folder / usage).write_text(f"{used}\n")
        (folder / "memory.stat").write_text(f"anon 7\n{cached} 100\n")
    found = list(capacity._limits("memory", limit, usage, tmp_path / "groups", tmp_path / "sys"))
    assert found == [(1000, 300, 100)]
