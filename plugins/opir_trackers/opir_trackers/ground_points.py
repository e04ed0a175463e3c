"""Where tracks came from and where they come down, with the covariance that the state's brings about.

Where and when tracks were launched: their paths, followed back, must have left the ground from rest.

A path's speed there is small and its height flat, so that where it crosses the ground says little of when it left. That
it left from rest, on ground near the ellipsoid, and was not seen before, says more: the time of the launch is weighed
over all times before the first look that saw it, and the place follows for each.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_ROTATION_RAD_S
from opir_core.estimation.lines_of_sight import turned
from opir_core.estimation.motion import weights_at
from opir_core.flight.forces import Forces
from opir_core.flight.gravity_and_drag import height_and_up
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.geometry.ellipsoid import WGS84
from opir_trackers.filter.estimates import PredictedMeasurements


class GroundPoints(NamedTuple):
    """Latitude_rad, longitude_rad and scene time_s (n, 3), and covariances (n, 3, 3) as in `Tracks`; nan for none."""

    place: FloatArray
    covariance: FloatArray

    @classmethod
    def nowhere(cls, count: int) -> "GroundPoints":
        """Return no points."""
        return cls(np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan))


#: Impacts are worked out to within this, m: they are known to hundreds of metres at best.
_CLOSE_M = 1.0

#: What fell below the ground is followed back to this high above it, m.
_CLEAR_M = 10.0

#: Impacts of states one standard deviation off may bend away from a line by so many standard deviations of the ellipse
#: that they make: along a bow 95 % ellipses that bend by 0.25 hold 93 %, by 0.5 hold 88, by 1 hold 80, by 3 hold 58.
_MOST_BENT = 1.0

#: An ellipse of 95 % with a longer semi-axis, m, is no plane's on a round Earth.
_WIDEST_M, _SQUARE_95 = 3e6, 5.991

#: No less than gravity's acceleration at the ground, and for some tens of kilometres below it, m/s².
_GRAVITY_M_S2 = 10.0

_NOW = np.zeros((1, 1))


def impacts(state: FloatArray, covariance: FloatArray, time_s: float, forces: Forces) -> GroundPoints:
    """Return where free flights from inertial states (n, 6) come down.

    The point is that of the mean under `forces`. The covariance is spread through two-body arcs by central differences,
    one standard deviation either way: their partials differ from those under `forces` by parts in a thousand. What is
    below the ground already came down before `time_s`. nan in all of a point where one of these arcs does not come
    down, where they bend too far from lines, and of ellipses too wide for a plane: how sure it is then cannot be said.
    """
    points = GroundPoints.nowhere(len(state))
    if not len(state):
        return points
    side = np.linalg.cholesky(covariance).transpose(0, 2, 1)
    mean = state[:, None]
    every, since_s = _above(np.concatenate([mean, mean + side, mean - side], axis=1))
    flight, fell = _fallen(every, Forces(zonal=(), gravity=forces.gravity))
    flight -= since_s
    landed = turned(fell.reshape(-1, 3), -(time_s + flight).ravel()).reshape(fell.shape)
    when, ground = time_s + flight[:, 0], landed[:, 0]
    if not forces.is_kepler:
        forced, point = _fallen(every[:, 0], forces)
        when = time_s + forced - since_s[:, 0]
        ground = turned(point, -when)
    axes = local_axes(ground)[:, :2].transpose(0, 2, 1)
    one, other = landed[:, 1:7], landed[:, 7:]
    plane = 0.5 * (one - other) @ axes
    bend = np.add.reduce(0.5 * (one + other) - landed[:, :1], axis=1)[:, None] @ axes
    later = 0.5 * (flight[:, 1:7] - flight[:, 7:])
    told = _told(ground, when, np.concatenate([plane, later[:, :, None]], axis=2).transpose(0, 2, 1))
    vague = ~_are_flat(told.covariance, bend[:, 0])
    told.place[vague], told.covariance[vague] = np.nan, np.nan
    return told


def _are_flat(covariance: FloatArray, bend: FloatArray) -> BoolArray:
    """Return which impacts have ellipses that can be told, by their covariances (n, 3, 3) and bends (n, 2), m."""
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    aside, along = bend[:, 0], bend[:, 1]
    bent = north * aside**2 - 2.0 * both * aside * along + east * along**2
    across = east * north - both**2
    # The longer axis is shorter than that: beyond half of the trace, the characteristic polynomial is positive there.
    far = _WIDEST_M**2 / _SQUARE_95
    narrow = ((far - east) * (far - north) > both**2) & (east + north < 2.0 * far)
    flat: BoolArray = (bent <= _MOST_BENT**2 * across) & narrow
    return flat


def _above(state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states (n, k, 6) before any fell below the ground, and how long ago that is, (n, 1) s, or (1, 1) for all.

    A fall through the ground is followed back to above it as if gravity, all of it downwards, were harder than it is:
    so the way back is not taken for too short. The others of a row go with it.
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


def _fallen(state: FloatArray, forces: Forces) -> tuple[FloatArray, FloatArray]:
    """Return times to impact (...) and points (..., 3) of states (..., 6) under forces."""
    from opir_core.flight.propagation import impact

    place_m, velocity_m_s = state[..., :3], state[..., 3:]
    if forces.is_kepler:
        return impact(place_m, velocity_m_s, forces=forces)
    return impact(place_m, velocity_m_s, forces=forces, tolerance_m=_CLOSE_M)


def _told(ground: FloatArray, when: FloatArray, plane: FloatArray) -> GroundPoints:
    where = ecef_to_geodetic(ground)
    place = np.stack([where.latitude_rad, where.longitude_rad, when], axis=1)
    return GroundPoints(place, plane @ plane.transpose(0, 2, 1))


def renewed(known: GroundPoints, fresh: GroundPoints) -> GroundPoints:
    """Return points with those that are known afresh in the place of the old.

    Not the surer of two: what follows from less is now and then surer and wrong.
    """
    new = np.isfinite(fresh.place[:, 0])
    place = np.where(new[:, None], fresh.place, known.place)
    return GroundPoints(place, np.where(new[:, None, None], fresh.covariance, known.covariance))


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
