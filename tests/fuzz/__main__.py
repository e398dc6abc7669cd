"""Fuzzing: `python -m tests.fuzz SECONDS [TARGET ...]`."""

import sys

from tests.fuzz.runner import main

if __name__ == "__main__":
    from tests.fuzz.targets import TARGETS  # not in the processes of targets, which import it for coverage

    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, sys.argv[2:] or list(TARGETS)))
