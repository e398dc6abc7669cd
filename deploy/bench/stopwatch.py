"""Where the time of a run goes: calls that are timed by name."""

import os
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any


class Stopwatch:
    """Seconds spent in timed calls, by name."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The call, whose time counts under a name."""

        def run(*arguments: Any, **named: Any) -> Any:
            begin = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                self.seconds[name] += time.perf_counter() - begin

        return run


def load() -> float:
    """Processes that wanted a core in the last minute: above the number of cores, times are too long."""
    return round(os.getloadavg()[0], 2)
