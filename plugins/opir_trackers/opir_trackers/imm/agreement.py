"""How often each sensor sees what at least two others see."""

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import SlicePrediction
from opir_trackers.imm.state import TrackerState
from opir_trackers.parts import Association

#: Two sensors agree; a third one may contradict them.
FEWEST_SENSORS = 3

#: Sine of the least elevation, 5°, of a sensor that surely sees a target.
LEAST_SINE = 0.087


def with_agreement(
    models: TrackingModels,
    state: TrackerState,
    prediction: SlicePrediction,
    association: Association,
) -> TrackerState:
    """Return the state with the sums of `Agreement` after a slice's lines."""
    sensors = len(models.period_s)
    if sensors < FEWEST_SENSORS:
        return state
    registration = state.registration
    looks, total = _looks(len(state.table), sensors, prediction, association)
    chance = _look_chances(models, state, prediction)
    agreement = registration.agreement.after(looks, total, state.table.seen, chance)
    return state._replace(registration=evolve(registration, agreement=agreement))


def _looks(
    tracks: int, sensors: int, prediction: SlicePrediction, association: Association
) -> tuple[FloatArray, FloatArray]:
    """Return the numbers of looks of sensors on each track (tracks, sensors), and of all (sensors,)."""
    sensor = prediction.lines.sensor
    owned = (association.owner >= 0).nonzero()[0]
    looks = np.zeros((tracks, sensors))
    np.add.at(looks, (association.owner[owned], sensor[owned]), 1.0)
    return looks, np.bincount(sensor, minlength=sensors).astype(np.float64)


def _look_chances(
    models: TrackingModels, state: TrackerState, prediction: SlicePrediction
) -> FloatArray:
    """Return the probabilities (n, sensors) of a look on each track in a slice, 0 out of view."""
    sensors = models.biases.sensors
    when_s = np.array([prediction.end_s])
    rate = models.association.detection_probability / models.period_s
    watches = [bool(sensor.is_watching(when_s)[0]) for sensor in sensors]
    chance = np.where(watches, -np.expm1(-rate * prediction.span_s), 0.0)
    burns = state.table.estimates.weight[:, :1] > 0.5
    return np.where(burns & _are_in_view(models, state, prediction.end_s), chance, 0.0)


def _are_in_view(models: TrackingModels, state: TrackerState, time_s: float) -> BoolArray:
    """Return which tracks are surely in view of which sensors, (n, sensors)."""
    sensors = models.biases.sensors
    place = state.table.estimates.likelier_position_m
    origin, *_ = models.biases.geometry(time_s, state.table.seen)
    line = _units(origin - place[:, None])
    sine = np.sum(line * _units(place)[:, None], axis=2)
    off_nadir = np.sum(line * _units(origin), axis=2)
    least = [max(float(np.sin(sensor.minimum_elevation_rad)), LEAST_SINE) for sensor in sensors]
    field = np.cos([sensor.field_of_regard_half_angle_rad for sensor in sensors])
    in_view: BoolArray = (sine > least) & (off_nadir > field)
    return in_view


def _units(vectors: FloatArray) -> FloatArray:
    """Return unit vectors (..., 3) along others."""
    length = np.sqrt(np.sum(vectors * vectors, axis=-1))
    return vectors / length[..., None]
