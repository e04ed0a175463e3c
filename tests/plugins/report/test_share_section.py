"""Launches on the page of a study: verdicts first, curves that count launches, conditions that are
not chosen.
"""

import numpy as np
import pytest
from attrs import evolve
from figure_rules import drawn_complaints
from matplotlib import pyplot
from opir_report import StudyPlots
from opir_report.pages.share_section import calibration_sentences, share_answers, share_section
from opir_report.pages.study_report import study_page
from opir_report.plots.share_curves import curve_rows, never_texts
from opir_report.saved_study import read_study
from opir_studies import Study, sweep
from study_scene import PERIOD, SCENE

CHANCE = "sensors[*].detection_probability.ICBM"
CONDITIONS = {"day": "2026-04-01T20:00:00Z", "night": SCENE["epoch"]}
SENTENCE = "detected within 2.5 s in 60 % of launches, in every condition"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shares") / "study"
    settings = Study(
        scene={**SCENE, "duration_s": 4.0},
        question="How fast is a launch detected?",
        vary={PERIOD: [3000, 1000], CHANCE: [0.2, 1.0]},
        conditions={"epoch": {"named": CONDITIONS}},
        runs=12,
        metrics=("latency",),
        requirements=(SENTENCE, "latency_p50_s <= 1.5"),
        executor="serial",
    )
    sweep(settings, folder)
    return read_study(folder)


def test_the_first_lines_are_the_verdicts_then_each_condition(study):
    lines = study_page(study).summary
    place = next(row for row, line in enumerate(lines) if line.startswith(SENTENCE))
    assert "met by scan period 1000 ms, detection probability of ICBM 1 (100 %" in lines[place]
    assert "In every condition latency median at most 1.5 s is met by" in lines[place + 1]
    assert lines[place + 2].startswith("Day: ")
    assert lines[place + 3].startswith("Night: ")
    assert "epoch" not in " ".join(lines)
    assert "least costly: condition" not in " ".join(lines)


def test_curves_count_launches(study):
    rows = curve_rows(study, "detected_s")
    launches = study.launches
    for row in range(0, len(rows), 7):
        name, condition = rows["design"][row], rows["condition"][row]
        labels = np.array(study.short_labels(launches, [PERIOD, CHANCE]))
        selected = (labels == name) & (launches["condition"] == condition)
        share = np.mean(launches["detected_s"][selected] <= rows["time_s"][row])
        assert rows["share"][row] == pytest.approx(share)
        assert rows["launches"][row] == selected.sum() == 12
    assert len(set(zip(rows["design"], rows["condition"], strict=True))) == 8
    assert all(np.diff(rows.where(rows["design"] == rows["design"][0])["share"][:3]) >= 0.0)


def test_the_caption_has_launches_runs_and_the_share_that_never_comes(study):
    section = share_section(study)
    caption = section.parts[0].caption
    assert "12 launches in 12 runs" in caption
    never = never_texts(curve_rows(study, "detected_s"))
    assert never[0] in caption
    table = section.parts[-1]
    assert len(table.rows) == 4 * (1 + 2)


def test_every_caption_has_runs_seeds_and_version(study):
    page = study_page(study)
    version = study.definition["versions"]["opir-core"]
    end = f"12 runs of each, seeds 100 to 111; opir {version}."
    assert all(figure.caption.endswith(end) for figure in page.figures())
    citing = next(section for section in page.sections if section.name == "citing")
    assert f"with opir {version} for 8 combinations" in citing.text
    assert "in the conditions day, night: 12 runs of each, seeds 100 to 111 with 96 launches" in (
        citing.text
    )


def test_curves_keep_the_rules_of_figures(study):
    section = share_section(study)
    assert drawn_complaints(section.parts[0]) == []


def test_curves_are_a_plot_of_a_notebook_too(study, tmp_path_factory):
    pyplot.switch_backend("agg")
    folder = next(tmp_path_factory.getbasetemp().glob("shares*/study"))
    figure = StudyPlots(folder).shares("detected_s")
    assert [axes.get_title("left") for axes in figure.axes] == ["day", "night"]
    with pytest.raises(KeyError, match="no time of launches; looked_s, detected_s, reported_s are"):
        StudyPlots(folder).shares("latency_s")
    pyplot.close("all")


def test_a_study_without_launches_has_no_section(study):
    bare = evolve(study, launches=None, shares=None)
    assert share_section(bare) is None
    assert share_answers(bare) == calibration_sentences(bare) == []


@pytest.mark.parametrize(("held", "is_said"), [(0.5, True), (0.95, False)])
def test_regions_that_hold_too_seldom_are_the_first_line(study, held, is_said):
    launches = study.launches
    column = (np.arange(len(launches)) % 20 < 20 * held).astype(float)
    columns = {**launches.columns, "impact_contained_at_90_s": column}
    stated = evolve(
        study,
        launches=evolve(launches, columns=columns),
        definition={**study.definition, "containments": {"impact_contained_at_90_s": 0.95}},
    )
    # All designs as one: 96 launches.
    columns["design"] = np.zeros(len(launches), dtype=int)
    columns["replicate"] = np.arange(len(launches))
    lines = study_page(stated).summary
    assert lines[0].startswith("Stated impact regions hold") == is_said
    if is_said:
        assert "impact contained at 90 s" in lines[0]
        assert "stated 95 %" in lines[0]
