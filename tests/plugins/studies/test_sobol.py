"""Sobol indices of functions whose indices are known, and against SALib on the same points."""

import csv

import numpy as np
import pytest
from opir_report.pages.study_report import studies_in, study_page
from opir_studies import Study, sweep
from opir_studies.sobol import sobol_indices, sobol_points
from SALib.analyze import sobol as salib
from study_scene import PERIOD, SCENE
from svg_texts import overprints, texts_of

from opir_core.errors import SceneError

SAMPLES = 2048


def ishigami(unit):
    x = np.pi * (2.0 * unit - 1.0)
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def sobol_g(unit):
    weights = np.array([0.0, 1.0, 4.5, 9.0])
    return np.prod((np.abs(4.0 * unit - 2.0) + weights) / (1.0 + weights), axis=1)


def exact_ishigami():
    first = 0.5 * (1.0 + 0.1 * np.pi**4 / 5.0) ** 2
    second = 7.0**2 / 8.0
    joint = 0.1**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = first + second + joint
    return (
        np.array([first, second, 0.0]) / variance,
        np.array([first + joint, second, joint]) / variance,
    )


def exact_g():
    weights = np.array([0.0, 1.0, 4.5, 9.0])
    parts = 1.0 / (3.0 * (1.0 + weights) ** 2)
    variance = np.prod(1.0 + parts) - 1.0
    total = [part * np.prod(np.delete(1.0 + parts, row)) for row, part in enumerate(parts)]
    return parts / variance, np.array(total) / variance


CASES = [(ishigami, 3, exact_ishigami), (sobol_g, 4, exact_g)]


@pytest.mark.parametrize(("function", "settings", "exact"), CASES)
def test_indices_are_those_of_the_closed_form(function, settings, exact):
    values = function(sobol_points(settings, SAMPLES, 58))
    index = sobol_indices(values, settings)
    first, total = exact()
    # Twice the 95 % interval: eight comparisons, all within it.
    assert (np.abs(index.first - first) <= 2.0 * index.first_half).all()
    assert (np.abs(index.total - total) <= 2.0 * index.total_half).all()
    assert (index.first_half < 0.1).all()


@pytest.mark.parametrize(("function", "settings", "_exact"), CASES)
def test_indices_are_those_of_salib_on_the_same_points(function, settings, _exact):
    values = function(sobol_points(settings, SAMPLES, 59))
    index = sobol_indices(values, settings)
    # SALib has the rows of one base point together: base, exchanged ones, other base.
    base, other_base, *exchanged = values.reshape(settings + 2, -1)
    rows = np.stack([base, *exchanged, other_base], axis=1).ravel()
    names = [f"x{number}" for number in range(settings)]
    problem = {"num_vars": settings, "names": names, "bounds": [[0.0, 1.0]] * settings}
    peer = salib.analyze(problem, rows, calc_second_order=False, seed=1)
    # SALib centres by the mean of all rows, not of both bases.
    np.testing.assert_allclose(index.first, peer["S1"], atol=1e-5)
    np.testing.assert_allclose(index.total, peer["ST"], atol=1e-9)
    np.testing.assert_allclose(index.first_half, peer["S1_conf"], rtol=0.4, atol=1e-6)
    np.testing.assert_allclose(index.total_half, peer["ST_conf"], rtol=0.4, atol=1e-6)


def test_a_constant_figure_has_no_indices():
    index = sobol_indices(np.ones(4 * 8), 2)
    assert np.isnan([index.first, index.total]).all()


def test_a_study_writes_the_indices_of_its_settings(tmp_path):
    """The scan period moves the latency; the noise of its lines of sight does not."""
    study = Study(
        scene={**SCENE, "duration_s": 12.0},
        vary={
            PERIOD: {"uniform": [100, 4000]},
            "sensors[0].line_of_sight_sigma_urad": {"uniform": [40, 60]},
        },
        design="sobol",
        samples=16,
        runs=3,
        metrics=("latency",),
        executor="serial",
    )
    result = sweep(study, tmp_path)
    assert len(result.definition["designs"]) == 16 * 4
    with (tmp_path / "sensitivity.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["figure"] == "latency_s"]
    index = {row["setting"]: float(row["total"]) for row in rows}
    assert index[PERIOD] > 0.5
    assert index["sensors[0].line_of_sight_sigma_urad"] == pytest.approx(0.0, abs=1e-12)
    page = study_page(studies_in(tmp_path))
    (figure,) = (each for each in page.figures() if each.name == "sensitivity")
    assert figure.data["setting"].tolist() == [PERIOD, "sensors[0].line_of_sight_sigma_urad"]
    assert figure.data["total"].tolist() == [pytest.approx(index[PERIOD]), pytest.approx(0.0)]
    assert "Sobol indices" in figure.caption
    assert "scan period" in figure.svg
    texts = [text.words for each in page.figures() for text in texts_of(each.svg)]
    assert "300" in texts, "ticks of drawn settings are round"
    assert [pair for each in page.figures() for pair in overprints(each.svg)] == []


def test_more_designs_than_a_study_may_have_are_refused(tmp_path):
    study = Study(
        scene=SCENE, vary={PERIOD: {"uniform": [1, 2]}}, design="sobol", samples=9000, runs=1
    )
    with pytest.raises(SceneError, match="more than 10000 designs"):
        sweep(study, tmp_path)
