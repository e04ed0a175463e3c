"""Signals that bend while P_d does not: the interpolation grid follows each band's signal and noise
by itself.
"""

from typing import Any

import numpy as np
import pytest
from attrs import frozen
from numpy.typing import NDArray

import opir_core as opir
from opir_core.planning import Looks
from opir_core.planning.looks import LookGeometry
from opir_core.plugin import DetectionProbability, Exposures, Response
from opir_core.simulation import ProbabilityInterpolant
from opir_core.simulation.refinement import FIRST_PIECE_S, KNOTS, GridRefiner, Intervals

Array = NDArray[np.float64]

#: Tolerance of signals and noise: relative, or in standard deviations of noise.
SHARE = 0.01
SIGMA = 0.05


@pytest.fixture(scope="module")
def plan() -> Any:
    """Return a plan of one launch seen by one sensor of 20 looks a second."""
    sensor = {
        "model": "generic-scanner",
        "id": "S",
        "orbital_slot_deg": -140.0,
        "scan_period_ms": 50.0,
    }
    target = {
        "id": "T",
        "type": "ICBM",
        "launch": {"lat_deg": 5.0, "lon_deg": -150.0, "time_s": 2.0},
        "aim": {"lat_deg": -50.0, "lon_deg": -110.0},
    }
    scene = {"scene": "bends", "epoch": "2026-04-01T12:00:00Z", "duration_s": 200.0, "outputs": []}
    return opir.compile_plan(
        opir.scene_from_mapping({**scene, "sensors": [sensor], "targets": [target]})
    )


@frozen
class Bent(DetectionProbability):
    """A model of a constant P_d in two bands, with a bend of signals or of noise; sums over the
    bands are constant.
    """

    quantile: float
    signal: float = 0.0
    noise: float = 0.0
    signal_level: float = 20.0
    probability_tolerance: float = 1e-4

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response:
        bend = np.tanh((exposures.emission_time_s - 61.7) / 1.5)
        signals = np.stack([bend, -bend], axis=1)
        snr = self.signal_level * (1.0 + self.signal * signals)
        noise = 3e-12 * (1.0 + self.noise * signals)
        return Response(np.full(len(exposures), self.quantile), snr, noise)

    def probability(self, exposures: Exposures) -> Any:
        raise AssertionError("only responses are interpolated here; nothing is measured")

    measure = probability
    measure_response = measure  # type: ignore[assignment]


def errors(geometry: LookGeometry, end_ns: int, model: Any) -> tuple[Array, Array]:
    """Return the interpolated less the true signals and noise (n, B) of all looks, over the
    tolerance.
    """
    looks = Looks.between(geometry.pairs, 0, end_ns)
    exact = model.response(geometry.exposures(looks.pair, looks.scan))
    interpolant = (
        ProbabilityInterpolant.of(geometry, model, 1e-4)
        .over(looks)
        .response(np.arange(len(looks.pair)))
    )
    return (
        (interpolant.snr - exact.snr) / np.maximum(SHARE * np.abs(exact.snr), SIGMA),
        (interpolant.noise_w_m2 - exact.noise_w_m2) / (SHARE * np.abs(exact.noise_w_m2)),
    )


@pytest.mark.parametrize("quantile", [0.3, 12.0], ids=["P_d of 0.6", "P_d of 1"])
@pytest.mark.parametrize(
    "bend", [{"signal": 0.7}, {"noise": 0.7}, {"signal": 0.7, "signal_level": 2.0}], ids=str
)
def test_cancelling_bends_of_two_bands_are_refined(
    plan: Any, bend: dict[str, float], quantile: float
) -> None:
    snr, noise = errors(plan.look_geometry(), plan.end_ns, Bent(quantile, **bend))
    assert len(snr) > 2000
    assert np.abs(snr).max() <= 1.0
    assert np.abs(noise).max() <= 1.0


@pytest.mark.parametrize("bend", [{"signal": 0.7}, {"noise": 0.7}], ids=str)
def test_certain_misses_and_straight_signals_get_first_knots(
    plan: Any, bend: dict[str, float]
) -> None:
    knots = {
        (name, quantile): GridRefiner(plan.look_geometry(), model, 1e-4).refined().values.shape[1]
        for quantile in (-12.0, 0.3, 12.0)
        for name, model in (("bent", Bent(quantile, **bend)), ("straight", Bent(quantile)))
    }
    # Neighbouring pieces share a knot.
    pieces = np.ceil(0.05 * (plan.pairs.last_scan[0] - plan.pairs.first_scan[0]) / FIRST_PIECE_S)
    assert (
        knots["straight", -12.0]
        == knots["bent", -12.0]
        == knots["straight", 12.0]
        == 2 * pieces + 1
    )
    assert knots["straight", 0.3] == (KNOTS - 1) * pieces + 1
    assert all(
        knots["bent", quantile] > knots["straight", quantile] + 10 for quantile in (0.3, 12.0)
    )


def is_straight(scan: Array, columns: Array) -> bool:
    """Return whether values (2 B, m) at scans (m,), signals first, are on lines between neighbours
    within tolerance.
    """
    for row, values in enumerate(columns):
        least = SIGMA if row < len(columns) // 2 else 0.0
        for knot in range(1, len(scan) - 1):
            ends = [knot - 1, knot + 1]
            line = np.interp(scan[knot], scan[ends], values[ends])
            # A line twice as long deviates four times as much from a curve.
            if abs(values[knot] - line) > 2.0 * max(SHARE * abs(values[knot]), least):
                return False
    return True


def bent_pieces(bands: int, knots: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return scans (knots, count) and signals and noise (2 bands, knots, count) of pieces.

    One value of each piece is off its line by a little less or more than is allowed.
    """
    rng = np.random.default_rng([17, bands, knots])
    scan = np.cumsum(rng.integers(0, 9, (knots, count)), axis=0)
    level = np.concatenate(
        [
            rng.choice([0.0, 0.8, 30.0, -30.0], (bands, count)),
            10.0 ** rng.uniform(-13, -9, (bands, count)),
        ]
    )
    slope = level * rng.uniform(-0.01, 0.01, level.shape)
    columns = level[:, None, :] + slope[:, None, :] * (scan - scan[0])
    piece = np.arange(count)
    row = rng.integers(2 * bands, size=count)
    knot = rng.integers(1, knots - 1, size=count)
    least = np.where(row < bands, SIGMA, 0.0)
    off = rng.choice([-1.0, 1.0], count) * rng.choice([0.3, 0.9, 1.1, 1.6], count)
    free = (scan[knot, piece] > scan[knot - 1, piece]) & (scan[knot + 1, piece] > scan[knot, piece])
    allowed = 2.0 * np.maximum(SHARE * np.abs(columns[row, knot, piece]), least)
    columns[row, knot, piece] += free * off * allowed
    return scan, columns


@pytest.mark.slow
@pytest.mark.parametrize("bands", [1, 2, 3])
@pytest.mark.parametrize("knots", [3, KNOTS])
def test_straightness_against_lines_between_neighbouring_knots(bands: int, knots: int) -> None:
    count = 2000
    scan, columns = bent_pieces(bands, knots, count)
    rows = np.arange(knots * count).reshape(knots, count)
    sine = np.zeros((1, knots * count))
    values = np.concatenate([sine, columns.reshape(2 * bands, -1), sine])
    pieces = Intervals(np.arange(count), scan, rows, np.full((2, count), np.nan))
    straight = GridRefiner(None, None, 1e-4)._is_straight(pieces, values)  # type: ignore[arg-type]
    expected = [
        is_straight(scan[:, piece].astype(np.float64), columns[:, :, piece])
        for piece in range(count)
    ]
    assert straight.tolist() == expected
    assert 0.3 < np.mean(expected) < 0.7


@pytest.mark.parametrize("bands", [1, 2, 3])
def test_pieces_are_steady_if_every_band_changes_by_little(bands: int) -> None:
    rng = np.random.default_rng([18, bands])
    count = 2000
    scan = np.array([[0], [7], [14]])
    level = rng.choice([0.02, 5.0, 400.0], (bands, count))
    # Straight signals; one band of each piece changes by a little less or more than is allowed,
    # down or up.
    maximum = np.maximum(0.3 * level, SIGMA)
    change = rng.choice([0.0, 0.2, 0.6], level.shape) * maximum
    changing = rng.integers(bands, size=count), np.arange(count)
    change[changing] = rng.choice([0.0, 0.9, 1.1, 1.6], count) * maximum[changing]
    share = np.where(rng.random(count) < 0.5, scan / 14.0, 1.0 - scan / 14.0)
    signals = level[:, None, :] - change[:, None, :] * share
    # Noise and quantiles may change by any amount.
    noise = (1.0 + 5.0 * share) * np.ones((bands, 1, 1))
    rows = np.arange(3 * count).reshape(3, count)
    quantile = 10.0 + 20.0 * share.reshape(1, -1)
    values = np.concatenate(
        [quantile, signals.reshape(bands, -1), noise.reshape(bands, -1), 0.0 * quantile]
    )
    pieces = Intervals(
        np.arange(count), np.broadcast_to(scan, rows.shape), rows, np.full((2, count), np.nan)
    )
    steady = GridRefiner(None, None, 1e-4)._is_steady(pieces, values)  # type: ignore[arg-type]
    expected = [
        all(
            max(band) - min(band) <= max(0.3 * max(band), SIGMA)
            for band in signals[:, :, row].tolist()
        )
        for row in range(count)
    ]
    assert steady.tolist() == expected
    assert 0.2 < np.mean(expected) < 0.8
