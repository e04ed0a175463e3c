"""States of `boost-profile` at a tick before which the burn may just have ended: against flights that end so."""

import numpy as np
import pytest
from attrs import evolve
from profile_flights import PRIORS, flights

from opir_core.tracking.profile import fit, flight
from opir_core.tracking.profile.end import DEVIATES, Silence, ends_of
from opir_core.tracking.profile.family import BURN, SIZE, START
from opir_core.tracking.profile.report import report
from opir_core.tracking.profile.thrust_end import with_ends

COUNT, PERIOD_S = 4, 0.1


def of_open_ends(kind, dark_s):
    """Return hypotheses whose burns were last seen `dark_s` before a tick, of an end known to 2 % before; the tick."""
    truth = flights(kind, COUNT, 3)
    burn_s = fit.family_of(truth, PRIORS).courses.burn_s
    # All are seen to the same time of the scene: they start so much sooner.
    tick_s = 150.0
    parameters = truth.parameters.copy()
    parameters[:, START] += tick_s - 0.98 * burn_s - fit.family_of(truth, PRIORS).start_s
    truth = evolve(truth, parameters=parameters)
    family = fit.family_of(truth, PRIORS)
    last, until = np.full((COUNT, 1), tick_s - dark_s), np.full((COUNT, 1), tick_s)
    silence = Silence(last, until, np.full((COUNT, 1), 0.6), np.array([PERIOD_S]))
    ends = ends_of(family.start_s, np.log(burn_s), np.full(COUNT, 0.02**2), silence)
    parameters[:, BURN] += ends.mean - np.log(burn_s)
    spread = np.zeros((COUNT, SIZE, SIZE))
    spread[:, range(SIZE), range(SIZE)] = 1e-14
    spread[:, BURN, BURN] = ends.variance
    weight = np.zeros((COUNT, 2))
    weight[:, 0] = 1e10
    return evolve(truth, parameters=parameters, spread=spread, end_quantiles=ends.quantiles, weight=weight), tick_s


def drawn(hypotheses, tick_s, count=4000):
    """Return states (n, count, 6) at a tick of flights whose burns end by the hypotheses' quantiles."""
    deviate = np.clip(np.random.default_rng(1).normal(size=count), -3.0, 3.0)
    states = []
    for row in range(len(hypotheses)):
        each = hypotheses.take(np.full(count, row))
        parameters = each.parameters.copy()
        sigma = np.sqrt(each.spread[0, BURN, BURN])
        parameters[:, BURN] += sigma * np.interp(deviate, DEVIATES, each.end_quantiles[0])
        family, none = fit.family_of(evolve(each, parameters=parameters), PRIORS), np.zeros((count, SIZE, SIZE))
        states.append(flight.states(family, none, tick_s, *flight.burnouts(family, none)).mean)
    return np.array(states)


@pytest.mark.parametrize("kind", ["SRBM", "ICBM"])
@pytest.mark.parametrize("dark_s", [0.15, 0.35, 0.6])
def test_moments_are_those_of_flights_that_burn_on_and_of_some_that_do_not(kind, dark_s):
    hypotheses, tick_s = of_open_ends(kind, dark_s)
    family = fit.family_of(hypotheses, PRIORS)
    plain = flight.states(family, hypotheses.spread, tick_s, *flight.burnouts(family, hypotheses.spread))
    told = with_ends(plain, hypotheses, family.start_s, family.courses.burn_s, tick_s, PRIORS)
    states = drawn(hypotheses, tick_s)
    sigma = states.std(axis=1)
    assert np.all(np.abs(told.mean - states.mean(axis=1)) < 0.1 * sigma)
    assert np.sqrt(np.diagonal(told.covariance, axis1=1, axis2=2)) == pytest.approx(sigma, rel=0.07)


def test_a_burn_that_has_just_been_seen_is_told_as_one_that_goes_on():
    hypotheses, tick_s = of_open_ends("IRBM", 0.0)
    family = fit.family_of(hypotheses, PRIORS)
    plain = flight.states(family, hypotheses.spread, tick_s, *flight.burnouts(family, hypotheses.spread))
    assert with_ends(plain, hypotheses, family.start_s, family.courses.burn_s, tick_s, PRIORS) is plain


def test_what_one_sensor_tells_has_the_end_in_it():
    hypotheses, tick_s = of_open_ends("IRBM", 0.35)
    family = fit.family_of(hypotheses, PRIORS)
    plain = flight.states(family, hypotheses.spread, tick_s, *flight.burnouts(family, hypotheses.spread))
    exact = with_ends(plain, hypotheses, family.start_s, family.courses.burn_s, tick_s, PRIORS)
    hypotheses = evolve(hypotheses, track=np.arange(COUNT))
    told = report(hypotheses, np.ones(COUNT), tick_s, PRIORS, "kepler", np.inf)
    assert told.state == pytest.approx(exact.mean)
    slower = np.sum((plain.mean - told.state)[:, 3:] * plain.mean[:, 3:], axis=1)
    assert np.all(slower > 0.0)
