"""Gates on ratios where signals lie near their edges, and far beyond them: chances and draws
against plain sums.

A conditional draw is the inverse of an integral. Here that is held to the law itself, number by
number: no sample is large enough to tell so small a fault from chance. The law is summed over a
fine grid, by nothing of the rule's own.
"""

from typing import NamedTuple

import mpmath
import numpy as np
import pytest
from attrs import evolve
from opir_photons.detection import RatioGates
from opir_photons.detection.band_rules import AnyBand
from opir_photons.detection.rejection_sampling import accepted_draws
from scipy.special import log_ndtr, ndtr

INF = np.inf
SHARES = np.array([1e-6, 1e-3, 0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 0.999, 1.0 - 1e-6])


class Case(NamedTuple):
    """A rule over bands and a look at it."""

    rule: RatioGates
    snr: np.ndarray
    noise: np.ndarray

    @property
    def bounds(self) -> list[tuple[float, float, float]]:
        """Return the bounds on each other band's signal over the first's, in deviations, and its
        expected signal.
        """
        ratio = self.noise[0] / self.noise
        bands = range(1, len(self.snr))
        return [
            (self.rule.lower[b] * ratio[b], self.rule.upper[b] * ratio[b], self.snr[b])
            for b in bands
        ]

    @property
    def first_open(self) -> float:
        """Return from which signal of the first band on all gates are open."""
        opens = [
            (self.rule.coincidence - self.off(high)) / high
            for _, high, _ in self.bounds
            if high < INF
        ]
        return max([self.rule.threshold, *opens])

    def off(self, slope: float) -> float:
        """Return how far a side of a gate lies beyond the line of its slope."""
        return self.rule.tolerance * float(np.sqrt(1.0 + slope**2)) if slope < INF else 0.0


def drawn_case(seed: int) -> Case:
    """Return a random rule with signals about the edges of its gates."""
    rng = np.random.default_rng(seed)
    bands = int(rng.integers(2, 4))
    lower = np.where(rng.random(bands) < 0.3, 0.0, 10.0 ** rng.uniform(-2.0, 0.5, bands))
    upper = np.where(
        rng.random(bands) < 0.3, INF, np.maximum(lower, 0.01) * 10.0 ** rng.uniform(0.1, 1.2, bands)
    )
    rule = RatioGates(
        float(rng.choice([3.0, 5.0, 7.0])), float(rng.choice([0.0, 2.0, 3.0, 5.0])), lower, upper
    )
    rule = evolve(rule, tolerance=float(rng.choice([0.0, 0.5, 3.0])))
    noise = np.array([1.0, *10.0 ** rng.uniform(-0.7, 0.7, bands - 1)])
    first = rng.uniform(-1.0, 25.0)
    edges = (
        np.where(rng.random(bands) < 0.5, lower, np.where(np.isfinite(upper), upper, lower))
        / noise
        * max(first, 1)
    )
    snr = np.maximum(edges, rule.coincidence) + 2.0 * rng.normal(size=bands)
    return Case(rule, np.array([first, *snr[1:]]), noise)


def log_density(case: Case, y: np.ndarray) -> np.ndarray:
    """Return the logarithm of the chance density of a detection with a signal y of the first
    band.
    """
    total = -0.5 * (y - case.snr[0]) ** 2 - 0.5 * np.log(2.0 * np.pi)
    for low, high, expected in case.bounds:
        below = np.maximum(low * y - case.off(low), case.rule.coincidence) - expected
        above = high * y + case.off(high) - expected
        flipped = below > 0.0
        near = np.where(flipped, -below, above)
        far = np.where(flipped, -above, below)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside = log_ndtr(near) + np.log(
                -np.expm1(np.minimum(log_ndtr(far) - log_ndtr(near), 0.0))
            )
        total = total + np.where(above > below, inside, -INF)
    return total


def law(case: Case) -> tuple[np.ndarray, np.ndarray, float]:
    """Return places y, the shares of detections below them, and the logarithm of the chance of a
    detection.
    """
    start = case.first_open * (1.0 + 1e-13)
    highest = (
        max(
            [
                start,
                case.snr[0],
                *(expected / high for _, high, expected in case.bounds if high < INF),
            ]
        )
        + 60.0
    )
    for points in (20_001, 20_001, 60_001):
        y = np.linspace(start, highest, points)
        height = log_density(case, y)
        alive = np.flatnonzero(height > height.max() - 60.0)
        start = y[max(alive[0] - 1, 0)]
        highest = y[min(alive[-1] + 1, points - 1)]
    density = np.exp(height - height.max())
    parts = 0.5 * (density[1:] + density[:-1]) * (y[1] - y[0])
    return (
        y,
        np.concatenate([[0.0], np.cumsum(parts)]) / parts.sum(),
        float(np.log(parts.sum()) + height.max()),
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_draws_invert_the_law_and_chances_are_its_integral(seed: int) -> None:
    case = drawn_case(seed)
    y, shares, log_chance = law(case)
    rows = len(SHARES)
    snr = np.tile(case.snr, (rows, 1))
    noise = np.tile(case.noise, (rows, 1))
    assert case.rule.log_chances(snr[:1], case.rule.slopes(noise[:1]))[0][0] == pytest.approx(
        log_chance, abs=3e-6
    )
    level = np.column_stack([np.tile(SHARES[::-1, None], (1, len(case.snr))), SHARES])
    drawn = case.rule.conditional(snr, case.rule.slopes(noise), level)
    assert case.rule.passes(drawn, case.rule.slopes(noise)).all()
    # Straight between 60 000 points of the sum, in tails whose doubles at 1e4 deviations have 12
    # digits.
    assert np.interp(drawn[:, 0], y, shares) == pytest.approx(
        SHARES, abs=5e-4 if log_chance < -1000.0 else 1e-4
    )
    for band, (low, high, expected) in enumerate(case.bounds, start=1):
        below = ndtr(
            np.maximum(low * drawn[:, 0] - case.off(low), case.rule.coincidence) - expected
        )
        chance = ndtr(high * drawn[:, 0] + case.off(high) - expected) - below
        clear = chance > 1e-6
        within = (ndtr(drawn[:, band] - expected) - below)[clear] / chance[clear]
        assert within == pytest.approx(SHARES[::-1][clear], abs=1e-5)


@pytest.mark.parametrize(
    ("threshold", "upper", "snr", "noise"),
    [
        (5.0, 0.0717, [4.19, 0.0753], [1.0, 1.601]),
        (7.0, 0.0421, [6.65, 3.28], [1.0, 0.92]),
        (3.0, 0.06, [12.0, 2.36], [1.0, 4.33]),
    ],
)
def test_tails_where_gates_open_far_out_are_mpmaths(
    threshold: float, upper: float, snr: list[float], noise: list[float]
) -> None:
    mpmath.mp.dps = 40
    rule = RatioGates(threshold, 3.0, np.array([0.0, 0.0]), np.array([INF, upper]))
    slope = mpmath.mpf(upper) * noise[0] / noise[1]
    opens = mpmath.mpf(3) * noise[1] / noise[0] / mpmath.mpf(upper)

    def density(y: mpmath.mpf) -> mpmath.mpf:
        tail = [
            mpmath.erfc((edge - snr[1]) / mpmath.sqrt(2)) / 2 for edge in (mpmath.mpf(3), slope * y)
        ]
        return mpmath.npdf(y, snr[0], 1) * (tail[0] - tail[1])

    fall = 1 / (opens - snr[0])
    exact = mpmath.log(
        mpmath.quad(density, [opens + fall * step for step in (0, 1, 3, 8, 20, 50, 120)])
    )
    result = rule.log_chances(np.array([snr]), rule.slopes(np.array([noise])))[0][0]
    assert result < -1000.0
    assert result == pytest.approx(float(exact), rel=1e-12, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "snr"),
    [
        (AnyBand(5.0), [4.0, 4.5, 3.0]),
        (
            RatioGates(5.0, 3.0, np.array([0.0, 0.3, 0.01]), np.array([INF, 3.0, 0.5])),
            [6.0, 8.0, 2.5],
        ),
        (
            RatioGates(5.0, 3.0, np.array([0.0, 0.3, 0.01]), np.array([INF, 3.0, 0.5])),
            [8.0, 24.0, 4.0],
        ),
        (RatioGates(5.0, 3.0, np.array([0.0, 0.8]), np.array([INF, 4.0])), [20.0, 16.0]),
        (RatioGates(5.0, 3.0, np.array([0.0, 0.8]), np.array([INF, 4.0])), [7.0, 28.0]),
    ],
    ids=["any", "inside", "upper edge", "lower edge of a bright one", "upper edge of two"],
)
def test_what_is_drawn_again_has_the_law_of_free_draws_that_pass(
    rule: AnyBand | RatioGates, snr: list[float]
) -> None:
    """Two samples, 40 cells a band: chi-squared at 99.9 % over the 14 bands of all cases together
    (Bonferroni).
    """
    from scipy.stats import chi2

    rng = np.random.default_rng(9)
    tries = 600_000
    ones = np.ones((tries, len(snr)))
    free = snr + rng.normal(size=ones.shape)
    selected = free[rule.passes(free, rule.slopes(ones))]
    rows = len(selected)
    chance = np.full(rows, np.exp(rule.log_chances(np.array([snr]), rule.slopes(ones[:1]))[0][0]))
    seeds = rng.integers(0, 1 << 64, size=rows, dtype=np.uint64)
    drawn = accepted_draws(rule, np.tile(snr, (rows, 1)), rule.slopes(ones[:rows]), chance, seeds)
    assert rule.passes(drawn, rule.slopes(ones[:rows])).all()
    for band in range(len(snr)):
        edges = np.quantile(
            np.concatenate([selected[:, band], drawn[:, band]]), np.linspace(0.0, 1.0, 41)[1:-1]
        )
        one, other = (
            np.bincount(np.searchsorted(edges, sample[:, band]), minlength=40)
            for sample in (selected, drawn)
        )
        assert ((one - other) ** 2 / (one + other)).sum() < chi2.isf(0.001 / 14, 39)
