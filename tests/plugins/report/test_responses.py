"""Main effects, interactions and contours of planted response surfaces, and the answer to a study's
question.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from figure_rules import drawn_complaints
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from opir_report.factorial import FactorialRuns, intervals, ranked_settings
from opir_report.pages.sentences import answers, least_costly
from opir_report.plots.effects import FigureScale
from opir_report.plots.responses import contour_pair, draw_contours, main_effect_rows, parts_of
from opir_report.saved_study import SavedStudy, read_study
from reported_runs import study_report_page
from scipy.stats import t
from varied_studies import write_study

PERIOD = "sensors[*].scan_period_ms"
COUNT = "sensors.count"
TARGETS = "targets"
LEVELS = {
    TARGETS: ["one ICBM", "raid of 8"],
    PERIOD: [10_000.0, 5000.0, 2000.0],
    COUNT: [1.0, 2.0, 4.0],
}
RUNS = 4


def warning_s(targets: str, period_ms: float, count: float) -> float:
    """Return the planted response: bilinear in period and count, 100 s less for the raid."""
    return (
        1000.0
        - 0.05 * period_ms
        + 50.0 * count
        - 0.004 * period_ms * count
        - 100.0 * (targets != "one ICBM")
    )


def noise_s() -> np.ndarray:
    """Return the noise of each run, the same in all designs."""
    return np.random.default_rng(8).normal(0.0, 5.0, RUNS)


@pytest.fixture
def planted(tmp_path: Path) -> SavedStudy:
    """Return a study of all combinations whose runs follow the response."""
    write_study(
        tmp_path,
        list(LEVELS),
        list(product(*LEVELS.values())),
        lambda levels: {
            "warning_time_s": warning_s(*(levels[path] for path in LEVELS)) + noise_s()
        },
        study="planted",
        design="factorial",
        figures={"warning_time_s": "s"},
        metrics={"warning_time": ["warning_time_s"]},
        question="What buys warning time?",
        split=TARGETS,
        settings={"warning_time": {"region_km2": 1e6, "launch_point_km": None}},
        requirements=[{"figure": "warning_time_s", "limit": 900.0, "is_least": True}],
    )
    return read_study(tmp_path)


def test_intervals_are_those_of_student() -> None:
    values = np.random.default_rng(1).normal(3.0, 2.0, (3, 7))
    values[1, :2] = np.nan
    values[2, 1:] = np.nan
    mean, low, high = intervals(values)
    for row in (0, 1):
        finite = values[row][np.isfinite(values[row])]
        ends = t.interval(
            0.95, len(finite) - 1, finite.mean(), finite.std(ddof=1) / len(finite) ** 0.5
        )
        np.testing.assert_allclose([mean[row], low[row], high[row]], [finite.mean(), *ends])
    assert mean[2] == values[2, 0]
    assert np.isnan([low[2], high[2]]).all()


def test_main_effects_are_means_over_the_other_settings(planted: SavedStudy) -> None:
    rows = main_effect_rows(planted, "warning_time_s")
    for path, kind, value, mean in zip(
        *(rows[name].tolist() for name in ("path", "part", "value", "mean")), strict=True
    ):
        values = [
            warning_s(*levels)
            for levels in product(*LEVELS.values())
            if levels[0] == kind and levels[list(LEVELS).index(path)] == float(value)
        ]
        assert mean == pytest.approx(np.mean(values) + noise_s().mean())
    assert len(rows) == 2 * (3 + 3)


def test_interactions_are_the_cells_of_the_response(planted: SavedStudy) -> None:
    runs = FactorialRuns.of(planted, "warning_time_s")
    rows = runs.rows([COUNT, PERIOD])
    for count, period, mean in zip(
        *(rows[name].tolist() for name in (COUNT, PERIOD, "mean")), strict=True
    ):
        expected = (
            np.mean([warning_s(kind, period, count) for kind in LEVELS[TARGETS]]) + noise_s().mean()
        )
        assert mean == pytest.approx(expected)


def test_changes_are_paired_over_runs(planted: SavedStudy) -> None:
    raid_runs = parts_of(planted, "warning_time_s")[1].runs
    expected = np.mean(
        [
            warning_s("raid of 8", 2000.0, count) - warning_s("raid of 8", 1e4, count)
            for count in (1, 2, 4)
        ]
    )
    # The noise is common to all designs: it cancels.
    np.testing.assert_allclose(raid_runs.change(PERIOD), [expected] * 3, rtol=1e-9)
    assert ranked_settings(raid_runs) == [PERIOD, COUNT]


def test_a_run_counts_only_with_a_value_everywhere(planted: SavedStudy) -> None:
    planted.runs["warning_time_s"][
        (planted.runs["design"] == 0) & (planted.runs["replicate"] == 2)
    ] = np.nan
    runs = FactorialRuns.of(planted, "warning_time_s").at(TARGETS, "one ICBM")
    means = runs.averaged([PERIOD])
    assert np.isnan(means[0, 2])
    assert np.isfinite(np.delete(means.ravel(), 2)).all()


def test_the_contour_of_a_requirement_follows_the_response(planted: SavedStudy) -> None:
    figure = Figure()
    FigureCanvasAgg(figure)
    runs = parts_of(planted, "warning_time_s")[0].runs
    pair = contour_pair(planted, "warning_time_s")
    assert pair == (PERIOD, COUNT)
    scale = FigureScale.of(planted, "warning_time_s")
    drawn = draw_contours(figure.add_subplot(), runs, pair, scale, planted.requirements)
    (vertices,) = [path.vertices for path in drawn[0].get_paths()]
    assert len(vertices) > 2
    # On the edges between settings that were run a bilinear response is linear, as the contour is.
    on_edges = [row for row in vertices if row[0] in LEVELS[PERIOD] or row[1] in LEVELS[COUNT]]
    assert len(on_edges) > 2
    for period_ms, count in on_edges:
        assert warning_s("one ICBM", period_ms, count) + noise_s().mean() == pytest.approx(
            900.0, abs=1e-6
        )


def test_the_answer_names_what_is_enough_and_what_changes_it(planted: SavedStudy) -> None:
    single, raid_runs = answers(planted)
    assert single.startswith("One ICBM: ")
    assert raid_runs.startswith("Raid of 8: ")
    ends = t.interval(0.95, RUNS - 1, noise_s().mean(), noise_s().std(ddof=1) / RUNS**0.5)
    combinations = [
        warning_s("one ICBM", *levels) for levels in product(LEVELS[PERIOD], LEVELS[COUNT])
    ]
    sure, mean = (
        sum(value + shift >= 900.0 for value in combinations)
        for shift in (ends[0], noise_s().mean())
    )
    assert (
        f"{sure} of 9 designs meet warning time at least 900 s with the whole 95 % interval"
        in single
    )
    assert ("more by the mean alone" in single) == (mean > sure)
    assert "from scan period 10000 ms to 2000 ms" in single
    assert "from number of sensors 1 to 4" in single


def test_the_least_costly_are_not_undercut(planted: SavedStudy) -> None:
    rows = planted.rows(next(iter(planted.units)))
    single = np.arange(9)  # periods from 10 s on, each with 1, 2 and 4 sensors
    assert single[least_costly(rows, planted.paths, single)].tolist() == [0]
    designs = np.array([2, 4, 5, 7])  # 10 s with 4, 5 s with 2 and 4, 2 s with 2
    assert designs[least_costly(rows, planted.paths, designs)].tolist() == [2, 4]


def test_a_requirement_that_nothing_meets_names_the_best(planted: SavedStudy) -> None:
    planted.definition["requirements"][0]["limit"] = 5000.0
    assert (
        "no design meets warning time at least 5000 s; warning time is at best"
        in answers(planted)[0]
    )
    assert "(scan period 2000 ms, number of sensors 4)" in answers(planted)[0]


def test_other_kinds_of_studies_have_no_such_section(planted: SavedStudy) -> None:
    planted.definition["design"] = "one-at-a-time"
    assert parts_of(planted, "warning_time_s") == []
    assert answers(planted) == []


@pytest.mark.slow
def test_the_page_begins_with_question_and_answer(planted: SavedStudy, tmp_path: Path) -> None:
    page = study_report_page(tmp_path)
    assert page.title == "What buys warning time?"
    assert page.summary == answers(planted)
    names = [figure.name for figure in page.figures()]
    assert {
        f"{kind}-warning_time_s" for kind in ("main-effects", "interactions", "contours")
    } <= set(names)
    assert [line for figure in page.figures() for line in drawn_complaints(figure)] == []
    table = dict(page.tables()[-1].rows)
    assert (
        table["warning time"]
        == "region 1\N{NARROW NO-BREAK SPACE}000\N{NARROW NO-BREAK SPACE}000 km², launch point not required"
    )
    assert table["runs"] == "4 of each design, seeds 0 to 3; all runs"
