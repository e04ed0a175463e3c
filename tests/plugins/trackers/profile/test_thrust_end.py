"""States of `boost-profile` at a tick before which the burn may just have ended: against flights that end so."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS, flights
from opir_trackers.profile import fit, flight
from opir_trackers.profile.end import Silence, ends_of
from opir_trackers.profile.family import BURN, SIZE, START
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.thrust_end import with_ends

COUNT, PERIOD_S, CHANCE, KNOWN = 4, 0.1, 0.6, 0.02


def of_open_ends(kind, time_since_last_s):
    """Return hypotheses last seen burning `time_since_last_s` before a tick, the tick, and draws of burns (n, m), s.

    Before that the logarithm of the burn's length is normal, and known to 2 %.
    """
    truth, tick_s = flights(kind, COUNT, 3), 150.0
    family = fit.family_of(truth, PRIORS)
    burn_s = family.courses.burn_s
    # All are seen to the same time of the scene: they start so much sooner.
    parameters = truth.parameters.copy()
    parameters[:, START] += tick_s - 0.98 * burn_s - family.start_s
    start_s = tick_s - 0.98 * burn_s
    last, until = np.full((COUNT, 1), tick_s - time_since_last_s), np.full((COUNT, 1), tick_s)
    silence = Silence(last, until, np.full((COUNT, 1), CHANCE), np.array([PERIOD_S]))
    ends = ends_of(start_s, np.log(burn_s), np.full(COUNT, KNOWN**2), silence)
    parameters[:, BURN] += ends.mean - np.log(burn_s)
    spread = np.zeros((COUNT, SIZE, SIZE))
    spread[:, range(SIZE), range(SIZE)] = 1e-14
    spread[:, BURN, BURN] = ends.variance
    weight = np.zeros((COUNT, 2))
    weight[:, 0] = 1e10
    columns = {"parameters": parameters, "spread": spread, "end_quantiles": ends.quantiles, "weight": weight}
    rng = np.random.default_rng(1)
    return (
        evolve(truth, **columns),
        tick_s,
        [_burns(rng, *each, time_since_last_s, tick_s) for each in zip(start_s, burn_s, strict=True)],
    )


def _burns(rng, start_s, burn_s, time_since_last_s, tick_s):
    """Return burns that last to the last light, each as likely as the looks that missed it since."""
    burn_s = burn_s * np.exp(KNOWN * rng.normal(size=100_000))
    past_s = start_s + burn_s - (tick_s - time_since_last_s)
    missed = np.floor(np.minimum(past_s, time_since_last_s) / PERIOD_S - 1e-6)
    return burn_s[(past_s > 0.0) & (rng.random(100_000) < (1.0 - CHANCE) ** missed)][:3000]


def flown(hypotheses, tick_s, burns):
    """Return states (m, 6) of each hypothesis (n,) at a tick, were its burns so long."""
    states = []
    for row, burn_s in enumerate(burns):
        each = hypotheses.take(np.full(len(burn_s), row))
        parameters = each.parameters.copy()
        parameters[:, BURN] += np.log(burn_s / fit.family_of(each.take([0]), PRIORS).courses.burn_s)
        none = np.zeros((len(burn_s), SIZE, SIZE))
        family = fit.family_of(evolve(each, parameters=parameters), PRIORS)
        states.append(flight.states(family, none, tick_s, *flight.burnouts(family, none)).mean)
    return states


@pytest.mark.parametrize("kind", ["SRBM", "ICBM"])
@pytest.mark.parametrize(("time_since_last_s", "off", "wide"), [(0.15, 0.1, 0.05), (0.35, 0.1, 0.1), (0.6, 0.3, 0.2)])
def test_moments_are_those_of_flights_that_burn_on_and_of_some_that_do_not(kind, time_since_last_s, off, wide):
    hypotheses, tick_s, burns = of_open_ends(kind, time_since_last_s)
    family = fit.family_of(hypotheses, PRIORS)
    plain = flight.states(family, hypotheses.spread, tick_s, *flight.burnouts(family, hypotheses.spread))
    told = with_ends(plain, hypotheses, family, np.arange(COUNT), tick_s)
    for row, states in enumerate(flown(hypotheses, tick_s, burns)):
        assert len(states) > 1000
        sigma = states.std(axis=0)
        assert np.all(np.abs(told.mean[row] - states.mean(axis=0)) < off * sigma)
        assert np.sqrt(np.diagonal(told.covariance[row])) == pytest.approx(sigma, rel=wide)


def test_a_burn_that_has_just_been_seen_is_told_as_one_that_goes_on():
    hypotheses, tick_s, _ = of_open_ends("IRBM", 0.0)
    family = fit.family_of(hypotheses, PRIORS)
    plain = flight.states(family, hypotheses.spread, tick_s, *flight.burnouts(family, hypotheses.spread))
    assert with_ends(plain, hypotheses, family, np.arange(COUNT), tick_s) is plain


def test_what_one_sensor_tells_has_the_end_in_it():
    hypotheses, tick_s, _ = of_open_ends("IRBM", 0.35)
    family = fit.family_of(hypotheses, PRIORS)
    plain = flight.states(family, hypotheses.spread, tick_s, *flight.burnouts(family, hypotheses.spread))
    exact = with_ends(plain, hypotheses, family, np.arange(COUNT), tick_s)
    hypotheses = evolve(hypotheses, track=np.arange(COUNT))
    told = report(hypotheses, np.ones(COUNT), tick_s, Basis(PRIORS, "kepler"))
    assert told.state == pytest.approx(exact.mean)
    slower = np.sum((plain.mean - told.state)[:, 3:] * plain.mean[:, 3:], axis=1)
    assert np.all(slower > 0.0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ["SRBM", "IRBM", "ICBM"])
def test_ends_that_are_more_open_than_the_class_has_them_lead_to_no_endless_burns(kind):
    hypotheses, tick_s, _ = of_open_ends(kind, 0.35)
    spread = hypotheses.spread.copy()
    spread[:, BURN, BURN] = 4.0
    told = report(
        evolve(hypotheses, spread=spread, track=np.arange(COUNT)), np.ones(COUNT), tick_s, Basis(PRIORS, "kepler")
    )
    assert np.isfinite(told.state).all()
    # The longest burn and the fastest, four standard deviations off, take no target twice about the Earth.
    known = np.isfinite(told.impact[:, 2])
    assert (told.impact[known, 2] < tick_s + 2e4).all()
