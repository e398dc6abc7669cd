"""The command `wireswarm`."""

import sys
from typing import Annotated

from typer import Exit, Option, Typer

from agent.shell.command import agent
from deploy.commands import experiments, files, hosts, lists, results, run, view, world
from protocol import command
from protocol.command import say
from protocol.status import Status

EXTRAS = {
    "pymunk": "world",
    "ezdxf": "export",
    "defusedxml": "export",
    "foxglove": "export",
    "rosbags": "bags",
} | dict.fromkeys(("cryptography", "matplotlib", "PIL", "psutil", "rich"), "deploy")
EXTRAS |= dict.fromkeys(("dask", "distributed", "pyarrow"), "sweep")  # what brings a package
EXTRAS |= dict.fromkeys(("rerun", "rerun_cli"), "view")

app = Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: wireswarm run --world office --robots 4",
)


@app.callback(invoke_without_command=True)
def wireswarm(
    show_version: Annotated[bool, Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    """Small robots map a building together as wireframes: trust, but verify."""
    if show_version:
        from importlib.metadata import version

        print(f"wireswarm {version('wireswarm')}")
        raise Exit


for _part in (run, world):
    app.add_typer(_part.commands)
app.command(epilog="Example: wireswarm agent --id r1 --connect tls/HOST:7447 --certs certs")(agent)
for _part in (hosts, results, view, files, lists, experiments):
    app.add_typer(_part.commands)


def main() -> None:
    """Entry point of `wireswarm`."""
    try:
        command.run(app)
    except ModuleNotFoundError as error:
        package = (error.name or "").split(".")[0]
        extra = EXTRAS.get(package)
        if extra is None:
            raise
        say(f"this command needs {package}: install it with `pip install 'wireswarm[{extra}]'`")
        sys.exit(Status.USAGE)
