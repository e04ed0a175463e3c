"""Every kind of picture of the reports keeps the rules of figures, on the page and at the width of
a paper.
"""

from pathlib import Path

import pytest
from figure_rules import broken_rules, drawn_complaints
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from reported_runs import report_page, study_report_page
from scored_scene import SCENE
from varied_studies import STUDIES, written

import opir_core


def complaints(page) -> list[str]:
    return [line for each in page.figures() for line in drawn_complaints(each)]


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_pictures_of_studies(name: str, tmp_path: Path) -> None:
    page = study_report_page(written(tmp_path / name, name))
    assert page.figures()
    assert complaints(page) == []


@pytest.mark.slow
def test_pictures_of_studies_side_by_side(tmp_path: Path) -> None:
    folders = [written(tmp_path / str(number), "one-knob") for number in range(2)]
    page = study_report_page(*folders)
    assert "one-knob (1)" in page.html(None)
    assert complaints(page) == []


@pytest.mark.slow
def test_pictures_of_a_run() -> None:
    target = {
        "id": "T2",
        "type": "SRBM",
        "launch": {"lat_deg": 30.0, "lon_deg": -118.0, "time_s": 5.0},
        "aim": {"lat_deg": 31.0, "lon_deg": -122.0},
    }
    scene = {
        **SCENE,
        "duration_s": 200.0,
        "detection": "snr",
        "targets": [*SCENE["targets"], target],
        "tracker": {"model": "imm", "cadence_s": 4.0},
    }
    page = report_page(opir_core.simulate(opir_core.scene_from_mapping(scene)))
    assert complaints(page) == []


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda axes: axes.text(0.99, 0.5, "far too long for the edge", transform=axes.transAxes), "cut by the edge"),
        (lambda axes: (axes.plot([1, 2, 3], [1, 2, 1]), axes.legend(["a"], loc="lower left")), "the legend covers"),
        (lambda axes: (axes.plot([1e8, 1e8 + 1]), None), "has the offset"),
        (lambda axes: (axes.semilogy([2, 3], [2.0, 3.0]), axes.yaxis.set_major_formatter("")), "has 0 labels"),
        (lambda axes: (axes.plot([1, 2], [1, 2]), axes.set_ylim(0, 100)), "the data use 1%"),
        (lambda axes: axes.text(0.5, 0.5, "tiny", fontsize=5), "5 pt"),
        (lambda axes: [axes.text(0.5, 0.5, words) for words in ("one", "two")], "printed over"),
    ],
)  # fmt: skip
def test_each_rule_is_seen_to_break(spoil, words: str) -> None:
    figure = Figure(figsize=(5.0, 3.0))
    FigureCanvasAgg(figure)
    spoil(figure.add_subplot())
    assert any(words in line for line in broken_rules(figure))


def test_a_legend_has_the_dashes_of_its_line() -> None:
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(5.0, 3.0))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot([1, 2], [1, 2], color="red", linestyle="--")
    axes.legend(handles=[Line2D([], [], color="red", label="a")], loc="upper left")
    assert any("other dashes" in line for line in broken_rules(figure))
