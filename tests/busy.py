"""`python -m tests.busy [TIMES] [LOOPS]`: the run of `make run` on a machine that is busy with endless loops.

One run without them tells what to write. A line for each tells how long it took and how it ended; the status is 1 where
one did not end complete with all robots and the same bytes.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.disturbed import loops
from tests.same_behaviour import of_run

COMMAND = ("run", "--world", "maze-15", "--robots", "3", "--quiet", "--out")
PATIENCE_S = 1200.0


def one(out: Path) -> tuple[str, dict[str, str]]:
    """How a run ended, and the digests of what its robots wrote. Raises TimeoutExpired."""
    began = time.monotonic()
    command = [sys.executable, "-m", "wireswarm", *COMMAND, str(out)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    taken_s = time.monotonic() - began
    if ended.returncode:
        return f"{taken_s:.1f} s, status {ended.returncode}: {ended.stderr.strip()}", {}
    robots = json.loads((out / "summary.json").read_text())["robots"]
    return f"{taken_s:.1f} s, " + ", ".join(
        sorted(f"{name} {robot['ended']}" for name, robot in robots.items())
    ), of_run(out)


def main(times: int, busy: int) -> int:
    """Run it once alone, and so many times beside so many loops."""
    good = 0
    with tempfile.TemporaryDirectory(prefix="wireswarm-busy-") as place:
        said, expected = one(Path(place, "alone"))
        print(f"alone: {said}", flush=True)
        with loops(busy):
            for k in range(times):
                said, found = one(Path(place, str(k)))
                good += found == expected and said.count("complete") == 3
                print(f"{said}  {'the same bytes' if found == expected else 'OTHER BYTES'}", flush=True)
    print(f"{good} of {times} are complete and the same")
    return 0 if good == times else 1


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    sys.exit(main(given[0] if given else 20, given[1] if len(given) > 1 else 16))
