"""Several hosts: the router between them, and the identities of all."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from agent.shell.command import Certs
from deploy.commands.options import Listen
from protocol.command import stop_on_signals

commands = Typer()


@commands.command(epilog="Example: wireswarm router --listen tls/0.0.0.0:7447 --certs certs")
def router(
    listen: Listen = None,
    secrets: Annotated[Path | None, Option(help="File of secrets, with a line of the world.")] = None,
    certs: Certs = None,
    insecure: Annotated[bool, Option("--insecure", help="Let anybody connect who reaches the address.")] = False,
    write: Annotated[
        Path | None, Option(help="Write the configuration for `zenohd --config FILE` instead.", metavar="FILE")
    ] = None,
) -> None:
    """Run a Zenoh router between a world and its robots, with their access control."""
    from deploy.router import route, write_config
    from protocol.errors import InputError
    from protocol.inbox import Inbox

    if write is not None:
        if listen is None:
            raise InputError("--write: name the endpoint, too, such as --listen tls/0.0.0.0:7447")
        write_config(write, listen, secrets, certs, insecure=insecure)
        return
    stop_on_signals(inbox := Inbox())
    route(listen, secrets, certs, inbox, insecure=insecure)


@commands.command("certs", epilog="Example: wireswarm certs certs --robots 2 --host 192.168.1.7")
def certs_(
    folder: Annotated[Path, Argument(help="Folder of certificates.", metavar="DIR")],
    robots: Annotated[str | None, Option(help="How many robots, or their names.", metavar="N|r1,r2")] = None,
    host: Annotated[
        list[str] | None,
        Option(help="A further address or name by which the world, or the router before it, is reached."),
    ] = None,
    revoke: Annotated[str | None, Option(help="Whose certificate counts no longer.", metavar="NAME")] = None,
) -> None:
    """Make identities for a world, a viewer and robots, by which they know each other over TLS."""
    from deploy.certs import issue, names_of
    from deploy.certs import revoke as end
    from protocol.errors import InputError

    if revoke is not None:
        if robots or host:
            raise InputError("--revoke: it goes alone; make another identity afterwards")
        end(folder, revoke)
        print(f"{revoke} is revoked; copies of {folder / 'roster.json'} on other hosts must be replaced")
        return
    made = issue(folder, names_of(robots), host or [])
    print(
        f"made {', '.join(made)} in {folder}\nA robot's host needs ca.pem, and NAME.pem and NAME.key of its robot; the "
        "world's ca.pem, world.pem, world.key and roster.json. ca.key stays here: who has it can make identities."
    )
