"""Where and when tracks were launched: their paths, followed back, must have left the ground from rest.

A path's speed there is small and its height flat, so that where it crosses the ground says little of when it left. That
it left from rest, on ground near the ellipsoid, and was not seen before, says more: the time of the launch is weighed
over all times before the first look that saw it, and the place follows for each.
"""

from typing import NamedTuple

import numpy as np

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import Geodetic, east_north_up_axes, ecef_to_geodetic
from opir_core.records import FloatArray, IntArray
from opir_core.tracking.filter.motion import BOOST, followed, weights_at
from opir_core.tracking.ground_points import GroundPoints
from opir_core.tracking.outlook import Outlook
from opir_core.tracking.rays import turned

#: A launch is sought so long before the first look that saw it, s, at so many times, denser towards that look. The
#: class profiles reach 10 km after 34 to 51 s, and 20 km, the highest top of a cloud, after 49 to 73 s.
_BEFORE_S, _TIMES = 80.0, 80

#: So many launches are seen from the ground on, as soon as a look comes; clouds hide the others for a time.
_AT_ONCE = 0.5

#: Sites lie this near the ellipsoid, m, and targets leave them this near to rest, m/s: standard deviations.
_SITE_M, _REST_M_S = 100.0, 1.0

#: A start from rest that no time explains better than this squared distance (4 degrees of freedom) did not happen.
_LAUNCHED = 25.0

#: Times less probable than this are left at the Earth's centre: its distance squared times this is below 1e-10 m².
_LEAST_CHANCE = 1e-24

#: The times before the first look stand for the stretches between these edges, s.
_EDGES_S = _BEFORE_S * np.linspace(0.0, 1.0, _TIMES + 1) ** 2
_MIDDLES_S, _WIDTHS_S = 0.5 * (_EDGES_S[1:] + _EDGES_S[:-1]), np.diff(_EDGES_S)

#: The chance beforehand that a launch was seen late, and lies in each of them.
_LATER = (1.0 - _AT_ONCE) * _WIDTHS_S / _BEFORE_S

#: The covariance of the height of a site, m², and of the velocity of what stands there, m²/s².
_AT_REST = np.diag(np.square([_SITE_M, _REST_M_S, _REST_M_S, _REST_M_S]))

_SPIN = EARTH_ROTATION_RAD_S * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def launches(
    outlook: Outlook, first_s: FloatArray, pause_s: FloatArray, noise: float, biased: FloatArray | None = None
) -> GroundPoints:
    """Return where boosts began, from rest on the ground at an unknown time before `first_s` (n,); nan for nowhere.

    `noise` is the intensity of the noise in the rate of the specific force, m/s³/√s. Beforehand a launch was as likely
    as not seen at once, after an exponential time of mean `pause_s` (n,); if not, then after any time up to 80 s. Mean
    and covariance are those of the mixture over times. `biased` (n, 3, 3) is what sensors' biases add to the covariance
    of the position, all along the path.
    """
    points, count = GroundPoints.nowhere(len(outlook.side)), len(outlook.side)
    if not count:
        return points
    track = np.repeat(np.arange(count), _TIMES)
    when = (first_s[:, None] - _MIDDLES_S).ravel()
    starts = _from_rest(outlook, track, when, noise, biased)
    misfit, log = starts.misfit, starts.log
    soon = -np.diff(np.exp(-_EDGES_S / pause_s[:, None]), axis=1)
    log = (log - 0.5 * misfit).reshape(count, _TIMES)
    log += np.log(_AT_ONCE * soon + _LATER)
    chance = np.exp(log - log.max(axis=1, keepdims=True))
    chance /= chance.sum(axis=1, keepdims=True)
    known = np.flatnonzero(misfit.reshape(count, _TIMES).min(axis=1) < _LAUNCHED)
    told = _blended(*_places(starts, when, np.flatnonzero(chance > _LEAST_CHANCE)), when, chance)
    told[1][:, 2, 2] += np.sum(chance * _WIDTHS_S**2, axis=1) / 12.0
    points.place[known], points.covariance[known] = told[0][known], told[1][known]
    return points


def _from_rest(
    outlook: Outlook, track: IntArray, when: FloatArray, noise: float, biased: FloatArray | None
) -> "_Starts":
    """Return what starts from rest at times (m,) say."""
    weight = weights_at(when - outlook.time_s)
    path = outlook.derivative.take(track, axis=0)
    position, velocity = followed(path, weight), _speeds(path, weight)
    ground = ecef_to_geodetic(turned(position, -when))
    up = _up(ground, when)
    covariance = _covariances(outlook, weight, noise * noise, outlook.time_s - when)
    if biased is not None:
        covariance[:, :3, :3] += biased[track]
    off = np.concatenate([ground.height_m[:, None], velocity - position @ _SPIN.T], axis=1)
    crossed = _gained(covariance, up)
    spread = _gained(crossed.transpose(0, 2, 1), up) + _AT_REST
    side = np.linalg.cholesky(spread)
    white = _forward(side, np.concatenate([crossed[:, :, :3], off[:, :, None]], axis=2))
    log = -np.log(np.diagonal(side, axis1=1, axis2=2)).sum(axis=1)
    return _Starts(position, covariance[:, :3, :3], white, np.sum(white[:, :, 3] ** 2, axis=1), log)


class _Starts(NamedTuple):
    """Paths at times (m,): place and its covariance, inertial, what a start from rest says of it, whitened (m, 4, 4).

    The first three columns of `white` are of the place, the last is what is off; `misfit` (m,) is the squared distance
    of a start from rest, `log` (m,) that of its density.
    """

    place: FloatArray
    covariance: FloatArray
    white: FloatArray
    misfit: FloatArray
    log: FloatArray


def _places(starts: _Starts, when: FloatArray, some: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return ECEF places (m, 3) and covariances (m, 3, 3) of some starts; the others are left at the Earth's centre."""
    places, covariances = np.zeros((len(when), 3)), np.zeros((len(when), 3, 3))
    white, turn = starts.white[some], _turns(-when[some])
    place = starts.place[some] - np.sum(white[:, :, :3] * white[:, :, 3:], axis=1)
    left = starts.covariance[some] - white[:, :, :3].transpose(0, 2, 1) @ white[:, :, :3]
    places[some] = turned(place, -when[some])
    covariances[some] = turn @ left @ turn.transpose(0, 2, 1)
    return places, covariances


def _gained(rows: FloatArray, up: FloatArray) -> FloatArray:
    """Return what heights (m, 1) and velocities over the ground (m, 3) gain, (m, 4, c), by rows (m, 6, c) of states."""
    gained = np.empty((len(rows), 4, rows.shape[2]))
    gained[:, 0] = (up[:, None] @ rows[:, :3])[:, 0]
    gained[:, 1:] = rows[:, 3:]
    gained[:, 1] += EARTH_ROTATION_RAD_S * rows[:, 1]
    gained[:, 2] -= EARTH_ROTATION_RAD_S * rows[:, 0]
    return gained


def _forward(side: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (m, k, c) of lower triangular systems (m, k, k), row by row."""
    found = right.copy()
    for row in range(side.shape[1]):
        for known in range(row):
            found[:, row] -= side[:, row, known, None] * found[:, known]
        found[:, row] /= side[:, row, row, None]
    return found


def _speeds(path: FloatArray, weight: FloatArray) -> FloatArray:
    """Return velocities (m, 3) from derivatives (m, 5, 3) of positions and weights of times (m, 5)."""
    velocity = path[:, 1].copy()
    for order in range(2, 5):
        velocity += path[:, order] * weight[:, order - 1, None]
    return velocity


def _up(ground: Geodetic, when: FloatArray) -> FloatArray:
    """Return the inertial directions (m, 3) in which height grows."""
    east = ground.longitude_rad + EARTH_ROTATION_RAD_S * when
    level = np.cos(ground.latitude_rad)
    return np.stack([level * np.cos(east), level * np.sin(east), np.sin(ground.latitude_rad)], axis=1)


def _turns(time_s: FloatArray) -> FloatArray:
    """Return the matrices (m, 3, 3) that turn ECEF vectors into the inertial frame at scene times (m,)."""
    angle = EARTH_ROTATION_RAD_S * time_s
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 2, 2] = np.sin(angle), 1.0
    turn[:, 0, 1] = -turn[:, 1, 0]
    return turn


def _covariances(outlook: Outlook, weight: FloatArray, intensity: float, span_s: FloatArray) -> FloatArray:
    """Return the covariances (m, 6, 6) of position and velocity at earlier times, with the noise gathered since.

    `weight` (m, 5) are those of the times, as many of each track in turn.
    """
    blocks = outlook.side.reshape(-1, 1, 4, 3, BOOST)
    share = weight.reshape(len(blocks), -1, 5, 1, 1)
    side = np.empty((len(blocks), share.shape[1], 6, BOOST))
    side[:, :, :3], side[:, :, 3:] = blocks[:, :, 0], blocks[:, :, 1]
    for order in range(1, 4):
        side[:, :, :3] += blocks[:, :, order] * share[:, :, order]
    for order in (2, 3):
        side[:, :, 3:] += blocks[:, :, order] * share[:, :, order - 1]
    spread = side.reshape(-1, 6, BOOST)
    covariance: FloatArray = spread @ spread.transpose(0, 2, 1)
    far, both, fast = span_s**7 / 252.0, -(span_s**6) / 72.0, span_s**5 / 20.0
    flat = covariance.reshape(len(covariance), 36)
    # A step of 7 goes down a diagonal of blocks of 3 by 3.
    for first, term in ((0, far), (3, both), (18, both), (21, fast)):
        flat[:, first : first + 15 : 7] += (intensity * term)[:, None]
    return covariance


def _blended(
    place: FloatArray, covariance: FloatArray, when: FloatArray, chance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return latitude_rad, longitude_rad and time (n, 3) and covariances (n, 3, 3) of mixtures over times."""
    count, times = chance.shape
    each = np.concatenate([place, when[:, None]], axis=1).reshape(count, times, 4)
    mean = (chance[:, None] @ each)[:, 0]
    apart = each - mean[:, None]
    total = (chance[:, :, None] * apart).transpose(0, 2, 1) @ apart
    total[:, :3, :3] += (chance[:, None] @ covariance.reshape(count, times, 9)).reshape(count, 3, 3)
    where = ecef_to_geodetic(mean[:, :3])
    flat = np.zeros((count, 3, 4))
    flat[:, :2, :3], flat[:, 2, 3] = east_north_up_axes(where.latitude_rad, where.longitude_rad)[:, :2], 1.0
    told = np.stack([where.latitude_rad, where.longitude_rad, mean[:, 3]], axis=1)
    return told, flat @ total @ flat.transpose(0, 2, 1)
