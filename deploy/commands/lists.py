"""What there is: the bundled worlds, and the settings."""

from __future__ import annotations

from typing import Annotated

from typer import Argument, Option, Typer

commands = Typer()


@commands.command(epilog="Example: wireswarm worlds --json")
def worlds(as_json: Annotated[bool, Option("--json", help="Print the sizes as JSON.")] = False) -> None:
    """List the bundled worlds: sizes, walls, free area, and a small drawing."""
    from deploy.terminal.worlds import to_json, to_text

    print(to_json() if as_json else to_text())


@commands.command("config", epilog="Example: wireswarm config radio --yaml")
def config_(
    of: Annotated[str, Argument(help="A setting or a group of them, such as radio.", metavar="[KEY]")] = "",
    as_yaml: Annotated[bool, Option("--yaml", help="Print a file for --config with all defaults.")] = False,
    as_json: Annotated[bool, Option("--json", help="Print JSON.")] = False,
) -> None:
    """List the settings: default, unit and reason."""
    from deploy.terminal.settings import to_json, to_text, to_yaml

    print(to_json(of) if as_json else to_yaml(of) if as_yaml else to_text(of))
