"""Reports and plots of a study: effects with intervals at the right places, and the sentences that
sum them up.
"""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from opir_report import StudyPlots, write_study_report
from repository import DATA
from saved_studies import PERIOD, PERIODS_MS, TRACKER, written_study

from opir_core.cli.main import main
from opir_core.errors import SceneError

SVG = re.compile(r"<svg.*?</svg>", re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written_study(tmp_path_factory.mktemp("studies") / "revisit")


def test_effects_are_drawn_over_the_numbers_that_vary(folder: Path) -> None:
    axes = StudyPlots(folder).effect("latency_s")
    lines = [line for line in axes.lines if len(line.get_xdata()) == len(PERIODS_MS)]
    assert len(lines) >= 2
    for line in lines[:2]:
        np.testing.assert_allclose(line.get_xdata(), PERIODS_MS, atol=1.0)
        if line.get_marker() == "o":
            np.testing.assert_allclose(line.get_ydata(), [2e-3 * period for period in PERIODS_MS])
    bars = np.concatenate([segment for bar in axes.collections for segment in bar.get_segments()])
    assert {round(float(y), 3) for y in bars[:, 1]} == {
        round(share * 2e-3 * period, 3) for period in PERIODS_MS for share in (0.9, 1.1)
    }
    assert axes.get_xlabel() == "scan period, ms"
    assert axes.get_ylabel() == "latency, s"
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {"none", "imm"}
    assert axes.get_legend().get_title().get_text() == "tracker"


def test_effects_over_names_have_their_names(folder: Path) -> None:
    axes = StudyPlots(folder).effect("latency_s", over=TRACKER)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["none", "imm"]


def test_designs_without_a_value_are_left_out(folder: Path) -> None:
    axes = StudyPlots(folder).effect("area_km2")
    assert axes.get_legend() is None
    assert all(np.isfinite(line.get_ydata()).all() for line in axes.lines)


def test_differences_are_paired_from_the_first_design(folder: Path) -> None:
    axes = StudyPlots(folder).difference("latency_s")
    (points,) = [line for line in axes.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(points.get_xdata(), [0.0, 0.1, 0.1, 0.3, 0.3], atol=1e-12)
    assert axes.get_yticklabels()[0].get_text() == "50 ms, imm"


def test_unknown_figures_and_paths_list_the_known_ones(folder: Path) -> None:
    with pytest.raises(KeyError, match="no figure 'speed'; it has latency_s, area_km2"):
        StudyPlots(folder).effect("speed")
    with pytest.raises(KeyError, match=r"'seed' does not vary .*tracker do"):
        StudyPlots(folder).effect("latency_s", over="seed")


@pytest.mark.slow
def test_the_report_of_a_study_says_how_much_what_changes(
    folder: Path, tmp_path: Path, capsys
) -> None:
    assert main(["report", str(folder), "-o", str(tmp_path / "study.html")]) == 0
    assert "data of 4 figures" in capsys.readouterr().out
    text = (tmp_path / "study.html").read_text(encoding="utf-8")
    assert (
        "latency: from 0.1 s [0.09, 0.11] (scan period 50 ms, tracker none) to 0.4 s [0.36, 0.44]"
        in text
    )
    assert (
        "area: 10\N{NARROW NO-BREAK SPACE}000 km² [9000, 11\N{NARROW NO-BREAK SPACE}000] in all"
        " designs" in text
    )
    assert PERIOD in text
    assert "60 runs" in text
    assert "seeds 3 to 12" in text
    for picture in SVG.findall(text):
        ElementTree.fromstring(picture)


@pytest.mark.slow
def test_a_study_has_one_report_to_the_byte(folder: Path, tmp_path: Path) -> None:
    page_a, page_b = (
        write_study_report(folder, tmp_path / f"{name}.html", with_data=False)[0] for name in "ab"
    )
    assert page_a.read_bytes() == page_b.read_bytes()


def test_a_damaged_study_gets_one_message(folder: Path, tmp_path: Path, capsys) -> None:
    broken = written_study(tmp_path / "broken")
    (broken / "results.parquet").write_bytes(b"no table")
    assert main(["report", str(broken)]) == 2
    assert "damaged results" in capsys.readouterr().err
    definition = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    for name in ("figures", "designs", "until"):
        part = {key: value for key, value in definition.items() if key != name}
        (broken / "study.json").write_text(json.dumps(part), encoding="utf-8")
        (broken / "results.parquet").write_bytes((folder / "results.parquet").read_bytes())
        assert main(["report", str(broken)]) == 2
        assert f"({name} is missing)" in capsys.readouterr().err
    (broken / "results.parquet").unlink()
    with pytest.raises(SceneError, match="no folder of a finished study"):
        StudyPlots(broken)
    newer = written_study(tmp_path / "later")
    (newer / "study.json").write_text(
        json.dumps({**definition, "study_version": 2}), encoding="utf-8"
    )
    with pytest.raises(SceneError, match=r"study version 2, where 3\.x is read"):
        StudyPlots(newer)


def test_a_study_of_an_earlier_version_is_plotted():
    assert StudyPlots(DATA / "formats" / "study-3").study.definition["runs"] == 2
