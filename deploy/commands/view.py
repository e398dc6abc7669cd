"""`wireswarm view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from agent.shell.command import Certs
from protocol.text import printable

commands = Typer()


@commands.command(epilog="Example: wireswarm view runs/maze-15-0")
def view(
    run: Annotated[
        Path | None, Argument(help="Run directory.", metavar="DIR", show_default="the newest in runs/")
    ] = None,
    connect: Annotated[str | None, Option(help="Endpoint of a world elsewhere, in place of DIR.")] = None,
    secrets: Annotated[Path | None, Option(help="File of secrets with the viewer's line.")] = None,
    certs: Certs = None,
    save: Annotated[
        Path | None, Option(help="Write a finished run for Rerun's own viewer instead.", metavar="FILE.rrd")
    ] = None,
    browser: Annotated[bool, Option(help="Open it in the browser; else the address is printed only.")] = True,
    beside: Annotated[
        bool, Option("--beside", help="Come before the run, and end with its command.", hidden=True)
    ] = False,
) -> None:
    """Show a run in the browser: world, robots, what each has mapped, whom it tries and trusts.

    A run that is under way is shown as it goes on, a finished one from its begin.
    """
    from protocol.errors import InputError

    if connect is not None and (run is not None or save is not None):
        other = "DIR" if run is not None else "--save"
        raise InputError(f"--connect and {other}: one shows a world elsewhere, one a run directory; leave one out")
    if connect is None and (secrets is not None or certs is not None):
        option = "--secrets" if secrets is not None else "--certs"
        raise InputError(f"{option}: it is for --connect; a run directory needs none, leave it out")
    from deploy.view import command

    if connect is not None:
        command.view_elsewhere(connect, secrets, certs, browser)
    elif save is not None:
        command.save(command.newest() if run is None else run, save)
        print(printable(str(save)))
    else:
        command.view(command.newest() if run is None else run, browser, beside)
