"""Forecasts are renewed where something has changed: as a share of a burn's age passes, at burnout, and
seldom in silence.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_forecast import BoostEstimates, Outcomes, RegionForecaster, RegionsConfig, vehicle_model
from plain_boosts import RADIUS_M

from opir_core.flight import Forces
from opir_core.scene import core_hypotheses

OUTCOMES = Outcomes(vehicle_model(), core_hypotheses())
COVARIANCE = np.diag([300.0] * 3 + [30.0] * 3 + [2.0] * 3 + [0.004]) ** 2


def estimates(tick_s: float, burnout_s: float = 1e3, numbers: tuple[int, ...] = (4,)):
    """Return tracks that rise from 0 s on, detected twenty times a second until burnout."""
    flown_s = min(tick_s, burnout_s)
    force = 20.0 / (1.0 - 0.005 * flown_s)
    speed = 12.0 * flown_s + 300.0
    mean = np.array(
        [
            *(RADIUS_M + 5.0 * flown_s**2 + 2e3, 0.0, 0.0),
            *(0.7 * speed, 465.0 + 0.7 * speed, 0.0),
            *(0.7 * force, 0.7 * force, 0.0, 0.008),
        ]
    )
    count = len(numbers)
    is_lit = tick_s < burnout_s
    silent_s = np.full(count, 0.05 if is_lit else tick_s - burnout_s)
    record = BoostEstimates.of_moments(
        np.array(numbers),
        np.tile(mean, (count, 1)),
        np.tile(COVARIANCE, (count, 1, 1)),
        np.full(count, 1.0 if is_lit else 0.0),
        silent_s,
        np.full(count, 0.05),
        len(OUTCOMES.hypotheses),
    )
    launch = np.zeros((count, 3))
    return evolve(record, launch=launch, launch_covariance=np.tile(np.eye(3), (count, 1, 1)))


def renewals(forecaster: RegionForecaster, ticks_s, burnout_s: float = 1e3) -> list[float]:
    """Return the ticks at which a track has other regions than at the tick before."""
    renewed = []
    latest = None
    for tick_s in map(float, ticks_s):
        regions = forecaster.forecasts(estimates(tick_s, burnout_s), tick_s).impact_regions[0]
        if regions is not latest:
            renewed.append(tick_s)
        latest = regions
    return renewed


def test_a_burn_is_forecast_as_a_share_of_its_age_passes() -> None:
    forecaster = RegionForecaster(OUTCOMES, Forces(zonal=()), RegionsConfig(renewal_share=0.2))
    times_s = np.array(renewals(forecaster, range(5, 151)))
    ages = times_s[1:] / times_s[:-1]
    assert (ages >= 1.2 - 1e-9).all()
    assert (ages <= 1.2 + 1.0 / times_s[:-1]).all()


def test_a_share_of_zero_renews_each_tick() -> None:
    forecaster = RegionForecaster(OUTCOMES, Forces(zonal=()), RegionsConfig(renewal_share=0.0))
    assert renewals(forecaster, range(50, 60)) == [float(tick) for tick in range(50, 60)]


def test_burnout_is_forecast_at_once_and_silence_seldom() -> None:
    forecaster = RegionForecaster(OUTCOMES, Forces(zonal=()))
    times_s = renewals(forecaster, range(90, 400), burnout_s=100.0)
    dark_s = [time_s - 100.0 for time_s in times_s if time_s >= 100.0]
    assert dark_s[0] == 0.0
    # Twice as silent at each, and no more once nothing can ignite.
    assert len(dark_s) <= 9
    assert max(dark_s) < 200.0


@pytest.mark.parametrize("count", [1, 3, 130])
def test_tracks_are_forecast_as_each_alone(count: int) -> None:
    together = RegionForecaster(OUTCOMES, Forces(zonal=()))
    numbers = tuple(range(2, 2 + count))
    forecasts = together.forecasts(estimates(60.0, numbers=numbers), 60.0)
    alone = RegionForecaster(OUTCOMES, Forces(zonal=())).forecasts(estimates(60.0), 60.0)
    assert np.array_equal(forecasts.given_launch, np.tile(alone.given_launch, (count, 1)))
    assert np.array_equal(forecasts.impact, np.tile(alone.impact, (count, 1)))


def test_tracks_that_come_and_go_keep_their_forecasts() -> None:
    forecaster = RegionForecaster(OUTCOMES, Forces(zonal=()), RegionsConfig(renewal_share=1.0))
    first = forecaster.forecasts(estimates(60.0, numbers=(3, 7)), 60.0)
    more = forecaster.forecasts(estimates(61.0, numbers=(3, 5, 7)), 61.0)
    fewer = forecaster.forecasts(estimates(62.0, numbers=(5, 7)), 62.0)
    assert more.impact_regions[2] is first.impact_regions[1]
    assert fewer.impact_regions[1] is first.impact_regions[1]
    assert fewer.impact_regions[0] is more.impact_regions[1]
    # Reported columns stay as they were.
    assert len(first) == 2


def test_what_is_no_launch_has_the_prior_and_no_region() -> None:
    forecaster = RegionForecaster(OUTCOMES, Forces(zonal=()))
    launched = forecaster.forecasts(estimates(60.0), 60.0)
    assert launched.impact_regions[0]
    record = evolve(estimates(61.0), is_launch=np.array([False]))
    forecasts = forecaster.forecasts(record, 61.0)
    assert not forecasts.impact_regions[0]
    assert forecasts.given_launch[0] == pytest.approx(OUTCOMES.prior)
    assert np.isnan(forecasts.impact).all()
    assert np.isfinite(launched.impact).all()
