"""The rule `likelihood`: its chances, its draws, and that another band never lowers the probability
of detection.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from opir_photons.detection import FusedBands
from opir_photons.detection.rejection_sampling import accepted_draws
from scipy.stats import kstest, norm
from snr_scene import NEXTGEN, SBIRS, joined, scene, windows_of

import opir_core as opir

signals = st.lists(st.floats(min_value=0.0, max_value=1e3), min_size=1, max_size=5)
noises = st.floats(min_value=1e-16, max_value=1e-8)


def rule_of(bands: int, threshold: float = 5.0) -> FusedBands:
    return FusedBands(threshold, np.arange(1.0, bands + 1.0), 2.0)


def quantile(snr: list[float], noise: list[float]) -> float:
    rule = rule_of(len(snr))
    rows = np.array([snr])
    return float(rule.quantile(rows, rule.directions(rows, np.array([noise])), 0.0)[0])


@given(signals, st.floats(min_value=0.0, max_value=1e3), st.data())
def test_another_band_never_lowers_the_probability_of_detection(
    snr: list[float], more: float, data: st.DataObject
) -> None:
    noise = data.draw(st.lists(noises, min_size=len(snr) + 1, max_size=len(snr) + 1))
    place = data.draw(st.integers(min_value=0, max_value=len(snr)))
    if max(snr) == 0.0:
        assert quantile(snr, noise[1:]) == -5.0
        return
    fewer = quantile(snr, noise[1:])
    all_ = quantile([*snr[:place], more, *snr[place:]], noise)
    assert all_ >= fewer - 1e-12 * abs(fewer + 5.0)
    useless = quantile([*snr[:place], 0.0, *snr[place:]], noise)
    assert useless == pytest.approx(fewer, abs=1e-12 * (abs(fewer) + 5.0))


@given(st.integers(min_value=1, max_value=5), st.floats(min_value=1.0, max_value=9.0))
def test_false_alarms_are_those_of_one_band(bands: int, threshold: float) -> None:
    rule = rule_of(bands, threshold)
    nothing = np.zeros((1, bands))
    log_chance, _ = rule.log_chances(nothing, rule.directions(nothing, np.full((1, bands), 1e-13)))
    assert log_chance[0] == pytest.approx(norm.logsf(threshold), rel=1e-12)


@pytest.mark.parametrize("snr", [[4.0, 3.0, 0.0], [0.5, 0.2, 0.1], [0.0, 0.0, 0.0]])
def test_free_draws_pass_as_often_as_the_probability_says(snr: list[float]) -> None:
    rule = rule_of(3, 2.0)
    rng = np.random.default_rng(1)
    rows = 200_000
    signal = np.array([snr])
    slopes = rule.directions(signal, np.ones((1, 3)))
    passed = rule.passes(signal + rng.normal(size=(rows, 3)), slopes).sum()
    chance = float(np.exp(rule.log_chances(signal, slopes)[0][0]))
    assert abs(passed - rows * chance) < 3.5 * np.sqrt(rows * chance * (1.0 - chance))


@pytest.mark.parametrize("snr", [[4.0, 3.0, 0.0], [1.0, 0.2, 0.5]])
def test_detections_are_distributed_as_passing_draws(
    snr: list[float],
) -> None:
    rule = rule_of(3, 3.0)
    rng = np.random.default_rng(2)
    rows = 400_000
    signal = np.tile(snr, (rows, 1))
    slopes = rule.directions(signal, np.ones(signal.shape))
    free = signal + rng.normal(size=signal.shape)
    selected = free[rule.passes(free, slopes)]
    count = min(len(selected), 20_000)
    seeds = rng.integers(0, 2**64, count, dtype=np.uint64)
    drawn = accepted_draws(rule, signal[:count], slopes[:count], np.ones(count), seeds)
    assert rule.passes(drawn, slopes[:count]).all()
    for band in range(3):
        assert kstest(drawn[:, band], selected[:count, band]).pvalue > 1e-3
    assert (
        kstest(drawn[:, 0] * drawn[:, 1], selected[:count, 0] * selected[:count, 1]).pvalue > 1e-3
    )


def test_a_draw_detects_however_bright_or_faint_the_source() -> None:
    rule = rule_of(2)
    rng = np.random.default_rng(3)
    snr = np.concatenate([10.0 ** rng.uniform(-6.0, 100.0, (500, 2)), np.zeros((500, 2))])
    slopes = rule.directions(snr, 10.0 ** rng.uniform(-60.0, 0.0, snr.shape))
    drawn = rule.conditional(snr, slopes, rng.random((1000, 3)))
    assert np.isfinite(drawn).all()
    assert rule.passes(drawn, slopes).all()
    assert (rule.strength(drawn, slopes) >= 5.0).all()


def without(sensor: dict, band: str) -> dict:
    """Return a sensor's block without one of its bands."""
    model = opir.Host.discover().component("opir_sensor_models", sensor["model"]).config
    bands = {
        name: edges for name, edges in model.__attrs_attrs__.bands.default.items() if name != band
    }
    return {**sensor, "bands": bands}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "band"), [(NEXTGEN, "LWIR"), (NEXTGEN, "SWIR"), (SBIRS, "SWIR"), (SBIRS, "MWIR")]
)
@pytest.mark.parametrize("plane", [None, "notional"])
def test_a_sensor_without_one_of_its_bands_never_detects_more(
    sensor: dict, band: str, plane: str | None
) -> None:
    selected = {
        "spectral_discrimination": "likelihood",
        "focal_plane": plane,
        "threshold_sigma": 7.0,
    }
    sensor = {**sensor, **selected, "orbital_slot_deg": -120.0}
    if plane:
        del sensor["nei_w_m2"]
    result = []
    for block in (sensor, without(sensor, band)):
        plan = opir.compile_plan(scene((block,), background="earth", duration_s=120))
        result.append(joined(windows_of(plan, [120.0]))[1].target)
    assert plan.detection.noise_chance[0] == pytest.approx(
        norm.sf(plan.sensors[0].radiometer.threshold)
    )
    counts = [np.bincount(targets[targets >= 0], minlength=3) for targets in result]
    assert (counts[0] >= counts[1]).all()
    assert counts[0].sum() > 0
