"""`wireswarm` and `python -m wireswarm`: the command line, after the guard of this package has been passed."""

from wireswarm.interrupts import ignore


def main() -> None:
    """Run the command. A process forked from it imports this module, and needs no command line."""
    from deploy.cli import main as command

    try:
        command()
    finally:
        ignore()


if __name__ == "__main__":
    main()
