"""Compile the numba kernels once, at installation, so that the first run does not spend its time on it.

What was compiled is kept, and compiled again where it changed, so this is never needed, only kind.
"""

from __future__ import annotations

import gc
import sys
import time

TICKS = 600
"""Two simulated minutes of two robots, which meet, align, verify and merge: every kernel with its types."""


def warm() -> None:
    """Let two robots step through the beginning of a run, in this process, recording nothing."""
    from agent.config import AgentConfig
    from deploy.inprocess import run
    from world.config import WorldConfig

    run(WorldConfig(world="apartment", robots=2, until=TICKS * 0.2), AgentConfig(), None)


def main() -> None:
    """Warm up; a failure is told and is none of the installation, since a run compiles what it needs."""
    begin = time.perf_counter()
    gc.disable()  # numba makes millions of objects that live on
    try:
        warm()
    except Exception as error:
        print(f"kernels are not compiled yet: {type(error).__name__}: {error}", file=sys.stderr)
    else:
        print(f"kernels compiled in {time.perf_counter() - begin:.1f} s")


if __name__ == "__main__":
    main()
