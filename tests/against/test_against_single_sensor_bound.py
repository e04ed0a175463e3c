"""What one sensor's directions alone tell of a body in free flight: the bound of the scores against
an own one, by SciPy's integrator and differences of whole flights.

That a sensor that moves bounds the range, however slowly, is W. H. Gilson's result (Tracking targets
with bearing data from a single sensor, MIT Lincoln Laboratory TR-809, 1989). The frame of this
script does not turn; opir's sensors and targets are turned into it by the sidereal rate alone.
"""

import numpy as np
import pytest
from opir_scoring.bound import PRIOR_SIGMA, DetectedLooks, state_bound
from scipy.integrate import solve_ivp

MU = 3.986004418e14
EARTH_RATE = 7.292115146706979e-5
SIGMA_RAD = 20e-6

#: A body 600 km up that climbs, and satellites that look at it: of a low orbit beside it, and a
#: geostationary one; inertial positions, m, and velocities, m/s.
TARGET = np.array([6.971e6, 0.0, 0.0, 1500.0, 5500.0, 2000.0])
SENSORS = {
    "low": np.array([7.571e6, -1.2e6, 4.0e5, 1000.0, 3000.0, 6400.0]),
    "geostationary": np.array([3.9e7, 1.6e7, 0.0, -1166.7, 2843.9, 0.0]),
}


def flown(state, time_s):
    """Return inertial positions (n, 3) at times from 0 on."""

    def rates(_time, y):
        return np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3])

    solution = solve_ivp(
        rates, (0.0, time_s[-1]), state, t_eval=time_s, rtol=1e-12, atol=1e-6, method="DOP853"
    )
    return solution.y.T


def directions(state, sensor_m, time_s):
    sight = flown(state, time_s)[:, :3] - sensor_m
    return sight / np.linalg.norm(sight, axis=1)[:, None]


def own_bound(sensor_m, time_s):
    """Return the covariance (6, 6) of the state at the last look."""
    steps = np.array([10.0, 10.0, 10.0, 0.01, 0.01, 0.01])
    columns = []
    changes = []
    for number, step in enumerate(steps):
        plus, minus = TARGET.copy(), TARGET.copy()
        plus[number] += step
        minus[number] -= step
        slope = directions(plus, sensor_m, time_s) - directions(minus, sensor_m, time_s)
        columns.append(slope.ravel() / (2.0 * step * SIGMA_RAD))
        changes.append((flown(plus, time_s)[-1] - flown(minus, time_s)[-1]) / (2.0 * step))
    jacobian = np.array(columns).T
    information = jacobian.T @ jacobian + np.diag(1.0 / np.square(PRIOR_SIGMA))
    change = np.array(changes).T
    return change @ np.linalg.inv(information) @ change.T


def turned(position_m, time_s):
    """Return positions (n, 3) in the frame that turns with the Earth, which is the inertial one at
    0 s.
    """
    angle = EARTH_RATE * time_s
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, z = position_m.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)


@pytest.mark.parametrize("kind", SENSORS)
@pytest.mark.parametrize("span_s", [60.0, 200.0])
def test_one_sensor_bounds_a_body_in_free_flight_as_an_own_script_says(kind, span_s):
    time_s = np.arange(0.0, span_s + 0.5, 1.0)
    sensor_m = flown(SENSORS[kind], time_s)[:, :3]
    looks = DetectedLooks.unbiased(
        time_s,
        turned(flown(TARGET, time_s)[:, :3], time_s),
        turned(sensor_m, time_s),
        np.full(len(time_s), SIGMA_RAD),
    )
    bound = state_bound(np.array([span_s]), looks)[0]
    own = own_bound(sensor_m, time_s)
    ours = np.sqrt(np.linalg.eigvalsh(bound[:3, :3]))
    theirs = np.sqrt(np.linalg.eigvalsh(own[:3, :3]))
    assert ours == pytest.approx(theirs, rel=0.02)
    speeds = np.sqrt(np.linalg.eigvalsh(bound[3:, 3:]))
    assert speeds == pytest.approx(np.sqrt(np.linalg.eigvalsh(own[3:, 3:])), rel=0.02)
