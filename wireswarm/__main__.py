"""`wireswarm` and `python -m wireswarm`: the command line, after the guard of this package has been passed."""


def main() -> None:
    """Entry point of the command `wireswarm`."""
    from deploy.cli import main

    main()


if __name__ == "__main__":
    main()
