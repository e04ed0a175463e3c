"""Neighbours: tracks so close in a sensor's view that the lines of sight of one may be those of the other.

Within the gate of the repeated association a line may be either's, and a mistaken one is not told from a right one: the
filter's covariance, which takes its lines for its own, is too small. So each sensor's lines of a track are taken to be
those of the track or of any of its neighbours there, with equal probabilities: an error of the direction and of its
rate, whose second moment is the mean of the separations. Lines that were mistaken once go on to be, so the error does
not average out; it is carried to the state as a bias of the sensor is.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import COAST, square_root
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.sensors import Biases, shifts_of_positions


def with_neighbours(
    estimates: ModeEstimates, state: FloatArray, time_s: float, seen: BoolArray, sensors: Biases, gate: float
) -> ModeEstimates:
    """Return the estimates with covariances that allow for the lines of neighbours.

    `state` (n, 6) are the means of inertial positions and velocities, `seen` (n, sensors) marks the sensors that see
    each track, and `gate` is the distance of neighbours, in standard deviations of one look.
    """
    added = np.zeros((len(state), COAST, COAST))
    if len(state) > 1:
        _add_separations(added, state, time_s, seen, sensors, gate)
    rows = np.flatnonzero(added.any(axis=(1, 2)))
    if not len(rows):
        return estimates
    part, wider = estimates.take(rows), added[rows]
    return estimates.put(
        rows,
        ModeEstimates(
            part.weight,
            part.boost_mean,
            _widened(part.boost_root, wider),
            part.coast_mean,
            _widened(part.coast_root, wider),
            part.detection_rate,
        ),
    )


def _add_separations(
    added: FloatArray, state: FloatArray, time_s: float, seen: BoolArray, sensors: Biases, gate: float
) -> None:
    """Add to covariances (n, 6, 6) what neighbours' lines may do to positions and velocities."""
    origin_m, _, weight = sensors.geometry(time_s, seen)
    shift = shifts_of_positions(state[:, :3], origin_m, seen, weight)
    for number, sensor in enumerate(sensors.sensors):
        track, other = _neighbours(
            state[:, :3] - origin_m[number], seen[:, number], gate * sensor.line_of_sight_sigma_rad
        )
        if not len(track):
            continue
        apart = (state[other] - state[track]).reshape(-1, 2, 3)
        moved = (shift[track, number] @ apart.transpose(0, 2, 1)).transpose(0, 2, 1).reshape(-1, COAST)
        # The track itself is one of those whose lines they may be.
        share = 1.0 / (1.0 + np.bincount(track, minlength=len(state)))
        np.add.at(added, track, share[track, None, None] * moved[:, :, None] * moved[:, None, :])


def _neighbours(apart: FloatArray, is_seen: BoolArray, reach_rad: float) -> tuple[IntArray, IntArray]:
    """Return tracks and neighbours, both ways: of tracks (n, 3) from a sensor, in directions nearer than a reach."""
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(is_seen)
    direction = apart[rows] / np.sqrt(np.sum(apart[rows] * apart[rows], axis=1))[:, None]
    pairs = cKDTree(direction).query_pairs(reach_rad, output_type="ndarray") if len(rows) > 1 else np.empty((0, 2), int)
    one, other = rows[pairs].T
    return np.concatenate([one, other]), np.concatenate([other, one])


def _widened(root: FloatArray, added: FloatArray) -> FloatArray:
    """Return the information roots (n, d, d) with covariances (n, 6, 6) added to those of position and velocity."""
    value, vector = np.linalg.eigh(added)
    side = np.zeros((*root.shape[:2], COAST))
    side[:, :COAST] = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    return square_root.information_root(np.concatenate([square_root.inverse_root(root), side], axis=2))
