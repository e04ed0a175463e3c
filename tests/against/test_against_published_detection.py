"""Detection against published cases: thresholds in Gaussian noise, M of N."""

import json

import mpmath
import numpy as np
import pytest
from opir_photons.detection import (
    false_alarm_probability,
    m_of_n_probability,
    probability_of_detection,
    threshold_sigma,
)
from repository import DATA
from scipy.stats import binom

CASES = json.loads((DATA / "reference_cases.json").read_text())
ROWS = {
    case["id"]: case
    for case in (CASES["cases"] if isinstance(CASES, dict) else CASES)
    if case["topic"] == "detection"
}


def rows(name):
    return list(ROWS[name]["expected"]["rows"])


@pytest.mark.parametrize("row", rows("gauss_threshold"), ids=str)
def test_thresholds_and_probabilities_in_gaussian_noise(row):
    threshold = threshold_sigma(row["pfa"])
    assert threshold == pytest.approx(row["threshold_sigma"], rel=1e-13)
    assert probability_of_detection(row["snr"], threshold) == pytest.approx(row["pd"], rel=1e-12)
    assert false_alarm_probability(threshold) == pytest.approx(row["pfa"], rel=1e-12)


@pytest.mark.parametrize(("needed", "looks"), [(1, 1), (2, 3), (3, 5), (8, 10), (0, 4), (5, 4)])
def test_m_of_n_is_the_tail_of_the_binomial_law(needed, looks):
    chance = np.array([0.0, 1e-9, 0.1, 0.5, 0.95, 1.0])
    assert m_of_n_probability(chance, needed, looks) == pytest.approx(
        binom.sf(needed - 1, looks, chance), rel=1e-11, abs=1e-300
    )


def test_tails_are_kept_down_to_the_least_double_and_below():
    assert threshold_sigma(1e-300) == pytest.approx(37.0470964, abs=1e-6)
    assert probability_of_detection(0.0, threshold_sigma(1e-300)) == pytest.approx(
        1e-300, rel=1e-12
    )


@pytest.mark.parametrize("deficit", [37.4, 37.6, 37.7, 38.0, 38.4, 38.6])
def test_the_least_probabilities_are_those_of_high_precision(deficit):
    with mpmath.workdps(40):
        exact = float(mpmath.erfc(mpmath.mpf(deficit) / mpmath.sqrt(2)) / 2)
    # Denormal numbers are multiples of the least double.
    assert float(probability_of_detection(1.0, deficit + 1.0)) == pytest.approx(
        exact, rel=1e-11, abs=5e-324
    )
    assert float(probability_of_detection([1.0], [deficit + 1.0])[0]) == pytest.approx(
        exact, rel=1e-11, abs=5e-324
    )
