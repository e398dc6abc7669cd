"""What the command lines of all programs have in common: signals, and errors as a sentence and an exit status."""

import os
import re
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from protocol.errors import InputError, LinkError, ProtocolError, RefusedError
from protocol.status import Status
from protocol.text import in_own_words, printable

if TYPE_CHECKING:
    from protocol.inbox import Inbox

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C and the end that a system asks for, which mean the same to every command."""
MAX_SENTENCE = 600  # characters of an error: longer ones quote what was given

for _library in ("OPENBLAS", "OMP", "MKL", "NUMBA"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")  # small arrays: threads would only wait for each other


def say(sentence: str) -> None:
    """Tell the user on stderr, where anybody listens."""
    with suppress(OSError):
        print(f"wireswarm: {printable(sentence):.{MAX_SENTENCE}}", file=sys.stderr, flush=True)


def tell(words: str) -> None:
    """Print on stdout. Where nobody reads it any more (`| head`), what goes on says the rest to nobody."""
    try:
        print(words, flush=True)
    except OSError:
        hush(sys.stdout)


def hush(stream: IO[str]) -> None:
    """Have a stream that nobody reads any more write to nowhere: else the end of Python would raise that again."""
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def stop_on_signals(inbox: "Inbox") -> None:
    """End at the next tick on Ctrl-C or SIGTERM; at once on a second."""

    def handler(number: int, frame: object) -> None:
        inbox.stop()
        signal.signal(number, signal.SIG_DFL)

    for number in SIGNALS:
        signal.signal(number, handler)


def mend_streams() -> None:
    """Have stdin, stdout and stderr open, and print what their encoding lacks as a question mark.

    Where one was closed (`>&-`), the next file or socket would get its number, and hear all that is printed.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w", closefd=False))
        getattr(sys, name).reconfigure(errors="replace")


def run(app: Callable[..., Any]) -> None:
    """Run a Typer app and exit: what a user can act on becomes one sentence and an exit status."""
    from typer import Abort

    mend_streams()

    try:
        sys.exit(app(standalone_mode=False))
    except (InputError, RefusedError) as error:
        say(str(error))
        sys.exit(Status.USAGE)
    except (LinkError, ProtocolError, OSError) as error:
        say("the working directory is gone: change into one that is there" if _is_nowhere(error) else str(error))
        sys.exit(Status.FAILURE)
    except (Abort, KeyboardInterrupt):
        sys.exit(Status.INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):  # Typer has Click's errors, but no public name for all of them
            raise
        say(_sentence(error) or "which command? `--help` lists them")
        sys.exit(Status.USAGE)


def _is_nowhere(error: Exception) -> bool:
    """Whether an error that names no file is that of a working directory that was removed."""
    if isinstance(error, FileNotFoundError) and error.filename is None:
        try:
            Path.cwd()
        except FileNotFoundError:
            return True
    return False


def _sentence(error: Any) -> str:
    """What Typer says of a command line, in our words: of a wrong value, its option and what it takes."""
    text = " ".join(error.format_message().split())  # choices stand in lines of their own
    wrong = re.fullmatch(r"Invalid value for '(?P<option>[^']+)': (?P<wish>.*?)\.?", text)
    return f"{wrong['option']}: {in_own_words(wrong['wish'])}" if wrong else text
