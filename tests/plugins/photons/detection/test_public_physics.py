"""The public functions of radiometry and detection: closed forms, Monte Carlo, and the domains of
their arguments.
"""

import math

import numpy as np
import pytest
from opir_photons.detection import (
    cumulative_probability,
    latency_cdf,
    latency_mean,
    latency_quantile,
    m_of_n_probability,
    probability_of_detection,
    threshold_sigma,
)
from opir_photons.radiometry import (
    band_radiance,
    band_transmittance,
    irradiance_at_aperture,
    minimum_detectable_intensity,
    planck_radiance,
)
from scipy.stats import binom, geom

from opir_core.flight import (
    Ephemeris,
    aim,
    boost_ephemeris,
    boost_profile,
    coast_ephemeris,
)
from opir_core.geometry import Geodetic

PROBABILITIES = np.array([0.0, 1e-12, 0.05, 0.35, 0.6, 0.95, 1.0])

#: Two-sided 99.9 % of a normal distribution.
Z = 3.2905


@pytest.mark.parametrize("looks", [0, 1, 2, 7, 1500])
def test_cumulative_probability_is_the_binomial_tail(looks: int) -> None:
    chance = cumulative_probability(PROBABILITIES, looks)
    assert chance == pytest.approx(binom.sf(0, looks, PROBABILITIES), rel=1e-12, abs=0.0)
    assert chance == pytest.approx(m_of_n_probability(PROBABILITIES, 1, looks), rel=1e-12, abs=0.0)


def test_cumulative_probability_of_small_chances() -> None:
    assert cumulative_probability(0.8, 10) == pytest.approx(0.9999998976, abs=5e-11)
    assert cumulative_probability(0.6, 5) == pytest.approx(0.98976, abs=1e-12)
    assert cumulative_probability(1e-20, 3) == pytest.approx(3e-20, rel=1e-15)
    assert cumulative_probability(0.5, np.inf) == 1.0
    assert cumulative_probability([[0.1], [0.2]], [1, 2, 3]).shape == (2, 3)
    assert np.isnan(cumulative_probability([-0.1, 1.1, np.nan, 0.5], [1.0, 1.0, 1.0, -1.0])).all()


@pytest.mark.parametrize("probability", [0.05, 0.6, 0.95])
def test_latency_of_aligned_scans_is_geometric(probability: float) -> None:
    """Times that are whole periods count the look at that time, though 0.2 * 3 is not 0.6 in
    binary.
    """
    scans = np.arange(60)
    steps = latency_cdf(0.2 * scans, 0.2, probability)
    assert steps == pytest.approx(geom.cdf(scans, probability), rel=1e-12, abs=0.0)
    assert latency_cdf(0.6, 0.2, probability) == steps[3]
    assert latency_cdf(0.6 - 2e-9, 0.2, probability) == steps[2]
    assert latency_mean(0.2, probability) == pytest.approx(0.2 * geom.mean(probability))


@pytest.mark.parametrize("phase", ["aligned", "random"])
@pytest.mark.parametrize("probability", [0.1, 0.6, 1.0])
def test_latency_against_simulated_scans(phase: str, probability: float) -> None:
    """The law is within 99.9 % of 50 000 launches whose looks are drawn one by one."""
    rng = np.random.default_rng(20)
    period_s = 0.2
    launches = 50_000
    first_s = period_s * (rng.random(launches) if phase == "random" else np.ones(launches))
    detected = rng.random((200, launches)) < probability
    latency_s = first_s + period_s * detected.argmax(axis=0)
    times_s = np.array([0.05, 0.2, 0.31, 0.4, 1.0, 2.07])
    measured = (latency_s <= times_s[:, None] + 1e-9).mean(axis=1)
    law = latency_cdf(times_s, period_s, probability, phase)
    assert np.all(np.abs(measured - law) <= Z * np.sqrt(law * (1.0 - law) / launches) + 1e-12)
    error_s = Z * latency_s.std() / math.sqrt(launches) + 1e-12
    assert abs(latency_s.mean() - latency_mean(period_s, probability, phase)) < error_s


@pytest.mark.parametrize("probability", [0.01, 0.35, 0.6, 0.95, 1.0])
def test_quantiles_of_latency_invert_the_law(probability: float) -> None:
    levels = np.linspace(0.0, 0.999, 57)
    random_s = latency_quantile(levels, 0.2, probability, "random")
    assert latency_cdf(random_s, 0.2, probability, "random") == pytest.approx(levels, abs=1e-8)
    aligned_s = latency_quantile(levels[1:], 0.2, probability)
    assert (latency_cdf(aligned_s, 0.2, probability) >= levels[1:] - 1e-12).all()
    assert (latency_cdf(aligned_s - 1e-8, 0.2, probability) < levels[1:]).all()
    assert latency_quantile(0.0, 0.2, probability) == 0.0


def test_the_papers_95th_percentiles() -> None:
    percentiles = latency_quantile(0.95, [0.2, 0.1, 0.05], [0.6, 0.8, 0.95])
    assert percentiles == pytest.approx([0.80, 0.20, 0.05])


def test_domains_of_latency() -> None:
    assert latency_cdf([-1.0, 0.0, np.inf], 0.2, 0.5).tolist() == [0.0, 0.0, 1.0]
    assert latency_cdf([-1.0, 0.0, np.inf], 0.2, 0.5, "random").tolist() == [0.0, 0.0, 1.0]
    assert np.isnan(
        latency_cdf([np.nan, 1.0, 1.0, 1.0], [1.0, 0.0, -1.0, 1.0], [0.5, 0.5, 0.5, 1.5])
    ).all()
    assert latency_mean(0.2, 0.0) == np.inf
    assert latency_quantile([0.0, 0.5], 0.2, 0.0).tolist() == [0.0, np.inf]
    assert np.isnan(latency_quantile([-0.1, 1.0], 0.2, 0.5)).all()
    for law in (
        lambda: latency_cdf(1.0, 0.2, 0.5, "swept"),
        lambda: latency_mean(0.2, 0.5, "spin"),
    ):
        with pytest.raises(ValueError, match="scan_phase must be aligned or random"):
            law()


def test_band_transmittance_is_that_of_the_table() -> None:
    """Nodes of the table, the top of the atmosphere, paths through the Earth, and rising with
    height.
    """
    assert band_transmittance(2.5, 3.0, 100e3, 0.3) == 1.0
    assert band_transmittance(2.5, 3.0, 10e3, -0.5) == 0.0
    heights = np.linspace(0.0, 99e3, 50)
    passed = band_transmittance(4.0, 5.0, heights[:, None], [0.2, 1.2], climate="tropical")
    assert passed.shape == (50, 2)
    assert (np.diff(passed, axis=0) >= 0.0).all()
    assert (passed[:, 1] >= passed[:, 0]).all()
    assert passed.min() > 0.0
    assert passed.max() <= 1.0


def test_band_transmittance_of_an_unknown_band_or_climate() -> None:
    with pytest.raises(ValueError, match=r"2.1 to 2.2 um is no band of LOWTRAN's table"):
        band_transmittance(2.1, 2.2, 0.0, 1.0)
    with pytest.raises(ValueError, match="'martian' is not one of us1976"):
        band_transmittance(2.5, 3.0, 0.0, 1.0, climate="martian")


def test_the_chain_from_source_to_probability_of_detection() -> None:
    """A source of the least intensity has P_d = 1/2 at its threshold, whatever the path."""
    passed = band_transmittance(4.0, 5.0, 20e3, math.radians(40.0))
    threshold = float(threshold_sigma(2.867e-7))
    least_w_sr = minimum_detectable_intensity(1e-12, 3.6e7, passed, threshold)
    snr = irradiance_at_aperture(least_w_sr, 3.6e7, passed) / 1e-12
    assert probability_of_detection(snr, threshold) == pytest.approx(0.5, abs=1e-12)
    wavelengths = np.linspace(4.0, 5.0, 2001)
    spectrum = planck_radiance(1500.0, wavelengths)
    assert np.trapezoid(spectrum, wavelengths) == pytest.approx(
        band_radiance(1500.0, 4.0, 5.0), rel=1e-7
    )


def test_a_whole_flight_from_launch_to_aim_point() -> None:
    launch, target = (
        Geodetic(np.radians([latitude]), np.radians([longitude]), np.zeros(1))
        for latitude, longitude in ((5.0, -100.0), (40.0, -60.0))
    )
    flight = aim(launch, target, 0.0, [boost_profile("ICBM_solid")])
    whole = Ephemeris.joined([boost_ephemeris(flight.path), coast_ephemeris(flight)])
    assert whole.position_m(0, whole.end_s[0]) == pytest.approx(flight.impact_ecef_m[0], abs=0.01)
    assert whole.position_m(0, whole.start_s[0]) == pytest.approx(
        flight.path.plane.launch_m[0], abs=0.01
    )
