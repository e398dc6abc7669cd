"""The page of the live view: for this machine and who knows its address, and it reaches nobody else."""

import http.client
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from deploy.view.serving import Tape, served

VIEWER = {"re_viewer.js": b"let wasm_bindgen;", "re_viewer_bg.wasm": b"\0asm"}


class Place:
    """A server with a tape, and a browser that follows no redirection."""

    def __init__(self, tape: Tape, address: str, once: str) -> None:
        self.tape, self.once = tape, urlsplit(once).path
        self.host, self.path = urlsplit(address).netloc, urlsplit(address).path

    def get(self, path: str, host: str | None = None) -> tuple[http.client.HTTPResponse, bytes]:
        connection = http.client.HTTPConnection(self.host, timeout=10)
        try:
            connection.request("GET", path, headers={} if host is None else {"Host": host})
            reply = connection.getresponse()
            return reply, reply.read()
        finally:
            connection.close()


def add(tape: Tape, data: bytes) -> None:
    with tape.file.open("ab") as stream:
        stream.write(data)
    tape.grown()


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    tape = Tape(tmp_path / "run.rrd")
    with served(tape, VIEWER) as (address, once):
        yield Place(tape, address, once)
        tape.end()


def test_the_page_may_reach_its_own_server_only(place: Place) -> None:
    reply, page = place.get(place.path)
    policy = reply.headers["Content-Security-Policy"]
    assert reply.status == HTTPStatus.OK and b"<canvas" in page and b"http" not in page
    assert "default-src 'none'" in policy and "connect-src 'self';" in policy
    for name in ("page.js", "page.css", *VIEWER):
        reply, data = place.get(place.path + name)
        assert reply.status == HTTPStatus.OK and data and reply.headers["Content-Security-Policy"] == policy
    assert place.host.startswith("127.0.0.1:")


@pytest.mark.parametrize("path", ["/", "/run.rrd", "/guess/", "/guess/run.rrd", "/../etc/passwd"])
def test_who_does_not_know_the_address_sees_nothing(place: Place, path: str) -> None:
    reply, data = place.get(path)
    assert (reply.status, data) == (HTTPStatus.NOT_FOUND, b"")
    assert place.get(place.path + "absent")[0].status == HTTPStatus.NOT_FOUND


def test_a_name_that_was_made_to_mean_this_machine_is_refused(place: Place) -> None:
    assert place.get(place.path, host="evil.example")[0].status == HTTPStatus.FORBIDDEN


def test_the_address_for_the_browser_leads_to_the_page_once(place: Place) -> None:
    first, _ = place.get(place.once)
    assert (first.status, first.headers["Location"]) == (HTTPStatus.SEE_OTHER, place.path)
    assert place.get(place.once)[0].status == HTTPStatus.NOT_FOUND


def test_a_recording_is_read_from_its_begin_while_it_grows(place: Place) -> None:
    add(place.tape, b"one ")
    with ThreadPoolExecutor(2) as pool:
        readers = [pool.submit(place.get, place.path + "run.rrd") for _ in range(2)]
        time.sleep(0.1)
        add(place.tape, b"two ")
        assert not any(reader.done() for reader in readers)
        add(place.tape, b"three")
        place.tape.end()
        assert [reader.result(10)[1] for reader in readers] == [b"one two three"] * 2
    assert place.get(place.path + "run.rrd")[1] == b"one two three"
