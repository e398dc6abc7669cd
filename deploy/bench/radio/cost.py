"""What the radio costs: its share of a run's time, and whether payload and overhead explain the wires."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from agent.communication.exchange import Exchange
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import explore
from deploy.bench.radio.traffic import BAD
from deploy.bench.tables import Table, columns, whole
from deploy.config import RunConfig
from deploy.launcher import launch
from world.radio import Radio

P = ParamSpec("P")
R = TypeVar("R")

MODELS = [
    {"kind": "line_of_sight"},
    {"kind": "log_distance"},
    {"kind": "gilbert_elliott"},
    {"kind": "asymmetric"},
    *BAD,
]
"""About all that there is."""


def cases(quick: bool) -> list[Case]:
    """Three robots with the default radio and with all models, alone on the machine."""
    world = {"world": "maze-15", "robots": 3, "seed": 0}
    limit = {"until": 150.0 if quick else 300.0}
    return [
        Case("cost/default", measure_share, {"world": {**world, **limit}}, alone=True),
        Case("cost/all models", measure_share, {"world": {**world, **limit, "radio": {"models": MODELS}}}, alone=True),
        Case("wire/lockstep", measure_wire, {"world": {**world, "until": 30.0 if quick else 120.0}}, alone=True),
    ]


def measure_share(world: Mapping[str, Any]) -> Figures:
    """Seconds of a run in one process, and those of them in the gate and in the robots' exchanges."""
    spent = {"gate_s": 0.0, "exchange_s": 0.0}

    def timed(function: Callable[P, R], name: str) -> Callable[P, R]:
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            begin = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                spent[name] += time.perf_counter() - begin

        return call

    explore({**world, "until": 2.0}, {})  # kernels are loaded
    methods: list[tuple[type, str, str]] = [
        (Radio, "offer", "gate_s"),
        (Radio, "deliver", "gate_s"),
        (Radio, "check", "gate_s"),
        (Exchange, "hear", "exchange_s"),
        (Exchange, "talk", "exchange_s"),
    ]
    before = [getattr(kind, method) for kind, method, _ in methods]
    try:
        for kind, method, name in methods:
            setattr(kind, method, timed(getattr(kind, method), name))
        begin = time.perf_counter()
        run = explore(world, {})
        total = time.perf_counter() - begin
    finally:
        for (kind, method, _), function in zip(methods, before, strict=True):
            setattr(kind, method, function)
    ticks = run.episode.tick
    return {"ticks": ticks, "total_s": total, **spent, "share": sum(spent.values()) / total}


def measure_wire(world: Mapping[str, Any]) -> Figures:
    """Wire, payload and overhead bytes of a run with processes. Raises RuntimeError where it did not end as asked."""
    config = RunConfig.model_validate(dict(world))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        result = launch(config, out, command_line=[])
        if result.errors or result.ended != "time":
            raise RuntimeError(f"the run ended as {result.ended}: {'; '.join(result.errors) or 'no reason given'}")
        wire = json.loads((out / "bandwidth.json").read_text(encoding="utf-8")).get("wire", {})
        factor = json.loads((out / "summary.json").read_text(encoding="utf-8"))["real_time_factor"]
    flows = [flow for robot in wire.values() for flow in robot.values()]
    keys = ("messages", "payload_bytes", "overhead_bytes", "wire_bytes")
    sums = {key: sum(flow[key] for flow in flows) for key in keys}
    worst = max((abs(flow["unexplained_share"]) for flow in flows), default=None)
    return {**sums, "unexplained": worst, "real_time_factor": factor}


TABLES = [
    Table(
        "cost",
        "Share of a run's time",
        whole("cost/{radio}"),
        columns("radio; ticks; total_s: run s; gate_s; exchange_s; share <= 0.05"),
        note="Three robots in maze-15, in one process, which is all work.",
    ),
    Table(
        "wire",
        "Bytes on the wires",
        whole("wire/{run}"),
        columns(
            "run; messages; payload_bytes; overhead_bytes; wire_bytes; unexplained <= 0.01: unexplained, worst link; "
            "real_time_factor"
        ),
        note="Of all links and directions.",
    ),
]
