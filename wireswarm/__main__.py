"""`wireswarm` and `python -m wireswarm`: the command line, after the guard of this package has been passed."""

from deploy.cli import main

if __name__ == "__main__":
    main()
