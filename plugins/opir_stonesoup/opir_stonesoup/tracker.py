"""Stone Soup as an opir tracker."""

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from ordered_set import OrderedSet
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

from opir_core.arrays import IntArray
from opir_core.plugin import Detections, Tracker, TrackerContext, Tracks
from opir_stonesoup.forecasts import TrackForecasts, track_forecasts
from opir_stonesoup.models import SIZES, EarthFixedTransition
from opir_stonesoup.reader import OpirDetectionReader, sights_of
from opir_stonesoup.settings import StoneSoupConfig
from opir_stonesoup.upkeep import GroundInitiator, SilenceDeleter, has_hits

_UNIX = datetime(1970, 1, 1)


class StoneSoupTracker(Tracker):
    """A Stone Soup multi-target tracker, stepped at opir's ticks.

    `tracker` has `update_tracker(time, detections)`, `tracks` and `data_associator`, like Stone
    Soup's simple trackers; `predictor` predicts its states, Earth-fixed as in
    `opir_stonesoup.models`, to the ticks. A track is reported once it has `needed_hits` detections;
    numbers follow the order in which tracks began. With `forecasts` tracks have hypotheses and
    impact regions.
    """

    def __init__(
        self,
        tracker: Any,
        predictor: Any,
        context: TrackerContext,
        *,
        cadence_s: float = 1.0,
        needed_hits: int = 1,
        forecasts: TrackForecasts | None = None,
    ) -> None:
        self.cadence_s: float | None = cadence_s
        self._tracker = tracker
        self._predictor = predictor
        if isinstance(getattr(tracker, "_tracks", None), set):
            # A plain set would go through the tracks in another order in each process.
            tracker._tracks = OrderedSet(tracker._tracks)
        self._ids = [sensor.id for sensor in context.sensors]
        self._epoch_us = context.epoch_us
        self._light_time = context.light_time
        self._needed_hits = needed_hits
        self._forecasts = forecasts
        self._number: dict[Any, int] = {}
        self._next_number = 0

    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 without one, by the tracks at the last tick.

        The state is unchanged.
        """
        tracks = OrderedSet(self._number)
        numbers: list[int] = []
        for time, detected in self._frames(detections):
            hypotheses = (
                self._tracker.data_associator.associate(tracks, detected, time) if tracks else {}
            )
            owner = {
                _likeliest(hypothesis): self._number[track]
                for track, hypothesis in hypotheses.items()
            }
            numbers += [owner.get(detection, -1) for detection in detected]
        return np.array(numbers, dtype=np.int64)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at this tick, sorted by track.

        `detections` are those since the last tick.
        """
        for time, detected in self._frames(detections):
            self._tracker.update_tracker(time, detected)
        self._count()
        return self._tracks(tick_s)

    def _frames(self, detections: Detections) -> Iterator[tuple[datetime, Any]]:
        sights = sights_of(detections, self._ids, self._epoch_us)
        size = self._predictor.transition_model.ndim_state
        return iter(
            OpirDetectionReader(sights=sights, ndim_state=size, light_time=self._light_time)
        )

    def _count(self) -> None:
        """Number the tracks confirmed since the last tick, and drop those that ended."""
        confirmed = [track for track in self._tracker.tracks if has_hits(track, self._needed_hits)]
        new_tracks = [track for track in confirmed if track not in self._number]
        self._number = {
            track: number for track, number in self._number.items() if track in self._tracker.tracks
        }
        for track in sorted(new_tracks, key=_began):
            self._number[track] = self._next_number
            self._next_number += 1

    def _tracks(self, tick_s: float) -> Tracks:
        count = len(self._number)
        time = _UNIX + timedelta(microseconds=self._epoch_us + round(tick_s * 1e6))
        states = [self._predictor.predict(track[-1], timestamp=time) for track in self._number]
        # Of particles the state vector has them all, and the mean is one.
        means = [np.asarray(state.mean, dtype=np.float64).reshape(-1)[:6] for state in states]
        covariances = [np.asarray(state.covar, dtype=np.float64)[:6, :6] for state in states]
        tracks = Tracks(
            tick_s=np.full(count, tick_s),
            track=np.array(list(self._number.values()), dtype=np.int64),
            state=np.array(means).reshape(count, 6),
            state_covariance=np.array(
                [0.5 * (covariance + covariance.T) for covariance in covariances]
            ).reshape(count, 6, 6),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
            impact=np.full((count, 3), np.nan),
            impact_covariance=np.full((count, 3, 3), np.nan),
            type_probability=np.full((count, 4), np.nan),
        )
        if self._forecasts is None or not count:
            return tracks
        return self._forecasts.added_to(tracks, list(self._number), states, time)


def stone_soup_tracker(config: StoneSoupConfig, context: TrackerContext) -> Tracker:
    """Return the tracker `stonesoup`."""
    predictor, updater = filter_of(config, context)
    hypothesiser = PDAHypothesiser(
        predictor,
        updater,
        clutter_spatial_density=config.false_alarms_per_sr,
        prob_detect=config.detection_probability,
        prob_gate=config.gate_probability,
    )
    deleter = SilenceDeleter(
        config.needed_hits, config.tentative_s, config.silence_s, config.lost_sigma_m
    )
    joint = config.association == "jpda"
    tracker = (MultiTargetMixtureTracker if joint else MultiTargetTracker)(
        initiator=GroundInitiator(updater=updater, ndim_state=SIZES[config.motion]),
        deleter=deleter,
        detector=None,
        data_associator=(JPDAwithEHM2 if joint else GNNWith2DAssignment)(hypothesiser),
        updater=updater,
    )
    return StoneSoupTracker(
        tracker,
        predictor,
        context,
        cadence_s=config.cadence_s,
        needed_hits=config.needed_hits,
        forecasts=track_forecasts(config, context),
    )


def filter_of(config: StoneSoupConfig, context: TrackerContext) -> tuple[Any, Any]:
    """Return Stone Soup's predictor and updater with opir's motion."""
    motion = EarthFixedTransition(
        ndim_state=SIZES[config.motion], noise=config.noise, forces=context.forces
    )
    if config.filter == "ekf":
        return ExtendedKalmanPredictor(motion), ExtendedKalmanUpdater(use_joseph_cov=True)
    # Sigma points of equal weight about the mean: the usual kappa of 3 - d is negative here, and so
    # might be variances.
    points = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
    return UnscentedKalmanPredictor(motion, **points), UnscentedKalmanUpdater(
        force_symmetric_covariance=True, **points
    )


def _likeliest(hypothesis: Any) -> Any:
    """Return the likeliest detection of a track's hypotheses, or None."""
    best = (
        max(hypothesis, key=lambda weighted: weighted.probability)
        if hasattr(hypothesis, "single_hypotheses")
        else hypothesis
    )
    return best.measurement if best else None


def _began(track: Any) -> tuple[Any, ...]:
    state = track[0]
    return (state.timestamp, *np.asarray(state.state_vector, dtype=np.float64)[:3, 0].tolist())
