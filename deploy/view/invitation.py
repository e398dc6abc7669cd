"""How a viewer finds a run that is under way: a file in its directory that only its owner can read."""

import json
from contextlib import suppress
from pathlib import Path

from protocol.access import VIEWER
from protocol.document import read_text
from protocol.errors import InputError
from protocol.files import write_whole
from protocol.secrets import Secrets

FILE = "viewer.json"


def invite(run: Path, endpoint: str, secrets: Secrets | None) -> None:
    """Write the world's endpoint and the viewer's secret, by which all may be read. Raises UnwritableError."""
    secret = None if secrets is None else secrets[VIEWER]
    write_whole(run / FILE, json.dumps({"endpoint": endpoint, "secret": secret}), private=True, durable=False)


def withdraw(run: Path) -> None:
    """Remove the file of a run that has ended. Where it cannot be removed, its secret opens nothing any more."""
    with suppress(OSError):
        (run / FILE).unlink()


def invited(run: Path) -> tuple[str, Secrets | None]:
    """Endpoint and credentials of a run that is under way. Raises InputError where the file is no such one."""
    try:
        told = json.loads(read_text(run / FILE))
        endpoint, secret = told["endpoint"], told["secret"]
        if not isinstance(endpoint, str) or not isinstance(secret, str | None):
            raise ValueError("an endpoint and a secret are wanted")
    except InputError as error:
        raise InputError(f"{run / FILE}: {error}") from None
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise InputError(f"{run / FILE}: no invitation of a run: {error}") from None
    return endpoint, None if secret is None else Secrets({VIEWER: secret})
