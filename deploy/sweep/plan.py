"""The file of a sweep, and the runs that it asks for."""

import hashlib
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence, Set
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field, FiniteFloat

from agent.shell.mind import source_of
from deploy.config import ONE_PROCESS, RunConfig, check_heeded
from protocol.configuration import ConfigError, is_world, put, validated
from protocol.document import read_document
from protocol.errors import InputError
from protocol.settings import MAX_NUMBER, Config
from world.maze import GENERATED
from world.worldfile import LISTS, bundled, load

MAX_RUNS = 100_000  # more are a typing error
PLANNED = ("world", "seed")
"""Settings with a field of their own."""

Settings = dict[str, Any]
"""Values by dotted key."""
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Bound = Annotated[FiniteFloat | int, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
"""No setting is larger, and between larger ones the generator cannot draw."""


class Range(Config):
    """Numbers to draw from; integers where both ends are."""

    low: Bound
    """The smallest one."""
    high: Bound
    """The largest one."""
    log: bool = False
    """Whether their logarithms are drawn evenly, instead of the numbers."""


class Drawn(Config):
    """Settings at random."""

    count: Annotated[int, Field(ge=1, le=MAX_RUNS)]
    """How many combinations."""
    seed: Seed = 0
    """They are drawn from it."""
    settings: dict[str, Range | Annotated[list[Any], Field(min_length=1)]]
    """By dotted key: a range, or a list of which one is taken."""


class SweepFile(Config):
    """What a sweep runs: each world with each combination of settings and each seed."""

    worlds: list[str] = Field(["maze-15"], min_length=1)
    """Names of worlds or world files, the latter seen from the sweep's file."""
    seeds: Annotated[int, Field(ge=1, le=MAX_RUNS)] | Annotated[list[Seed], Field(min_length=1)] = 1
    """How many, from 0 on, or which ones."""
    settings: Settings = Field({})
    """Of all runs, by dotted key."""
    grid: dict[str, Annotated[list[Any], Field(min_length=1)]] = Field({})
    """By dotted key the values of which all combinations are run."""
    cases: list[Settings] = Field([{}], min_length=1)
    """Settings of which one after the other is taken, together with each combination of the grid."""
    drawn: Drawn | None = None
    """Settings at random, together with each of those."""


class Job(NamedTuple):
    """One run of a sweep."""

    key: str
    """Hash of all that decides its result, the source of minds of your own included, but for our code."""
    settings: Settings
    """By dotted key those that the file gives, world and seed included."""
    config: Mapping[str, Any]
    """The whole configuration, as JSON values."""
    world: Any = None
    """Fields of the world's file; None for a bundled or generated world."""
    hashes: Mapping[str, str] = {}
    """Columns of the result that tell which world's file and minds of your own it is of; empty where there are none."""


def read_jobs(file: Path) -> list[Job]:
    """The runs that a file asks for, each once. Raises ConfigError, WorldFileError and InputError."""
    try:
        fields = read_document(file)
        if not isinstance(fields, dict):
            raise ConfigError(f"a sweep is KEY: VALUE, not {type(fields).__name__}")
        if is_world(fields):
            raise ConfigError(f"this is a world: a sweep's file names it, as `worlds: [{file.name}]`")
        plan = validated(SweepFile, fields)
        seeds = range(plan.seeds) if isinstance(plan.seeds, int) else plan.seeds
        drawn = 1 if plan.drawn is None else plan.drawn.count
        factors = len(plan.worlds), len(seeds), len(plan.cases), drawn, *map(len, plan.grid.values())
        if math.prod(factors) > MAX_RUNS:  # asked before they are made: all of a large grid fill any memory
            raise ConfigError(f"more than {MAX_RUNS} runs: divide it, by seeds for instance")
        worlds = {name: _world(file.parent, name) for name in plan.worlds}
        jobs: dict[str, Job] = {}
        for point, (name, document) in product(_points(plan), worlds.items()):
            for job in _jobs({**point, "world": name}, document, seeds):
                jobs.setdefault(job.key, job)
    except InputError as error:
        raise type(error)(f"{file}: {error}") from None
    return list(jobs.values())


def _world(folder: Path, name: str) -> Any:
    """The fields of a world's file that are of a world; None for a bundled or generated one. Raises WorldFileError.

    Files are seen from the folder only: workers do not have what is in this process's.
    """
    if name in bundled() or GENERATED.fullmatch(name):
        load(name)
        return None
    load(file := folder / name)
    document = read_document(file)
    return {key: document[key] for key in ("name", "units", *LISTS) if key in document}


def _points(plan: SweepFile) -> Iterator[Settings]:
    """Combinations of settings."""
    drawn: Sequence[Settings] = [{}] if plan.drawn is None else list(_drawn(plan.drawn))
    grid = [dict(zip(plan.grid, values, strict=True)) for values in product(*plan.grid.values())]
    for some in product(grid, plan.cases, drawn):
        keys = [key for one in (plan.settings, *some) for key in one]
        for key in keys:
            if key in PLANNED:
                raise ConfigError(f"{key}: name it at the top, as {key}s")
        if again := {key for one in some for key in one if sum(key in other for other in some) > 1}:
            raise ConfigError(f"{min(again)}: it stands in more than one of grid, cases and drawn")
        _check_groups(plan.settings, {key for one in some for key in one})
        yield {key: value for one in (plan.settings, *some) for key, value in one.items()}


def _check_groups(settings: Settings, varied: Set[str]) -> None:
    """Raise ConfigError where a group and a part of it would take each other's place.

    Only a part that is varied may stand beside its group in the settings of all runs: it is put into that.
    """
    for key in (*settings, *varied):
        names = key.split(".")
        for group in (".".join(names[:count]) for count in range(1, len(names))):
            if group in varied or (group in settings and key in settings):
                raise ConfigError(f"{group} and {key}: one would replace the other, so write only one of them")


def _drawn(drawn: Drawn) -> Iterator[Settings]:
    rng = np.random.default_rng(drawn.seed)
    for _ in range(drawn.count):
        yield {key: _draw(rng, key, choices) for key, choices in drawn.settings.items()}


def _draw(rng: np.random.Generator, key: str, choices: Range | list[Any]) -> Any:
    if isinstance(choices, list):
        return choices[rng.integers(len(choices))]
    low, high = choices.low, choices.high
    if not low <= high or (choices.log and low <= 0):
        raise ConfigError(f"drawn.settings.{key}: from low to high, and above 0 where log is set")
    whole = isinstance(low, int) and isinstance(high, int)
    if whole and not choices.log:
        return int(rng.integers(int(low), int(high), endpoint=True))
    value = float(np.exp(rng.uniform(np.log(low), np.log(high))) if choices.log else rng.uniform(low, high))
    return min(max(round(value), low), high) if whole else value


def minds_hash(minds: Mapping[str, str], loaded: bool = False) -> str:
    """Of the files in which the minds of your own are written, as in the column `mind.hash`. Raises InputError.

    loaded: as they were when this process loaded them, where it did for a mind; else as they are now.
    """
    return _hash(_source_hashes(minds, loaded))


def _source_hashes(minds: Mapping[str, str], loaded: bool = False) -> dict[str, str]:
    """Of the file of each robot's mind; empty where it has none."""
    before = set(sys.modules)
    files = {robot: source_of(name) for robot, name in minds.items()}
    for name in sys.modules.keys() - before:  # another mind may be in a module that is loaded with these
        if (file := getattr(sys.modules[name], "__file__", None) or "").endswith(".py"):
            _hash_when_loaded(Path(file))
    of = _hash_when_loaded if loaded else _file_hash
    return {robot: "" if file is None else of(file) for robot, file in files.items()}


def _file_hash(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


_hash_when_loaded = cache(_file_hash)


def _hash(content: Any) -> str:
    """Of JSON values; empty of nothing."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8] if content else ""


def _jobs(settings: Settings, document: Any, seeds: Sequence[int]) -> Iterator[Job]:
    """A run for each seed. Their configurations are one but for it, and checked once: there may be 100,000."""
    tree: dict[str, Any] = {}
    for key, value in settings.items():
        put(tree, key, value)
    config = validated(RunConfig, tree)
    check_heeded(config, ONE_PROCESS, "a sweep, of whose runs each is one process,")
    whole = config.model_dump(mode="json")
    minds = _source_hashes(whole["mind"])
    hashes = {"world.hash": _hash(document), "mind.hash": _hash(minds)}
    for seed in seeds:
        seeded = whole | {"seed": seed}
        text = json.dumps([seeded, document, *([minds] if minds else [])], sort_keys=True)
        yield Job(hashlib.sha256(text.encode()).hexdigest()[:24], settings | {"seed": seed}, seeded, document, hashes)
