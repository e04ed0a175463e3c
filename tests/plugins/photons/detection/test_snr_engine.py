"""The model `snr` in the engine: noise at its rate, what a window costs, calibration, and no
dependence.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from attrs import fields
from opir_photons.detection import snr
from opir_photons.detection.gate_density import GateDensity
from scipy.stats import chi2, norm, poisson, spearmanr
from snr_scene import DSP, NEAR_THRESHOLD, NEXTGEN, SBIRS, joined, scene, windows_of

import opir_core as opir
from opir_core import Detections, DetectionTruth, Engine
from opir_core.plugin import Response
from opir_core.random_streams.philox import Reader
from opir_core.simulation import false_alarms


def assert_same(one: Detections, other: Detections, leave_out: Sequence[str] = ()) -> None:
    for attribute in fields(Detections):
        if attribute.name not in leave_out:
            assert (
                getattr(one, attribute.name).tobytes() == getattr(other, attribute.name).tobytes()
            ), attribute.name


@pytest.fixture(scope="module")
def plan() -> Any:
    return opir.compile_plan(scene(NEAR_THRESHOLD))


@pytest.fixture(scope="module")
def whole(plan: Any) -> tuple[Detections, DetectionTruth]:
    return joined(windows_of(plan, [60.0]))


def test_no_slicing_changes_a_byte(plan: Any, whole: tuple[Detections, DetectionTruth]) -> None:
    cut = joined(windows_of(plan, [0.05, 3.0, 17.123456789, 17.2, 41.0, 60.0]))
    assert (whole[1].target < 0).sum() > 1000
    assert_same(cut[0], whole[0])
    assert cut[1].target.tobytes() == whole[1].target.tobytes()
    assert np.all(np.diff(whole[0].time_ns) >= 0)
    assert len(np.unique(whole[0].detection_id, axis=0)) == len(whole[0])


def test_neighbours_change_nobodys_draws() -> None:
    alone = opir.compile_plan(scene([SBIRS], "R"))
    crowd = opir.compile_plan(scene())
    result, _ = joined(windows_of(alone, [60.0]))
    everyone, truth = joined(windows_of(crowd, [60.0]))
    # In the whole scene B is sensor 1 and R target 1.
    width = alone.detection.width
    reference = everyone.take((everyone.sensor == 1) & ((truth.target == 1) | (truth.target < 0)))
    assert len(reference) > 20
    assert_same(result, reference, leave_out=("sensor", "band_irradiance_w_m2"))
    assert np.array_equal(result.band_irradiance_w_m2, reference.band_irradiance_w_m2[:, :width])


def test_noise_comes_at_the_rate_that_the_threshold_implies(
    plan: Any, whole: tuple[Detections, DetectionTruth]
) -> None:
    result, truth = whole
    noise = result.take(truth.target < 0)
    cells = 4.0 * np.pi * np.sin(np.radians(5.0)) ** 2 / 56e-6**2
    expected = norm.sf(5.0) * cells * 300
    counted = int((noise.sensor == 0).sum())
    low, high = poisson.interval(0.999, expected)
    assert low <= counted <= high
    assert np.all(noise.detection_count == 1)
    assert np.all(noise.snr >= 5.0)


def test_noise_is_spread_uniformly_over_the_field_of_regard(
    plan: Any, whole: tuple[Detections, DetectionTruth]
) -> None:
    noise = whole[0].take((whole[1].target < 0) & (whole[0].sensor == 0))
    down = -noise.sensor_ecef_m / np.linalg.norm(noise.sensor_ecef_m, axis=1)[:, None]
    half = 1.0 - np.cos(np.radians(10.0))
    shares = np.sort((1.0 - (noise.line_of_sight_ecef * down).sum(axis=1)) / half)
    assert shares[-1] <= 1.0 + 1e-9
    assert np.max(np.abs(shares - (np.arange(len(shares)) + 0.5) / len(shares))) < 1.95 / np.sqrt(
        len(shares)
    )
    turns = np.sort(
        np.arctan2(
            noise.line_of_sight_ecef[:, 2],
            noise.line_of_sight_ecef @ np.cross(down[0], [0, 0, 1.0]),
        )
    )
    turns = (turns + np.pi) / (2.0 * np.pi)
    assert np.max(np.abs(turns - (np.arange(len(turns)) + 0.5) / len(turns))) < 1.95 / np.sqrt(
        len(turns)
    )


@pytest.mark.slow
def test_windows_read_each_pair_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = opir.compile_plan(scene(NEAR_THRESHOLD, duration_s=220))
    reads = []
    built = []
    philox = np.random.Philox
    words = Reader.words
    monkeypatch.setattr(np.random, "Philox", lambda **place: built.append(place) or philox(**place))
    monkeypatch.setattr(Reader, "words", lambda *place: reads.append(place) or words(*place))
    engine = Engine(plan)
    # One for all pairs; of each sensor three for its noise: how often, which, and the phase of its
    # scan.
    assert len(built) <= 1 + 3 * len(plan.sensors)
    monkeypatch.setattr(GateDensity, "panels", None)
    reads.clear()
    window = engine.advance(plan.end_ns)
    measured = int((window.truth.target >= 0).sum())
    assert measured > 400
    noise = [place for place in reads if place[0] is not engine._streams._reader]
    pairs = int((plan.pairs.looks > 0).sum())
    # Whether it detects, and where it lies: what it measures is spun from that.
    assert len(reads) - len(noise) <= 2 * pairs
    # Of each sensor how often, and a read for each block of 256 false alarms on average.
    scans = np.array([plan.end_ns / sensor.scan.period_ns for sensor in plan.sensors])
    assert len(noise) <= np.sum(3 + plan.detection.rate_per_scan * scans / 230.0)


@pytest.mark.slow
def test_noise_is_measured_by_sensor_in_time_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = opir.compile_plan(scene(NEAR_THRESHOLD))
    asked = []
    inner = type(plan.detection).measure_noise
    monkeypatch.setattr(
        type(plan.detection),
        "measure_noise",
        lambda *given: asked.append(given[1]) or inner(*given),
    )
    window = Engine(plan).advance(plan.end_ns)
    assert len(asked) == 1
    assert len(asked[0]) > 1000
    assert np.all(np.diff(asked[0]) >= 0)
    noise = window.detections.take(window.truth.target < 0)
    assert np.all(np.diff(window.detections.time_ns) >= 0)
    assert np.array_equal(np.sort(noise.sensor), asked[0])
    # Without a target they are what they were, in the same order.
    alone = Engine(opir.compile_plan(scene(NEAR_THRESHOLD, names="I", duration_s=60)))
    assert_same(alone.advance(round(3e9)).detections, noise.take(noise.time_ns < 3e9))


def test_windows_are_measured_once_a_kind_of_receiver(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = opir.compile_plan(scene(NEAR_THRESHOLD, duration_s=220))
    total = Engine(plan).advance(plan.end_ns)
    measured = []
    repeated = []
    placed = []
    inner = type(plan.detection).measure_response
    to_pass = snr.accepted_draws
    directions = false_alarms._directions
    monkeypatch.setattr(
        type(plan.detection), "measure_response", lambda *g: measured.append(len(g[2])) or inner(*g)
    )
    monkeypatch.setattr(
        snr, "accepted_draws", lambda *given: repeated.append(len(given[1])) or to_pass(*given)
    )
    monkeypatch.setattr(
        false_alarms,
        "_directions",
        lambda *given: placed.append(len(given[0])) or directions(*given),
    )
    monkeypatch.setattr("opir_core.planning.looks.BLOCK_ROWS", 100)
    parted = Engine(plan).advance(plan.end_ns)
    seen = int((total.truth.target >= 0).sum())
    kinds = len(set(plan.detection.twin.tolist()))
    assert measured == [seen]
    assert seen > 50 * kinds
    # Of each kind what targets' draws left, and the exceedances of noise.
    assert kinds < len(repeated) <= 2 * kinds
    # False alarms are placed a block at a time, each once.
    assert max(placed) == 100
    assert len(placed) == -(-sum(placed) // 100)
    assert sum(placed) >= (total.truth.target < 0).sum() > 0
    # How many rows are worked on at a time changes nothing.
    assert_same(parted.detections, total.detections)
    assert parted.truth.range_m.tobytes() == total.truth.range_m.tobytes()


class _Given:
    """Dice that hand out given normal numbers (n, B)."""

    def __init__(self, normal: np.ndarray) -> None:
        self.normal = normal

    def normals(self, purpose: str, count: int = 1) -> np.ndarray:
        return self.normal[:, :count].copy()

    def uniforms(self, purpose: str, words: int = 1) -> np.ndarray:
        # A row's own number, whichever rows are taken.
        return np.remainder(np.abs(self.normal[:, :1]) * 1e6, 1.0) * np.ones(words)

    def take(self, rows: Any) -> "_Given":
        return _Given(self.normal[rows])


@pytest.mark.slow
@pytest.mark.parametrize("signal", [pytest.param(4.0, marks=pytest.mark.slow), 6.0, 9.0])
def test_measurements_forget_rejected_draws(
    signal: float,
) -> None:
    """Two samples, 40 cells a band, chi-squared; and no rank correlation with what failed: 99.9 %,
    Bonferroni of 24.
    """
    gates = {**NEXTGEN, "spectral_discrimination": "triple-coincidence", "threshold_sigma": 5.0}
    model = opir.compile_plan(scene((DSP, SBIRS, gates))).detection
    rows = 60_000
    receiver = model.receivers[2]
    rng = np.random.default_rng(int(signal))
    noise = np.tile(model.dark_noise_w_m2[2], (rows, 1))
    # The colour of a plume, which lies within the gates.
    colour = model.environment.reference_intensity_w_sr[receiver.bands] / model.dark_noise_w_m2[2]
    snr = np.tile(signal * colour / colour[0], (rows, 1))
    log_chance = receiver.rule.log_chances(snr[:1], receiver.rule.slopes(noise[:1]))[0]
    response = Response(np.full(rows, norm.ppf(np.exp(log_chance[0]))), snr, noise)
    normal = rng.normal(size=(rows, 3))
    measured = model.measure_response(response, np.full(rows, 2, dtype=np.int32), _Given(normal))
    drawn = measured.band_irradiance_w_m2 / noise
    free = snr[:1] + rng.normal(size=(int(rows / np.exp(log_chance[0])), 3))
    selected = free[
        receiver.rule.passes(free, receiver.rule.slopes(noise[:1].repeat(len(free), axis=0)))
    ]
    failed = ~receiver.rule.passes(snr + normal, receiver.rule.slopes(noise))
    assert receiver.rule.passes(drawn, receiver.rule.slopes(noise)).all()
    for band in range(3):
        edges = np.quantile(selected[:, band], np.linspace(0.0, 1.0, 41)[1:-1])
        one, other = (
            np.bincount(np.searchsorted(edges, each[:, band]), minlength=40)
            for each in (selected, drawn)
        )
        spread = (
            one * np.sqrt(rows / len(selected)) - other * np.sqrt(len(selected) / rows)
        ) ** 2 / (one + other)
        assert spread.sum() < chi2.isf(0.001 / 24, 39)
        for other_band in range(3):
            ranks = spearmanr(normal[failed, other_band], drawn[failed, band]).statistic
            assert abs(ranks) < norm.isf(0.0005 / 24) / np.sqrt(failed.sum())


def test_calibrated_sensors_see_the_reference_as_the_paper_says() -> None:
    model = opir.compile_plan(scene(detection={"model": "snr", "calibrate": "paper"})).detection
    for number, expected in enumerate((0.6, 0.8, 0.95)):
        receiver = model.receivers[number]
        signal = model.environment.reference_intensity_w_sr[receiver.bands] / 3.6e7**2
        noise = receiver.nei_w_m2
        chance = np.exp(
            receiver.rule.log_chances(
                (signal / noise)[None, :], receiver.rule.slopes(noise[None, :])
            )[0][0]
        )
        assert chance == pytest.approx(expected, abs=1e-12)


def test_residuals_are_as_wide_as_they_say(plan: Any) -> None:
    wide = opir.compile_plan(scene([DSP], "I", duration_s=200))
    result, truth = joined(windows_of(wide, [200.0]))
    result = result.take(truth.target >= 0)
    truth = truth.take(truth.target >= 0)
    true = wide.targets.position_ecef_m(truth.target, truth.emission_time_s) - result.sensor_ecef_m
    true /= np.linalg.norm(true, axis=1)[:, None]
    squared = np.sum(
        ((result.line_of_sight_ecef - true) / result.line_of_sight_sigma_rad[:, None]) ** 2, axis=1
    )
    ordered = np.sort(1.0 - np.exp(-squared / 2.0))
    count = len(ordered)
    assert count > 200
    assert np.ptp(result.line_of_sight_sigma_rad) > 1e-7
    assert np.max(np.abs(ordered - (np.arange(count) + 0.5) / count)) < 1.95 / np.sqrt(count)
    assert np.allclose(
        result.line_of_sight_sigma_rad, np.hypot(50e-6, 56e-6 / result.snr), rtol=1e-12, atol=0.0
    )
