"""Tables of sweeps: medians with intervals, differences by seed, and their forms as files."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from deploy.commands.experiments import table
from deploy.sweep import picture
from deploy.sweep.measure import task_of
from deploy.sweep.plan import read_jobs
from deploy.sweep.statistics import Estimate, difference, median, wilson
from deploy.sweep.store import Store
from deploy.sweep.tables import Sheet, against, compare, compared, draw, medians, select, show, to_csv, to_latex, words
from deploy.sweep.work import FAILED, OK, Row
from protocol.errors import InputError
from protocol.files import UnwritableError
from tests.deploy.sweep.sweeps import write_sweep

NAMES = ["team.t_90", "mean.path_m"]


def row(range_m: float, seed: int, t_90: float | None, path_m: float, status: str = OK) -> Row:
    settings = {"world": "office", "radio.range_m": range_m, "seed": seed}
    figures = {"team.t_90": t_90, "mean.path_m": path_m} if status == OK else {}
    return {"key": f"{range_m}-{seed}", "status": status, "reason": "", "settings": json.dumps(settings), **figures}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Ten seeds of two ranges; the longer one is 10 s faster, but for seed 9, and drives 1 m more."""
    store = Store(tmp_path / "abc", "abc")
    for seed in range(10):
        store.keep(row(2, seed, 100.0 + seed, 20.0 + seed))
        store.keep(row(4, seed, 90.0 + seed if seed < 9 else None, 21.0 + seed))
    store.keep(row(4, 10, None, 0.0, FAILED))
    return tmp_path


def test_the_interval_of_a_median_holds_it_and_shrinks_with_more_runs() -> None:
    few, many = median([float(k) for k in range(10)]), median([k / 100 for k in range(1000)])
    assert few is not None and many is not None
    assert few.value == 4.5 and few.low < 4.5 < few.high
    assert many.high - many.low < (few.high - few.low) / 3
    assert median([]) is None


@pytest.mark.parametrize("count", [6, 7, 10, 25])
def test_the_interval_of_a_median_holds_that_of_the_distribution(count: int) -> None:
    found = [median(values) for values in np.random.default_rng(0).exponential(size=(1000, count)).tolist()]
    assert sum(one.low <= math.log(2) <= one.high for one in found) >= 940  # type: ignore[operator, union-attr]


def test_five_runs_tell_no_interval() -> None:
    assert median([1.0, 2.0, 3.0, 4.0, 5.0]) == (3.0, None, None)
    assert median([7.0]) == (7.0, None, None)
    assert median([1.0, 2.0, 3.0, 4.0, 5.0, math.inf]) == (3.5, 1.0, math.inf)
    assert words(median([7.0])) == "7 [-]"


def test_the_interval_of_a_share_is_never_certain() -> None:
    pairs = [(2.0, 1.0)] * 5
    found = difference(pairs, "team.coverage")
    assert found is not None and found.better == (1.0, pytest.approx(0.5655, abs=1e-4), 1.0)
    found = difference([(1.0, 1.0)], "team.coverage")
    assert found is not None and found.better.value == 0.5
    assert wilson(0, 10) == (0.0, pytest.approx(0.2775, abs=1e-4)) and wilson(0, 0) == (0.0, 1.0)


def test_a_time_that_is_not_reached_is_longer_than_any() -> None:
    found = median([1.0, 2.0, math.inf, math.inf, math.inf])
    assert found is not None and found.value == math.inf
    pairs = [(5.0, math.inf), (math.inf, math.inf), (math.inf, 3.0), (4.0, 5.0)]
    paired = difference(pairs, "team.t_90")
    assert paired is not None and paired.better.value == (1 + 0.5 + 0 + 1) / 4


def test_better_is_more_or_less_by_the_measure() -> None:
    pairs = [(2.0, 1.0)] * 5
    more = ("team.coverage", "worst.wall_recall", "robots.r1.corner_precision", "machine.real_time_factor")
    less = ("mean.wall_rmse_m", "robots.r1.t_99", "mean.bytes_sent", "alignments.unmerged")
    machine = ("machine.late_ticks", "machine.links_lost", "machine.step_ms_median.r1")
    for measure in more + less + machine:
        found = difference(pairs, measure)
        assert found is not None and found.better.value == (measure in more) and found.median.value == 1.0


def test_medians_are_over_the_seeds_of_runs_that_are_alike(folder: Path) -> None:
    sheet = medians(select(str(folder))[0], NAMES)
    assert sheet.heads == ["radio.range_m", "runs", "failed", *NAMES]
    short, long = sorted(sheet.lines, key=lambda line: str(line[0]))
    assert short[:3] == ["2", 10, 0] and long[:3] == ["4", 11, 1]
    assert [line[3].value for line in (short, long)] == [104.5, 94.5]  # type: ignore[union-attr]


def test_lines_stand_in_the_order_of_their_values(folder: Path) -> None:
    """They stood in that of hashes, or of texts."""
    store = Store(folder / "abc", "abc")
    for given in ({"radio.range_m": 10}, {"radio.range_m": None}, {}, {"radio.range_m": 0.5}):
        settings = json.dumps({"world": "office", "seed": 0} | given)
        store.keep(row(3, 0, 1.0, 1.0) | {"settings": settings, "key": f"{given}"})
    rows = select(str(folder))[0]
    assert [line[0] for line in medians(rows, NAMES).lines] == ["", "null", "0.5", "2", "4", "10"]
    sheet = against(rows, "radio.range_m=2", ["team.t_90"])
    assert [line[0] for line in sheet.lines] == ["", "null", "0.5", "4", "10"]


def asked(text: str, folder: Path, t_90: float) -> None:
    """Keep a result for each run of a sweep's file that is not there yet, as if it had been made."""
    store = Store(folder / "abc", "abc")
    for job in read_jobs(write_sweep(folder, text)):
        if job.key not in store.kept():
            store.keep(task_of(job).row(OK) | {"team.t_90": t_90})


def test_runs_of_a_sweep_that_was_extended_are_among_those_of_the_same_configuration(tmp_path: Path) -> None:
    """Those at the default had been made before it was named, and were of no range."""
    asked("{settings: {until: 5, radio: {mtu_bytes: 1000}}, seeds: 6}", tmp_path, 90.0)
    asked("{settings: {until: 5, radio.mtu_bytes: 1000}, grid: {radio.range_m: [2, 4]}, seeds: 7}", tmp_path, 100.0)
    rows, _ = select(str(tmp_path))
    sheet = medians(rows, ["team.t_90"])
    assert sheet.heads[0] == "radio.range_m" and {tuple(line[:2]) for line in sheet.lines} == {("4", 7), ("2", 7)}
    (line,) = against(rows, "radio.range_m=2", ["team.t_90"]).lines
    long, short = f"{tmp_path}:people=0,radio.range_m=4", f"{tmp_path}:people=0,radio.range_m=2.0"
    (time,) = compare(long, short, ["team.t_90"]).lines
    assert line == ["4", *time] and time[1:3] == [7, 0] and time[3].value == -10  # type: ignore[union-attr]


def test_settings_that_no_file_gives_may_differ_between_revisions(tmp_path: Path) -> None:
    """A new default is what two commits are compared for."""
    for revision, config in (("abc", {"people": 0}), ("def", {"people": 1, "new": True})):
        for seed in range(2):
            whole = {"config": json.dumps({"radio": {"range_m": 2.0}, "seed": seed, "world": "office"} | config)}
            Store(tmp_path / revision, revision).keep(row(2, seed, 1.0, 2.0) | whole)
    assert compare(str(tmp_path / "abc"), str(tmp_path / "def"), ["team.t_90"]).lines[0][1] == 2
    assert len(select(f"{tmp_path}:people=1")[0]) == 2


def test_a_group_that_is_named_is_left_out_of_the_pairs(tmp_path: Path) -> None:
    for seed in range(2):
        for mind in ({}, {"r1": "a:A"}):
            settings = {"settings": json.dumps({"mind": mind, "seed": seed})}
            Store(tmp_path / "abc", "abc").keep(row(2, seed, 1.0, 2.0) | settings | {"key": f"{seed}-{len(mind)}"})
    (time,) = against(select(str(tmp_path))[0], "mind={}", ["team.t_90"]).lines
    assert time[0] == '{"r1": "a:A"}' and time[2] == 2


@pytest.mark.parametrize("who", ["r1", "*"])
def test_the_mind_of_one_robot_or_of_all_is_compared_with_another(who: str, tmp_path: Path) -> None:
    """Their hashes differ with them, and are no setting."""
    store = Store(tmp_path, "abc")
    for seed in range(2):
        for mind, hashed in (({}, ""), ({who: "a:A"}, "aaaa"), ({who: "b:B"}, "bbbb")):
            settings = {"settings": json.dumps({"mind": mind, "seed": seed}), "mind.hash": hashed}
            store.keep(row(2, seed, 1.0, 2.0) | settings | {"key": f"{seed}-{hashed}"})
    one, other = f"mind.{who}=a:A", f"mind.{who}=b:B"
    assert compare(f"{tmp_path}:{one}", f"{tmp_path}:{other}", ["team.t_90"]).lines[0][1] == 2
    sheet = against(select(str(tmp_path))[0], one, ["team.t_90"])
    assert [(line[0], line[2]) for line in sheet.lines] == [("", 2), ("b:B", 2)]


def test_commits_are_compared_where_a_world_was_edited_or_had_no_hash_yet(tmp_path: Path) -> None:
    for revision, tiny in (("older", ""), ("old", "1111"), ("new", "2222")):
        store = Store(tmp_path / revision, revision)
        for world, hashed in (("tiny.yaml", tiny), ("maze-15", "")):
            settings = {"settings": json.dumps({"world": world, "seed": 0}), "key": world}
            hashes = {"world.hash": hashed, "mind.hash": ""} if tiny else {}
            store.keep(row(2, 0, 1.0, 2.0) | settings | hashes)
    for revision in ("older", "old"):
        assert compare(str(tmp_path / revision), str(tmp_path / "new"), ["team.t_90"]).lines[0][1] == 2
    store.keep(row(2, 0, 1.0, 2.0) | settings | {"key": "edited", "world.hash": "3333"})
    assert compare(str(tmp_path / "old"), str(tmp_path / "new"), ["team.t_90"]).lines[0][1] == 1


def test_runs_are_compared_by_seed(folder: Path) -> None:
    first, keys = select(f"{folder}:radio.range_m=4")
    second, _ = select(f"{folder}:radio.range_m=2")
    time, path = compared(first, second, keys, NAMES).lines
    assert time[:3] == ["team.t_90", 10, 0] and path[:3] == ["mean.path_m", 10, 0]
    assert time[3].value == -10 and time[4].value == 0.9  # type: ignore[union-attr]
    assert path[3] == (1.0, 1.0, 1.0) and path[4] == (0.0, *wilson(0, 10))
    sheet = against(select(str(folder))[0], "radio.range_m=2", NAMES)
    assert sheet.lines == [["4", *time], ["4", *path]]


def test_a_folder_may_have_a_colon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To pyarrow it was an address, and to us the end of the folder."""
    monkeypatch.chdir(tmp_path)
    Store(Path("res:12/abc"), "abc").keep(row(2, 0, 1.0, 2.0))
    assert len(select("res:12")[0]) == 1
    assert select("res:12:radio.range_m=2,seed=0")[1] == ["radio.range_m", "seed"]
    with pytest.raises(InputError, match="res:12:seed=1: no results"):
        select("res:12:seed=1")


def test_values_that_are_equal_are_one_however_they_are_written(tmp_path: Path) -> None:
    store = Store(tmp_path, "abc")
    for seed, (range_m, loss) in enumerate([(4, 1), (4.0, 1.0)]):
        models = [{"kind": "bernoulli", "loss": loss}, {"kind": "latency", "ticks": 2}]
        settings = {"radio.range_m": range_m, "radio.models": models, "seed": seed}
        store.keep(row(4, seed, 1.0, 2.0) | {"settings": json.dumps(settings)})
    store.keep(row(2, 0, 1.0, 2.0))
    for wish in ("4", "4.0", "4e0"):
        assert len(select(f"{tmp_path}:radio.range_m={wish}")[0]) == 2
    models = f"[{{loss: 1, kind: bernoulli}}, {300 * ' '}{{ticks: 2.0, kind: latency}}]"
    rows, keys = select(f"{tmp_path}:radio.models={models},radio.range_m=4")
    assert len(rows) == 2 and keys == ["radio.models", "radio.range_m"]
    assert [line[0] for line in medians(rows, NAMES).lines] == [2]


def test_two_commits_are_compared(folder: Path) -> None:
    Store(folder, "def").keep(row(2, 3, 50.0, 10.0))
    new, keys = select(f"{folder}:revision=def")
    old, _ = select(str(folder / "abc"))
    (time,) = compared(new, old, [*keys, "revision"], ["team.t_90"]).lines
    assert time[1] == 1 and time[3] == (-53.0, None, None) and time[4] == (1.0, *wilson(1, 1))


def test_runs_of_several_revisions_are_compared_within_each(tmp_path: Path) -> None:
    for revision, slower in (("abc", 0.0), ("def", 1000.0)):
        store = Store(tmp_path / revision, revision)
        for seed in range(10):
            store.keep(row(2, seed, slower + 100.0, 20.0))
            store.keep(row(4, seed, slower + 90.0, 20.0))
    long, short = f"{tmp_path}:radio.range_m=4", f"{tmp_path}:radio.range_m=2"
    (time,) = compare(long, short, ["team.t_90"]).lines
    assert time[1] == 20 and time[3] == (-10.0,) * 3
    (time,) = compare(f"{long},revision=def", f"{short},revision=abc", ["team.t_90"]).lines
    assert time[1] == 10 and time[3] == (990.0,) * 3
    with pytest.raises(InputError, match=r"differ only in revision: choose by DIR:revision=VALUE"):
        compare(f"{long},revision=def", short, ["team.t_90"])
    with pytest.raises(InputError, match=r"differ only in radio\.range_m: choose"):
        compare(str(tmp_path), short, ["team.t_90"])


def test_a_run_that_two_sweeps_hold_is_one(tmp_path: Path) -> None:
    """It was refused, as one that is alike in all; of a failed one and its repetition the latter counts."""
    for sweep, status in (("robots", FAILED), ("range", OK), ("seeds", OK)):
        store = Store(tmp_path / sweep / "abc", "abc")
        for seed in range(2):
            store.keep(row(2, seed, 1.0, 2.0, status if seed else OK))
    assert medians(select(str(tmp_path))[0], NAMES).lines[0][:2] == [2, 0]


def test_one_result_twice_is_refused(folder: Path) -> None:
    rows, _ = select(f"{folder}:radio.range_m=2")
    with pytest.raises(InputError, match="2-0 and 2-0 are alike in all, seed and revision too: remove one"):
        compared([*rows, rows[0] | {}], rows, [], NAMES)
    with pytest.raises(InputError, match="2-0 and 2-0 are alike in all"):
        medians([*rows, rows[0] | {}], NAMES)


def test_runs_of_a_world_or_a_mind_that_was_changed_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were in one median, as the settings do not tell what their files held."""
    monkeypatch.syspath_prepend(str(tmp_path))
    mind, results = tmp_path / "edited_mind.py", tmp_path / "results"
    mind.write_text("class Edited:\n    def step(self, observation, heard): ...\n")
    text = '{worlds: [tiny.yaml, maze-15], grid: {mind: [{}, {r1: "edited_mind:Edited"}]}, seeds: 2}'
    asked(text, results, 10.0)
    mind.write_text(mind.read_text() + "    speed = 1\n")
    asked(text, results, 20.0)
    rows = select(str(results))[0]
    sheet = medians(rows, ["team.t_90"])
    assert sheet.heads[:4] == ["mind.hash", "mind.r1", "world", "world.hash"] and len(sheet.lines) == 6
    assert {line[4] for line in sheet.lines} == {2}
    own = {(line[2], str(line[0])) for line in sheet.lines if line[0]}
    (first, second) = sorted({hashed for _, hashed in own})
    (time,) = compare(f"{results}:mind.hash={first}", f"{results}:mind.hash={second}", ["team.t_90"]).lines
    assert time[1] == 4 and abs(time[3].value) == 10.0  # type: ignore[union-attr]
    with pytest.raises(InputError, match=r"differ only in mind\.hash: choose by DIR:mind\.hash=VALUE"):
        against(rows, "mind={}", ["team.t_90"])
    assert against([row for row in rows if row["mind.hash"] != first], "mind={}", ["team.t_90"]).lines[0][2] == 4


def test_tables_are_written_as_csv_latex_and_pictures(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows, out = select(str(folder))[0], tmp_path / "tables"
    show([medians(rows, NAMES), against(rows, "radio.range_m=2", NAMES)], out)
    assert {file.name for file in out.iterdir()} == {
        f"{name}.{kind}" for name in ("medians", "differences") for kind in ("csv", "tex", "png")
    }
    lines = list(csv.DictReader((out / "medians.csv").read_text().splitlines()))
    assert {line["radio.range_m"]: float(line["team.t_90"]) for line in lines} == {"2": 104.5, "4": 94.5}
    assert float(lines[0]["team.t_90 low"]) < float(lines[0]["team.t_90"]) < float(lines[0]["team.t_90 high"])
    assert r"radio.range\_m & runs" in (out / "medians.tex").read_text()
    with pytest.raises(InputError, match="name a directory that can be written"):
        show([medians(rows, NAMES)], out / "medians.csv")
    (other := tmp_path / "other").mkdir()
    (other / "medians.csv").mkdir()
    capsys.readouterr()
    with pytest.raises(UnwritableError):
        show([medians(rows, NAMES), against(rows, "radio.range_m=2", NAMES)], other)
    said = capsys.readouterr().out
    assert "medians" in said.lower() and "differences" in said.lower()


def test_an_interval_that_never_ends_is_drawn_to_the_edge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Figure] = []
    monkeypatch.setattr(picture, "write_figure", lambda figure, *_, **__: shown.append(figure))
    estimates = [Estimate(5.0, 4.0, math.inf), Estimate(math.inf, 7.0, math.inf), Estimate(3.0, None, None)]
    draw(
        Sheet("Medians", ["runs", "failed", "team.t_90"], [[6, 0, one] for one in estimates]), tmp_path / "medians.png"
    )
    (panel,) = shown[0].axes
    lines = [line.get_xdata() for line in panel.lines if line.get_marker() == "None"]
    for begin in (4.0, 7.0):
        assert any(len(line) == 2 and tuple(line) == (begin, panel.get_xlim()[1]) for line in lines)
    assert 7.0 < panel.get_xlim()[1] < 10.0


def drawn(sheet: Sheet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Figure:
    shown: list[Figure] = []
    monkeypatch.setattr(picture, "write_figure", lambda figure, *_, **__: shown.append(figure))
    draw(sheet, tmp_path / "some.png")
    return shown[0]


def test_times_that_no_run_reached_are_told_and_are_no_equal_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [
        row(range_m, seed, None, float(range_m + seed)) | {"revision": "abc"} for range_m in (2, 4) for seed in range(6)
    ]
    figure = drawn(medians(rows, NAMES), tmp_path, monkeypatch)
    time, path = figure.axes
    assert [text.get_text() for text in time.texts] == ["not reached (6 of 6)"] * 2 and not len(time.get_xticks())
    assert [text.get_text() for text in path.texts] == ["", ""]
    assert time.get_ylabel() == "radio.range_m" and time.get_title() == "team.t_90 (s)"
    sheet = against(rows, "radio.range_m=2", NAMES)
    assert sheet.lines[0] == ["4", "team.t_90", 6, 0, None, None, 6]
    assert sheet.lines[1][-1] == 0 and isinstance(sheet.lines[1][4], Estimate)


def test_each_measure_of_differences_has_its_own_axis_unit_and_zero(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = drawn(against(select(str(folder))[0], "radio.range_m=2", NAMES), tmp_path, monkeypatch)
    time, path = figure.axes
    assert figure.get_suptitle() == "Differences by seed: radio.range_m=4 less 2"
    assert time.get_title() == "team.t_90 (s)" and path.get_title() == "mean.path_m (m)"
    assert time.get_xlim() != path.get_xlim()
    assert all(any(list(line.get_xdata()) == [0, 0] for line in panel.lines) for panel in figure.axes)


def test_a_picture_of_many_measures_is_no_wider_than_a_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sheet = Sheet("Medians", ["failed", *"abcdefg"], [[0, *[Estimate(1.0, 0.0, 2.0)] * 7]])
    assert drawn(sheet, tmp_path, monkeypatch).get_size_inches()[0] < 14


def test_a_picture_has_no_more_lines_than_can_be_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was an error, and the tables after it were lost."""
    assert picture.TALLEST_IN * picture.DPI < 2**16  # else Matplotlib draws nothing
    monkeypatch.setattr(picture, "TALLEST_IN", 10.0)
    for measures, lines in ((1, 21), (9, 5)):
        line = [0, *[Estimate(1.0, None, None)] * measures]
        sheet = Sheet("Medians", ["failed", *map(str, range(measures))], [line] * 30)
        figure = drawn(sheet, tmp_path, monkeypatch)
        assert figure.get_suptitle() == f"Medians, the first {lines} lines of 30"
        assert len(figure.axes[0].get_yticks()) == lines and figure.get_size_inches()[1] <= 10


def test_a_measure_without_any_value_is_a_dash(tmp_path: Path) -> None:
    store = Store(tmp_path / "abc", "abc")
    store.keep(row(2, 0, None, 0.0, FAILED))
    sheet = medians(select(str(tmp_path))[0], ["team.t_90"])
    assert "-" in to_latex(sheet) and "revision" not in to_csv(sheet)


def test_a_measure_of_a_robot_that_only_some_runs_have_is_missing_in_the_others(tmp_path: Path) -> None:
    """It was refused as soon as one run had fewer robots, and words were dashes."""
    for seed in range(2):
        Store(tmp_path / "abc", "abc").keep(row(2, seed, 1.0, 2.0) | {"ended": "time"})
        Store(tmp_path / "abc", "abc").keep(row(4, seed, 1.0, 2.0) | {"robots.r3.t_90": 7.0})
    rows = select(str(tmp_path))[0]
    lines = medians(rows, ["robots.r3.t_90"]).lines
    assert [(line[0], line[3]) for line in lines] == [("2", None), ("4", (7.0, None, None))]
    with pytest.raises(InputError, match=r"--measure ended: a result has mean\.path_m, "):
        medians(rows, ["ended"])


def test_a_row_of_latex_does_not_begin_with_a_bracket() -> None:
    """It was taken for an argument of the command before it."""
    text = to_latex(Sheet("Medians", ["radio.models", "t"], [["[]", Estimate(1.0, None, None)], ["*", None]]))
    assert text.splitlines()[4:6] == [r"{[}] & 1 [-] \\", r"{*} & - \\"]


def test_a_figure_that_is_no_number_is_none(tmp_path: Path) -> None:
    store = Store(tmp_path / "abc", "abc")
    for seed, path_m in enumerate((5.0, math.nan, 7.0)):
        store.keep(row(2, seed, 1.0, path_m))
    (line,) = medians(select(str(tmp_path))[0], ["mean.path_m"]).lines
    assert line[-2:] == [(6.0, None, None), 2]


def test_a_median_of_fewer_values_than_runs_tells_how_many_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A median over one run stood under `runs 10, failed 0`."""
    store = Store(tmp_path / "abc", "abc")
    for seed in range(10):
        store.keep(row(2, seed, None, 20.0) | {"mean.wall_rmse_m": None if seed else 0.01})
    sheet = medians(select(str(tmp_path))[0], ["mean.wall_rmse_m", *NAMES])
    assert sheet.heads == ["runs", "failed", "mean.wall_rmse_m", "mean.wall_rmse_m values", *NAMES]
    assert sheet.lines[0][:4] == [10, 0, (0.01, None, None), 1]
    assert "mean.wall_rmse_m high,mean.wall_rmse_m values,team.t_90" in to_csv(sheet)
    panels = drawn(sheet, tmp_path, monkeypatch).axes
    assert [panel.get_title() for panel in panels] == ["mean.wall_rmse_m (m)", "team.t_90 (s)", "mean.path_m (m)"]
    assert [text.get_text() for text in panels[1].texts] == ["not reached (10 of 10)"]


def test_a_value_without_partners_costs_no_other_its_answer(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in range(20, 23):
        Store(folder / "abc", "abc").keep(row(8, seed, 90.0, 20.0))
    lines = against(select(str(folder))[0], "radio.range_m=2", NAMES).lines
    assert [line[:3] for line in lines] == [[value, name, n] for value, n in (("4", 10), ("8", 0)) for name in NAMES]
    assert lines[2][3:] == [0, None, None, 0]
    with pytest.raises(InputError, match=r"--against radio\.range_m=8: no run with it and none with another value"):
        table(folder, NAMES, "radio.range_m=8")
    assert "Medians" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("what", "sentence"),
    [
        ("nowhere", "no folder"),
        ("{}:radio.range_m", "write KEY=VALUE"),
        ("{}:radio.range_m=7", "no results; radio.range_m is 2, 4$"),
        ("{}:radio.range=7", "no results; no run has radio.range$"),
        ("{}:seed=0,radio.models=[{{,seed=1", r"seed=1: radio\.models: no YAML"),
    ],
)
def test_what_selects_nothing_is_refused(folder: Path, what: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        select(what.format(folder))


def test_an_unknown_measure_and_a_comparison_without_pairs_are_refused(folder: Path) -> None:
    rows, _ = select(str(folder))
    with pytest.raises(InputError, match=r"--measure team\.t_91: a result has .*mean\.path_m"):
        medians(rows, ["team.t_91"])
    with pytest.raises(InputError, match="no two of these runs"):
        compared(rows[:1], rows[-1:], [], NAMES)
    with pytest.raises(InputError, match=r"another value; there are 2, 4$"):
        against(rows, "radio.range_m=3", NAMES)
    with pytest.raises(InputError, match=r"--against radio\.models: no YAML"):
        against(rows, "radio.models=[", NAMES)
