"""The two settings of sensing that runs and benchmarks compare: the paper's, and that of a real robot."""

from collections.abc import Mapping
from contextvars import ContextVar
from typing import Any

from protocol.messages import RobotSpec

IDEAL: dict[str, Any] = {
    "lidar": {"turning": False, "noise_share": 0.0, "grazing_deg": 0.0, "mixed": 0.0},
    "odometry": {"noisy": False},
}
"""Settings of `spec` for the paper's sensing: a lidar that looks everywhere at once, and exact odometry."""

_DEFAULT = RobotSpec().model_dump()

REAL: dict[str, Any] = {part: {key: _DEFAULT[part][key] for key in settings} for part, settings in IDEAL.items()}
"""The same settings for a TurtleBot3 Burger with its LDS-01: the defaults, each of which says where it is from."""


IDEAL_BENCHMARK: ContextVar[bool] = ContextVar("IDEAL_BENCHMARK", default=False)
"""Whether the runs of the benchmark that is measured have the paper's sensing, where they do not say otherwise."""


def of_benchmark(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a run with the benchmark's sensing."""
    spec, own = IDEAL if IDEAL_BENCHMARK.get() else {}, settings.get("spec", {})
    return {**settings, "spec": {**own, **{part: some | own.get(part, {}) for part, some in spec.items()}}}


def named(spec: RobotSpec) -> str:
    """What a robot's sensing is called in tables: `ideal`, `real`, or `as set`."""
    for name, settings in (("ideal", IDEAL), ("real", REAL)):
        if all(
            getattr(getattr(spec, part), key) == value for part, some in settings.items() for key, value in some.items()
        ):
            return name
    return "as set"
