"""Every kind of picture of the reports keeps the rules of figures, on the page and at the width of
a paper.
"""

from pathlib import Path

import pytest
from figure_rules import broken_rules, drawn_complaints
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from opir_report.canvas import svg_of
from reported_runs import report_page, study_report_page
from scored_scene import SCENE
from svg_texts import cut_texts, figures_in, overprints, texts_of
from varied_studies import STUDIES, written

import opir_core


def complaints(page) -> list[str]:
    pictures = [line for each in page.figures() for line in drawn_complaints(each)]
    figures = figures_in(page.html(None))
    assert len(figures) >= len(list(page.figures()))
    assert all(texts_of(svg) for svg in figures)
    printed_over = [pair for svg in figures for pair in overprints(svg)]
    return [*pictures, *printed_over, *(words for svg in figures for words in cut_texts(svg))]


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
    ("texts", "pairs"),
    [
        ([(0.5, 0.5, 0), (0.52, 0.5, 0)], 1),
        ([(0.5, 0.5, 0), (0.5, 0.6, 0)], 0),
        ([(0.5, 0.5, 30), (0.5, 0.56, 30)], 0),
        ([(0.5, 0.5, 30), (0.52, 0.56, -30)], 1),
        ([(0.1, 0.5, 90), (0.1, 0.6, 90)], 1),
    ],
)
def test_texts_on_each_other_are_read_from_the_file(texts, pairs: int) -> None:
    def draw(figure):
        for number, (x, y, angle) in enumerate(texts):
            figure.text(x, y, f"scan period {number}", rotation=angle, rotation_mode="anchor")
        figure.text(1.0, 0.1, "beyond")

    svg = svg_of(draw, (5.0, 3.0), "texts", "texts")
    assert len(overprints(svg)) == pairs
    assert cut_texts(svg) == ["beyond"]


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
