"""Where and when tracks were launched: their paths, followed back, must have left the ground from rest.

A path's speed there is small and its height flat, so that where it crosses the ground says little of when it left. That
it left from rest, on ground near the ellipsoid, and was not seen before, says more: the time of the launch is weighed
over all times before the first look that saw it, and the place follows for each.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.estimation.motion import weights_at
from opir_core.flight.ellipsoidal_height import height_and_up
from opir_core.geometry.ellipsoid import WGS84
from opir_trackers.ground_points import GroundPoints
from opir_trackers.predicted_measurements import PredictedMeasurements

#: A launch is sought so long before the first look that saw it, s, at so many times, denser towards that look. The
#: class profiles reach 10 km after 34 to 51 s, and 20 km, the highest top of a cloud, after 49 to 73 s.
_BEFORE_S, _TIMES = 80.0, 80

#: So many launches are seen from the ground on, as soon as a look comes; clouds hide the others for a time.
_AT_ONCE = 0.5

#: Sites lie this near the ellipsoid, m, and targets leave them this near to rest, m/s: standard deviations.
_SITE_M, _REST_M_S = 100.0, 1.0

#: A start from rest that no time explains better than this squared distance (4 degrees of freedom) did not happen.
_LAUNCHED = 25.0

#: The times before the first look stand for the stretches between these edges, s.
_EDGES_S = _BEFORE_S * np.linspace(0.0, 1.0, _TIMES + 1) ** 2
_MIDDLES_S, _WIDTHS_S = 0.5 * (_EDGES_S[1:] + _EDGES_S[:-1]), np.diff(_EDGES_S)

#: The chance beforehand that a launch was seen late, and lies in each of them.
_LATER = (1.0 - _AT_ONCE) * _WIDTHS_S / _BEFORE_S

#: The variances of the height of a site, m², and of the velocity of what stands there, m²/s².
_AT_REST = np.square([_SITE_M, _REST_M_S, _REST_M_S, _REST_M_S])


#: The places below the diagonal.
_BELOW = np.tril_indices(3, -1)


def launches(
    outlook: PredictedMeasurements,
    first_s: FloatArray,
    pause_s: FloatArray,
    noise: float,
    biased: FloatArray | None = None,
) -> GroundPoints:
    """Return where boosts began, from rest on the ground at an unknown time before `first_s` (n,); nan for nowhere.

    `noise` is the intensity of the noise in the rate of the specific force, m/s³/√s. Beforehand a launch was as likely
    as not seen at once, after an exponential time of mean `pause_s` (n,); if not, then after any time up to 80 s. Mean
    and covariance are those of the mixture over times. `biased` (n, 3, 3) is what sensors' biases add to the covariance
    of the position, all along the path.
    """
    count = len(outlook.side)
    if not count:
        return GroundPoints.nowhere(0)
    when = (first_s[:, None] - _MIDDLES_S).ravel()
    starts = _from_rest(outlook, when, noise, biased)
    soon = -np.diff(np.exp(-_EDGES_S / pause_s[:, None]), axis=1)
    log = (starts.log - 0.5 * starts.misfit).reshape(count, _TIMES)
    log += np.log(_AT_ONCE * soon + _LATER)
    chance = np.exp(log - log.max(axis=1, keepdims=True))
    chance /= chance.sum(axis=1, keepdims=True)
    place, covariance = _blended(*_places(starts, when), when, chance)
    covariance[:, 2, 2] += chance @ (_WIDTHS_S**2 / 12.0)
    row, column = _BELOW
    covariance[:, row, column] = covariance[:, column, row]
    nowhere = starts.misfit.reshape(count, _TIMES).min(axis=1) >= _LAUNCHED
    if np.count_nonzero(nowhere):
        place[nowhere], covariance[nowhere] = np.nan, np.nan
    return GroundPoints(place, covariance)


class _Starts(NamedTuple):
    """Paths at times (m,): place (3, m) and its covariance (3, 3, m), inertial, and what a start from rest says of it.

    That is whitened, `white` (4, 4, m): the first three columns are of the place, the last is what is off; `misfit`
    (m,) is the squared distance of a start from rest, `log` (m,) that of its density.
    """

    place: FloatArray
    covariance: FloatArray
    white: FloatArray
    misfit: FloatArray
    log: FloatArray


def _from_rest(outlook: PredictedMeasurements, when: FloatArray, noise: float, biased: FloatArray | None) -> _Starts:
    """Return what starts from rest at times (m,), as many of each track in turn, say."""
    count = len(outlook.side)
    weight = weights_at(when - outlook.time_s).T.reshape(5, count, -1).transpose(1, 0, 2)
    path = outlook.derivative.transpose(0, 2, 1)
    place, velocity = _rows(path @ weight), _rows(path[:, :, 1:] @ weight[:, :4])
    covariance = _covariances(outlook, weight)
    _add_noise(covariance, noise * noise, outlook.time_s - when)
    if biased is not None:
        covariance[:3, :3] += np.repeat(biased.transpose(1, 2, 0), _TIMES, axis=2)
    height, up = height_and_up(place, 1.0 / np.sqrt(np.add.reduce(place * place)))
    state = np.concatenate([place, velocity])[:, None]
    crossed = _gained(covariance, up)
    told = np.concatenate([_gained(crossed.transpose(1, 0, 2), up), crossed[:, :3], _gained(state, up)], axis=1)
    told[0, -1] = height
    log = _whitened(told)
    white = told[:, 4:]
    return _Starts(place, covariance[:3, :3], white, np.add.reduce(white[:, 3] * white[:, 3]), log)


def _whitened(rows: FloatArray) -> FloatArray:
    """Make of rows [S | B] (4, 4 + c, m) L⁻¹ B, with L Lᵀ = S + the covariance at rest, and return -log det L (m,).

    In place; what is left of S is of no use. No pivot is less than one of those at rest alone.
    """
    log = np.zeros(rows.shape[2])
    for k, at_rest in enumerate(_AT_REST.tolist()):
        pivot = np.sqrt(np.maximum(rows[k, k] + at_rest, _LEAST_PIVOT))
        log -= np.log(pivot)
        rows[k, k + 1 :] /= pivot
        rows[k + 1 :, k + 1 :] -= rows[k, k + 1 : 4, None] * rows[k, None, k + 1 :]
    return log


_LEAST_PIVOT = _REST_M_S**2


def _places(starts: _Starts, when: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ECEF places (3, m) and covariances (3, 3, m) of starts from rest."""
    white, off = starts.white[:, :3], starts.white[:, 3]
    place = starts.place - np.add.reduce(white * off[:, None])
    left = starts.covariance - np.add.reduce(white[:, :, None] * white[:, None])
    angle = EARTH_ROTATION_RAD_S * when
    sine, cosine = np.sin(angle), np.cos(angle)
    return _turned(place, sine, cosine), _turned(_turned(left, sine, cosine).swapaxes(0, 1), sine, cosine)


def _turned(rows: FloatArray, sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """Return rows x, y, z (3, ..., m) turned backwards about z."""
    turned = rows.copy()
    turned[0] = cosine * rows[0] + sine * rows[1]
    turned[1] = cosine * rows[1] - sine * rows[0]
    return turned


def _gained(rows: FloatArray, up: FloatArray) -> FloatArray:
    """Return what heights and velocities over the ground gain, (4, c, m), by rows (6, c, m) of states; `up` (3, m)."""
    gained = np.empty((4, *rows.shape[1:]))
    gained[0] = up[0] * rows[0] + up[1] * rows[1] + up[2] * rows[2]
    gained[1:] = rows[3:]
    gained[1] += EARTH_ROTATION_RAD_S * rows[1]
    gained[2] -= EARTH_ROTATION_RAD_S * rows[0]
    return gained


def _rows(each: FloatArray) -> FloatArray:
    """Return rows (c, m) of what is known of each track in turn (n, c, t)."""
    return np.ascontiguousarray(each.transpose(1, 0, 2)).reshape(each.shape[1], -1)


def _covariances(outlook: PredictedMeasurements, weight: FloatArray) -> FloatArray:
    """Return the covariances (6, 6, m) of position and velocity at times of weights (n, 5, t).

    Each is a sum of products of two weights; rounding is of the largest one's size.
    """
    count, _, times = weight.shape
    share = np.zeros((count, 4, 2, times))
    share[:, :, 0], share[:, 1:, 1] = weight[:, :4], weight[:, :3]
    both = share[:, :, None, :, None] * share[:, None, :, None]
    known = (outlook.side @ outlook.side.transpose(0, 2, 1)).reshape(count, 4, 3, 4, 3).transpose(0, 2, 4, 1, 3)
    sums = known.reshape(count, 9, 16) @ both.reshape(count, 16, 4 * times)
    # Tracks, two axes of space, position or velocity twice, times.
    parts = sums.reshape(count, 3, 3, 2, 2, times).transpose(3, 1, 4, 2, 0, 5)
    return np.ascontiguousarray(parts).reshape(6, 6, count * times)


def _add_noise(covariance: FloatArray, intensity: float, span_s: FloatArray) -> None:
    """Add to covariances (6, 6, m) what noise of the rate of the specific force gathers in spans (m,)."""
    square = span_s * span_s
    fast = (intensity / 20.0) * square * square * span_s
    both = span_s * fast * (-20.0 / 72.0)
    far = square * fast * (20.0 / 252.0)
    for axis in range(3):
        covariance[axis, axis] += far
        covariance[axis, axis + 3] += both
        covariance[axis + 3, axis] += both
        covariance[axis + 3, axis + 3] += fast


def _blended(
    place: FloatArray, covariance: FloatArray, when: FloatArray, chance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return latitude_rad, longitude_rad and time (n, 3) and covariances (n, 3, 3) of mixtures over times."""
    count, times = chance.shape
    each = np.concatenate([place, when[None]]).reshape(4, count, times).transpose(1, 0, 2)
    weighed = chance[:, :, None]
    mean = each @ weighed
    apart = each - mean
    total = (chance[:, None] * apart) @ apart.transpose(0, 2, 1)
    spreads = covariance.reshape(9, count, times).transpose(1, 0, 2)
    total[:, :3, :3] += (spreads @ weighed).reshape(count, 3, 3)
    told, level = _on_ground(mean[:, :3, 0])
    told[:, 2] = mean[:, 3, 0]
    flat = np.zeros((count, 3, 4))
    flat[:, :2, :3], flat[:, 2, 3] = level, 1.0
    return told, flat @ total @ flat.transpose(0, 2, 1)


def _on_ground(place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes, rad, beside a third column, and axes east and north (n, 2, 3) at places (n, 3).

    One step of Bowring's formula (Survey Review 23, 1976): to 2e-13 rad within 10 km of the ellipsoid.
    """
    x, y, z = place.T
    a, b, e2 = WGS84.equatorial_radius_m, WGS84.polar_radius_m, WGS84.eccentricity_squared
    out = np.maximum(np.hypot(x, y), 1e-3)
    length = np.hypot(a * z, b * out)
    sine, cosine = a * z / length, b * out / length
    rise, run = z + e2 / (1.0 - e2) * b * sine**3, out - e2 * a * cosine**3
    length = np.hypot(rise, run)
    sine, cosine, ahead, aside = rise / length, run / length, x / out, y / out
    told, level = np.empty((len(place), 3)), np.empty((len(place), 2, 3))
    told[:, 0], told[:, 1] = np.arctan2(rise, run), np.arctan2(y, x)
    level[:, 0, 0], level[:, 0, 1], level[:, 0, 2] = -aside, ahead, 0.0
    level[:, 1, 0], level[:, 1, 1], level[:, 1, 2] = -sine * ahead, -sine * aside, cosine
    return told, level
