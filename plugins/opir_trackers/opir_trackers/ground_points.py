"""Launch and impact points of tracks, with the covariance propagated from the state."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_ROTATION_RAD_S
from opir_core.estimation.lines_of_sight import earth_rotated
from opir_core.estimation.motion import taylor_weights
from opir_core.flight.forces import Forces
from opir_core.flight.gravity_and_drag import height_and_up
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.geometry.ellipsoid import WGS84
from opir_trackers.filter.estimates import PredictedMeasurements


class GroundPoints(NamedTuple):
    """Latitude_rad, longitude_rad and scene time_s (n, 3), and covariances (n, 3, 3) as in `Tracks`; nan if unknown."""

    place: FloatArray
    covariance: FloatArray

    @classmethod
    def nowhere(cls, count: int) -> "GroundPoints":
        """Return unknown points."""
        return cls(np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan))


#: Tolerance of impact points, m: their standard deviation is hundreds of metres at best.
_CLOSE_M = 1.0

#: States below the ground are followed back to this height above it, m.
_CLEAR_M = 10.0

#: Impacts of states one standard deviation off may deviate from a line by this many standard deviations of the ellipse:
#: with a deviation of 0.25, 95 % ellipses contain 93 %, with 0.5 88 %, with 1 80 %, with 3 58 %.
_MOST_BENT = 1.0

#: A 95 % ellipse with a longer semi-axis, m, does not fit a plane on a round Earth.
_WIDEST_M, _SQUARE_95 = 3e6, 5.991

#: Upper bound on the acceleration of gravity from the ground to some tens of kilometres below, m/s².
_GRAVITY_M_S2 = 10.0

_NOW = np.zeros((1, 1))


def impacts(state: FloatArray, covariance: FloatArray, time_s: float, forces: Forces) -> GroundPoints:
    """Return the impact points of free flights from inertial states (n, 6).

    The point is that of the mean under `forces`. The covariance is propagated through two-body arcs by central
    differences of one standard deviation: their partial derivatives differ from those under `forces` by parts in a
    thousand. States below the ground have their impact before `time_s`. A point is nan where one of these arcs has no
    impact, where they deviate too far from lines, and where the ellipse is too wide for a plane: there is no valid
    covariance then.
    """
    points = GroundPoints.nowhere(len(state))
    if not len(state):
        return points
    side = np.linalg.cholesky(covariance).transpose(0, 2, 1)
    mean = state[:, None]
    every, since_s = _before_ground(np.concatenate([mean, mean + side, mean - side], axis=1))
    flight, fell = _impacts_of(every, Forces(zonal=(), gravity=forces.gravity))
    flight -= since_s
    landed = earth_rotated(fell.reshape(-1, 3), -(time_s + flight).ravel()).reshape(fell.shape)
    when, ground = time_s + flight[:, 0], landed[:, 0]
    if not forces.is_kepler:
        # A point with a two-body arc that does not come down has no covariance: its arc is not integrated in vain.
        falls = np.flatnonzero(np.isfinite(flight).all(axis=1))
        forced, point = np.full(len(state), np.nan), np.full((len(state), 3), np.nan)
        forced[falls], point[falls] = _impacts_of(every[falls, 0], forces)
        when = time_s + forced - since_s[:, 0]
        ground = earth_rotated(point, -when)
    axes = local_axes(ground)[:, :2].transpose(0, 2, 1)
    one, other = landed[:, 1:7], landed[:, 7:]
    plane = 0.5 * (one - other) @ axes
    bend = np.add.reduce(0.5 * (one + other) - landed[:, :1], axis=1)[:, None] @ axes
    later = 0.5 * (flight[:, 1:7] - flight[:, 7:])
    points = _points_on_ground(ground, when, np.concatenate([plane, later[:, :, None]], axis=2).transpose(0, 2, 1))
    vague = ~_are_elliptic(points.covariance, bend[:, 0])
    points.place[vague], points.covariance[vague] = np.nan, np.nan
    return points


def _are_elliptic(covariance: FloatArray, bend: FloatArray) -> BoolArray:
    """Return which impacts have a valid ellipse, by covariances (n, 3, 3) and deviations (n, 2) from lines, m."""
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    aside, along = bend[:, 0], bend[:, 1]
    bent = north * aside**2 - 2.0 * both * aside * along + east * along**2
    across = east * north - both**2
    # The longer axis is shorter than that: beyond half of the trace, the characteristic polynomial is positive there.
    far = _WIDEST_M**2 / _SQUARE_95
    narrow = ((far - east) * (far - north) > both**2) & (east + north < 2.0 * far)
    flat: BoolArray = (bent <= _MOST_BENT**2 * across) & narrow
    return flat


def _before_ground(state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states (n, k, 6) above the ground, and how long before, (n, 1) s, or (1, 1) for all.

    A fall through the ground is followed back with an upper bound on gravity, so the time is not underestimated. All
    states of a row are moved together.
    """
    place, speed = state[:, :, :3], state[:, :, 3:]
    if np.minimum.reduce(np.add.reduce(place * place, axis=2), axis=None) > EARTH_EQUATORIAL_RADIUS_M**2:
        return state, _NOW
    height_m = ecef_to_geodetic(place).height_m
    low = height_m < 0.0
    fall_m_s = -np.sum(local_axes(place)[:, :, 2] * speed, axis=2)
    climb_m = _CLEAR_M - height_m
    root = fall_m_s**2 - 2.0 * _GRAVITY_M_S2 * climb_m
    fell = low & (fall_m_s > 0.0) & (root > 0.0)
    back_s = np.where(fell, 2.0 * climb_m / (fall_m_s + np.sqrt(np.where(fell, root, 1.0))), 0.0)
    since_s: FloatArray = back_s.max(axis=1, keepdims=True)
    rows = np.flatnonzero(since_s)
    earlier = state.copy()
    earlier[rows] = np.concatenate(propagate_kepler(place[rows], speed[rows], -since_s[rows]), axis=2)
    return earlier, since_s


def _impacts_of(state: FloatArray, forces: Forces) -> tuple[FloatArray, FloatArray]:
    """Return times to impact (...) and impact points (..., 3) of states (..., 6) under forces."""
    from opir_core.flight.propagation import impact

    place_m, velocity_m_s = state[..., :3], state[..., 3:]
    if forces.is_kepler:
        return impact(place_m, velocity_m_s, forces=forces)
    return impact(place_m, velocity_m_s, forces=forces, tolerance_m=_CLOSE_M)


def _points_on_ground(ground: FloatArray, when: FloatArray, plane: FloatArray) -> GroundPoints:
    """Return ground points from ECEF points, times and roots of their covariance."""
    where = ecef_to_geodetic(ground)
    place = np.stack([where.latitude_rad, where.longitude_rad, when], axis=1)
    return GroundPoints(place, plane @ plane.transpose(0, 2, 1))


def updated_points(known: GroundPoints, fresh: GroundPoints) -> GroundPoints:
    """Return points with the finite ones of `fresh` in place of the known.

    The more certain of two is not preferred: an estimate from less data may be more certain and wrong.
    """
    new = np.isfinite(fresh.place[:, 0])
    place = np.where(new[:, None], fresh.place, known.place)
    return GroundPoints(place, np.where(new[:, None, None], fresh.covariance, known.covariance))


#: Launch times are searched over this interval before the first detection, s, on a grid denser towards it. The class
#: profiles reach 10 km after 34 to 51 s, and 20 km, the highest cloud top, after 49 to 73 s.
_BEFORE_S, _TIMES = 80.0, 80

#: Prior probability that a launch is detected from the ground at the next look; others are hidden by clouds at first.
_AT_ONCE = 0.5

#: Standard deviations of the height of launch sites above the ellipsoid, m, and of the velocity at ignition, m/s.
_SITE_M, _REST_M_S = 100.0, 1.0

#: Gate, squared distance with 4 degrees of freedom, for a start from rest at the best time.
_LAUNCHED = 25.0

#: Edges of the time intervals before the first detection, s.
_EDGES_S = _BEFORE_S * np.linspace(0.0, 1.0, _TIMES + 1) ** 2
_MIDDLES_S, _WIDTHS_S = 0.5 * (_EDGES_S[1:] + _EDGES_S[:-1]), np.diff(_EDGES_S)

#: Prior probability of a late detection in each interval.
_LATER = (1.0 - _AT_ONCE) * _WIDTHS_S / _BEFORE_S

#: Variances of the height of a site, m², and of the velocity at rest, m²/s².
_AT_REST = np.square([_SITE_M, _REST_M_S, _REST_M_S, _REST_M_S])


#: Indices below the diagonal.
_BELOW = np.tril_indices(3, -1)


def launches(
    predicted: PredictedMeasurements,
    first_s: FloatArray,
    pause_s: FloatArray,
    noise: float,
    biased: FloatArray | None = None,
) -> GroundPoints:
    """Return launch points of boosts from rest on the ground at an unknown time before `first_s` (n,); nan if none.

    `noise` is the process-noise density of the jerk, m/s³/√s. The prior: with probability 1/2 the launch is detected at
    once, after an exponential time of mean `pause_s` (n,); else after a uniform time up to 80 s. Mean and covariance
    are the moments of the mixture over launch times. `biased` (n, 3, 3) is the position covariance due to sensor
    biases, along the whole path.
    """
    count = len(predicted.root)
    if not count:
        return GroundPoints.nowhere(0)
    when = (first_s[:, None] - _MIDDLES_S).ravel()
    starts = _rest_likelihood(predicted, when, noise, biased)
    soon = -np.diff(np.exp(-_EDGES_S / pause_s[:, None]), axis=1)
    log = (starts.log - 0.5 * starts.misfit).reshape(count, _TIMES)
    log += np.log(_AT_ONCE * soon + _LATER)
    chance = np.exp(log - log.max(axis=1, keepdims=True))
    chance /= chance.sum(axis=1, keepdims=True)
    place, covariance = _moment_matched(*_places(starts, when), when, chance)
    covariance[:, 2, 2] += chance @ (_WIDTHS_S**2 / 12.0)
    row, column = _BELOW
    covariance[:, row, column] = covariance[:, column, row]
    nowhere = starts.misfit.reshape(count, _TIMES).min(axis=1) >= _LAUNCHED
    if np.count_nonzero(nowhere):
        place[nowhere], covariance[nowhere] = np.nan, np.nan
    return GroundPoints(place, covariance)


class _LaunchTimes(NamedTuple):
    """Paths at times (m,): inertial position (3, m), its covariance (3, 3, m), and the likelihood of a start from rest.

    `white` (4, 4, m) is whitened: the first three columns are by the position, the last is the residual. `misfit` (m,)
    is the squared distance of a start from rest, `log` (m,) the logarithm of its normalisation.
    """

    place: FloatArray
    covariance: FloatArray
    white: FloatArray
    misfit: FloatArray
    log: FloatArray


def _rest_likelihood(
    predicted: PredictedMeasurements, when: FloatArray, noise: float, biased: FloatArray | None
) -> _LaunchTimes:
    """Return the likelihood of starts from rest at times (m,), equally many per track."""
    count = len(predicted.root)
    weight = taylor_weights(when - predicted.time_s).T.reshape(5, count, -1).transpose(1, 0, 2)
    path = predicted.derivative.transpose(0, 2, 1)
    place, velocity = _rows(path @ weight), _rows(path[:, :, 1:] @ weight[:, :4])
    covariance = _covariances(predicted, weight)
    _add_noise(covariance, noise * noise, predicted.time_s - when)
    if biased is not None:
        covariance[:3, :3] += np.repeat(biased.transpose(1, 2, 0), _TIMES, axis=2)
    height, up = height_and_up(place, 1.0 / np.sqrt(np.add.reduce(place * place)))
    state = np.concatenate([place, velocity])[:, None]
    crossed = _height_and_velocity(covariance, up)
    points = np.concatenate(
        [_height_and_velocity(crossed.transpose(1, 0, 2), up), crossed[:, :3], _height_and_velocity(state, up)], axis=1
    )
    points[0, -1] = height
    log = _whitened(points)
    white = points[:, 4:]
    return _LaunchTimes(place, covariance[:3, :3], white, np.add.reduce(white[:, 3] * white[:, 3]), log)


def _whitened(rows: FloatArray) -> FloatArray:
    """Replace rows [S | B] (4, 4 + c, m) by L⁻¹ B, L Lᵀ = S + the covariance at rest; return -log det L (m,).

    In place; S is overwritten. Each pivot is at least that of the covariance at rest.
    """
    log = np.zeros(rows.shape[2])
    for k, at_rest in enumerate(_AT_REST.tolist()):
        pivot = np.sqrt(np.maximum(rows[k, k] + at_rest, _LEAST_PIVOT))
        log -= np.log(pivot)
        rows[k, k + 1 :] /= pivot
        rows[k + 1 :, k + 1 :] -= rows[k, k + 1 : 4, None] * rows[k, None, k + 1 :]
    return log


_LEAST_PIVOT = _REST_M_S**2


def _places(starts: _LaunchTimes, when: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ECEF positions (3, m) and covariances (3, 3, m) of starts from rest."""
    white, off = starts.white[:, :3], starts.white[:, 3]
    place = starts.place - np.add.reduce(white * off[:, None])
    left = starts.covariance - np.add.reduce(white[:, :, None] * white[:, None])
    angle = EARTH_ROTATION_RAD_S * when
    sine, cosine = np.sin(angle), np.cos(angle)
    return _to_ecef(place, sine, cosine), _to_ecef(_to_ecef(left, sine, cosine).swapaxes(0, 1), sine, cosine)


def _to_ecef(rows: FloatArray, sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """Return rows x, y, z (3, ..., m) rotated backwards about z."""
    earth_rotated = rows.copy()
    earth_rotated[0] = cosine * rows[0] + sine * rows[1]
    earth_rotated[1] = cosine * rows[1] - sine * rows[0]
    return earth_rotated


def _height_and_velocity(rows: FloatArray, up: FloatArray) -> FloatArray:
    """Return heights and velocities over the ground, (4, c, m), from states (6, c, m), linearised; `up` (3, m)."""
    gained = np.empty((4, *rows.shape[1:]))
    gained[0] = up[0] * rows[0] + up[1] * rows[1] + up[2] * rows[2]
    gained[1:] = rows[3:]
    gained[1] += EARTH_ROTATION_RAD_S * rows[1]
    gained[2] -= EARTH_ROTATION_RAD_S * rows[0]
    return gained


def _rows(each: FloatArray) -> FloatArray:
    """Return rows (c, m) from blocks of each track (n, c, t)."""
    return np.ascontiguousarray(each.transpose(1, 0, 2)).reshape(each.shape[1], -1)


def _covariances(predicted: PredictedMeasurements, weight: FloatArray) -> FloatArray:
    """Return the covariances (6, 6, m) of position and velocity at times with Taylor weights (n, 5, t).

    Each is a sum of products of two weights; the rounding error is of the size of the largest.
    """
    count, _, times = weight.shape
    share = np.zeros((count, 4, 2, times))
    share[:, :, 0], share[:, 1:, 1] = weight[:, :4], weight[:, :3]
    both = share[:, :, None, :, None] * share[:, None, :, None]
    known = (predicted.root @ predicted.root.transpose(0, 2, 1)).reshape(count, 4, 3, 4, 3).transpose(0, 2, 4, 1, 3)
    sums = known.reshape(count, 9, 16) @ both.reshape(count, 16, 4 * times)
    # Tracks, two axes of space, position or velocity twice, times.
    parts = sums.reshape(count, 3, 3, 2, 2, times).transpose(3, 1, 4, 2, 0, 5)
    return np.ascontiguousarray(parts).reshape(6, 6, count * times)


def _add_noise(covariance: FloatArray, intensity: float, span_s: FloatArray) -> None:
    """Add to covariances (6, 6, m) the process noise of the jerk over spans (m,)."""
    square = span_s * span_s
    fast = (intensity / 20.0) * square * square * span_s
    both = span_s * fast * (-20.0 / 72.0)
    far = square * fast * (20.0 / 252.0)
    for axis in range(3):
        covariance[axis, axis] += far
        covariance[axis, axis + 3] += both
        covariance[axis + 3, axis] += both
        covariance[axis + 3, axis + 3] += fast


def _moment_matched(
    place: FloatArray, covariance: FloatArray, when: FloatArray, chance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return latitude_rad, longitude_rad and time (n, 3) and covariances (n, 3, 3) of mixtures over launch times."""
    count, times = chance.shape
    each = np.concatenate([place, when[None]]).reshape(4, count, times).transpose(1, 0, 2)
    weighed = chance[:, :, None]
    mean = each @ weighed
    apart = each - mean
    total = (chance[:, None] * apart) @ apart.transpose(0, 2, 1)
    spreads = covariance.reshape(9, count, times).transpose(1, 0, 2)
    total[:, :3, :3] += (spreads @ weighed).reshape(count, 3, 3)
    points, level = _on_ground(mean[:, :3, 0])
    points[:, 2] = mean[:, 3, 0]
    flat = np.zeros((count, 3, 4))
    flat[:, :2, :3], flat[:, 2, 3] = level, 1.0
    return points, flat @ total @ flat.transpose(0, 2, 1)


def _on_ground(place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes, rad, with a third column, and east and north axes (n, 2, 3) at positions (n, 3).

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
    points, level = np.empty((len(place), 3)), np.empty((len(place), 2, 3))
    points[:, 0], points[:, 1] = np.arctan2(rise, run), np.arctan2(y, x)
    level[:, 0, 0], level[:, 0, 1], level[:, 0, 2] = -aside, ahead, 0.0
    level[:, 1, 0], level[:, 1, 1], level[:, 1, 2] = -sine * ahead, -sine * aside, cosine
    return points, level
