"""The file of a sweep: what it asks for, and what is refused."""

import hashlib
import json
import re
from pathlib import Path

import pytest

from deploy.config import RunConfig
from deploy.revision import ROOT
from deploy.sweep.plan import read_jobs
from protocol.configuration import validated
from protocol.errors import InputError
from tests.deploy.sweep.sweeps import write_sweep


def test_worlds_settings_and_seeds_combine(tmp_path: Path) -> None:
    text = """
worlds: [maze-15, tiny.yaml]
seeds: [3, 7]
settings: {until: 5}
grid: {robots: [1, 2], radio.range_m: [2, null]}
cases: [{}, {people: 1}]
"""
    jobs = read_jobs(write_sweep(tmp_path, text))
    assert len(jobs) == len({job.key for job in jobs}) == 2 * 2 * 2 * 2 * 2
    assert {job.config["seed"] for job in jobs} == {3, 7} and {job.config["until"] for job in jobs} == {5}
    assert {job.config["radio"]["range_m"] for job in jobs} == {2, None}
    assert sum(job.config["people"] for job in jobs) == 16
    assert {(job.config["world"], job.world is None) for job in jobs} == {("maze-15", True), ("tiny.yaml", False)}


def test_a_group_of_all_runs_takes_nothing_from_a_case(tmp_path: Path) -> None:
    text = """
settings: {radio: {mtu_bytes: 1000}}
grid: {robots: [2, 3]}
cases: [{}, {radio.range_m: 2}]
"""
    radios = [job.config["radio"] for job in read_jobs(write_sweep(tmp_path, text))]
    assert [radio["range_m"] for radio in radios] == [4.0, 2.0] * 2
    assert {radio["mtu_bytes"] for radio in radios} == {1000}


def test_drawn_settings_are_the_same_each_time_and_within_their_ranges(tmp_path: Path) -> None:
    text = """
drawn:
  count: 20
  settings:
    robots: {low: 1, high: 3}
    radio.range_m: {low: 0.5, high: 50.0, log: true}
    starts: [file, random]
"""
    jobs = read_jobs(write_sweep(tmp_path, text))
    assert jobs == read_jobs(tmp_path / "sweep.yaml") and len(jobs) == 20
    assert {job.config["robots"] for job in jobs} == {1, 2, 3}
    assert {job.config["starts"] for job in jobs} == {"file", "random"}
    ranges = sorted(job.config["radio"]["range_m"] for job in jobs)
    assert 0.5 <= ranges[0] < 5 < ranges[-1] <= 50


def test_the_key_follows_from_the_configuration_and_the_content_of_the_world(tmp_path: Path) -> None:
    (first,) = read_jobs(write_sweep(tmp_path, "worlds: [tiny.yaml]"))
    (same,) = read_jobs(write_sweep(tmp_path, "worlds: [tiny.yaml]\nsettings: {radio.range_m: 4.0}"))
    (other,) = read_jobs(write_sweep(tmp_path, "worlds: [tiny.yaml]\nsettings: {radio.range_m: 4.5}"))
    world = tmp_path / "tiny.yaml"
    world.write_text(world.read_text().replace("0.5, 0.6", "0.5, 0.5"))
    (moved,) = read_jobs(tmp_path / "sweep.yaml")
    assert first.key == same.key and len({first.key, other.key, moved.key}) == 3


def test_what_is_no_field_of_a_world_counts_for_nothing(tmp_path: Path) -> None:
    """Keys of several types in it ended the sweep with a traceback."""
    (before,) = read_jobs(write_sweep(tmp_path, "worlds: [tiny.yaml]"))
    with (tmp_path / "tiny.yaml").open("a") as world:
        world.write("notes: {1: a, b: c}\n")
    assert read_jobs(tmp_path / "sweep.yaml") == [before]


def test_the_key_follows_from_the_source_of_a_mind_of_your_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    mind = tmp_path / "standing_mind.py"
    mind.write_text("class Standing:\n    def step(self, observation, heard): ...\n")
    plan = write_sweep(tmp_path, 'seeds: 2\ngrid: {mind: [{}, {r1: "standing_mind:Standing"}]}')
    before = [job.key for job in read_jobs(plan)]
    assert before == [job.key for job in read_jobs(plan)]
    mind.write_text(mind.read_text() + "    speed = 1\n")
    after = [job.key for job in read_jobs(plan)]
    assert after[:2] == before[:2] and not set(after[2:]) & set(before)


def test_a_world_is_not_looked_for_where_the_command_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_sweep(tmp_path, "worlds: [other.yaml]")
    (here := tmp_path / "here").mkdir()
    (tmp_path / "tiny.yaml").rename(here / "other.yaml")
    monkeypatch.chdir(here)
    with pytest.raises(InputError, match=r"sweep\.yaml: .*/other\.yaml: neither a file nor a bundled world"):
        read_jobs(file)


def test_each_seed_has_the_configuration_that_was_checked_and_its_hash(tmp_path: Path) -> None:
    for job in read_jobs(write_sweep(tmp_path, "worlds: [maze-15, tiny.yaml]\nseeds: [0, 7]\ngrid: {robots: [1, 2]}")):
        assert job.config == validated(RunConfig, dict(job.settings)).model_dump(mode="json")
        text = json.dumps([job.config, job.world], sort_keys=True)
        assert job.key == hashlib.sha256(text.encode()).hexdigest()[:24]


def test_the_files_in_the_docs_are_sweeps(tmp_path: Path) -> None:
    text, minds = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs/experiments.md").read_text(), re.S)
    jobs = read_jobs(write_sweep(tmp_path, text.replace("my-world", "tiny")))
    assert len(jobs) == 3 * 10 * 6 * 2 * 5
    assert len(read_jobs(write_sweep(tmp_path, minds))) == 6 * 3


def test_the_thousand_runs_of_the_docs_are_a_thousand() -> None:
    jobs = read_jobs(ROOT / "docs/examples/thousand-runs.yaml")
    assert len(jobs) == 1000
    assert len({json.dumps([job.config["world"], job.config["seed"]]) for job in jobs}) == 100


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("grod: {}", "grod: there is no such setting"),
        ("settings: {radio.rnge_m: 1}", "radio.rnge_m: there is no such setting"),
        ("grid: {robots: []}", "grid.robots: list should have at least 1 item"),
        ("grid: {seed: [1]}", "seed: name it at the top, as seeds"),
        ("grid: {robots: [1]}\ncases: [{robots: 2}]", "robots: it stands in more than one"),
        ("settings: {spec.lidar.beams: 9}\ngrid: {spec.lidar: [{}]}", "spec.lidar and spec.lidar.beams: one would"),
        ("grid: {spec.lidar.beams: [9]}\ncases: [{spec.lidar: {}}]", "spec.lidar and spec.lidar.beams: one would"),
        ("settings: {spec: {}, spec.lidar.beams: 9}", "spec and spec.lidar.beams: one would"),
        ("settings: {server.real_time: 1}", "server.real_time: a sweep, of whose runs each is one process, has no use"),
        ("worlds: [nowhere]", "nowhere: neither a file nor a bundled world"),
        ("seeds: -1", "seeds: "),
        ("drawn: {count: 1, settings: {robots: {low: 3, high: 1}}}", "drawn.settings.robots: from low to high"),
        ("[1]", "a sweep is KEY: VALUE"),
        ("", "a sweep is KEY: VALUE"),
        ("worlds: &a [hall]\ncases: [*a, *a]", "line 2: the alias *a"),
        (f"cases: {'[' * 5000}{']' * 5000}", "nested deeper than"),
        (f"grid: {{{', '.join(f'a{k}: [1, 2, 3]' for k in range(300))}}}", "more than 100000 runs"),
        ("seeds: 100000\nworlds: [hall, office]", "more than 100000 runs"),
        ("drawn: {count: 1, settings: {robots: []}}", "drawn.settings.robots"),
        ("drawn: {count: 1, settings: {until: {low: 0, high: .inf}}}", "drawn.settings.until"),
        ("drawn: {count: 1, settings: {until: {low: -1.7e308, high: 1.7e308}}}", "drawn.settings.until"),
    ],
)
def test_a_wrong_file_is_refused_by_a_sentence_with_its_name(tmp_path: Path, text: str, sentence: str) -> None:
    file = write_sweep(tmp_path, text)
    with pytest.raises(InputError) as error:
        read_jobs(file)
    assert str(error.value).startswith(f"{file}: ") and sentence in str(error.value)
