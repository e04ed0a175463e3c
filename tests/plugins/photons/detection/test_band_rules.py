"""Rules over bands: exact probabilities, measurements as they are conditional on a detection, and
all of it far out.
"""

import mpmath
import numpy as np
import pytest
from attrs import evolve
from opir_photons.detection import RatioGates
from opir_photons.detection.band_rules import AnyBand
from opir_photons.detection.rejection_sampling import (
    LEAST_PASSING,
    accepted_draws,
    tail_normals,
    truncated_normals,
)
from scipy.stats import kstest, norm

INF = np.inf
TRIPLE = RatioGates(5.0, 3.0, np.array([-INF, 0.3, 0.01]), np.array([INF, 3.0, 0.5]))
TOLERANT = evolve(TRIPLE, tolerance=2.0)
PAIR = RatioGates(5.0, 3.0, np.array([-INF, 0.8]), np.array([INF, 4.0]))


def integral(rule: RatioGates, snr: list[float], noise: list[float]) -> mpmath.mpf:
    """Return P_d by adaptive integration at 30 digits, cut at every kink."""
    mpmath.mp.dps = 30

    def tail(x: mpmath.mpf) -> mpmath.mpf:
        return mpmath.erfc(x / mpmath.sqrt(2)) / 2

    def density(y: mpmath.mpf) -> mpmath.mpf:
        value = mpmath.npdf(y, snr[0], 1)
        for band in range(1, len(snr)):
            steep = mpmath.mpf(noise[0]) / noise[band]
            slopes = rule.lower[band] * steep, rule.upper[band] * steep
            off = [rule.tolerance * mpmath.sqrt(1 + slope**2) for slope in slopes]
            low = max(rule.coincidence, slopes[0] * y - off[0])
            high = slopes[1] * y + off[1]
            value *= (
                max(tail(low - snr[band]) - tail(high - snr[band]), mpmath.mpf(0))
                if high > low
                else 0
            )
        return value

    cuts = {5.0, *np.arange(6.0, 40.0, 2.0).tolist()}
    for band in range(1, len(snr)):
        for bound in (rule.lower[band], rule.upper[band]):
            steep = bound * noise[0] / noise[band]
            off = rule.tolerance * np.hypot(1.0, steep)
            places = [
                (level + sign * off) / steep
                for level in (rule.coincidence, snr[band])
                for sign in (-1, 1)
            ]
            cuts |= {float(cut) for cut in places if 5.0 < cut < 40.0}
    return mpmath.quad(density, sorted(cuts))


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.0, pytest.param(1.0, marks=pytest.mark.slow), 3.0])
@pytest.mark.parametrize(
    ("snr", "noise"),
    [
        ([7.17, 11.41, 1.15], [1.0, 2.86, 1.07]),
        ([5.93, 9.93, 3.27], [1.0, 1.78, 0.28]),
        pytest.param([10.55, 6.46, 2.64], [1.0, 2.43, 1.05], marks=pytest.mark.slow),
        pytest.param([1.14, 10.26, 6.89], [1.0, 2.67, 1.52], marks=pytest.mark.slow),
        ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ],
)
def test_the_integral_is_that_of_mpmath_far_down_too(
    snr: list[float], noise: list[float], tolerance: float
) -> None:
    rule = evolve(TRIPLE, tolerance=tolerance)
    log_hit, log_miss = rule.log_chances(np.array([snr]), rule.slopes(np.array([noise])))
    exact = integral(rule, snr, noise)
    assert log_hit[0] == pytest.approx(float(mpmath.log(exact)), abs=2e-9)
    assert log_miss[0] == pytest.approx(float(mpmath.log(1 - exact)), rel=1e-8, abs=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("snr", "noise"),
    [
        ([21.80359598, 7.7067904], [0.25643526, 1.80133238]),
        ([8.83413222, 7.73050943], [0.72099044, 2.22613923]),
    ],
)
def test_a_wide_gate_keeps_its_far_side(snr: list[float], noise: list[float]) -> None:
    exact = integral(PAIR, snr, noise)
    for slack, within in ((0.0, 2e-9), (1e-9, 2e-9)):
        log_hit, _ = PAIR.log_chances(np.array([snr]), PAIR.slopes(np.array([noise])), slack)
        assert np.exp(log_hit[0]) == pytest.approx(float(exact), abs=within)


@pytest.mark.slow
@pytest.mark.parametrize("rule", [PAIR, TRIPLE, TOLERANT], ids=["pair", "triple", "tolerant"])
@pytest.mark.parametrize("scale", [1.0, 3.0, 30.0])
def test_the_quick_way_is_as_near_as_it_says(rule: RatioGates, scale: float) -> None:
    rng = np.random.default_rng(8)
    bands = len(rule.lower)
    snr = rng.uniform(0.0, 14.0, (1500, bands)) * np.array([1.0, 1.0, 0.4])[:bands]
    snr *= rng.choice([1.0, scale], (1500, 1))
    noise = 10.0 ** rng.uniform(-0.7, 0.7, (1500, bands))
    exact, quick = (
        np.exp(rule.log_chances(snr, rule.slopes(noise), slack)[0]) for slack in (0.0, 1e-9)
    )
    assert 0.0 < np.abs(exact - quick).max() <= 1.5e-9


def test_a_slack_leaves_probabilities_within_it() -> None:
    snr = np.random.default_rng(3).uniform(0.0, 14.0, (400, 2))
    exact, near = (
        np.exp(PAIR.log_chances(snr, PAIR.slopes(np.ones((400, 2))), slack)[0])
        for slack in (0.0, 1e-5)
    )
    assert 0.0 < np.abs(exact - near).max() <= 1e-5


@pytest.mark.parametrize(
    "rule", [AnyBand(5.0), TRIPLE, TOLERANT], ids=["any", "triple", "tolerant"]
)
def test_free_draws_pass_as_often_as_the_probability_says(rule: AnyBand | RatioGates) -> None:
    rng = np.random.default_rng(4)
    rows = 40_000
    for snr in ([6.0, 9.0, 1.5], [4.0, 4.5, 3.0], [9.0, 14.0, 3.5]):
        passed = rule.passes(
            np.array(snr) + rng.normal(size=(rows, 3)), rule.slopes(np.ones((rows, 3)))
        ).sum()
        chance = float(
            np.exp(rule.log_chances(np.array([snr]), rule.slopes(np.ones((1, 3))))[0][0])
        )
        # 99.9 % of the normal law that the binomial one is near to.
        assert abs(passed - rows * chance) < 3.29 * np.sqrt(rows * chance * (1.0 - chance)) + 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "rule", [AnyBand(5.0), TRIPLE, TOLERANT], ids=["any", "triple", "tolerant"]
)
def test_conditional_measurements_match_passing_draws(
    rule: AnyBand | RatioGates,
) -> None:
    rng = np.random.default_rng(5)
    snr = np.array([6.0, 8.0, 2.5])
    ones = np.ones((60_000, 3))
    free = snr + rng.normal(size=ones.shape)
    selected = free[rule.passes(free, rule.slopes(ones))]
    drawn = rule.conditional(
        np.tile(snr, (len(selected), 1)),
        rule.slopes(ones[: len(selected)]),
        rng.random((len(selected), 4)),
    )
    assert rule.passes(drawn, rule.slopes(ones[: len(drawn)])).all()
    for band in range(3):
        ordered = np.sort(selected[:, band])
        distance = np.max(
            np.abs(
                np.searchsorted(ordered, np.sort(drawn[:, band])) / len(selected)
                - _shares(len(drawn))
            )
        )
        # Two samples of n: Kolmogorov's 1.95 at 99.9 % times sqrt(2 / n).
        assert distance < 1.95 * np.sqrt(2.0 / len(selected))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("snr", "least", "most"),
    [
        ([6.0, 8.0, 2.5], 0.1, 1.0),
        ([2.0, 18.0, 2.0], LEAST_PASSING, 0.01),
        ([2.0, 28.0, 2.0], 0.0, LEAST_PASSING),
    ],
    ids=["many pass", "hardly any passes", "inverted"],
)
def test_accepted_proposals_match_the_inverse(snr: list[float], least: float, most: float) -> None:
    rng = np.random.default_rng(6)
    ones = np.ones((6_000, 3))
    rows = np.tile(snr, (len(ones), 1))
    chance = np.full(len(ones), np.exp(TRIPLE.log_chances(rows[:1], TRIPLE.slopes(ones[:1]))[0][0]))
    assert least < TRIPLE.passing(rows[:1], chance[:1])[0] < most
    drawn = accepted_draws(
        TRIPLE,
        rows,
        TRIPLE.slopes(ones),
        chance,
        rng.integers(0, 2**64, len(ones), dtype=np.uint64),
    )
    inverse = TRIPLE.conditional(rows, TRIPLE.slopes(ones), rng.random((len(ones), 4)))
    assert TRIPLE.passes(drawn, TRIPLE.slopes(ones)).all()
    for band in range(3):
        ordered = np.sort(inverse[:, band])
        distance = np.max(
            np.abs(
                np.searchsorted(ordered, np.sort(drawn[:, band])) / len(ones) - _shares(len(ones))
            )
        )
        assert distance < 1.95 * np.sqrt(2.0 / len(ones))


@pytest.mark.parametrize(
    "rule", [AnyBand(5.0), TRIPLE, TOLERANT], ids=["any", "triple", "tolerant"]
)
def test_proposals_pass_as_often_as_is_said_of_them(rule: AnyBand | RatioGates) -> None:
    rng = np.random.default_rng(8)
    rows = 40_000
    for snr in ([6.0, 9.0, 1.5], [4.0, 4.5, 3.0], [1.0, 12.0, 3.5], [9.0, 29.0, 3.5]):
        signal = np.tile(snr, (rows, 1))
        ones = np.ones((rows, 3))
        chance = np.exp(rule.log_chances(signal[:1], rule.slopes(ones[:1]))[0])
        share = float(rule.passing(signal[:1], chance)[0])
        passed = rule.passes(
            rule.proposed(signal, rule.slopes(ones), rng.random((rows, 4))), rule.slopes(ones)
        ).sum()
        assert abs(passed - rows * share) <= 3.29 * np.sqrt(rows * share * (1.0 - share)) + 1.0


def test_few_proposals_where_thresholds_decide() -> None:
    proposed = []

    class Counted(RatioGates):
        def proposed(self, snr: np.ndarray, slopes: np.ndarray, uniforms: np.ndarray) -> np.ndarray:
            proposed.append(len(snr))
            return super().proposed(snr, slopes, uniforms)

    rule = Counted(5.0, 3.0, np.array([-INF, 0.3]), np.array([INF, 3.0]))
    rng = np.random.default_rng(9)
    ones = np.ones((5_000, 2))
    # A faint source of the right colour: free draws would take thousands of tries each.
    snr = np.array([1.6, 2.4]) * rng.uniform(0.9, 1.1, (len(ones), 1))
    chance = np.exp(rule.log_chances(snr, rule.slopes(ones))[0])
    drawn = accepted_draws(
        rule, snr, rule.slopes(ones), chance, rng.integers(0, 2**64, len(ones), dtype=np.uint64)
    )
    assert rule.passes(drawn, rule.slopes(ones)).all()
    assert np.mean(1.0 / chance) > 3_000
    assert sum(proposed) < 2 * len(ones)


def test_a_row_is_drawn_alike_whoever_is_drawn_with_it() -> None:
    rng = np.random.default_rng(7)
    snr = rng.uniform(3.0, 9.0, (500, 3))
    seeds = rng.integers(0, 2**64, 500, dtype=np.uint64)
    chance = np.exp(TRIPLE.log_chances(snr, TRIPLE.slopes(np.ones((500, 3))))[0])
    total = accepted_draws(TRIPLE, snr, TRIPLE.slopes(np.ones((500, 3))), chance, seeds)
    part = slice(100, 137)
    assert np.array_equal(
        accepted_draws(
            TRIPLE, snr[part], TRIPLE.slopes(np.ones((37, 3))), chance[part], seeds[part]
        ),
        total[part],
    )


def _shares(count: int) -> np.ndarray:
    return (np.arange(count) + 0.5) / count


def test_nothing_is_lost_from_1e_minus_12_to_1e12() -> None:
    snr = np.repeat(np.logspace(-12, 12, 49)[:, None], 3, axis=1) * np.array([1.0, 1.7, 0.1])
    for rule in (AnyBand(5.0), TRIPLE):
        log_hit, log_miss = rule.log_chances(snr, rule.slopes(np.ones(snr.shape)))
        assert np.all((log_hit <= 0.0) & (log_miss <= 0.0))
        assert not np.isnan(log_hit).any()
        assert not np.isnan(log_miss).any()
        assert np.all(np.diff(log_hit) >= -1e-9)
        assert np.exp(log_hit[-1]) == 1.0
    assert AnyBand(37.0).log_chances(np.zeros((1, 1)), np.ones((1, 1)))[0][0] == pytest.approx(
        norm.logsf(37.0)
    )
    # P_fa of 1e-300 and far below what a double holds.
    assert AnyBand(37.0471).log_chances(np.zeros((1, 1)), np.ones((1, 1)))[0][0] == pytest.approx(
        -690.776, abs=1e-2
    )
    assert AnyBand(1e4).log_chances(np.zeros((1, 1)), np.ones((1, 1)))[0][0] == pytest.approx(
        -5.0000010e7, rel=1e-7
    )


@pytest.mark.parametrize(
    ("low", "high"), [(-1.0, 2.0), (3.0, 4.0), (30.0, INF), (-INF, -35.0), (1e5, INF), (-9.0, -8.9)]
)
def test_truncated_numbers_follow_their_law_in_every_tail(low: float, high: float) -> None:
    count = 4000
    drawn = truncated_normals(np.full(count, low), np.full(count, high), _shares(count))
    assert np.all((drawn >= low) & (drawn <= high))
    if high <= 0.0:
        low, high, drawn = -high, -low, -drawn
    total = np.expm1(norm.logsf(high) - norm.logsf(low))
    assert (
        kstest(np.expm1(norm.logsf(drawn) - norm.logsf(low)) / total, "uniform").statistic
        < 1.0 / count
    )


@pytest.mark.parametrize("low", [-INF, -50.0, -3.0, 0.0, 3.0, 30.0, 36.0, 36.5, 1e5])
def test_tail_numbers_follow_their_law_in_every_tail(low: float) -> None:
    count = 4000
    drawn = tail_normals(np.full(count, low), _shares(count))
    assert np.all(np.isfinite(drawn) & (drawn >= low))
    assert kstest(np.exp(norm.logsf(drawn) - norm.logsf(low)), "uniform").statistic < 1.0 / count
    assert np.isfinite(tail_normals(np.full(2, low), np.array([0.0, 1.0 - 2.0**-53]))).all()
