"""False alarms confirmed over scans: the closed form against cells and scans drawn one by one."""

import numpy as np
import pytest
from opir_photons.detection.confirmation import (
    false_confirmation_probability,
    gate_radius_cells,
    repeated_crossing_probability,
)
from scipy.integrate import quad
from scipy.spatial import cKDTree
from scipy.stats import binom, norm


def drawn_share(chance: float, needed: int, radius: np.ndarray, seed: int) -> tuple[int, int]:
    """Return how many false alarms are confirmed, of how many: points drawn in a plane, scan by
    scan.
    """
    rng = np.random.default_rng(seed)
    side = 300.0
    scans = 400
    margin = float(radius.max(initial=0.0))
    drawn = [rng.random((rng.poisson(chance * side * side), 2)) * side for _ in range(scans)]
    trees = [cKDTree(points) for points in drawn]
    confirmed = 0
    total = 0
    for scan in range(len(radius), scans):
        inner = drawn[scan][np.all((drawn[scan] > margin) & (drawn[scan] < side - margin), axis=1)]
        hits = np.zeros(len(inner), dtype=np.int64)
        for back, reach in enumerate(radius, start=1):
            hits += trees[scan - back].query_ball_point(inner, reach, return_length=True) > 0
        confirmed = confirmed + int(np.sum(hits >= needed - 1))
        total = total + len(inner)
    return confirmed, total


@pytest.mark.slow
@pytest.mark.parametrize(("needed", "scans"), [(1, 1), (2, 2), (2, 3), (3, 4), (4, 6)])
def test_false_confirmations_match_the_closed_form(needed: int, scans: int) -> None:
    radius = gate_radius_cells(np.arange(1, scans), 0.2, 5.6e-5, 3.6e7, 8000.0)
    chance = 2e-3
    confirmed, total = drawn_share(chance, needed, radius, seed=needed + 10 * scans)
    share = false_confirmation_probability(chance, needed, radius)
    # Neighbours share their gates: twice the binomial spread is allowed, at 99.9 %.
    least, most = binom.interval(0.999, total, share)
    assert least - (total * share - least) <= confirmed <= most + (most - total * share)


def test_gates_grow_by_the_way_of_the_fastest_source() -> None:
    # 8 km/s for 10 s are 80 km, 40 cells of 2 km.
    assert gate_radius_cells([0, 1, 2], 10.0, 2e3 / 3.6e7, 3.6e7, 8000.0) == pytest.approx(
        [1.0, 41.0, 81.0]
    )


def test_small_chances_are_not_lost() -> None:
    radius = np.array([2.0, 3.0])
    # Three detections in three scans: both gates must be hit.
    exact = (1e-12 * np.pi * 4.0) * (1e-12 * np.pi * 9.0)
    assert false_confirmation_probability(1e-12, 3, radius) == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("chance", [0.1, 1e-3, 2.867e-7, 1e-12])
@pytest.mark.parametrize("correlation", [-0.1, 0.05, 0.3, 0.8, 0.99])
def test_a_crossing_repeats_as_the_integral_over_the_first_says(
    chance: float, correlation: float
) -> None:
    limit = norm.isf(chance)
    spread = np.sqrt(1.0 - correlation**2)

    def both(first: float) -> float:
        return float(norm.pdf(first) * norm.sf((limit - correlation * first) / spread))

    expected = quad(both, limit, limit + 12.0, epsabs=0.0, epsrel=1e-10, limit=500)[0] / chance
    assert float(repeated_crossing_probability(chance, correlation)) == pytest.approx(
        expected, rel=1e-8
    )


def test_repeated_crossings_by_correlation() -> None:
    assert repeated_crossing_probability(1e-6, [0.0, 1.0]).tolist() == pytest.approx(
        [1e-6, 1.0], rel=1e-12
    )
    assert float(repeated_crossing_probability(1e-6, -0.5)) < 1e-12
    assert float(repeated_crossing_probability(0.0, 0.5)) == 0.0
    radius = np.array([1.5, 2.5])
    assert false_confirmation_probability(1e-5, 3, radius, 1.0) == pytest.approx(1.0)
    alone = false_confirmation_probability(1e-5, 2, radius)
    assert false_confirmation_probability(1e-5, 2, radius, [0.0, 0.0]) == alone
    assert false_confirmation_probability(1e-5, 2, radius, 0.2) > 3.0 * alone


def test_correlated_noise_confirms_as_series_of_cells() -> None:
    """A chain of looks at one cell, whose neighbours cross independently; 4 standard deviations."""
    rng = np.random.default_rng(8)
    chance = 0.02
    rho = 0.6
    radius = np.array([1.2, 1.4])
    looks = 400_000
    limit = norm.isf(chance)
    before = np.empty((2, looks))
    now = rng.normal(size=looks)
    for scan in range(2):
        before[scan] = rho ** (scan + 1) * now + np.sqrt(1.0 - rho ** (2 * scan + 2)) * rng.normal(
            size=looks
        )
    near = rng.random((2, looks)) < -np.expm1(-chance * (np.pi * radius**2 - 1.0))[:, None]
    crossed = now > limit
    confirmed = ((before > limit) | near).any(axis=0)[crossed]
    expected = false_confirmation_probability(chance, 2, radius, rho ** np.array([1.0, 2.0]))
    # A cell of a gate is its area's worth of a Poisson field: exp(-P_fa) for 1 - P_fa.
    allowed = 4.0 * np.sqrt(expected * (1.0 - expected) / crossed.sum()) + chance**2
    assert confirmed.mean() == pytest.approx(expected, abs=allowed)
