"""A recording shown to whoever called the command: the address in the terminal, and the page in the browser."""

import os
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager

from deploy.view.serving import Tape, served
from deploy.view.web_viewer import viewer_files


@contextmanager
def show(tape: Tape, browser: bool) -> Iterator[None]:
    """Serve a tape, from its begin to all who come. Raises LinkError where Rerun does not start."""
    with served(tape, viewer_files()) as (address, once):
        print(f"{address}\nThe address is a key to the truth of this run. Ctrl-C ends the view.", flush=True)
        if browser and (sys.platform in ("darwin", "win32") or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
            webbrowser.open(once)  # without a display it would be a browser in this terminal
        yield
