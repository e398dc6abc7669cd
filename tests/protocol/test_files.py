"""Files on a full disk and in processes that are killed."""

import os
import pickle
import resource
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from protocol.files import PIECE_CHARS, LineFile, UnwritableError, remove_parts, write_whole


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """No file may grow beyond `size`: a write ends short, and the next one fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_file_that_cannot_be_written_is_as_it_was_and_nothing_lies_beside_it(tmp_path: Path) -> None:
    file = tmp_path / "map.json"
    with largest_file(1000):
        with pytest.raises(UnwritableError, match=rf"^cannot write {file}: File too large$"):
            write_whole(file, "x" * 1001)
        assert not list(tmp_path.iterdir())
        write_whole(file, "old")
        with pytest.raises(UnwritableError):
            write_whole(file, "x" * 1001)
    assert file.read_text() == "old" and list(tmp_path.iterdir()) == [file]
    write_whole(file, b"new")
    assert file.read_text() == "new"
    with pytest.raises(UnwritableError, match=r"^cannot write .*/absent/map.json: No such file or directory"):
        write_whole(tmp_path / "absent/map.json", "")


def test_what_a_killed_process_left_of_a_file_is_removed(tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    begin = "from protocol.files import *; os.fsync = lambda fd: os._exit(9)"
    write = f"{begin}; write_whole(Path({str(folder / 'r1.json')!r}), 'x')"
    assert subprocess.run([sys.executable, "-c", write], check=False).returncode == 9
    assert len(list(folder.iterdir())) == 1 and not (folder / "r1.json").exists()
    remove_parts(tmp_path)
    assert not list(folder.iterdir())


def test_only_the_owner_reads_a_private_file_and_others_are_as_the_user_wants_them(tmp_path: Path) -> None:
    umask = os.umask(0o027)
    try:
        write_whole(tmp_path / "secrets", "", private=True)
        write_whole(tmp_path / "public", "")
    finally:
        os.umask(umask)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("secrets", "public")]
    assert modes == [0o600, 0o640]


def test_a_file_of_lines_ends_with_a_complete_one_when_the_disk_is_full(tmp_path: Path) -> None:
    file = tmp_path / "events.jsonl"
    kept = LineFile(file)
    with largest_file(100_005):
        for number in range(40_000):
            kept.write(f"{number:09d}\n")
        kept.flush()
    for again in (kept.check, kept.close):
        with pytest.raises(UnwritableError, match=rf"^cannot write {file}: File too large$"):
            again()
        kept.write("more\n")
    assert file.stat().st_size == kept.size == 100_000
    assert {len(line) for line in file.read_text().splitlines()} == {9}


def test_a_file_of_lines_hands_complete_lines_to_the_system_and_goes_on_where_it_is_told(tmp_path: Path) -> None:
    file = tmp_path / "events.jsonl"
    kept = LineFile(file)
    kept.write("one\n")
    assert file.read_text() == ""
    kept.flush()
    size = kept.size
    kept.write("x" * PIECE_CHARS + "\n")
    assert file.read_text() == "one\n" + "x" * PIECE_CHARS + "\n"
    kept.close()
    again = LineFile(file, size)
    again.write("twö\n")
    again.close()
    assert file.read_text(encoding="utf-8") == "one\ntwö\n" and again.size == 9


def test_files_that_cannot_be_written_for_one_reason_are_told_together() -> None:
    error = UnwritableError((Path("a"), "full"), (Path("b"), "read-only"), (Path("c"), "full"))
    assert str(error) == str(pickle.loads(pickle.dumps(error))) == "cannot write a, c: full; cannot write b: read-only"


def test_no_file_takes_the_place_of_a_pipe_or_a_device(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "pipe")
    with pytest.raises(UnwritableError, match=rf"^cannot write {pipe}: this is no file$"):
        write_whole(pipe, "x")
    assert pipe.is_fifo()
    with pytest.raises(UnwritableError, match="/dev/null: this is no file"):
        write_whole(Path("/dev/null"), "x")


def test_lines_go_to_no_link_pipe_or_device(tmp_path: Path) -> None:
    """A pipe was waited for, and of what a link points to all beyond the first lines was cut away."""
    (theirs := tmp_path / "theirs").write_text("all of it")
    (link := tmp_path / "link").symlink_to(theirs)
    os.mkfifo(pipe := tmp_path / "pipe")
    reader = None
    for file in (link, pipe, Path("/dev/null"), pipe):
        with pytest.raises(UnwritableError, match=rf"^cannot write {file}: this is no file$"):
            LineFile(file)
        reader = reader or os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # the second time, one is there
    os.close(reader)
    with pytest.raises(UnwritableError, match="Is a directory"):
        LineFile(tmp_path)
    assert theirs.read_text() == "all of it"
