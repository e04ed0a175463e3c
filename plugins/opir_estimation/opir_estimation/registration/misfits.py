"""Information on the sensors' shared errors from the lines of sight of a slice, whatever their
targets do.

Of each target that several sensors see in a slice, the mean residuals of the sensors determine its
position and, beyond it, how far the rays miss each other: two residuals a sensor less three
coordinates, which for two sensors is the misfit of the epipolar planes. The position is eliminated
with practically no prior, so neither the target's motion nor the errors of its track enter, each
look counts once, and slices are independent but for the errors themselves.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_estimation.directions import matvec
from opir_estimation.gating import GatedPairs
from opir_estimation.law_files import law_parameters
from opir_estimation.registration.shared_errors import ERRORS, Vantages

LAW = law_parameters("opir_estimation.registration", "registration")


class MeanResiduals(NamedTuple):
    """Mean residuals (k, 2), rad, of rows `track` and `sensor` (k,), in the tangent planes of
    `axes` (k, 2, 3).

    `variance` (k,) is that of each of the two, `look_rad` (k,) the error of a look, `time_s` (k,)
    the mean time; `scatter_rad2` (k,) is the sum of squared deviations of the looks from a line
    over time, with `degrees` (k,) of freedom.
    """

    track: IntArray
    sensor: IntArray
    time_s: FloatArray
    axes: FloatArray
    residual: FloatArray
    variance: FloatArray
    look_rad: FloatArray
    scatter_rad2: FloatArray
    degrees: FloatArray


def mean_residuals(assigned: GatedPairs, sensor: IntArray, sensors: int) -> MeanResiduals:
    """Return the means of assigned pairs (m,) by track and `sensor` (m,), of a number of sensors,
    without outliers.
    """
    key, group = np.unique(assigned.track * sensors + sensor, return_inverse=True)
    plausible = _without_outliers(assigned, group, len(key))
    # The median of each axis may be another look's, so that no look is near both.
    groups, first_row, group = np.unique(group[plausible], return_index=True, return_inverse=True)
    residual = assigned.measured[plausible]
    time_s = assigned.time_s[plausible]
    variance = np.square(assigned.sigma_rad[plausible])
    mean = _means(group, len(groups), np.column_stack([residual, time_s, variance]))
    looks = np.bincount(group, minlength=len(groups)).astype(np.float64)
    look_rad = np.sqrt(mean[:, 3])
    scatter, degrees = _scatter(group, looks, residual - mean[group, :2], time_s - mean[group, 2])
    return MeanResiduals(
        key[groups] // sensors,
        key[groups] % sensors,
        mean[:, 2],
        assigned.axes[plausible[first_row], :2],
        mean[:, :2],
        look_rad * look_rad / looks,
        look_rad,
        scatter,
        degrees,
    )


def _without_outliers(assigned: GatedPairs, group: IntArray, count: int) -> IntArray:
    """Return the rows of pairs (m,) that are near the median residual of their groups."""
    middle = [_medians(group, count, column) for column in assigned.measured.T]
    distance = np.sum((assigned.measured - np.stack(middle, axis=1)[group]) ** 2, axis=1)
    return np.flatnonzero(distance <= LAW.gate * np.square(assigned.sigma_rad))


def _means(group: IntArray, count: int, values: FloatArray) -> FloatArray:
    """Return the means (count, p) of values (m, p) by group."""
    looks = np.bincount(group, minlength=count)
    return np.stack([np.bincount(group, column, count) / looks for column in values.T], axis=1)


def _scatter(
    group: IntArray, looks: FloatArray, residual: FloatArray, since_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the sums (k,) of squared deviations of residuals (m, 2) from lines over time, and
    degrees of freedom.

    Both are about the means of their groups. The error of a velocity shows as a slope, which is not
    noise.
    """
    count = len(looks)
    spread = np.bincount(group, since_s * since_s, count)
    total = np.bincount(group, np.sum(residual * residual, axis=1), count)
    slopes = [np.bincount(group, since_s * column, count) for column in residual.T]
    slope = np.sum(np.square(np.stack(slopes, axis=1)), axis=1)
    sloped = np.divide(slope, spread, out=np.zeros(count), where=spread > 0.0)
    is_enough = looks > 2.0
    return np.where(is_enough, total - sloped, 0.0), np.where(is_enough, 2.0 * looks - 4.0, 0.0)


def _medians(group: IntArray, count: int, values: FloatArray) -> FloatArray:
    """Return the lower medians (count,) of values (m,) by group."""
    order = np.lexsort((values, group))
    size = np.bincount(group, minlength=count)
    return values[order[np.cumsum(size) - size + (size - 1) // 2]]


class Misfits(NamedTuple):
    """The information of targets (k,) on all sensors' errors: matrix (k, q, q), vector (k, q) and
    square (k,).

    Minus twice the log likelihood of errors e (q,) is square - 2 vector · e + e · matrix e, of
    `degrees` (k,) of freedom. `track` (k,) is the row of each target.
    """

    track: IntArray
    matrix: FloatArray
    vector: FloatArray
    square: FloatArray
    degrees: FloatArray

    def about(self, error: FloatArray) -> "Misfits":
        """Return the information on errors of which `error` (q,) were taken off the lines
        before.
        """
        turned = matvec(self.matrix, np.broadcast_to(error, self.vector.shape))
        square = self.square + (2.0 * self.vector + turned) @ error
        return self._replace(vector=self.vector + turned, square=square)


def misfits(
    means: MeanResiduals,
    position_m: FloatArray,
    velocity_m_s: FloatArray,
    speed_m_s: FloatArray,
    vantages: Vantages,
) -> Misfits:
    """Return the information of mean residuals about predictions of tracks (n,).

    `position_m` and `velocity_m_s` (n, 3) are inertial, `speed_m_s` (n,) is the standard deviation
    of the velocity, which counts where the sensors looked at different times.
    """
    sensors = len(vantages.origin_m)
    looks = np.bincount(means.track, minlength=len(position_m)).astype(np.float64)
    rows = np.flatnonzero(looks >= 2.0)
    shared = np.flatnonzero(looks[means.track] >= 2.0)
    track = means.track[shared]
    sensor = means.sensor[shared]
    time_s = means.time_s[shared]
    line = position_m[track] - vantages.origin_m[sensor]
    range_m = np.sqrt(np.sum(line * line, axis=1))
    slope = means.axes[shared] / range_m[:, None, None]
    middle_s = np.bincount(track, time_s, len(position_m)) / np.maximum(looks, 1.0)
    moved = speed_m_s[track] * (time_s - middle_s[track]) / range_m
    weight = 1.0 / np.sqrt(means.variance[shared] + moved * moved)
    row = np.searchsorted(rows, track)
    shift = vantages.displacements(position_m[rows], velocity_m_s[rows])[row, sensor]
    stack = np.zeros((len(rows), sensors, 2, 3 + ERRORS * sensors + 1))
    looked = _look_rows(slope, slope @ shift, means.residual[shared], sensor, stack.shape[-1])
    stack[row, sensor] = looked * weight[:, None, None]
    whitened = stack.reshape(len(rows), 2 * sensors, stack.shape[-1])
    return _without_position(rows, whitened, looks[rows] * 2.0 - 3.0)


def _look_rows(
    slope: FloatArray, shift: FloatArray, residual: FloatArray, sensor: IntArray, width: int
) -> FloatArray:
    """Return rows (m, 2, width) of mean residuals (m, 2): their slopes by position and by the
    errors of their sensors (m, 2, 3), and themselves.
    """
    rows = np.zeros((len(sensor), 2, width))
    rows[:, :, :3] = slope
    columns = 3 + ERRORS * sensor[:, None] + np.arange(ERRORS)
    rows[np.arange(len(sensor))[:, None], :, columns] = shift.mT
    rows[:, :, -1] = residual
    return rows


def _without_position(track: IntArray, stack: FloatArray, degrees: FloatArray) -> Misfits:
    """Return the information of whitened rows (k, 2 s, 3 + q + 1) of position, errors and
    residuals, position free.
    """
    gram = stack.mT @ stack
    inner = gram[:, :3, :3] + np.eye(3) / LAW.position_sigma_m**2
    errors = gram[:, 3:, 3:] - gram[:, 3:, :3] @ np.linalg.solve(inner, gram[:, :3, 3:])
    return Misfits(track, errors[:, :-1, :-1], errors[:, :-1, -1], errors[:, -1, -1], degrees)
