"""The figures of `wireswarm bench sensing`: path errors, and what sensing is called."""

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from deploy.bench import lockstep
from deploy.bench.explored import Tracks
from deploy.config import RunConfig
from deploy.sensing import IDEAL, IDEAL_BENCHMARK, REAL, named, of_benchmark
from protocol.geometry import compose
from protocol.messages import RobotSpec


def test_a_path_is_judged_after_the_best_fit_and_as_it_is_in_the_own_frame() -> None:
    frame, tracks = (3.0, -1.0, 0.7), Tracks()
    for k in range(200):
        own = (k * 0.05, math.sin(k / 20), 0.0)
        tracks.true.append(np.array([(9.0, 9.0, 9.0), compose(frame, own)]))
        tracks.believed["r2"].append(compose((0.1, 0.2, 0.01), own))  # as another frame: a fit takes it out
        tracks.odometry["r2"].append((own[0], own[1] + 0.5, 0.0))
    errors = tracks.errors(1, "r2", frame)
    assert errors["path_rms_m"] == pytest.approx(0, abs=1e-5) and errors["path_max_m"] == pytest.approx(0, abs=1e-5)
    assert errors["odometry_rms_m"] == pytest.approx(0.5)
    assert errors["frame_rms_m"] == pytest.approx(0.26, abs=0.03)


def test_a_benchmark_with_ideal_sensing_leaves_alone_what_its_runs_set() -> None:
    settings = {"world": "office", "spec": {"lidar": {"noise_m": 0.03}, "odometry": {"noisy": True}}}
    assert of_benchmark(settings) == settings
    token = IDEAL_BENCHMARK.set(True)
    found = of_benchmark(settings)["spec"]
    IDEAL_BENCHMARK.reset(token)
    assert found["lidar"] == IDEAL["lidar"] | {"noise_m": 0.03} and found["odometry"] == {"noisy": True}


def test_lockstep_compares_processes_and_one_process_of_one_sensing(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    def run(config: RunConfig, _agent: object, _out: object, keep: Callable[[None], None], _mind: object) -> None:
        seen.append(named(config.spec))
        keep(None), keep(None)

    def launch(config: RunConfig, out: Path, **_: object) -> SimpleNamespace:
        seen.append(named(config.spec))
        out.mkdir()
        (out / "summary.json").write_text('{"real_time_factor": 9.0}')
        return SimpleNamespace(errors=(), ended="time")

    monkeypatch.setattr("deploy.inprocess.run", run)
    monkeypatch.setattr("deploy.bench.explored.launch", launch)
    for ideal in (True, False):
        token = IDEAL_BENCHMARK.set(ideal)
        lockstep.measure("apartment", 1, 10)
        IDEAL_BENCHMARK.reset(token)
    assert seen == ["ideal", "ideal", "real", "real"]


def test_sensing_has_a_name() -> None:
    assert named(RobotSpec.model_validate(IDEAL)) == "ideal"
    assert named(RobotSpec.model_validate(REAL)) == "real"
    assert named(RobotSpec.model_validate(REAL | {"odometry": {"noisy": False}})) == "as set"
