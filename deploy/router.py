"""`wireswarm router`: a Zenoh router between a world and its robots, run here or configured for `zenohd`."""

from pathlib import Path

from protocol.command import tell
from protocol.credentials import of_router
from protocol.files import check_has_folder, write_whole
from protocol.inbox import Inbox
from protocol.session import check_endpoint, check_reach, open_router, router_config


def write_config(file: Path, listen: str, secrets: Path | None, certs: Path | None, *, insecure: bool) -> None:
    """Write a configuration for a router of others: `zenohd --config FILE`. It names keys or secrets where they are.

    Raises InputError, UnwritableError.
    """
    check_has_folder(file, "--write")
    credentials, guard = of_router(secrets, certs)
    check_endpoint(listen, credentials)
    if credentials is None and not insecure:
        check_reach(listen)
    write_whole(file, router_config(listen, guard), private=True)


def route(listen: str | None, secrets: Path | None, certs: Path | None, inbox: Inbox, *, insecure: bool) -> None:
    """Be a router until the inbox is stopped. Raises InputError."""
    credentials, _ = of_router(secrets, certs)
    with open_router(listen, credentials, insecure=insecure) as (_, endpoint):
        tell(f"listening on {endpoint}")
        while not inbox.stopped:
            inbox.next()
