"""What the lines of sight of a slice say of the sensors' shared errors, whatever their targets do.

Of each target that several sensors see in a slice, the mean residuals of the sensors determine its
position and, beyond it, how far the rays miss each other: two residuals a sensor less three
coordinates, which for two sensors is the misfit of the epipolar planes. The position is eliminated
with no prior to speak of, so neither the target's motion nor the errors of its track enter, each
look counts once, and slices are independent but for the errors themselves.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import matvec
from opir_trackers.gating import GatedPairs
from opir_trackers.registration.shared_errors import ERRORS, Vantages

#: Prior standard deviation of a position about its prediction, m: none to speak of.
_ANYWHERE_M = 1e6

#: Squared distance from the median of a sensor's residuals, in variances, beyond which a look
#: counts as an outlier: two degrees of freedom exceed it with a probability of 10⁻³, as for tracks.
_IMPROBABLE = 13.8


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
    count = len(key)
    residual = assigned.measured
    middle = np.stack([_medians(group, count, residual[:, axis]) for axis in (0, 1)], axis=1)
    apart = residual - middle[group]
    good = np.flatnonzero(
        np.sum(apart * apart, axis=1) <= _IMPROBABLE * np.square(assigned.sigma_rad)
    )
    # The median of each axis may be another look's, so that no look is near both.
    some, whose = np.unique(group[good], return_inverse=True)
    mean = _means(whose, len(some), np.column_stack([residual, assigned.time_s])[good])
    looks = np.bincount(whose, minlength=len(some)).astype(np.float64)
    look_rad = np.sqrt(_means(whose, len(some), np.square(assigned.sigma_rad[good])[:, None])[:, 0])
    scatter, degrees = _scatter(
        whose, looks, residual[good] - mean[whose, :2], assigned.time_s[good] - mean[whose, 2]
    )
    return MeanResiduals(
        key[some] // sensors,
        key[some] % sensors,
        mean[:, 2],
        assigned.axes[good[np.unique(whose, return_index=True)[1]], :2],
        mean[:, :2],
        look_rad * look_rad / looks,
        look_rad,
        scatter,
        degrees,
    )


def _means(group: IntArray, count: int, values: FloatArray) -> FloatArray:
    """Return the means (count, p) of values (m, p) by group."""
    looks = np.bincount(group, minlength=count)
    return np.stack([np.bincount(group, column, count) / looks for column in values.T], axis=1)


def _scatter(
    group: IntArray, looks: FloatArray, residual: FloatArray, since_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the sums (k,) of squared deviations of residuals (m, 2) from lines over time, and
    degrees of freedom.

    Both are about the means of their groups. What is not known of a velocity shows as a slope,
    which is no noise.
    """
    count = len(looks)
    long = np.bincount(group, since_s * since_s, count)
    total = np.bincount(group, np.sum(residual * residual, axis=1), count)
    pulled = np.stack(
        [np.bincount(group, since_s * residual[:, axis], count) for axis in (0, 1)], axis=1
    )
    sloped = np.divide(np.sum(pulled * pulled, axis=1), long, out=np.zeros(count), where=long > 0.0)
    enough = looks > 2.0
    return np.where(enough, total - sloped, 0.0), np.where(enough, 2.0 * looks - 4.0, 0.0)


def _medians(group: IntArray, count: int, values: FloatArray) -> FloatArray:
    """Return the lower medians (count,) of values (m,) by group."""
    order = np.lexsort((values, group))
    size = np.bincount(group, minlength=count)
    return np.asarray(values[order[np.cumsum(size) - size + (size - 1) // 2]])


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
    seen = np.bincount(means.track, minlength=len(position_m)).astype(np.float64)
    rows = np.flatnonzero(seen >= 2.0)
    place = np.full(len(position_m), -1)
    place[rows] = np.arange(len(rows))
    mine = np.flatnonzero(place[means.track] >= 0)
    track = means.track[mine]
    sensor = means.sensor[mine]
    apart = position_m[track] - vantages.origin_m[sensor]
    range_m = np.sqrt(np.sum(apart * apart, axis=1))
    slope = means.axes[mine] / range_m[:, None, None]
    middle_s = np.bincount(track, means.time_s[mine], len(position_m)) / np.maximum(seen, 1.0)
    moved = speed_m_s[track] * (means.time_s[mine] - middle_s[track]) / range_m
    sharp = 1.0 / np.sqrt(means.variance[mine] + moved * moved)
    stack = np.zeros((len(rows), sensors, 2, 3 + ERRORS * sensors + 1))
    at = place[track], sensor
    stack[*at, :, :3] = slope
    own = vantages.displacements(position_m[rows], velocity_m_s[rows])[at]
    columns = 3 + ERRORS * sensor[:, None] + np.arange(ERRORS)
    stack[at[0][:, None], at[1][:, None], :, columns] = (slope @ own).transpose(0, 2, 1)
    stack[*at, :, -1] = means.residual[mine]
    stack[at] *= sharp[:, None, None]
    return _without_position(
        rows, stack.reshape(len(rows), 2 * sensors, stack.shape[-1]), seen[rows] * 2.0 - 3.0
    )


def _without_position(track: IntArray, stack: FloatArray, degrees: FloatArray) -> Misfits:
    """Return the information of whitened rows (k, 2 s, 3 + q + 1) of position, errors and
    residuals, position free.
    """
    gram = stack.transpose(0, 2, 1) @ stack
    inner = gram[:, :3, :3] + np.eye(3) / _ANYWHERE_M**2
    left = gram[:, 3:, 3:] - gram[:, 3:, :3] @ np.linalg.solve(inner, gram[:, :3, 3:])
    return Misfits(track, left[:, :-1, :-1], left[:, :-1, -1], left[:, -1, -1], degrees)
