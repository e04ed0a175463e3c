"""Hypotheses and impact regions of Stone Soup's tracks, by a forecaster of opir."""

from collections.abc import Sequence
from datetime import datetime
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve
from opir_estimation import COAST, earth_rotated
from opir_forecast import BoostEstimates, Forecaster, burning_probability, launch_probability
from opir_trackers import GROUND, LAUNCH, Composition, PartContext, made_part
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.types.state import GaussianState
from stonesoup.types.update import Update

from opir_core.arrays import FloatArray
from opir_core.flight import forces_of
from opir_core.plugin import TrackerContext, Tracks
from opir_stonesoup.models import EarthFixedTransition, free_forces, inertial_matrix
from opir_stonesoup.settings import StoneSoupConfig

#: Number of detections whose times give the mean pause between them.
_RECENT = 20

#: The most states that a forecast uses: position, velocity, specific force.
_BURN = 9

#: Groups of hypotheses.
_GROUPS = 5


class TrackForecasts(NamedTuple):
    """The forecasts of tracks: moving sources are launches, and others stand on the ground.

    `coast` predicts states in free flight; looks detect a target with `detection_probability`.
    """

    forecaster: Forecaster
    composition: Composition
    hypotheses: int
    coast: Any
    detection_probability: float

    def added_to(
        self, tracks: Tracks, sources: Sequence[Any], predictions: Sequence[Any], time: datetime
    ) -> Tracks:
        """Return tracks at a time with the forecasts of the Stone Soup tracks that they are of, whose
        states have predictions.
        """
        launch = launch_probability(tracks.state[:, 3:], tracks.state_covariance[:, 3:, 3:])
        estimates = evolve(
            self._estimates(tracks, sources, predictions, time), is_launch=launch > 0.5
        )
        forecasts = self.forecaster.forecasts(estimates, float(tracks.tick_s[0]))
        groups = np.zeros((len(tracks), _GROUPS))
        groups[:, LAUNCH] = launch
        groups[:, GROUND] = 1.0 - launch
        return evolve(
            tracks,
            impact=forecasts.impact,
            impact_covariance=forecasts.impact_covariance,
            impact_sigmas=forecasts.impact_sigmas,
            impact_regions=forecasts.impact_regions,
            probability_burning=forecasts.probability_burning,
            probability_relights=forecasts.probability_relights,
            **self.composition.columns(groups, forecasts.given_launch),
        )

    def _estimates(
        self, tracks: Tracks, sources: Sequence[Any], predictions: Sequence[Any], time: datetime
    ) -> BoostEstimates:
        """Return what the tracker knows of its tracks: if they burn, the predictions; if they coast,
        the free flights since the last detections.
        """
        tick_s = float(tracks.tick_s[0])
        silent_s, pause_s = np.array([_times_s(track, time) for track in sources]).T
        chance = np.full(len(sources), self.detection_probability)
        burning = burning_probability(silent_s, pause_s, chance)
        coasts = [self.coast.predict(_free(track[-1]), timestamp=time) for track in sources]
        burns = _moments(predictions, _BURN, tick_s)
        estimates = BoostEstimates.of_moments(
            tracks.track, *burns, burning, silent_s, pause_s, self.hypotheses
        )
        return estimates.with_coasts(*_moments(coasts, COAST, tick_s))


def track_forecasts(config: StoneSoupConfig, context: TrackerContext) -> TrackForecasts:
    """Return the forecasts that the settings ask for."""
    forces = free_forces(context.forces)
    part = PartContext(tracker=context, settings=config, forces=forces_of(context.forces))
    free_flight = EarthFixedTransition(ndim_state=COAST, noise=config.coast_noise, forces=forces)
    return TrackForecasts(
        made_part(Forecaster, "forecast", part),
        Composition.of(context.hypotheses),
        len(context.hypotheses),
        ExtendedKalmanPredictor(free_flight),
        config.detection_probability,
    )


def _free(state: Any) -> GaussianState:
    """Return position and velocity of a state."""
    mean = np.asarray(state.mean, dtype=np.float64)[:COAST]
    return GaussianState(mean, state.covar[:COAST, :COAST], timestamp=state.timestamp)


def _moments(states: Sequence[Any], most: int, time_s: float) -> tuple[FloatArray, FloatArray]:
    """Return inertial means (n, d) and covariances (n, d, d) of Earth-fixed states at a time, of at
    most so many components.
    """
    mean = np.array([np.asarray(state.mean, dtype=np.float64).ravel()[:most] for state in states])
    covariance = np.array([state.covar[:most, :most] for state in states], dtype=np.float64)
    turn = earth_rotated(np.eye(3), np.full(3, time_s)).T
    matrix = np.kron(np.eye(mean.shape[1] // 3), turn) @ inertial_matrix(mean.shape[1])
    return mean @ matrix.T, matrix @ covariance @ matrix.T


def _times_s(track: Any, time: datetime) -> tuple[float, float]:
    """Return the time since the last detection of a track, s, and the mean one between detections."""
    updates = (state for state in reversed(track.states) if isinstance(state, Update))
    times = [state.timestamp for state in islice(updates, _RECENT + 1)]
    pauses = max(len(times) - 1, 1)
    return (time - times[0]).total_seconds(), (times[0] - times[-1]).total_seconds() / pauses
