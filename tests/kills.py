"""`python -m tests.kills [RUNS] [OUT]`: whole runs in which each robot and the world are killed once, at random ticks.

A table of how each ended, what its maps lost to those of the undisturbed run, and the longest time without a tick. The
status is 1 where one did not end complete, lost more than 0.02, stood still for over 10 s, or its books do not balance.
"""

import random
import sys
import tempfile
import time
from pathlib import Path

import psutil

from deploy.bandwidth.books import NoRunError, read_books
from deploy.config import RunConfig
from deploy.launch.launcher import launch
from deploy.metrics import score_walls, truth_of
from deploy.report.rundir import read_run
from protocol.geometry import apply
from protocol.messages import Progress
from world.worldfile import load

WORLD, ROBOTS = "apartment", 3
LOSS, HANG_S = 0.02, 10.0


class Killer:
    """Follows a run, kills its world once at a tick, and knows the longest time in which no tick passed."""

    def __init__(self, tick: float) -> None:
        self.tick, self.killed = tick, -1
        self.last, self.longest_s, self.since = -1, 0.0, 0.0

    def __call__(self, progress: Progress) -> None:
        tick, now = progress.clock.tick, time.monotonic()
        if tick != self.last:
            self.longest_s = max(self.longest_s, now - self.since if self.last >= 0 else 0.0)
            self.last, self.since = tick, now
        if self.killed < 0 and tick >= self.tick:
            for child in psutil.Process().children(recursive=True):
                if any(link.status == psutil.CONN_LISTEN for link in child.net_connections("tcp")):
                    child.kill()
                    self.killed = tick


def run(out: Path, faults: list[str], world_tick: float) -> tuple[str, dict[str, float], Killer]:
    """How a run ended, the worth of each robot's map (the mean of wall recall and precision), and its killer."""
    config = RunConfig(world=WORLD, robots=ROBOTS, seed=0, faults=faults, restart=bool(faults))
    killer = Killer(world_tick)
    result = launch(config, out, show=killer)
    world, found = load(config.world), read_run(out)
    worth = {}
    for robot, frame in found.frames.items():
        truth = truth_of(world, frame[:2], config.spec.radius_m, config.spec.lidar.range_max_m)
        drawn = found.maps[robot]
        scored = score_walls(apply(frame, drawn.vertices)[drawn.edges].reshape(-1, 4), truth)
        worth[robot] = (scored.recall + scored.precision) / 2
    read_books(out)  # raises NoRunError where they do not balance
    return f"{result.ended} ({result.status})", worth, killer


def main(runs: int, folder: Path) -> int:
    """Run them one after the other."""
    rng, bad = random.Random(0), 0
    ended, whole, killer = run(folder / "undisturbed", [], float("inf"))
    last = killer.last
    print(f"undisturbed: {ended} at tick {last}, worth {whole}", flush=True)
    for number in range(runs):
        faults = [f"r{k}@{rng.randrange(2, last)}" for k in range(1, ROBOTS + 1)]
        try:
            ended, worth, killer = run(folder / str(number), faults, rng.randrange(2, last))
        except NoRunError as error:
            ended, worth = str(error), {}
        loss = max((whole[robot] - worth.get(robot, 0.0) for robot in whole), default=1.0)
        fine = ended == "complete (0)" and loss <= LOSS and killer.longest_s <= HANG_S and killer.killed >= 0
        bad += not fine
        what = " ".join([*faults, f"world@{killer.killed}"])
        print(
            f"{what}: {ended}, lost {loss:+.4f}, longest {killer.longest_s:.1f} s{'' if fine else '  BAD'}", flush=True
        )
    print(f"{runs - bad} of {runs} are fine")
    return 1 if bad else 0


if __name__ == "__main__":
    asked = sys.argv[1:]
    place = Path(asked[1]) if len(asked) > 1 else Path(tempfile.mkdtemp(prefix="wireswarm-kills-"))
    sys.exit(main(int(asked[0]) if asked else 20, place))
