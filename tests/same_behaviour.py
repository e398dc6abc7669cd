"""Whether robots behave as at another commit: the same maps, events and paths, byte for byte.

    python -m tests.same_behaviour e12916e [--quick]

Runs the bundled worlds with three robots and ideal sensing, seeds 0 and 1, in one process each, from both sources on
this machine, and compares the SHA-256 of what they wrote. Status 1 where anything differs. Digests of a commit are kept
under results/same_behaviour/, as they do not change.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORLDS = ("apartment", "hall", "maze-15", "office", "symmetric")
SEEDS = (0, 1)
COMPARED = ("maps/*.json", "events.jsonl", "trajectories/*.tum")

RUN = """
import sys
from pathlib import Path
from agent.config import AgentConfig
from deploy.inprocess import run
from world.config import WorldConfig
try:
    from deploy.sensing import IDEAL
except ImportError:
    IDEAL = {}
world, seed, out = sys.argv[1:]
config = WorldConfig.model_validate({"world": world, "robots": 3, "seed": int(seed), "spec": IDEAL})
run(config, AgentConfig(), Path(out))
"""
"""Works with the sources of every commit since e12916e; the first ones knew ideal sensing only."""


def digests(sources: Path, world: str, seed: int) -> dict[str, str]:
    """SHA-256 by file of a run of three robots with the sources of a checkout."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        environment = {**os.environ, "PYTHONPATH": str(sources), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-c", RUN, world, str(seed), str(out)]
        subprocess.run(command, cwd=sources, env=environment, check=True, timeout=1800)
        return of_run(out)


def of_run(out: Path) -> dict[str, str]:
    """SHA-256 by file of what robots wrote into a run directory."""
    files = sorted(file for pattern in COMPARED for file in out.glob(pattern))
    return {str(file.relative_to(out)): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def of_checkout(sources: Path, cases: list[tuple[str, int]]) -> dict[str, dict[str, str]]:
    """Digests by case. One case runs before the others, so that kernels are compiled only once."""
    first, *others = cases
    found = {"-".join(map(str, first)): digests(sources, *first)}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        results = pool.map(lambda case: digests(sources, *case), others)
        found.update({"-".join(map(str, case)): result for case, result in zip(others, results, strict=True)})
    return found


def of_commit(revision: str, cases: list[tuple[str, int]]) -> dict[str, dict[str, str]]:
    """Digests by case with the sources of a commit, from a temporary work tree of it."""
    full = _git("rev-parse", f"{revision}^{{commit}}")
    kept = ROOT / "results" / "same_behaviour" / f"{full}.json"
    known: dict[str, dict[str, str]] = json.loads(kept.read_text()) if kept.exists() else {}
    missing = [case for case in cases if "-".join(map(str, case)) not in known]
    if missing:
        with tempfile.TemporaryDirectory() as folder:
            tree = Path(folder) / "tree"
            _git("worktree", "add", "--detach", str(tree), full)
            try:
                known.update(of_checkout(tree, missing))
            finally:
                _git("worktree", "remove", "--force", str(tree))
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(known, indent=1))
    return known


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True, timeout=60)
    return done.stdout.strip()


def main() -> int:
    """Compare this checkout with a commit, and print a line a case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit")
    parser.add_argument("--quick", action="store_true", help="two runs instead of ten")
    options = parser.parse_args()
    cases = [("apartment", 0), ("maze-15", 1)] if options.quick else [(w, s) for w in WORLDS for s in SEEDS]
    theirs, ours = of_commit(options.commit, cases), of_checkout(ROOT, cases)
    differ = False
    for case, found in ours.items():
        other = sorted(file for file in found.keys() | theirs[case].keys() if found.get(file) != theirs[case].get(file))
        differ = differ or bool(other)
        print(f"{case:<14}", f"differs: {', '.join(other)}" if other else f"{len(found)} files the same")
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
