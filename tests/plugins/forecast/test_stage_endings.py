"""How soon stages end, against quadratures of the law by SciPy."""

import numpy as np
import pytest
from boost_law import ASCENTS, BURN, MISSILE, MODEL, RATIO
from opir_forecast.stage_endings import StageEndings
from opir_forecast.vehicles import LAW, VehicleStages
from scipy.integrate import quad
from scipy.stats import lognorm


def endings(stages):
    """Return missiles with stages: gap, burn time, first acceleration and growth, each a tuple."""
    columns = np.zeros((4, 1, MODEL.stages.shape[1]))
    columns[:, 0, : len(stages)] = np.transpose(stages)
    return StageEndings(MODEL, np.array([MISSILE]), VehicleStages(*columns))


def rate_per_s(stages, since_s):
    """Return the rate at which the burn of a missile ends."""
    return float(np.exp(endings(stages).log_rates(np.array([0]), np.array([since_s])))[0])


def density(burn_s, first, growth):
    """Return the density of a first stage's burn time, given first acceleration and growth, up to a
    factor.
    """
    medians = np.exp(MODEL.median_log[MISSILE, 0])
    spread = MODEL.sigma[MISSILE, 0]
    ratio = 1.0 / (1.0 - growth * burn_s)
    # Growth is (1 - 1/R)/B: at a given one, R changes by B R² with it.
    laws = (lognorm(spread[row], scale=medians[row]) for row in (BURN, RATIO))
    of_burn, of_ratio = (law.pdf(x) for law, x in zip(laws, (burn_s, ratio), strict=True))
    strength = 1.0 + (first * ratio / MODEL.data["highest_m_s2"]) ** 8
    return of_burn * of_ratio * burn_s * ratio**2 / strength


@pytest.mark.parametrize(
    ("first", "growth", "since_s"),
    [(20.0, 0.008, 60.0), (20.0, 0.011, 70.0), (14.0, 0.005, 40.0), (28.0, 0.009, 75.0)],
)
def test_a_burn_ends_at_the_rate_of_the_law_of_its_burn_times(first, growth, since_s):
    stage = (0.0, 500.0, first, growth)
    longest_s = float(
        endings([stage])._present(np.array([0]), np.array([0]), np.array([since_s])).longest_s[0]
    )
    width_s = (longest_s - since_s) / LAW.cells
    soon, ever = (
        quad(density, since_s, end_s, args=(first, growth))[0]
        for end_s in (since_s + width_s, longest_s)
    )
    assert rate_per_s([stage], since_s) == pytest.approx(soon / ever / width_s, rel=0.02)


def test_stages_that_have_lost_more_of_their_mass_end_sooner():
    rates = [rate_per_s([(0.0, 500.0, 20.0, growth)], 60.0) for growth in (0.004, 0.008, 0.012)]
    assert rates == sorted(rates)
    assert rates[2] > 3.0 * rates[0]


def test_a_stage_that_is_followed_at_once_does_not_end_in_the_dark():
    lower = (0.0, 60.0, 20.0, 0.01)
    assert rate_per_s([lower, (0.0, 60.0, 20.0, 0.01)], 50.0) < 1e-20
    assert rate_per_s([lower, (4.0, 60.0, 20.0, 0.01)], 50.0) > 1e-3
    # The last one does.
    assert rate_per_s([lower, (0.0, 60.0, 20.0, 0.01)], 100.0) > 1e-3


def test_shares_of_ascents_are_those_of_their_kinds_wherever_they_lead():
    share = np.exp(ASCENTS.log_share)
    weight = np.exp(ASCENTS.log_weight)
    for kind in np.split(np.arange(len(share)), [1800, 2200, 2800]):
        assert share[kind].sum() == pytest.approx(weight[kind].sum(), rel=1e-6)
        flying = share[kind][share[kind] > 1e-9]
        assert np.ptp(flying) == pytest.approx(0.0, abs=1e-12)
