"""CFAR against draws of reference cells, its loss against the noncentral t, and looks of correlated
noise.
"""

import numpy as np
import pytest
from opir_photons.detection import (
    cfar_loss,
    cfar_probability_of_detection,
    cfar_threshold,
    effective_looks,
    probability_of_detection,
    threshold_sigma,
)


@pytest.mark.slow
@pytest.mark.parametrize("cells", [8, 24])
@pytest.mark.parametrize("snr", [0.0, 4.0])
def test_draws_of_reference_cells_cross_as_often_as_student_says(cells: int, snr: float) -> None:
    """400 000 looks; 4 standard deviations."""
    rng = np.random.default_rng(cells)
    looks = 400_000
    reference = rng.normal(3.0, 2.0, (looks, cells))
    tested = rng.normal(3.0 + 2.0 * snr, 2.0, looks)
    spread = reference.std(axis=1, ddof=1) * np.sqrt(1.0 + 1.0 / cells)
    threshold = float(cfar_threshold(1e-3, cells))
    crossed = float(np.mean((tested - reference.mean(axis=1)) / spread >= threshold))
    expected = float(cfar_probability_of_detection(snr, threshold, cells))
    assert crossed == pytest.approx(
        expected, abs=4.0 * np.sqrt(expected * (1.0 - expected) / looks)
    )


@pytest.mark.parametrize("probability", [1e-3, 2.867e-7])
@pytest.mark.parametrize("cells", [16, 32, 200])
def test_a_loss_of_snr_stands_for_the_estimated_noise(probability: float, cells: int) -> None:
    loss = float(cfar_loss(probability, cells))
    threshold = float(threshold_sigma(probability))
    limit = float(cfar_threshold(probability, cells))
    assert float(cfar_probability_of_detection(loss * threshold, limit, cells)) == pytest.approx(
        0.5, abs=1e-6
    )
    snr = np.linspace(0.0, 3.0 * threshold, 100)
    off = cfar_probability_of_detection(loss * snr, limit, cells) - probability_of_detection(
        snr, threshold
    )
    assert np.abs(off).max() < 0.031


def test_the_loss_falls_to_nothing_with_many_cells() -> None:
    losses = cfar_loss(1e-6, np.array([8.0, 16.0, 64.0, 1e3, 1e5]))
    assert np.all(np.diff(losses) < 0.0)
    assert losses[-1] == pytest.approx(1.0, abs=2e-4)


def test_effective_looks_are_those_of_the_variance_of_a_mean() -> None:
    rng = np.random.default_rng(11)
    rho = 0.8
    looks = 25
    series = np.empty((200_000, looks))
    series[:, 0] = rng.normal(size=len(series))
    for look in range(1, looks):
        series[:, look] = rho * series[:, look - 1] + np.sqrt(1 - rho**2) * rng.normal(
            size=len(series)
        )
    result = float(effective_looks(rho ** np.arange(looks)))
    assert 1.0 / series.mean(axis=1).var() == pytest.approx(result, rel=0.015)
    assert float(effective_looks(np.eye(1, 9)[0])) == 9.0
    assert float(effective_looks(np.ones(9))) == pytest.approx(1.0)


@pytest.mark.parametrize("cells", [2, 3, 8, 64, 1_000_000])
@pytest.mark.parametrize("probability", [0.3, 0.16, 1e-3, 1e-6, 1e-12, 8e-24])
def test_losses_of_any_number_of_cells_give_half(cells: int, probability: float) -> None:
    loss = float(cfar_loss(probability, cells))
    limit = float(cfar_threshold(probability, cells))
    snr = loss * float(threshold_sigma(probability))
    assert loss >= 1.0
    assert float(cfar_probability_of_detection(snr, limit, cells)) == pytest.approx(0.5, abs=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("cells", [2, 8, 64, 1_000_000])
@pytest.mark.parametrize("threshold", [-5.0, 0.0, 1.0, 10.0, 1e4, 1e9])
def test_detection_only_grows_with_signals_up_to_the_largest(cells: int, threshold: float) -> None:
    snr = np.array(
        [0.0, 1e-300, 1.0, 1e2, 1e4, 3e4, 1e5, 3e5, 1e6, 1e8, 1e10, 1e12, 1e15, 1e300, np.inf]
    )
    result = cfar_probability_of_detection(snr, threshold, cells)
    assert np.all(np.diff(result) >= -1e-9)
    assert np.all((result >= 0.0) & (result <= 1.0))
    assert result[-3:].tolist() == pytest.approx([1.0, 1.0, 1.0])
