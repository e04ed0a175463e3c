"""What the stereo filter tells of its tracks at a tick."""

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight.forces import Forces
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import Tracks
from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES, UNKNOWN_TYPE
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.ground_points import impacts
from opir_trackers.stereo.track_management import TrackTable


def estimates(
    state: FloatArray,
    covariance: FloatArray,
    is_free: BoolArray,
    roster: TrackTable,
    time_s: float,
    forces: Forces,
    types: FloatArray,
) -> Tracks:
    """Return the tracks of means (n, 6) and covariances (n, 6, 6) of inertial states at a time; nan for the unknown.

    An impact is told of the tracks `is_free` (n,), and `types` are those of the tracks' types.
    """
    count = len(state)
    impact, burnout = _unknown(count, 6, 3), _unknown(count, 8, 7)
    if np.count_nonzero(is_free):
        free = np.flatnonzero(is_free)
        impact[free, 0], impact[free, 1:4] = impacts(state[free], covariance[free], time_s, forces)
    state, covariance = earth_fixed(state, covariance, time_s)
    return Tracks(
        tick_s=np.array([time_s] * count),
        track=roster.number,
        state=state,
        state_covariance=covariance,
        launch=roster.launch,
        launch_covariance=roster.launch_covariance,
        impact=impact[:, 0],
        impact_covariance=impact[:, 1:4],
        impact_sigmas=impact[:, 4],
        state_sigmas=impact[:, 5],
        type_probability=types,
        burnout=burnout[:, 7],
        burnout_covariance=burnout[:, :7],
    )


def _unknown(*shape: int) -> FloatArray:
    nothing = np.empty(shape)
    nothing.fill(np.nan)
    return nothing


#: A target that has been dark for longer will not light another stage, s.
STAGED_S = 4.0


def free_flights(filter_: ImmFilter, bank: ModeEstimates) -> BoolArray:
    """Return which tracks (n,) are taken for free flights, of which an impact is told.

    They more likely coast than burn, for where a burning target comes down depends on when its burn ends; and, where
    silence is what tells the end, they have been dark for longer than stages are.
    """
    time_since_last_s = bank.pace[:, 2] if filter_.switches and filter_.cold_chance < 1.0 else np.inf
    return np.asarray((bank.weight[:, 1] > 0.5) & (time_since_last_s > STAGED_S))


def evidence_of(sensors: Sequence[Sensor]) -> FloatArray:
    """Return log P(reported | true), (sensors, reported types + 1, true types), from each sensor's confusion.

    The last reported type stands for none. A sensor without a confusion matrix says nothing.
    """
    table = np.zeros((len(sensors), len(REPORTED_TYPES) + 1, len(TARGET_TYPES)))
    for number, sensor in enumerate(sensors):
        for column, true in enumerate(TARGET_TYPES):
            for row, reported in enumerate(REPORTED_TYPES):
                if true in sensor.confusion:
                    chance = sensor.confusion[true].get(reported, 0.0)
                    table[number, row, column] = np.log(max(chance, _LEAST_CHANCE))
    return table


def type_posterior(reports: IntArray, evidence: FloatArray) -> FloatArray:
    """Return probabilities (n, types) over `REPORTED_TYPES` from the last report of each sensor, (n, sensors).

    Every type is as likely as the others beforehand. A sensor's reports of one launch are one draw, so each sensor
    counts once. UNKNOWN is certain where no sensor has said anything, and impossible otherwise.
    """
    log = evidence[np.arange(len(evidence)), reports].sum(axis=1)
    share = np.exp(log - log.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    silent = np.all((reports < 0) | (reports == UNKNOWN_TYPE), axis=1)[:, None]
    return np.concatenate([np.where(silent, 0.0, share), silent], axis=1)


#: A report that a confusion matrix rules out still has this chance.
_LEAST_CHANCE = 1e-6


def earth_fixed(state: FloatArray, covariance: FloatArray, time_s: float) -> tuple[FloatArray, FloatArray]:
    """Return inertial states (n, 6) and covariances (n, 6, 6) in ECEF, the velocity relative to the turning Earth."""
    sine, cosine = sin(EARTH_ROTATION_RAD_S * time_s), cos(EARTH_ROTATION_RAD_S * time_s)
    fast, slow = EARTH_ROTATION_RAD_S * cosine, EARTH_ROTATION_RAD_S * sine
    change = np.array(
        (
            *(cosine, sine, 0.0, 0.0, 0.0, 0.0),
            *(-sine, cosine, 0.0, 0.0, 0.0, 0.0),
            *(0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            *(-slow, fast, 0.0, cosine, sine, 0.0),
            *(-fast, -slow, 0.0, -sine, cosine, 0.0),
            *(0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        )
    ).reshape(6, 6)
    moved = change @ covariance @ change.T
    return state @ change.T, 0.5 * (moved + moved.transpose(0, 2, 1))
