"""The runner of the fuzz targets, guided by coverage where atheris is installed.

Each target runs in a process of its own. An input that raises, takes over 0.1 s of CPU twice, or makes memory grow by
over 64 MB is printed and kept in fuzz-failures/, and the status is 1.
"""

import multiprocessing as mp
import random
import resource
import sys
import time
from collections.abc import Callable
from hashlib import sha256
from importlib.util import find_spec
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

SLOW_S, GROWTH_MB = 0.1, 64
FIRST = 2000  # inputs after which caches of honest maps are full
FAILURES = Path("fuzz-failures")


def mutant(rng: random.Random, seeds: list[bytes]) -> bytes:
    """A seed with some bytes changed, cut, doubled, or joined to another seed."""
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 4, 8))):
        at, end = sorted(rng.randrange(len(data) + 1) for _ in range(2))
        match rng.randrange(7):
            case 0:
                del data[at:end]
            case 1:
                data[at:at] = data[at:end][:64]
            case 2:
                data[at:at] = rng.choice(
                    (b"\xff", b"\0", b"[", b"{", b"9", b"-", b"1e999", b'"', b"\x1b", b",", b"nan", b"\n")
                )
            case 3:
                other = rng.choice(seeds)
                data[at:] = other[rng.randrange(len(other) + 1) :]
            case _ if at < len(data):
                data[at] = rng.choice((data[at] ^ 1 << rng.randrange(8), rng.randrange(256)))
    return bytes(data)


def checked(name: str, data: bytes) -> tuple[str | None, float]:
    """Why an input is a failure, None for most, and the CPU seconds that it took."""
    from tests.fuzz.targets import TARGETS

    for _ in range(2):  # the first time may pay for something else, such as garbage
        began = time.thread_time()
        try:
            TARGETS[name].fuzz(data)
        except Exception as error:
            return f"{type(error).__name__}: {error}", 0.0
        taken_s = time.thread_time() - began
        if taken_s < SLOW_S:
            return None, taken_s
    return f"takes {taken_s:.2f} s", taken_s


class Memory:
    """How much that of this process has grown since its first inputs."""

    def __init__(self) -> None:
        self._first = self._inputs = 0

    def grown(self) -> int:
        """MB, after one input more."""
        self._inputs += 1
        now = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        if self._inputs <= FIRST:
            self._first = now
        return now - self._first


def run_random(name: str, seconds: float, tried: "Synchronized[int]", seed: int) -> None:
    """Mutate for so many seconds, and tell the worst; tried counts the inputs. Raises AssertionError."""
    from tests.fuzz.targets import TARGETS

    rng, seeds = random.Random(seed), TARGETS[name].seeds()
    end, memory, grown, slowest_s = time.monotonic() + seconds, Memory(), 0, 0.0
    while time.monotonic() < end:
        data = mutant(rng, seeds)
        reason, taken_s = checked(name, data)
        slowest_s = max(slowest_s, taken_s)
        if reason:
            FAILURES.mkdir(exist_ok=True)
            (FAILURES / f"{name}-{sha256(data).hexdigest()[:8]}").write_bytes(data)
            raise AssertionError(f"{name}: {reason}: {data[:200]!r}")
        tried.value += 1
        if (grown := memory.grown()) > GROWTH_MB:
            raise AssertionError(f"{name}: memory grew by {grown} MB: {data[:200]!r}")
    print(f"{name}: the slowest took {slowest_s:.3f} s, memory grew by {grown} MB")


def run_guided(name: str, seconds: float, tried: "Synchronized[int]") -> None:
    """The same with atheris, whose process ends with it."""
    import atheris

    with atheris.instrument_imports(include=["protocol", "agent", "deploy", "world"], exclude=_compiled()):
        from tests.fuzz.targets import TARGETS
    FAILURES.mkdir(exist_ok=True)
    corpus = FAILURES.parent / "results" / "fuzz" / name
    corpus.mkdir(parents=True, exist_ok=True)
    for data in TARGETS[name].seeds():
        (corpus / sha256(data).hexdigest()[:16]).write_bytes(data)

    memory = Memory()

    def one(data: bytes) -> None:
        tried.value += 1
        reason, _ = checked(name, data)
        if reason:
            raise AssertionError(f"{name}: {reason}")
        if (grown := memory.grown()) > GROWTH_MB:
            raise AssertionError(f"{name}: memory grew by {grown} MB")

    options = [
        f"-max_total_time={seconds:.0f}",
        "-rss_limit_mb=1024",
        f"-artifact_prefix={FAILURES}/{name}-",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], str(corpus), *options], one)
    atheris.Fuzz()


def _compiled() -> list[str]:
    """Modules with code for numba, which cannot compile the counters of atheris."""
    root = Path(__file__).parents[2]
    files = (file for file in root.glob("[ad]*/**/*.py") if "from agent.kernels import" in file.read_text("utf-8"))
    return ["protocol.geometry", *(".".join(file.relative_to(root).with_suffix("").parts) for file in files)]


def main(seconds: float, names: list[str], seed: int = 0) -> int:
    """Fuzz these targets one after the other, and tell how many inputs that were; seed: where nothing guides."""
    run: Callable[..., None] = run_guided
    more: tuple[Any, ...] = ()
    if find_spec("atheris") is None:
        print("atheris is not installed: inputs are mutated without a look at coverage")
        run, more = run_random, (seed,)
    context, bad, total = mp.get_context("spawn"), [], 0
    for name in names:
        tried = context.Value("Q", 0)  # shared, because atheris ends its process
        process = context.Process(target=run, args=(name, seconds, tried, *more))
        process.start()
        process.join()
        total += tried.value
        print(f"{name}: {tried.value:,} inputs", flush=True)
        bad += [name] if process.exitcode else []
    print(f"{total:,} inputs in all")
    if bad:
        print(f"failures in {', '.join(bad)}: see {FAILURES}/")
    return 1 if bad else 0
