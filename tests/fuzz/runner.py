"""The runner of the fuzz targets, guided by coverage where atheris is installed.

Each target runs in a process of its own. An input that raises, takes over 0.1 s of CPU twice, or makes memory grow by
over 64 MB is printed and kept in fuzz-failures/, and the status is 1.
"""

import multiprocessing as mp
import random
import resource
import sys
import time
from hashlib import sha256
from pathlib import Path

SLOW_S, GROWTH_MB = 0.1, 64
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


def checked(name: str, data: bytes) -> str | None:
    """Why an input is a failure; None for most."""
    from tests.fuzz.targets import TARGETS

    for _ in range(2):  # the first time may pay for something else, such as garbage
        began = time.thread_time()
        try:
            TARGETS[name].fuzz(data)
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        if time.thread_time() - began < SLOW_S:
            return None
    return f"takes {time.thread_time() - began:.2f} s"


def run_random(name: str, seconds: float, seed: int) -> int:
    """Mutate for so many seconds; returns how many inputs were tried. Raises AssertionError."""
    from tests.fuzz.targets import TARGETS

    rng, seeds = random.Random(seed), TARGETS[name].seeds()
    end, tried, peak = time.monotonic() + seconds, 0, 0
    while time.monotonic() < end:
        data = mutant(rng, seeds)
        if reason := checked(name, data):
            FAILURES.mkdir(exist_ok=True)
            (FAILURES / f"{name}-{sha256(data).hexdigest()[:8]}").write_bytes(data)
            raise AssertionError(f"{name}: {reason}: {data[:200]!r}")
        tried += 1
        now = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        if tried <= 2000:
            peak = now  # caches of honest maps are full by then
        elif now - peak > GROWTH_MB:
            raise AssertionError(f"{name}: memory grew by {now - peak} MB: {data[:200]!r}")
    print(f"{name}: {tried} inputs", flush=True)
    return tried


def run_guided(name: str, seconds: float) -> None:
    """The same with atheris, whose process ends with it."""
    import atheris

    with atheris.instrument_imports(include=["protocol", "agent.communication", "deploy", "world.worldfile"]):
        from tests.fuzz.targets import TARGETS
    FAILURES.mkdir(exist_ok=True)
    corpus = FAILURES.parent / "results" / "fuzz" / name
    corpus.mkdir(parents=True, exist_ok=True)
    for data in TARGETS[name].seeds():
        (corpus / sha256(data).hexdigest()[:16]).write_bytes(data)

    def one(data: bytes) -> None:
        if reason := checked(name, data):
            raise AssertionError(f"{name}: {reason}")

    options = [
        f"-max_total_time={seconds:.0f}",
        "-rss_limit_mb=1024",
        f"-artifact_prefix={FAILURES}/{name}-",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], str(corpus), *options], one)
    atheris.Fuzz()


def main(seconds: float, names: list[str]) -> int:
    """Fuzz these targets one after the other."""
    try:
        import atheris  # noqa: F401
    except ImportError:
        print("atheris is not installed: inputs are mutated without a look at coverage")
        guided = False
    else:
        guided = True
    context, bad = mp.get_context("spawn"), []
    for name in names:
        process = context.Process(
            target=run_guided if guided else run_random, args=(name, seconds) if guided else (name, seconds, 0)
        )
        process.start()
        process.join()
        bad += [name] if process.exitcode else []
    if bad:
        print(f"failures in {', '.join(bad)}: see {FAILURES}/")
    return 1 if bad else 0
