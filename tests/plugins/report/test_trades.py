"""What a study's report says of its designs, of a study whose answers are known: fronts, weights,
constants, files.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from figure_rules import drawn_complaints
from opir_report.pages.page import ReportTable
from opir_report.pages.paper import latex_table, markdown_table
from opir_report.pages.study_report import studies_in
from opir_report.plots.panels import effect_panels
from opir_report.plots.trades import convergence_rows, front_of, is_higher_better, tornado_rows
from opir_report.saved_study import read_study
from opir_report.words import figure_words, level_words, number_words, setting_words, shown_unit
from reported_runs import study_report_page
from saved_studies import PERIOD, TRACKER, written_study
from varied_studies import written

from opir_core.cli.main import main
from opir_core.errors import SceneError


def test_the_front_is_what_no_other_point_beats() -> None:
    rng = np.random.default_rng(3)
    cost, other_cost = rng.integers(0, 6, (2, 60)).astype(np.float64)
    expected = [
        not any(
            cost[rival] <= cost[row]
            and other_cost[rival] <= other_cost[row]
            and (cost[rival] < cost[row] or other_cost[rival] < other_cost[row])
            for rival in range(60)
        )
        for row in range(60)
    ]
    assert front_of(cost, other_cost).tolist() == expected


def test_a_tornado_has_the_range_of_marginal_means(tmp_path: Path) -> None:
    rows = tornado_rows(read_study(written_study(tmp_path / "a")), "latency_s")
    assert rows["path"].tolist() == [PERIOD, TRACKER]
    np.testing.assert_allclose(rows["low"], [0.1, 0.7 / 3.0])
    np.testing.assert_allclose(rows["high"], [0.4, 0.7 / 3.0])
    assert (rows["low_value"][0], rows["high_value"][0]) == ("50", "200")


def test_convergence_ends_at_the_mean_and_interval_of_all_runs(tmp_path: Path) -> None:
    from scipy.stats import t

    study = read_study(written(tmp_path / "a", "one-knob"))
    rows = convergence_rows(study, "latency_s")
    values = study.runs["latency_s"][study.runs["design"] == 1]
    final = rows.where((rows["design"] == 1) & (rows["runs"] == len(values)))
    low, high = t.interval(
        0.95, len(values) - 1, values.mean(), values.std(ddof=1) / len(values) ** 0.5
    )
    np.testing.assert_allclose(
        [final[name][0] for name in ("mean", "low_95", "high_95")], [values.mean(), low, high]
    )


def test_requested_figures_come_first_constants_are_text(tmp_path: Path) -> None:
    page = study_report_page(written(tmp_path / "a", "two-knobs"))
    assert page.sections[0].name == "answer"
    assert page.figures()[0].name == "effect-latency_s"
    assert page.figures()[1].name == "effect-position_rmse_m"
    section = next(section for section in page.sections if section.name == "metric-other")
    assert "In every run: tracked 1." in section.text
    assert any(line.startswith("latency at most 0.5 s: met by") for line in page.summary)


@pytest.mark.parametrize(
    ("name", "panels"),
    [
        ("one-knob", 1),
        ("two-knobs", 1),
        ("small-multiples", 5),
        ("three-knobs", 2),
        ("one-at-a-time", 3),
    ],
)
def test_settings_of_many_values_are_small_multiples(
    name: str, panels: int, tmp_path: Path
) -> None:
    assert len(effect_panels(read_study(written(tmp_path / "a", name)), "latency_s")) == panels


@pytest.mark.parametrize(
    ("bounds", "is_cut"), [([0.0, 0.9], (True, True)), ([None, None], (False, False))]
)
def test_intervals_are_cut_at_the_bounds_of_the_study(
    bounds: list, is_cut: tuple, tmp_path: Path
) -> None:
    folder = written(tmp_path / "a", "one-knob")
    definition = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    definition["bounds"]["warned"] = bounds
    (folder / "study.json").write_text(json.dumps(definition), encoding="utf-8")
    rows = read_study(folder).rows("warned")
    assert (rows["low_95"].min() == 0.0, rows["high_95"].max() == 0.9) == is_cut


def test_the_better_direction_of_figures(tmp_path: Path) -> None:
    study = read_study(written(tmp_path / "a", "one-knob"))
    senses = [is_higher_better(study, name) for name in ("latency_s", "warned", "impact_area_km2")]
    assert senses == [False, True, False]


def test_studies_side_by_side_need_the_same_settings(tmp_path: Path) -> None:
    first_study = written(tmp_path / "a", "one-knob")
    second_study = written(tmp_path / "b", "two-knobs")
    with pytest.raises(SceneError, match="vary different settings: one-knob sensors"):
        studies_in([first_study, second_study])
    joined = studies_in([first_study, written_again(tmp_path / "c")])
    assert joined.paths == ["study", PERIOD]
    rows = joined.rows("latency_s")
    assert rows["design"].tolist() == list(range(6))
    assert rows["study"].tolist() == ["one-knob"] * 3 + ["other"] * 3


def written_again(folder: Path) -> Path:
    written(folder, "one-knob")
    definition = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    (folder / "study.json").write_text(
        json.dumps({**definition, "study": "other"}), encoding="utf-8"
    )
    return folder


@pytest.mark.slow
def test_figures_and_tables_are_files_for_papers(tmp_path: Path, capsys) -> None:
    folder = written(tmp_path / "a", "one-knob")
    command = [
        "report",
        str(folder),
        "-o",
        str(tmp_path / "a.html"),
        "--figures",
        str(tmp_path / "figures"),
    ]
    assert main([*command, "--formats", "png,pdf"]) == 0
    assert "figures, 3 tables" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert {"effect-latency_s.png", "effect-latency_s.pdf", "trade.png"} <= names
    assert (tmp_path / "figures" / "trade.png").read_bytes().startswith(b"\x89PNG")
    assert main([*command, "--formats", "gif"]) == 2
    assert "'gif' is no format; there are png, svg, pdf" in capsys.readouterr().err


@pytest.mark.slow
def test_the_path_of_an_optimisation_keeps_the_rules_of_figures(tmp_path: Path) -> None:
    folder = written(tmp_path / "a", "three-knobs")
    definition = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    definition |= {"design": "optimise", "objective": {"figure": "latency_s", "is_largest": False}}
    (folder / "study.json").write_text(json.dumps(definition), encoding="utf-8")
    page = study_report_page(folder)
    assert "path" in [figure.name for figure in page.figures()]
    assert [line for figure in page.figures() for line in drawn_complaints(figure)] == []


def test_tables_are_escaped() -> None:
    table = ReportTable("50 % of a_b", ("a|b", "x"), [("1 & 2", "3 µm²")])
    assert r"1 \& 2 & 3 \textmu{}m\textsuperscript{2} \\" in latex_table(table)
    assert r"\caption{50 \% of a\_b}" in latex_table(table)
    assert "| a\\|b | x |\n|---|---:|\n| 1 & 2 | 3 µm² |\n" in markdown_table(table)


def test_names_are_words_with_units() -> None:
    assert setting_words("sensors[*].scan_period_ms") == ("scan period", "ms")
    assert setting_words("sensors[*].detection_probability.ICBM") == (
        "detection probability of ICBM",
        "",
    )
    assert setting_words("sensors[0]") == ("sensors 0", "")
    assert level_words("sensors[2].pointing.slew_deg_s", "0.2") == "slew 0.2 °/s"
    assert level_words("links.downlinks[1].rate_bytes_s", "4000") == "rate 4000 bytes/s"
    assert setting_words("growth_per_s") == ("growth", "per s")
    assert figure_words("position_rmse_m", "m") == "position RMSE"
    assert figure_words("false_events_a_day", "1/day") == "false events"
    assert level_words("sensors[*].orbital_slot_deg", "-135") == "orbital slot -135°"
    assert number_words(12_345.6) == "12\N{NARROW NO-BREAK SPACE}350"
    assert number_words(1679.4, 3) == "1680"
    assert shown_unit("m", np.array([3.0e4])).unit == "km"
    assert shown_unit("km2", np.array([3.0e6])).divisor == 1e6
