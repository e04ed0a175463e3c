"""The flights of the tracking set, in steps of Runge and Kutta, against those of SciPy's integrator
with the same parameters.
"""

import sys

import numpy as np
import pytest
from repository import ROOT

sys.path += [str(ROOT / "benchmarks"), str(ROOT / "benchmarks" / "tracking_set")]

from foreign_flights import drawn_flight
from set_flights import burns, flown


def set_row(boost, gaps):
    """Return the parameters of the set for a boost without drag and steering, ignited at 10 s."""
    steering = np.zeros(len(boost.burn_s) - 1)
    launch = [*boost.launch, boost.azimuth, 10.0, boost.rise_s, boost.kick, 0.0]
    stages = [boost.burn_s, boost.acceleration_m_s2, boost.growth, steering]
    return np.concatenate([launch, *stages, boost.gap_s[:-1] if gaps else []])


@pytest.mark.parametrize(("stages", "gaps"), [(1, False), (2, True), (3, False)])
def test_flights_with_the_same_parameters_are_the_same(stages, gaps):
    flight = drawn_flight(stages, gaps, np.random.default_rng([1, stages, gaps]))
    row = set_row(flight.boost, gaps)
    times = np.array([3.0, 20.0, 50.0, flight.burnout_s, flight.burnout_s + 20.0])
    expected = np.array([flight.state(time) for time in times])
    states = flown(row[None], stages, float(times[-1]) + 11.0).states(times + 10.0)[0]
    assert states == pytest.approx(expected, abs=0.3)
    assert states[:, 3:] == pytest.approx(expected[:, 3:], abs=5e-3)
    assert burns(row, stages) - 10.0 == pytest.approx(np.array(flight.burns_s), abs=1e-6)
