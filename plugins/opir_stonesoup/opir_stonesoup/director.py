"""Stone Soup's sensor managers as an opir director."""

import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from ordered_set import OrderedSet
from stonesoup.base import Property
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.sensor.sensor import SimpleSensor
from stonesoup.sensormanager import BruteForceSensorManager, GreedySensorManager
from stonesoup.sensormanager.action import Action, ActionableProperty, ActionGenerator
from stonesoup.sensormanager.reward import UncertaintyRewardFunction
from stonesoup.types.array import StateVector
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import ExtendedKalmanUpdater

from opir_core.arrays import FloatArray
from opir_core.plugin import Command, Director, DirectorContext, Sensor, Situation, Tracks
from opir_stonesoup.models import EarthFixedTransition, SightModel, sensor_axes
from opir_stonesoup.settings import StoneSoupDirectorConfig

_UNIX = datetime(1970, 1, 1)
#: Least standard deviation of a line of sight, rad: an exact one would make the update singular.
_FINEST_RAD = 1e-8


class LookAtTrack(Action):  # type: ignore[misc]
    """Points a `NarrowFieldSensor` at a track, by its number."""

    def act(self, current_time: Any, timestamp: Any, init_value: int, **_: Any) -> int:
        """Return the track."""
        return int(self.target_value)


class TracksInReach(ActionGenerator):  # type: ignore[misc]
    """The tracks at which a `NarrowFieldSensor` can look, an action each."""

    def __contains__(self, item: Any) -> bool:
        return item in self.owner.models

    def __iter__(self) -> Iterator[LookAtTrack]:
        return map(self._action, self.owner.models)

    @property
    def default_action(self) -> LookAtTrack:
        """The track at which it looks."""
        return self._action(self.current_value)

    def _action(self, track: int) -> LookAtTrack:
        return LookAtTrack(generator=self, end_time=self.end_time, target_value=track)


class NarrowFieldSensor(SimpleSensor):  # type: ignore[misc]
    """A sensor that measures the track at which it looks, -1 for none, and no other.

    `models` has the measurement model of each track that it can be pointed at. Truths have the
    number of their track in their metadata.
    """

    number: int = Property(doc="its place among the sensors")
    models: Mapping[int, SightModel] = Property(doc="measurement models by track")
    target: int = ActionableProperty(TracksInReach, default=-1, doc="the track it looks at")

    def __hash__(self) -> int:
        # Sets of sensors have the same order in each process.
        return int(self.number)

    __eq__ = object.__eq__

    @property
    def measurement_model(self) -> SightModel:
        """The measurement model of the track at which it looks."""
        return self.models[self.target]

    def is_detectable(self, state: Any, measurement_model: Any = None) -> bool:
        """Return whether a truth is that of the track at which it looks."""
        return bool(state.metadata["track"] == self.target)

    def is_clutter_detectable(self, state: Any) -> bool:
        """Return False: false alarms tell nothing of a track."""
        return False


class StoneSoupDirector(Director):
    """Has a sensor manager of Stone Soup choose a track for each sensor.

    The reward is Stone Soup's `UncertaintyRewardFunction`: by how much the norm of the covariance
    of the predicted states shrinks by the looks up to the next decision, taken as one measurement
    with their mean error.
    """

    needs_detections: bool = False

    def __init__(self, config: StoneSoupDirectorConfig, context: DirectorContext) -> None:
        self._config = config
        self._epoch_us = context.epoch_us
        transition = EarthFixedTransition(ndim_state=6, noise=config.noise)
        self._reward = UncertaintyRewardFunction(
            predictor=ExtendedKalmanPredictor(transition), updater=ExtendedKalmanUpdater()
        )

    @property
    def interval_s(self) -> float:
        """Time between decisions, s."""
        return self._config.interval_s

    def commands(self, situation: Situation) -> Sequence[Command]:
        """Return a command for each sensor that can be pointed at a track."""
        tracks = _launches(situation.tracks, self._config.least_probability_launch)
        position_m = tracks.state[:, :3] + tracks.state[:, 3:] * (
            situation.time_s - tracks.tick_s[:, None]
        )
        time = self._time(situation.time_s)
        sensors = OrderedSet(self._sensors(situation, tracks, position_m, time))
        if not sensors:
            return []
        name, manager = self._manager(sensors)
        end = time + timedelta(seconds=self.interval_s)
        (chosen,) = manager.choose_actions(self._tracks(tracks), end)
        rows = {track: row for row, track in enumerate(tracks.track.tolist())}
        targets = {sensor: action.target_value for sensor, (action,) in chosen.items()}
        return [
            Command(
                sensor=situation.sensors[sensor.number].id,
                position_ecef_m=position_m[rows[targets[sensor]]],
                velocity_m_s=tracks.state[rows[targets[sensor]], 3:],
                track=targets[sensor],
                reason=f"track {targets[sensor]}, by Stone Soup's {name}",
            )
            for sensor in sensors
        ]

    def _manager(self, sensors: OrderedSet[NarrowFieldSensor]) -> tuple[str, Any]:
        """Return the manager, by its name: of too many plans the greedy one."""
        plans = math.prod(len(sensor.models) for sensor in sensors)
        is_brute = self._config.manager == "brute-force" and plans <= self._config.most_plans
        kind = BruteForceSensorManager if is_brute else GreedySensorManager
        # Plain sets of them would have another order in each process.
        manager = kind(sensors=sensors, platforms=OrderedSet(), reward_function=self._reward)
        return kind.__name__, manager

    def _time(self, time_s: float) -> datetime:
        return _UNIX + timedelta(microseconds=self._epoch_us + round(time_s * 1e6))

    def _tracks(self, tracks: Tracks) -> OrderedSet[Track]:
        """Return the tracks as Stone Soup's, with their numbers in the metadata."""
        rows = zip(
            tracks.track.tolist(), tracks.tick_s.tolist(), tracks.state, tracks.state_covariance,
            strict=True,
        )  # fmt: skip
        # Without an id of its own a track draws one from the system's entropy.
        return OrderedSet(
            Track(
                [GaussianState(StateVector(state), covariance, timestamp=self._time(tick_s))],
                id=str(number),
                init_metadata={"track": number},
            )
            for number, tick_s, state, covariance in rows
        )

    def _sensors(
        self, situation: Situation, tracks: Tracks, position_m: FloatArray, time: datetime
    ) -> Iterator[NarrowFieldSensor]:
        """Yield the sensors that can be pointed at a track now and at the next decision."""
        end_s = situation.time_s + self.interval_s
        end_m = position_m + tracks.state[:, 3:] * self.interval_s
        for number, sensor in enumerate(situation.sensors):
            reach = situation.in_reach(sensor.id, position_m)
            reach &= situation.in_reach(sensor.id, end_m, self.interval_s)
            sensor_m = sensor.orbit.position_ecef_m(np.array([end_s]))[0]
            models = {
                int(tracks.track[row]): self._model(sensor, sensor_m, end_m[row])
                for row in np.flatnonzero(reach)
            }
            if models:
                field = NarrowFieldSensor(number=number, models=models)
                field.timestamp = time
                yield field

    def _model(self, sensor: Sensor, sensor_m: FloatArray, target_m: FloatArray) -> SightModel:
        """Return the measurement model of the mean of a sensor's looks at a target."""
        chance = float(np.mean([*sensor.detection_probability.values()] or [1.0]))
        looks = max(chance * self.interval_s / (sensor.scan.period_ns * 1e-9), 1.0)
        sigma_rad = max(sensor.line_of_sight_sigma_rad, _FINEST_RAD)
        variance = sigma_rad**2 / looks + sensor.line_of_sight_bias_sigma_rad**2
        return SightModel(
            ndim_state=6,
            mapping=(0, 1, 2),
            noise_covar=np.diag([variance, variance]),
            translation_offset=StateVector(sensor_m),
            # Along the line of sight, where both angles have the same scale.
            axes=sensor_axes(sensor_m - target_m),
        )


def _launches(tracks: Tracks, least_probability: float) -> Tracks:
    """Return the rows of tracks with a state and its covariance that may be launches."""
    is_known = np.isfinite(tracks.state).all(axis=1)
    is_known &= np.isfinite(tracks.state_covariance).all(axis=(1, 2)) & (tracks.end == 0)
    return tracks.take(np.flatnonzero(is_known & ~(tracks.probability_launch < least_probability)))


def stone_soup_director(
    config: StoneSoupDirectorConfig, context: DirectorContext
) -> StoneSoupDirector:
    """Return the director `stonesoup`."""
    return StoneSoupDirector(config, context)
