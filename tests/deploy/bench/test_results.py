"""The declarations of the benchmarks fit the results that are committed, and each other."""

import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from deploy.bench.alignment import trials
from deploy.bench.benchmark import Benchmark, report
from deploy.bench.cases import Case, Outcome
from deploy.bench.study import STUDIES, comparison, study
from deploy.bench.tables import Table, columns, grouped, share, total, whole
from deploy.commands.experiments import BENCHMARKS
from deploy.revision import ROOT, WITH_BENCHMARKS, revision
from protocol.errors import InputError
from protocol.files import UnwritableError
from protocol.status import Status


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_case_has_a_name_of_its_own_and_plain_arguments(name: str) -> None:
    for quick in (True, False):
        cases = Benchmark(name).cases(quick)
        assert len({case.name for case in cases}) == len(cases) > 0
        assert all(len(case.key) == 16 for case in cases)
    assert Benchmark(name).sections({}) == []


RESULTS = ROOT / "results"
PUBLISHED = sorted(file.name for file in RESULTS.glob("*.json"))
ELSEWHERE = {"exact", "exact-twins", "thin", "team"}  # in files of their own, as these runs take long
UNTOLD = {"left"}  # where there is nothing to tell
OLDER = {"alignment-ideal-exact.json": {"crossing_m"}}  # columns that are newer than the file


@pytest.mark.parametrize("file", PUBLISHED)
def test_the_committed_results_have_the_declared_tables_columns_and_bars(file: str) -> None:
    name, *words = file.removesuffix(".json").split("-")
    part = next((word for word in words if word != "ideal"), None)
    benchmark = Benchmark(name, part=part)
    assert benchmark.file(RESULTS, quick=False, ideal="ideal" in words) == RESULTS / file
    kept = json.loads((RESULTS / file).read_text())["sections"]
    tables: dict[str, Table] = {table.name: table for one in benchmark.parts for table in one.TABLES}
    assert list(kept) == [table for table in tables if table in kept]
    assert set(tables) - set(kept) <= UNTOLD | (ELSEWHERE if part is None else set())
    lacking: set[str] = set()
    for section, found in kept.items():
        table = tables[section]
        assert found["bars"] == {column.key: column.bar for column in table.columns if column.bar}
        keys = {key for row in found["rows"] for key in row}
        lacking |= {column.key for column in table.columns} - keys
        if isinstance(table.title, str):
            assert found["title"] == table.title
    assert lacking == OLDER.get(file, set())


@pytest.mark.parametrize("name", STUDIES.values())
def test_a_study_measures_what_its_published_tables_need_and_no_more(name: str) -> None:
    kept = json.loads((RESULTS / f"{name}-ideal.json").read_text())["sections"]
    parts = [{table.name for table in part.TABLES} for part in Benchmark(name, kept).parts]
    assert kept.keys() <= set().union(*parts) and all(tables & kept.keys() for tables in parts)


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_measures_one_part_only_where_asked(name: str) -> None:
    parts = {part.__name__.rpartition(".")[2]: part for part in Benchmark(name).parts}
    for chosen, part in parts.items():
        assert Benchmark(name, part=chosen).parts == [part]
    with pytest.raises(InputError, match=f"its parts are {next(iter(parts))}"):
        Benchmark(name, part="nothing")


def test_one_part_leaves_the_tables_of_all_parts_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names: list[str] = []

    def measure(cases: list[Case], *_: object) -> Outcome:
        names.extend(case.name for case in cases)
        return Outcome({}, {})

    monkeypatch.setattr("deploy.bench.benchmark.measure_all", measure)
    (tmp_path / "radio-quick.json").write_text("as before")
    Benchmark("radio", part="codec").run(True, tmp_path, 1)
    assert names and all(name.startswith("codec/") for name in names)
    assert (tmp_path / "radio-quick.json").read_text() == "as before"
    assert (tmp_path / "radio-quick-codec.json").is_file()


def test_results_tell_command_and_revision_and_of_each_section_its_sensing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, other = Table("own", "Own", "case", "x", sensing="ideal"), Table("other", "Other", "case", "x")
    monkeypatch.setattr("deploy.bench.benchmark.measure_all", lambda *_: Outcome({"case": {"x": 1}}, {}))
    benchmark = Benchmark("radio", part="codec")
    monkeypatch.setattr(benchmark.parts[0], "TABLES", [own, other])
    for ideal, others in ((False, "real"), (True, "ideal")):
        benchmark.run(True, tmp_path, 1, ideal)
        document = json.loads(benchmark.file(tmp_path, True, ideal).read_text())
        assert document["revision"] == revision(WITH_BENCHMARKS) and document["sensing"] == others
        assert document["command"] == f"wireswarm bench radio --part codec{' --ideal' if ideal else ''} --quick"
        assert {name: one["sensing"] for name, one in document["sections"].items()} == {"own": "ideal", "other": others}


def test_partial_maps_are_recorded_with_the_sensing_that_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded: set[bool] = set()

    def measure(cases: list[Case], *_: object, **__: object) -> Outcome:
        recorded.update(case.ideal for case in cases)
        return Outcome({}, {})

    monkeypatch.setattr("deploy.bench.alignment.trials.measure_all", measure)
    monkeypatch.setattr("deploy.bench.benchmark.measure_all", lambda *_: Outcome({}, {}))
    for ideal in (True, False):
        recorded.clear()
        Benchmark("alignment", part="trials").run(True, tmp_path, 1, ideal)
        assert recorded == {ideal}


def test_pairs_read_the_recordings_and_make_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each made those again that had failed, and all but one of parallel cases found the folder locked."""
    monkeypatch.setattr(trials, "KEEP", tmp_path)
    monkeypatch.setattr(trials, "measure_all", lambda *_, **__: pytest.fail("a case records"))
    with pytest.raises(InputError, match="parquet"):
        trials.within("apartment", quick=True)


def test_pairs_of_a_world_are_not_kept_without_one_of_its_recordings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They counted as whole for ever."""
    monkeypatch.setattr(trials, "KEEP", tmp_path)
    figures = {"frame": (0.0, 0.0, 0.0), "lengths": [], "snapshots": []}

    def kept(cases: list[Case], _: Path) -> Outcome:
        made = {
            case.name: {"world": case.arguments["world"], **figures} for case in cases if case.name != "symmetric/1"
        }
        return Outcome(made, {case.name: "it died" for case in cases if case.name not in made})

    monkeypatch.setattr(trials, "kept", kept)
    for call in (lambda: trials.within("symmetric", True), lambda: trials.between(True, ["apartment", "symmetric"])):
        with pytest.raises(RuntimeError, match="no recording symmetric/1: it died"):
            call()
    assert trials.within("apartment", quick=True) == {"pairs": []}


def test_groups_of_cases_make_rows_and_all_of_them_the_last(tmp_path: Path) -> None:
    figures = {
        f"runs/{world}/{seed}": {"t": t, "ok": t < 4} for world, seed, t in (("a", 0, 1), ("b", 0, 5), ("a", 1, 2))
    }
    assert grouped(figures, "runs/{world}/*")[0] == ({"world": "a"}, [figures["runs/a/0"], figures["runs/a/1"]])
    heads = columns(
        "world; t median <= 3: median t; t_spread spread: spread; ok; sum",
        ok=share(lambda run: run["ok"]),
        sum=lambda runs, _: total(runs, "t"),
    )
    assert [column.head for column in heads] == ["world", "median t", "spread", "ok", "sum"]
    table = Table("one", "One", "runs/{world}/*", heads, total="all", judged=lambda row: row["world"] != "b")
    section = table.section(figures)
    assert section.rows[0] == {"world": "a", "t": 1.5, "t_spread": "1-2", "ok": 1.0, "sum": 3}
    assert section.rows[2]["world"] == "all" and section.rows[2]["sum"] == 8
    assert [section.missed(k) for k in range(3)] == [[], None, []]
    report("some", {}, "ideal", [section], {}, tmp_path / "some.json")
    document = json.loads((tmp_path / "some.json").read_text())
    assert document["met"] == {"one": True} and document["sections"]["one"]["bars"] == {"t": "<= 3"}


def test_tables_are_printed_also_where_they_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = Table("one", "One", lambda _: [{"x": 0}], columns("x >= 1")).section({})
    with pytest.raises(UnwritableError):
        report("some", {}, "ideal", [section], {"case/1": "it died"}, tmp_path)
    said = capsys.readouterr().out
    assert "One: " in said and "no figures of case/1: it died" in said


def test_a_row_of_a_function_may_stand_beside_the_bars() -> None:
    table = Table("one", "One", lambda _: [{"x": 0, "judged": False}, {"x": 1}], columns("x >= 1"))
    section = table.section({})
    assert list(section.rows) == [{"x": 0}, {"x": 1}] and section.met is True


def test_a_quick_sample_is_not_judged_by_the_bars_of_all() -> None:
    stream = io.StringIO()
    section = replace(Table("one", "One", lambda _: [{"x": 0}], columns("x >= 1")).section({}), quick=True)
    section.print(Console(file=stream))
    assert section.met is None and section.as_dict()["rows"] == [{"x": 0, "missed": None}]
    shown = " ".join(stream.getvalue().split())
    assert shown.startswith("One: not judged (quick)") and "!" not in shown


def test_columns_that_make_no_sense_are_refused() -> None:
    for words in ("", "a b c", "a > 3", "a <= "):
        with pytest.raises(ValueError, match="no column"):
            columns(words)


@pytest.mark.parametrize("width", [40, 80, 200])
def test_a_table_is_divided_to_fit_a_terminal_and_loses_no_figure(width: int) -> None:
    heads = columns("world; " + "; ".join(f"figure_{k} <= 12" for k in range(20)))
    table = Table("wide", "Wide", whole("runs/{world}"), heads)
    figures = {f"runs/{world}": {f"figure_{k}": k for k in range(20)} for world in ("office", "maze")}
    stream = io.StringIO()
    table.section(figures).print(Console(file=stream, width=width))
    lines = stream.getvalue().splitlines()
    assert max(len(line.rstrip()) for line in lines) <= width
    assert lines[0].startswith("Wide: not met")
    assert (sum("office" in line for line in lines) == 1) == (width == 200)
    for k in range(13, 20):
        assert sum(f"{k} !" in line for line in lines) == 2


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_is_compared_with_what_is_published(name: str) -> None:
    text = (RESULTS / f"{STUDIES[name]}-ideal.json").read_text()
    before, now = json.loads(text), json.loads(text)
    rows = comparison(before, now).section({}).rows
    assert [row["table"] for row in rows] == list(before["sections"])
    assert all(row["same"] == row["values"] > 0 and row["then"] == row["now"] for row in rows)
    first = rows[0]["table"]
    row = now["sections"][first]["rows"][0]
    row[[key for key in row if key != "missed"][-1]] = "other"  # the first ones say which row it is
    del now["sections"][rows[1]["table"]]
    again = comparison(before, now).section({}).rows
    assert again[0]["same"] == rows[0]["same"] - 1 and again[1]["same"] == 0 and again[2:] == rows[2:]


def test_a_row_that_is_missing_makes_no_other_value_different() -> None:
    """Rows were compared by their number."""
    text = (RESULTS / "exploration-ideal.json").read_text()
    before, now = json.loads(text), json.loads(text)
    gone = now["sections"]["plain"]["rows"].pop(3)
    now["sections"]["speed"]["rows"][0]["real_time_factor"] = 1.0
    lost = {row["table"]: row["values"] - row["same"] for row in comparison(before, now).section({}).rows}
    assert {table: count for table, count in lost.items() if count} == {"plain": len(gone) - 1, "speed": 1}


def test_a_study_says_which_layouts_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "drlnav_stage7.yaml").touch()
    monkeypatch.setattr("deploy.bench.layouts.SHARED", tmp_path)
    monkeypatch.setattr(Benchmark, "run", lambda *_, **__: pytest.fail("that is all"))
    with pytest.raises(pytest.fail.Exception, match="that is all"):
        study("radio", tmp_path, 1)
    said = capsys.readouterr().err
    assert "gbeltramo_building" in said and "pal_home_w" in said and "drlnav_stage7" not in said


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_a_quick_study_runs_to_its_end(name: str, tmp_path: Path) -> None:
    assert study(name, tmp_path, 1, quick=True) == Status.OK
    made = json.loads((tmp_path / f"{STUDIES[name]}-ideal-quick.json").read_text())
    assert made["sections"] and not made["failed"]


def test_a_study_does_not_overwrite_what_it_is_compared_with() -> None:
    with pytest.raises(InputError, match="choose another folder"):
        study("trust", RESULTS, None)


def test_it_does_not_do_so_through_a_linked_checkout_either(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (link := tmp_path / "link").symlink_to(ROOT)
    monkeypatch.setattr("deploy.bench.study.PUBLISHED", link / "results")
    with pytest.raises(InputError, match="choose another folder"):
        study("trust", link / "results", None)
