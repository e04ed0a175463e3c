"""One mode of `imm` equals Stone Soup's extended Kalman filter (MIT licence), look by look, to
rounding.

Both get the same motion (a constant jerk driven by white noise, without gravity), the same
projection of a point onto the plane across a line of sight, and the same looks, one a slice.
"""

import datetime

import numpy as np
from opir_estimation import BOOST, AngleMeasurements, Gaussian, Motion, square_root, tangent_axes
from opir_estimation.filter.burn_modes import carried
from opir_estimation.filter.iterated_update import Mode, updated

from opir_core.flight.forces import Forces, ZonalField

STEP_S = 0.5
SIGMA_RAD = 2e-5
NOISE = 0.3
WEIGHTLESS = Forces(zonal=(), gravity=ZonalField(mu_m3_s2=0.0))
SENSORS_M = 42164e3 * np.array([[np.cos(0.17), np.sin(0.17), 0.0], [np.cos(1.7), np.sin(1.7), 0.0]])


def looks(count):
    """Return origins, axes and positions across them of looks at a curved path, and the prior."""
    rng = np.random.default_rng(11)
    start = np.array([3.1e6, 4.2e6, 3.7e6])
    origins = []
    axes = []
    angles = []
    for number in range(1, count + 1):
        time_s = number * STEP_S
        target = (
            start + np.array([40.0, -20.0, 60.0]) * time_s + np.array([9.0, 6.0, 12.0]) * time_s**2
        )
        origin = SENSORS_M[number % 2]
        separation = target + rng.normal(size=3) * 700.0 - origin
        origins.append(origin)
        axes.append(tangent_axes((separation / np.linalg.norm(separation))[None])[0])
        angles.append(np.zeros(2))
    prior = np.concatenate([start + rng.normal(size=3) * 2e3, rng.normal(size=9) * 10.0])
    sigma = np.repeat([3e3, 300.0, 20.0, 0.5], 3)
    return origins, axes, np.array(angles), np.stack([prior, sigma])


def look_across():
    """Return the class of Stone Soup measurement models of a look: the two directions across it."""
    from stonesoup.base import Property
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.types.array import StateVector

    class Across(NonLinearGaussianMeasurement):
        origin: np.ndarray = Property(doc="where from")
        frame: np.ndarray = Property(doc="axes as rows, the third along the look")

        @property
        def ndim_meas(self):
            return 2

        def local(self, state):
            position = np.array(state.state_vector[list(self.mapping)], dtype=float).ravel()
            return self.frame @ (position - self.origin)

        def function(self, state, noise=False, **_):
            local = self.local(state)
            return StateVector(local[:2] / local[2])

        def jacobian(self, state, **_):
            local = self.local(state)
            full = np.zeros((2, 12))
            full[:, list(self.mapping)] = (
                self.frame[:2] - (local[:2] / local[2])[:, None] * self.frame[2]
            ) / local[2]
            return full

        def inverse_function(self, detection, **_):
            raise AssertionError(
                "an extended Kalman update needs the measurement function, not its inverse"
            )

    return Across


def stone_soup_estimates(origins, axes, seen, prior):
    """Return Stone Soup's mean and covariance after the last look, in our order of the state."""
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantNthDerivative,
    )
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    order = np.array([3 * (k % 4) + k // 4 for k in range(12)])
    model = CombinedLinearGaussianTransitionModel(
        [ConstantNthDerivative(constant_derivative=3, noise_diff_coeff=NOISE**2) for _ in range(3)]
    )
    timestamp = datetime.datetime(2026, 4, 1)
    state = GaussianState(prior[0][order], np.diag(prior[1][order] ** 2), timestamp=timestamp)
    predictor = ExtendedKalmanPredictor(model)
    updater = ExtendedKalmanUpdater(None)
    across = look_across()
    noise = {"ndim_state": 12, "mapping": (0, 4, 8), "noise_covar": np.eye(2) * SIGMA_RAD**2}
    for number, (origin, frame) in enumerate(zip(origins, axes, strict=True), start=1):
        time = timestamp + datetime.timedelta(seconds=number * STEP_S)
        measure = across(**noise, origin=origin, frame=frame)
        reported = Detection(
            StateVector(seen[number - 1]), timestamp=time, measurement_model=measure
        )
        state = updater.update(SingleHypothesis(predictor.predict(state, timestamp=time), reported))
    back = np.argsort(order)
    return np.array(state.state_vector, dtype=float).ravel()[back], np.array(state.covar)[
        np.ix_(back, back)
    ]


def test_forty_looks():
    origins, axes, seen, prior = looks(40)
    mean, covariance = stone_soup_estimates(origins, axes, seen, prior)
    motion = Motion(BOOST, NOISE, WEIGHTLESS)
    state = Gaussian(prior[:1].copy(), np.diag(1.0 / prior[1])[None])
    for number, (origin, frame) in enumerate(zip(origins, axes, strict=True), start=1):
        state = carried(motion, state, np.array([STEP_S]))
        time_s = number * STEP_S
        sight = AngleMeasurements(
            np.zeros(1, dtype=np.int64),
            np.array([time_s]),
            origin[None],
            frame[None],
            seen[number - 1][None],
            np.eye(2)[None] / SIGMA_RAD,
        )
        (update,) = updated([Mode(motion, *state)], time_s, sight, rounds=1)
        state = Gaussian(update.mean, update.root)
    mine = square_root.covariance(state.root)[0]
    sigma = np.sqrt(np.diag(mine))
    assert np.all(np.abs(state.mean[0] - mean) < 1e-6 * sigma), (
        "a millionth of a standard deviation"
    )
    assert np.all(np.abs(mine - covariance) < 1e-7 * np.outer(sigma, sigma))
