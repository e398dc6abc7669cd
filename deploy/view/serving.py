"""A recording in the browser: a server on 127.0.0.1 for our page, Rerun's viewer and the recording as it grows.

Whoever knows the address sees the truth of a run. Robots may run on this machine, too, so the address holds a secret.
The page may reach this server and nobody else (Content-Security-Policy).
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

PAGE = {"": "page.html", "page.css": "page.css", "page.js": "page.js"}  # by its name in the address
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".wasm": "application/wasm",
}
RECORDING = "run.rrd"
PIECE_BYTES = 1 << 20
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; connect-src 'self'; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Tape:
    """A recording in a file: one writes, any number read from its begin and wait for more."""

    def __init__(self, file: Path) -> None:
        """file: made here, empty."""
        self.file = file
        self._ended, self._more = False, threading.Condition()
        file.touch()

    def grown(self) -> None:
        """Tell readers that there is more."""
        with self._more:
            self._more.notify_all()

    def end(self) -> None:
        """Nothing more will come."""
        with self._more:
            self._ended = True
            self._more.notify_all()

    def read(self) -> Iterator[bytes]:
        """All pieces until the end."""
        with self.file.open("rb") as stream:
            while True:
                with self._more:
                    while not (piece := stream.read(PIECE_BYTES)) and not self._ended:
                        self._more.wait()
                if not piece:
                    return
                yield piece


@contextmanager
def served(tape: Tape, viewer: Mapping[str, bytes]) -> Iterator[tuple[str, str]]:
    """Serve a recording with the viewer's files; yields the page's address, and one that leads to it once.

    The second is for a browser's command line, which other users of this machine can read.
    """
    folder = Path(__file__).parent
    files = {name: (KINDS[Path(file).suffix], (folder / file).read_bytes()) for name, file in PAGE.items()}
    files |= {name: (KINDS[Path(name).suffix], data) for name, data in viewer.items()}
    server = _Server(tape, files)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    thread.start()
    try:
        yield f"{server.origin}{server.secret_path}", f"{server.origin}{server.once}"
    finally:
        server.shutdown()
        server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, tape: Tape, files: Mapping[str, tuple[str, bytes]]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.tape, self.files = tape, files
        self.secret_path, self.once = _secret_path(), _secret_path()
        self.host = f"127.0.0.1:{self.server_port}"
        self.origin = f"http://{self.host}"

    def handle_error(self, *_: Any) -> None:
        """A browser that goes away is no error."""


def _secret_path() -> str:
    return f"/{secrets.token_urlsafe(24)}/"


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = 60

    def do_GET(self) -> None:
        """Serve a file of the page, the recording, or lead to the page."""
        server, path = self.server, self.path
        name = path.removeprefix(server.secret_path)
        if self.headers.get("Host") != server.host:  # a page elsewhere whose name was made to mean this machine
            self._say(HTTPStatus.FORBIDDEN)
        elif secrets.compare_digest(path.encode(), server.once.encode()):
            server.once = _secret_path()
            self._say(HTTPStatus.SEE_OTHER, Location=server.secret_path)
        elif not secrets.compare_digest(path[: len(server.secret_path)].encode(), server.secret_path.encode()):
            self._say(HTTPStatus.NOT_FOUND)
        elif name == RECORDING:
            self._play()
        elif name in server.files:
            kind, data = server.files[name]
            self._say(HTTPStatus.OK, **{"Content-Type": kind, "Content-Length": str(len(data))})
            self.wfile.write(data)
        else:
            self._say(HTTPStatus.NOT_FOUND)

    def _play(self) -> None:
        self._say(HTTPStatus.OK, **{"Content-Type": "application/octet-stream"})
        with suppress(ConnectionError, TimeoutError):
            for piece in self.server.tape.read():
                self.wfile.write(piece)

    def _say(self, status: HTTPStatus, **headers: str) -> None:
        self.send_response(status)
        for name, value in (HEADERS | headers).items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Nothing: addresses are secret."""
