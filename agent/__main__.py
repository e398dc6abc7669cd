"""`python -m agent`: one robot, with nothing of this project but `agent` and `protocol`."""

from typer import Typer

from agent.shell.command import agent
from protocol.command import run

if __name__ == "__main__":
    app = Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)  # works without rich
    app.command()(agent)
    run(app)
