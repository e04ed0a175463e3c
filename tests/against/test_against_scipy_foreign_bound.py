"""The flights that bounds differentiate, against those of SciPy's integrator with the same
parameters.
"""

import sys

import numpy as np
import pytest
from repository import ROOT

sys.path.append(str(ROOT / "benchmarks"))

import foreign_bound
from foreign_flights import drawn_flight, ecef


@pytest.mark.parametrize(("stages", "gaps"), [(1, False), (2, True)])
def test_flights_with_the_same_parameters_are_the_same(stages, gaps):
    flight = drawn_flight(stages, gaps, np.random.default_rng([1, stages, gaps]))
    parameters, _ = foreign_bound.parameters(flight.boost, 10.0)
    paths = foreign_bound.flown(parameters[None], stages)
    times = np.array([3.0, 20.0, 50.0, flight.burnout_s, flight.burnout_s + 20.0])
    states = np.array([flight.state(time) for time in times])
    assert paths.states(times + 10.0)[0] == pytest.approx(states, abs=0.3)
    assert paths.states(times + 10.0)[0, :, 3:] == pytest.approx(states[:, 3:], abs=5e-3)
    # Burnout to impact the error of the velocity grows for up to 2000 s.
    assert paths.impacts()[0] == pytest.approx(ecef(*flight.impact[:2]), abs=5.0)
    edges = foreign_bound.edges(parameters[None], stages)[0] - 10.0
    assert edges == pytest.approx(np.unique(np.round(flight.burns_s, 9)), abs=1e-6)
