"""Trials of the boost-profile fit: parts of a posterior to which steps from what was found do not lead."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS, bank_after, flights, lines_of_sight, watch_of
from opir_trackers.profile import fit
from opir_trackers.profile import flight as profile_flight
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.hypotheses import probability
from opir_trackers.profile.report import Basis, report
from scipy.stats import chi2

from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import nees

#: A sharp sensor: looks every 50 ms, with errors of 10 µrad, that nearly all detect.
SEEING = {"sensors": 1, "period_s": 0.05, "chance": 0.95}

#: When it is seen for 20 s.
TICK_S = 40.0


def seen_late(count):
    """Return a flight so many times over that clouds hide for 15 s, and what looks see of it, by track."""
    truth = flights("ICBM", 500, 1).take(np.full(count, 472))
    truth = evolve(truth, track=np.arange(count))
    track, rays = lines_of_sight(truth, 10e-6, 3, **SEEING, hidden_s=np.full(count, 14.86))
    return truth, track, rays


@pytest.mark.slow
def test_a_boost_that_pitched_before_its_first_light_is_not_given_up_for_one_that_pitched_after_it():
    # It has leaned for a while when it is seen, and in one of fifty draws of errors looks fit one that starts to lean.
    truth, track, rays = seen_late(200)
    chosen = np.array([27, 30, 173])
    mine = np.flatnonzero(np.isin(track, chosen) & (rays.time_s < TICK_S))
    track, rays, truth = track[mine], rays.take(mine), truth.take(chosen)
    fitting = Fitting(PRIORS.take([TARGET_TYPES.index("ICBM")]), watch_of(**SEEING), True)
    bank = bank_after(fitting, track, rays, int(TICK_S))
    likely, finer = bank.hypotheses, fitting.parts(bank, TICK_S)
    parts = None if finer is None else (finer, probability(finer))
    told = report(likely, probability(likely), TICK_S, Basis(fitting.priors, "kepler"), parts)
    nothing = np.zeros((len(truth), 10, 10))
    family = fit.family_of(truth, PRIORS)
    state, _ = profile_flight.sloped_states(family, TICK_S, *profile_flight.burnouts(family, nothing))
    assert np.all(nees(told.state - state, told.state_covariance) < chi2.isf(1e-6, 6))
