"""The radio's share of a run's time, and whether payload and overhead add up to the bytes on the wires."""

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

from agent.communication.exchange import Exchange
from deploy.bench.cases import Case, Figures
from deploy.bench.explored import Stopwatch, explore, launched, read_json
from deploy.bench.radio.traffic import BAD
from deploy.bench.tables import Table, whole
from world.radio.gate import Radio

MODELS = [{"kind": kind} for kind in ("line_of_sight", "log_distance", "gilbert_elliott", "asymmetric")] + BAD
"""Nearly all models that there are."""
TIMED = {"gate_s": (Radio, ("offer", "deliver", "check")), "exchange_s": (Exchange, ("hear", "talk"))}
"""Classes and their methods whose calls are timed."""


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
    clock = Stopwatch()
    explore({**world, "until": 2.0}, {})  # kernels are loaded
    with ExitStack() as stack:
        for name, (kind, methods) in TIMED.items():
            for method in methods:
                stack.enter_context(patch.object(kind, method, clock.timed(name, getattr(kind, method))))
        run = clock.timed("total_s", explore)(world, {})
    spent = dict(clock.seconds)
    share = (spent["gate_s"] + spent["exchange_s"]) / spent["total_s"]
    return {"ticks": run.episode.tick, **spent, "share": share}


def measure_wire(world: Mapping[str, Any]) -> Figures:
    """Wire, payload and overhead bytes of a run with processes. Raises RuntimeError where it did not end as asked."""
    with launched(world) as (folder, ended):
        if ended != "time":
            raise RuntimeError(f"the run ended as {ended}")
        wire = read_json(folder / "bandwidth.json").get("wire", {})
        factor = read_json(folder / "summary.json")["real_time_factor"]
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
        "radio; ticks; total_s: run s; gate_s; exchange_s; share <= 0.05",
        note="Three robots in maze-15, in one process, which is all work.",
    ),
    Table(
        "wire",
        "Bytes on the wires",
        whole("wire/{run}"),
        "run; messages; payload_bytes; overhead_bytes; wire_bytes; unexplained <= 0.01: unexplained, worst link; "
        "real_time_factor",
        note="Of all links and directions.",
    ),
]
