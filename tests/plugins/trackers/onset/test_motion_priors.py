"""Priors of motion at an age, against draws that are weighted by how they fly at that age."""

import numpy as np
import pytest
from opir_trackers.configs import HypothesesConfig
from opir_trackers.onset.motion_priors import LAW, MotionPriors
from opir_trackers.onset.motion_statistics import LAUNCH, NONE
from opir_trackers.onset.posterior import log_silence

CONFIG = HypothesesConfig()


def flights_of(priors):
    """Return which components are of aircraft on a northward course that turn or gain speed."""
    speed_m_s = priors.mean[:, 4]
    return np.flatnonzero((priors.group == NONE) & np.isclose(speed_m_s, 230.0))


@pytest.mark.parametrize("age_s", [10.0, 20.0])
def test_aircraft_fly_as_aircraft_do_up_to_an_age(age_s):
    first = MotionPriors.of(CONFIG)
    row = flights_of(first)[1]
    flight = next(kind for kind in LAW.flights if kind.gain_m_s2[1:] == (2.0, 6.0, 3.0))
    rng = np.random.default_rng(4)
    drawn = first.mean[row] + rng.standard_normal((400_000, 12)) @ first.root[row].T
    place, speed, gain, jerk = drawn.reshape(-1, 4, 3).transpose(1, 0, 2)
    height_m = place[:, 2] + age_s * speed[:, 2] + age_s**2 / 2 * gain[:, 2]
    height_m += age_s**3 / 6 * jerk[:, 2]
    later_m_s = speed + age_s * gain + age_s**2 / 2 * jerk
    later_m_s2 = gain + age_s * jerk
    log = -0.5 * ((height_m - 8e3) / 6e3) ** 2
    log -= 0.5 * np.sum(np.square(later_m_s[:, :2]), axis=1) / 240.0**2
    log -= 0.5 * np.square(later_m_s[:, 2] / flight.climb_m_s)
    log -= 0.5 * np.sum(np.square(later_m_s2 / [6.0, 6.0, 3.0]), axis=1)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    # Position aside is anywhere in view.
    known = slice(2, None)
    mean = weight @ drawn
    spread = (weight[:, None] * (drawn - mean)).T @ (drawn - mean)
    priors = first.at(age_s)
    sigma = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(
        (priors.mean[row] - mean)[known] / sigma[known], np.zeros(10), atol=0.05
    )
    covariance = priors.root[row] @ priors.root[row].T
    np.testing.assert_allclose(
        (covariance / np.outer(sigma, sigma))[known, known],
        (spread / np.outer(sigma, sigma))[known, known],
        atol=0.05,
    )


def test_an_age_changes_no_prior_but_those_of_aircraft():
    first = MotionPriors.of(CONFIG)
    later = first.at(40.0)
    np.testing.assert_array_equal(first.log_weight, later.log_weight)
    same = np.isclose(first.mean, later.mean).all(axis=1)
    assert same[first.group != NONE].all()
    assert same[first.group == LAUNCH].any()
    assert np.count_nonzero(~same) == 8 * len(LAW.flights) + 8 * 3


@pytest.mark.parametrize(("lines", "silent_s"), [(4, 1.0), (12, 0.5)])
def test_a_silence_is_as_improbable_as_draws_of_rates_say(lines, silent_s):
    rng = np.random.default_rng(5)
    lit_s = 0.8
    rate = rng.gamma(lines, 1.0 / lit_s, 400_000)
    expected = np.mean(rng.poisson(rate * silent_s) == 0)
    silence = np.exp(log_silence(np.array([float(lines)]), np.array([lit_s]), np.array([silent_s])))
    assert silence[0] == pytest.approx(expected, rel=0.1)
