"""The files of Rerun's web viewer, as its program serves them.

Its own page loads fonts and tells of its use; ours (page.html) takes the same viewer and lets it reach nobody else.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
import urllib.request
from pathlib import Path

import rerun_cli

from protocol.errors import LinkError
from protocol.temporary import temporary_folder

NAMES = ("re_viewer.js", "re_viewer_bg.wasm")
START_S = 30.0  # until the program serves them; a second on an idle machine


def viewer_files() -> dict[str, bytes]:
    """JavaScript and WebAssembly of the viewer by name. Raises LinkError where the program does not serve them.

    The program runs for a moment, for this machine only, with a home of its own in which its telemetry is off.
    """
    program = Path(rerun_cli.__file__).with_name("rerun.exe" if os.name == "nt" else "rerun")
    with temporary_folder() as home:
        settings = home / ".config/rerun/analytics.json"
        settings.parent.mkdir(parents=True)
        settings.write_text(json.dumps({"analytics_enabled": False, "analytics_id": "", "metadata": {}}))
        said = home / "said"
        alone = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "RERUN_"))}
        options = ["--serve-web", "--bind", "127.0.0.1", "--port", "auto", "--web-viewer-port", "0"]
        with said.open("wb") as log:
            process = subprocess.Popen(
                [program, *options], env=alone | {"HOME": str(home)}, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
        try:
            place = _place(process, said)
            return {name: _fetched(f"{place}/{name}") for name in NAMES}
        except OSError as error:
            raise LinkError(f"Rerun's viewer does not start: {error}") from None
        finally:
            process.kill()
            process.wait()


def _place(process: subprocess.Popen[bytes], said: Path) -> str:
    """Where the program serves the viewer. Raises OSError."""
    deadline = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < deadline:
        if match := re.search(r"web-viewer at (http://127\.0\.0\.1:\d+)", said.read_text("utf-8", "replace")):
            return match[1]
        time.sleep(0.05)
    raise OSError(said.read_text("utf-8", "replace").strip()[-300:] or "it says nothing")


def _fetched(address: str) -> bytes:
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with direct.open(address, timeout=START_S) as reply:
        data: bytes = reply.read()
    return data
