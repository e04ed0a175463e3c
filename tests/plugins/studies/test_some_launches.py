"""Figures that some launches lack: what is printed, required and optimised says so, against rates
that are known.
"""

import json

import numpy as np
import pytest
import some_launches
from opir_report.pages.sentences import answers, is_surely_met, mean_text, verdicts
from opir_report.pages.study_report import study_page
from opir_report.saved_study import read_study
from opir_scoring import percent_text, share_text
from opir_studies import Study, optimise, sweep
from opir_studies.finished import FinishedRuns
from opir_studies.optimising import Objective, outcome_of
from opir_studies.planning import planned_study
from opir_studies.requirements import FigureRequirement
from opir_studies.result import written_result
from opir_studies.runs import RunRecord
from opir_studies.statistics import share_with_value
from opir_studies.sweep_command import as_text
from scipy.stats import binom
from some_launches import values_of
from study_scene import PERIOD, SCENE

from opir_core.cli.main import main
from opir_core.plugin import Host

CHANCE = "sensors[*].detection_probability.ICBM"
RUNS = 20


@pytest.fixture(scope="module")
def host():
    """Let every host offer the metric."""
    host = Host.discover()
    host.register(some_launches)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Host, "discover", classmethod(lambda _cls: host))
        yield


def study(**changes):
    base = {
        "scene": {**SCENE, "duration_s": 2.0},
        "study": "s",
        "vary": {CHANCE: [0.3, 1.0]},
        "runs": RUNS,
        "executor": "serial",
    }
    return Study(**{**base, "metrics": ("chance",), "requirements": ("time_s <= 60",), **changes})


def written(settings, folder, spread_s=10.0):
    """Return the result of a study whose runs are drawn here, without a simulation."""
    planned = planned_study(settings)
    runs = FinishedRuns.of(planned, folder)
    for place, design in enumerate(planned.designs):
        seed = design.scene.seed
        chance = design.scene.sensors[0].model.config.detection_probability["ICBM"]
        rows = figures(values_of(seed, settings.runs, chance, spread_s))
        runs.add(place, [record(run, seed + run, row) for run, row in enumerate(rows)])
    return written_result(planned, folder, runs.first([settings.runs] * len(planned.designs)))


def record(run, seed, values):
    """Return the record of a run with one launch, which is looked at and seen at once."""
    return RunRecord(run, seed, 0.0, values, launches=((1.0,), (1.0,), (1.0,), ("ICBM",)))


def figures(values):
    """Return the mean, the share and the mean where all have a value, of the launches (runs,
    launches) of each run.
    """
    has_value = np.isfinite(values)
    count = np.where(has_value.any(axis=1), has_value.sum(axis=1), np.nan)
    means = np.where(has_value, values, 0.0).sum(axis=1) / count
    means_of_all = np.where(has_value.all(axis=1), means, np.nan)
    return list(zip(means, has_value.mean(axis=1), means_of_all, strict=True))


@pytest.fixture(scope="module")
def result(host, tmp_path_factory):
    return written(study(show=("time_s", "time_of_all_s")), tmp_path_factory.mktemp("study"))


@pytest.mark.slow
def test_a_study_that_is_run_has_the_values_that_are_drawn(result, tmp_path):
    simulated = sweep(study(show=("time_s", "time_of_all_s")), tmp_path)
    for name in ("share", "mean", "runs_with_value", "low_95"):
        drawn = result.table[name].to_numpy()
        np.testing.assert_allclose(simulated.table[name].to_numpy(), drawn, rtol=1e-12)


def test_the_share_is_that_of_the_launches_with_a_value(result):
    partial, complete = result.rows("time_s")
    has_value = np.isfinite(values_of(SCENE["seed"], RUNS, 0.3))
    size = has_value.size
    assert partial["share"] == pytest.approx(has_value.mean(), rel=1e-12)
    count = partial["share"] * size
    assert binom.ppf(5e-4, size, 0.3) <= count <= binom.isf(5e-4, size, 0.3)
    assert complete["share"] == 1.0
    assert partial["runs_with_value"] == np.count_nonzero(has_value.any(axis=1))
    shares = [row["share"] for row in result.rows("time_of_all_s")]
    assert shares == [np.mean(has_value.all(axis=1)), 1.0]


def test_a_share_is_over_the_runs_that_a_figure_applies_to():
    values = np.array([1.0, np.nan, np.nan, 2.0])
    assert share_with_value(values) == 0.5
    assert share_with_value(values, np.array([0.5, 0.0, np.nan, 1.0])) == 0.5
    assert np.isnan(share_with_value(values[1:2], np.array([np.nan])))


def test_a_mean_over_some_launches_meets_no_requirement(result):
    partial, _ = result.rows("time_s")
    assert partial["mean"] < 60.0
    text = as_text(result)
    percent = f"{100.0 * partial['share']:.0f} %"
    count = partial["runs_with_value"] + RUNS
    for words in (
        "time_s <= 60: met by 1 of 2 designs (1.0)",
        f"as launches without the figure miss it: 0.3: {percent} of the launches in 20",
        "not by a mean over some, as launches",
        f"(%): the mean is over that share of the launches. With a value: time_s in {count}",
        "over that share of the runs. With a value: time_of_all_s in 20 of 40 runs",
    ):
        assert words in text
    table, differences = text.split("minus the first design")
    (row,) = [line for line in table.splitlines() if line.startswith("0.3 ")]
    assert f"] ({percent})" in row
    difference = next(line for line in differences.splitlines() if line.startswith("1.0"))
    assert f"(100 % minus {percent})" in difference


@pytest.mark.parametrize(("chance", "is_in_every_run"), [(0.05, False), (1.0, True)])
def test_figures_of_every_run_are_a_sentence(host, tmp_path, chance, is_in_every_run):
    settings = study(
        metrics=({"chance": {"spread_s": 0.0}},),
        vary={PERIOD: [100, 200]},
        requirements=(),
        overrides={"sensors[0].detection_probability": {"ICBM": chance}},
    )
    text = as_text(written(settings, tmp_path, spread_s=0.0))
    sections = study_page(read_study(tmp_path)).sections
    is_said = "In every run: time 50 s" in " ".join(section.text for section in sections)
    assert is_said == is_in_every_run
    assert ("In brackets" in text or "(%)" in text) != is_in_every_run


def test_the_report_says_of_which_launches_a_mean_is(result):
    saved = read_study(result.folder)
    rows = saved.rows("time_s")
    percent = f"{100.0 * rows['share'][0]:.0f} %"
    assert mean_text(saved, rows, 0).endswith(f"] (of {percent} of launches)")
    assert "launches" not in mean_text(saved, rows, 1)
    (verdict,) = verdicts(saved)
    assert (
        "met by 1 of 2 designs: detection probability of ICBM 1; not by a mean over some ("
        in verdict
    )
    assert f"(of {percent} of launches)" in verdict
    requirement = saved.requirements[0]
    assert is_surely_met(saved, requirement).tolist() == [False, True]
    assert rows["high_95"][0] < requirement["limit"]


def test_an_answer_names_the_best_design_of_all_launches(host, tmp_path):
    question = {
        "question": "Which?",
        "vary": {CHANCE: [0.3, 1.0], PERIOD: [100, 200]},
        "show": ("time_s",),
    }
    written(study(**question, requirements=("time_s <= 1",)), tmp_path)
    (answer,) = answers(read_study(tmp_path))
    assert "time is at best 54" in answer or "time is at best 55" in answer
    assert "detection probability of ICBM 1" in answer
    written(study(**question), tmp_path)
    (answer,) = answers(read_study(tmp_path))
    assert answer.startswith("2 of 4 designs meet time at most 60 s")
    assert "2 would by means over some of the launches, which do not count" in answer
    assert "Change of time (of 3" in answer


@pytest.mark.slow
def test_the_best_design_is_one_that_all_launches_have(host, tmp_path):
    pytest.importorskip("optuna")
    optimised = optimise(study(requirements=()), tmp_path, "min time_s", evaluations=2)
    means = [row["mean"] for row in optimised.result.rows("time_s")]
    best = optimised.result.definition["designs"][optimised.best]
    assert best[CHANCE] == 1.0
    assert means[optimised.best] == max(means)
    assert optimised.is_feasible


@pytest.mark.slow
def test_the_command_exits_with_2_where_launches_lack_figures(host, tmp_path, capsys, monkeypatch):
    pytest.importorskip("optuna")
    monkeypatch.chdir(tmp_path)
    scene = json.dumps({**SCENE, "duration_s": 2.0})
    (tmp_path / "scene.json").write_text(scene, encoding="utf-8")
    words = f"optimise scene.json --vary {CHANCE}=0.2,0.4 --runs 5 --metric chance -o out"
    command = [*words.split(), "--executor=serial", "--objective", "max having"]
    command += ["--require", "time_s <= 60"]
    assert main([*command, "--json"]) == 2
    document = json.loads(capsys.readouterr().out)
    assert document["best"][CHANCE] == 0.4
    assert document["shares"]["time_s"] == pytest.approx(document["means"]["having"])
    assert main(command) == 2
    text = capsys.readouterr().out
    words = "no design that was evaluated meets all requirements and has these figures in all"
    assert words in text
    assert "(%): the mean is over that share of the launches" in text


def test_ranks_put_launches_first_then_requirements_then_the_value():
    objective = Objective("x", is_largest=False)
    required = (FigureRequirement("y", 10.0, False),)

    def outcome(x, y, share_x=1.0, share_y=1.0):
        return outcome_of({"x": x, "y": y}, {"x": share_x, "y": share_y}, required, objective)

    order = [
        outcome(5.0, 9.0),
        outcome(6.0, 9.0),
        outcome(1.0, 11.0),
        outcome(1.0, 9.0, share_x=0.9),
        outcome(1.0, 9.0, share_y=0.5),
        outcome(np.nan, np.nan, share_x=0.0, share_y=np.nan),
    ]
    assert sorted(order) == order
    assert [design.is_feasible for design in order] == [True, True, False, False, False, False]


def test_runs_that_failed_are_not_counted(host, tmp_path):
    planned = planned_study(study(runs=3))
    runs = [record(number, number, (50.0, 1.0, 50.0)) for number in range(3)]
    finished = FinishedRuns.of(planned, tmp_path)
    finished.add(0, [runs[0], runs[2]])
    finished.add(1, runs)
    result = written_result(planned, tmp_path, finished.first([3, 3]))
    counts = [(row["runs"], row["share"]) for row in result.rows("time_s")]
    assert counts == [(2, 1.0), (3, 1.0)]


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.0, "0 %"),
        (1.0, "100 %"),
        (0.05, "5 %"),
        (0.9996, "99.96 %"),
        (1e-4, "0.01 %"),
        (np.nan, "-"),
    ],
)
def test_a_share_that_is_not_all_is_never_printed_as_all(share, text):
    assert percent_text(share) == text


def test_a_share_has_its_interval_if_known():
    assert share_text(0.996, 0.9, 1.0) == "99.6 % [90, 100]"
    assert share_text(0.25, float("nan"), float("nan")) == "25 %"
