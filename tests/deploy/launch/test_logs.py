"""Logs of processes: bounded, continued, and absent where nothing was said."""

import multiprocessing
import os
from pathlib import Path

from deploy.launch.logs import LEFT_OUT, MAX_LOG_BYTES, Log


def test_a_log_is_bounded_and_goes_on_where_a_process_comes_back(tmp_path: Path) -> None:
    file = tmp_path / "logs" / "r1.log"

    def say(words: bytes) -> Log:
        ours, theirs = multiprocessing.Pipe(duplex=False)
        log = Log(file, ours)
        while words:
            words = words[os.write(theirs.fileno(), words[:60_000]) :]
            assert log.read()
        theirs.close()
        assert not log.read()
        return log

    assert say(b"").where() == "" and not file.exists()
    assert say(b"one\n").where() == f"; what it said is in {file}"
    say(b"two\n")
    assert file.read_bytes() == b"one\ntwo\n"
    say(b"x" * 2 * MAX_LOG_BYTES)
    say(b"three\n")
    assert file.read_bytes().startswith(b"one\ntwo\nxxx") and file.read_bytes().endswith(b"x" + LEFT_OUT)
    assert file.stat().st_size == MAX_LOG_BYTES + len(LEFT_OUT)


def test_a_log_that_cannot_be_written_is_lost_and_ends_nothing(tmp_path: Path) -> None:
    (tmp_path / "logs").write_text("in the way")
    ours, theirs = multiprocessing.Pipe(duplex=False)
    log = Log(tmp_path / "logs" / "r1.log", ours)
    os.write(theirs.fileno(), b"words")
    assert log.read() and log.where() == ""
