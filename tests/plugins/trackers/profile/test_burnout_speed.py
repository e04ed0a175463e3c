"""The burnout speed's prior, taken anew far from where hypotheses stand: against sums of information."""

import numpy as np
import pytest
from class_flights import PRIORS
from hypothesis import assume, given
from hypothesis import strategies as st
from opir_trackers.profile.burnout_speed import moved_by_speed, placed
from opir_trackers.profile.family import BURN, SHAPE, SPEED, natural

from opir_core.scene.scene import TARGET_TYPES

kinds = st.sampled_from(range(len(TARGET_TYPES)))
seeds = st.integers(0, 2**32 - 1)


def case(kind, seed, sigma=0.05):
    """Return the prior of a class, where a hypothesis stands, a place along its end, and what is left there."""
    dice = np.random.default_rng(seed)
    prior = PRIORS.take(np.array([kind]))
    stood, root = 0.05 * dice.normal(size=(1, 10)), dice.normal(size=(10, 10))
    place = stood.copy()
    place[0, BURN] += 0.3 * dice.normal()
    return prior, stood, place, sigma**2 * (0.1 * root @ root.T + 0.1 * np.eye(10))[None]


def speed_of(parameters, prior):
    """Return the logarithm of the burnout speed over the class's, and its slopes (10,)."""
    found = natural(parameters, prior)
    slope = np.zeros(10)
    slope[SPEED], slope[BURN], slope[SHAPE] = 1.0, found.by_burn[0], found.by_rate[0]
    return found.parameters[0, SPEED], slope


@given(kinds, seeds)
def test_where_a_hypothesis_stands_nothing_changes(kind, seed):
    prior, stood, _, spread = case(kind, seed)
    found = placed(stood, stood, spread, prior, np.ones(1))
    assert found.parameters == pytest.approx(stood, abs=1e-9)
    assert found.spread == pytest.approx(spread, abs=1e-9)
    assert found.log == pytest.approx(0.0, abs=1e-9)


@given(kinds, seeds, st.floats(1.0, 9.0))
def test_of_two_priors_one_is_taken_out_and_the_other_put_in(kind, seed, misfit):
    prior, stood, place, spread = case(kind, seed)
    (here, before), (there, after) = speed_of(stood, prior), speed_of(place, prior)
    weight = 1.0 / (prior.speed_sigma[0] ** 2 * misfit)
    assume(weight * before @ spread[0] @ before < 0.98)
    found = placed(stood, place, spread, prior, np.array([misfit]))
    # Information adds up: that of what is left, less that of the one prior, and that of the other.
    old = np.linalg.inv(spread[0])
    new = old + weight * (np.outer(after, after) - np.outer(before, before))
    told = here + before @ (place - stood)[0]
    right = weight * (told * before - there * after)
    assert found.spread[0] == pytest.approx(np.linalg.inv(new), rel=1e-6, abs=1e-9)
    away = np.linalg.solve(new, right)
    assert found.parameters[0] - place[0] == pytest.approx(away, rel=1e-6, abs=1e-9)
    square = weight * (there**2 - told**2) - right @ away
    size = np.linalg.slogdet(new)[1] - np.linalg.slogdet(old)[1]
    assert found.log[0] == pytest.approx(-0.5 * (square + size), rel=1e-6, abs=1e-8)


@given(kinds, seeds)
def test_a_prior_that_is_all_that_is_known_of_the_speed_stays_linear(kind, seed):
    prior, stood, place, spread = case(kind, seed)
    _, slope = speed_of(stood, prior)
    along = spread[0] @ slope
    known = slope @ along
    # Of the speed no more is left than 0.995 of the prior's variance.
    more = (0.995 * prior.speed_sigma[0] ** 2 - known) / known**2
    spread = spread + more * np.outer(along, along)
    found = placed(stood, place, spread, prior, np.ones(1))
    assert np.array_equal(found.parameters, place)
    assert np.array_equal(found.spread, spread)
    assert found.log == 0.0


@given(kinds, st.sampled_from((-1.0, 1.0)), st.floats(0.01, 1.5))
def test_steps_within_the_prior_go_as_far_as_its_speeds(kind, way, sigmas):
    prior = PRIORS.take(np.array([kind]))
    stands, step = np.zeros((1, 10)), np.zeros((1, 10))
    here, slope = speed_of(stands, prior)
    # So long a burn is faster by so many of the prior's standard deviations, were the speed linear.
    wanted = way * sigmas * prior.speed_sigma[0]
    step[0, BURN] = wanted / slope[BURN]
    found = moved_by_speed(stands, step, sigmas, prior, np.ones(1))
    assert speed_of(found, prior)[0] - here == pytest.approx(wanted, abs=1e-4)


@given(kinds, st.floats(-0.15, 0.15))
def test_steps_of_which_the_prior_says_little_are_taken_as_they_are(kind, longer):
    prior = PRIORS.take(np.array([kind]))
    stands, step = np.zeros((1, 10)), np.zeros((1, 10))
    step[0, BURN] = longer
    # Were the prior as wide as a thousand of such steps, it would not bend them.
    found = moved_by_speed(stands, step, 1e3, prior, np.ones(1))
    assert found == pytest.approx(stands + step, abs=1e-6)
