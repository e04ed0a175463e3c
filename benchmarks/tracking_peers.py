"""Stone Soup and FilterPy on the problems of tracking.py, as their users would put them
together.
"""

import datetime
import time
from typing import Any

import numpy as np
from tracking_problems import (
    CHANCE,
    CLUTTER,
    KEPLER,
    PRIOR_M,
    PRIOR_M_S,
    SENSORS_M,
    SIGMA_RAD,
    Problem,
)

from opir_core.estimation import tangent_axes
from opir_core.estimation.motion import COAST, Motion
from opir_core.geometry import ecef_to_eci

EPOCH = datetime.datetime(2026, 4, 1)
#: Farther from the expected angles than 4.5 standard deviations of the prior and the noise
#: together, rad.
_FARTHEST_RAD = 2e-4
PRIOR = np.diag(np.repeat([PRIOR_M, PRIOR_M_S], 3) ** 2)
MOTION = Motion(COAST, 0.0, KEPLER)


def two_body(state: np.ndarray, step_s: float) -> np.ndarray:
    """Return a state (6,) after a step by Runge and Kutta's fourth-order method, in plain numpy."""

    def rate(value: np.ndarray) -> np.ndarray:
        place = value[:3]
        square = place @ place
        return np.concatenate([value[3:], -3.986004418e14 / (square * np.sqrt(square)) * place])

    first = rate(state)
    second = rate(state + 0.5 * step_s * first)
    third = rate(state + 0.5 * step_s * second)
    return state + step_s / 6.0 * (
        first + 2.0 * second + 2.0 * third + rate(state + step_s * third)
    )


def stone_soup_parts() -> tuple[Any, Any]:
    """Return the two-body transition model, and a function that makes a measurement model at a
    sensor's place.
    """
    from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
    from stonesoup.models.transition.base import TransitionModel
    from stonesoup.models.transition.nonlinear import GaussianTransitionModel
    from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors

    class TwoBody(GaussianTransitionModel, TransitionModel):
        @property
        def ndim_state(self) -> int:
            return 6

        def function(
            self, state: Any, noise: Any = False, time_interval: Any = None, **_: Any
        ) -> Any:
            step_s = time_interval.total_seconds()
            columns = np.asarray(state.state_vector, dtype=float).reshape(6, -1)
            moved = np.stack([two_body(column, step_s) for column in columns.T], axis=1)
            return StateVectors(moved) if columns.shape[1] > 1 else StateVector(moved)

        def jacobian(self, state: Any, time_interval: Any = None, **_: Any) -> np.ndarray:
            place = np.asarray(state.state_vector[:3], dtype=float).reshape(1, 3)
            return MOTION.transition(place, np.array([time_interval.total_seconds()]))[0]

        def covar(self, **_: Any) -> Any:
            return CovarianceMatrix(np.zeros((6, 6)))

    def measure(sensor: int, time_s: float) -> Any:
        return CartesianToElevationBearing(
            ndim_state=6,
            mapping=(0, 1, 2),
            noise_covar=CovarianceMatrix(np.eye(2) * SIGMA_RAD**2),
            translation_offset=StateVector(ecef_to_eci(SENSORS_M[sensor], time_s)),
        )

    return TwoBody(), measure


def stone_soup_frames(case: Problem) -> list[tuple[Any, set[Any], list[Any]]]:
    """Return each frame's time and detections; angles are elevation and bearing in the inertial
    axes.
    """
    from stonesoup.types.angle import Bearing, Elevation
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection

    _, measure = stone_soup_parts()
    frames: list[tuple[Any, set[Any], list[Any]]] = []
    starts = np.flatnonzero(np.diff(case.rays.time_s, prepend=-1.0))
    for start, stop in zip(starts, np.append(starts[1:], len(case.rays)), strict=True):
        part = case.rays.take(slice(start, stop))
        when = EPOCH + datetime.timedelta(seconds=part.time_s[0])
        model = measure(part.sensor[0], part.time_s[0])
        toward = ecef_to_eci(part.direction_ecef, part.time_s)
        reports = [
            Detection(
                StateVector([[Elevation(np.arcsin(d[2]))], [Bearing(np.arctan2(d[1], d[0]))]]),
                timestamp=when,
                measurement_model=model,
            )
            for d in toward
        ]
        frames.append((when, set(reports), reports))
    return frames


def stone_soup_filter(case: Problem, unscented: bool) -> tuple[np.ndarray, float]:
    """Return the state at the end of a single target's looks, and the seconds taken."""
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

    transition, _ = stone_soup_parts()
    predictor = (UnscentedKalmanPredictor if unscented else ExtendedKalmanPredictor)(transition)
    updater = (UnscentedKalmanUpdater if unscented else ExtendedKalmanUpdater)(None)
    frames = stone_soup_frames(case)
    state: Any = GaussianState(case.prior[0], PRIOR, timestamp=EPOCH)
    start = time.process_time()
    for when, _, reports in frames:
        state = updater.update(
            SingleHypothesis(predictor.predict(state, timestamp=when), reports[0])
        )
    return np.asarray(state.state_vector, dtype=float).ravel(), time.process_time() - start


def filterpy_filter(case: Problem) -> tuple[np.ndarray, float]:
    """Return the state at the end of a single target's looks with FilterPy's EKF, and the seconds
    taken.
    """
    from filterpy.kalman import ExtendedKalmanFilter

    class TwoBody(ExtendedKalmanFilter):
        def predict_x(self, u: Any = 0) -> None:
            self.x = two_body(self.x, self.step_s)

    rays = case.rays
    origins = ecef_to_eci(rays.origin_ecef_m, rays.time_s)
    axes = tangent_axes(ecef_to_eci(rays.direction_ecef, rays.time_s))
    one = TwoBody(6, 2)
    one.x = case.prior[0].copy()
    one.P = PRIOR.copy()
    one.R = np.eye(2) * SIGMA_RAD**2
    one.Q = np.zeros((6, 6))
    before = 0.0
    start = time.process_time()
    for when, origin, frame in zip(rays.time_s, origins, axes, strict=True):
        one.step_s = when - before
        one.F = MOTION.transition(one.x[None, :3], np.array([one.step_s]))[0]
        one.predict()
        before = when

        def seen(
            state: np.ndarray, origin: np.ndarray = origin, frame: np.ndarray = frame
        ) -> np.ndarray:
            local = frame @ (state[:3] - origin)
            return local[:2] / local[2]

        def slope(
            state: np.ndarray, origin: np.ndarray = origin, frame: np.ndarray = frame
        ) -> np.ndarray:
            local = frame @ (state[:3] - origin)
            part = (frame[:2] - (local[:2] / local[2])[:, None] * frame[2]) / local[2]
            return np.concatenate([part, np.zeros((2, 3))], axis=1)

        one.update(np.zeros(2), slope, seen)
    return one.x, time.process_time() - start


def stone_soup_associator(way: str, predictor: Any, updater: Any, solid_angle_sr: float) -> Any:
    """Return what associates, `nearest` or `joint`, with clutter in a solid angle."""
    from stonesoup.dataassociator.probability import JPDAwithEHM2
    from stonesoup.dataassociator.tree import DetectionKDTreeGNN2D
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.measures import Mahalanobis

    if way == "joint":
        density = CLUTTER / solid_angle_sr
        guess = PDAHypothesiser(
            predictor,
            updater,
            clutter_spatial_density=density,
            prob_detect=CHANCE,
            prob_gate=0.9999,
        )
        return JPDAwithEHM2(guess)
    distance = DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=4.5)
    return DetectionKDTreeGNN2D(
        hypothesiser=distance, predictor=predictor, updater=updater, max_distance=_FARTHEST_RAD
    )


def stone_soup_raid(
    case: Problem, way: str, solid_angle_sr: float
) -> tuple[list[tuple[float, np.ndarray]], float]:
    """Return the positions at each frame's time, and the seconds taken, of `nearest` or `joint`
    association.
    """
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    transition, _ = stone_soup_parts()
    predictor = ExtendedKalmanPredictor(transition)
    updater = ExtendedKalmanUpdater(None)
    tracks = [Track([GaussianState(prior, PRIOR, timestamp=EPOCH)]) for prior in case.prior]
    associator = stone_soup_associator(way, predictor, updater, solid_angle_sr)
    frames = stone_soup_frames(case)
    reports = []
    seconds = 0.0
    for when, detections, _ in frames:
        start = time.process_time()
        found = associator.associate(set(tracks), detections, when)
        for track in tracks:
            track.append(
                blended(found[track], updater) if way == "joint" else single(found[track], updater)
            )
        seconds += time.process_time() - start
        place = np.stack(
            [np.asarray(track.state_vector[:3], dtype=float).ravel() for track in tracks]
        )
        reports.append(((when - EPOCH).total_seconds(), place))
    return reports, seconds


def single(hypothesis: Any, updater: Any) -> Any:
    """Return the state after one hypothesis."""
    return updater.update(hypothesis) if hypothesis else hypothesis.prediction


def blended(hypotheses: Any, updater: Any) -> Any:
    """Return the state after all hypotheses, by first and second moments, as in Stone Soup's own
    JPDA tutorial.
    """
    from stonesoup.functions import gm_reduce_single
    from stonesoup.types.array import StateVectors
    from stonesoup.types.update import GaussianStateUpdate

    states = []
    weights = []
    for hypothesis in hypotheses:
        states.append(single(hypothesis, updater))
        weights.append(hypothesis.probability)
    means = StateVectors([state.state_vector for state in states])
    covariances = np.stack([state.covar for state in states], axis=2)
    mean, covariance = gm_reduce_single(means, covariances, np.asarray(weights, dtype=float))
    return GaussianStateUpdate(mean, covariance, hypotheses, hypotheses[0].prediction.timestamp)
