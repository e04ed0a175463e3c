"""Launch points of tracks: where boosts followed back begin at rest on the ground."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from opir_estimation import PredictedMeasurements, dot, taylor_weights

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight import height_and_up
from opir_core.geometry import WGS84


class LaunchPoints(NamedTuple):
    """Latitude_rad, longitude_rad and scene time_s (n, 3), and covariances (n, 3, 3) as in
    `Tracks`; nan if unknown.
    """

    place: FloatArray
    covariance: FloatArray

    @classmethod
    def nowhere(cls, count: int) -> "LaunchPoints":
        """Return unknown points."""
        return cls(np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan))


def are_in_orbit(state: FloatArray) -> BoolArray:
    """Return which inertial states (n, 6), above the ground, fly in orbits that do not reach it.

    With their energy and angular momentum the climb there would have a negative square (Bate,
    Mueller and White, Fundamentals of Astrodynamics, 1971, 1.4).
    """
    position, velocity = np.split(state, 2, axis=1)
    energy = 0.5 * dot(velocity, velocity) - EARTH_MU_M3_S2 / np.sqrt(dot(position, position))
    momentum = np.cross(position, velocity) / EARTH_EQUATORIAL_RADIUS_M
    lacking = 0.5 * dot(momentum, momentum) - EARTH_MU_M3_S2 / EARTH_EQUATORIAL_RADIUS_M
    return np.asarray(energy < lacking)


def updated_points(earlier: LaunchPoints, points: LaunchPoints) -> LaunchPoints:
    """Return points with the finite ones in place of earlier ones.

    The more certain of two is not preferred: an estimate from less data may be more certain and
    wrong.
    """
    new = np.isfinite(points.place[:, 0])
    place = np.where(new[:, None], points.place, earlier.place)
    covariance = np.where(new[:, None, None], points.covariance, earlier.covariance)
    return LaunchPoints(place, covariance)


#: Launch times are searched over this interval before the first detection, s, on a grid denser
#: towards it. The class profiles reach 10 km after 34 to 51 s, and 20 km, the highest cloud top,
#: after 49 to 73 s.
BEFORE_S = 80.0
_TIMES = 80

#: Prior probability that a launch is seen from the ground, and detected at the next looks; others
#: are hidden by clouds at first.
AT_ONCE = 0.5

#: Kinds of launch sites, at sea level and inland: means and standard deviations of heights above
#: the ellipsoid, m, and the shares of the inland ones, together as high as land is: 0.9 km in the
#: mean, 0.85 km about it (ETOPO1: 0.8 km).
SITES = np.array([[0.0, 100.0], [500.0, 300.0], [1800.0, 1000.0]])

#: Standard deviation of the velocity at ignition, m/s.
_REST_M_S = 1.0

#: Edges of the time intervals before the first detection, s: times of launch are worked out in
#: each.
EDGES_S = BEFORE_S * np.linspace(0.0, 1.0, _TIMES + 1) ** 2
_MIDDLES_S = 0.5 * (EDGES_S[1:] + EDGES_S[:-1])
_WIDTHS_S = np.diff(EDGES_S)

#: Probabilities (times, times) of each interval, given that of the wait for a report in view, for
#: what is hidden for a uniform time before.
_CLOUDED = np.diff(np.clip((EDGES_S - _MIDDLES_S[:, None]) / BEFORE_S, 0.0, 1.0), axis=1)

#: Starts from rest are worked out at each kind of site and each time: means and variances of
#: heights, times before the first detection, and the widths of their intervals (cases,).
_SITE_HEIGHT_M, _SITE_M2 = np.repeat([SITES[:, 0], SITES[:, 1] ** 2], _TIMES, axis=1)
_CASES_S, _CASE_WIDTHS_S = np.tile([_MIDDLES_S, _WIDTHS_S], len(SITES))


def site_shares(inland: float) -> FloatArray:
    """Return the prior probabilities of the kinds of launch sites, with a share of sites inland."""
    return np.array([1.0 - inland, inland * 0.7, inland * 0.3])


class Ground(NamedTuple):
    """A kind of ground that sites are on: its prior probability, mean and standard deviation of the
    height, m.
    """

    share: float
    mean_m: float
    sigma_m: float


def grounds(inland: float) -> list[Ground]:
    """Return the possible kinds of ground, with a share of sites inland."""
    heights = SITES.tolist()
    shares = site_shares(inland).tolist()
    return [
        Ground(share, *height) for share, height in zip(shares, heights, strict=True) if share > 0.0
    ]


def site_height_m(inland: float) -> float:
    """Return the root mean square of the heights of launch sites, m, with a share of sites
    inland.
    """
    return float(np.sqrt(site_shares(inland) @ np.sum(SITES**2, axis=1)))


class FirstMotion(NamedTuple):
    """What the filter assumed of motions (n,) at the first detection: (n,) each, or numbers.

    Height, m, over the ellipsoid, climb, m/s, net acceleration, m/s², and jerk, m/s³, upwards;
    standard deviations of position, m, velocity, m/s, acceleration and jerk, the same on each axis.
    """

    height: FloatArray
    climb: FloatArray
    acceleration: FloatArray
    jerk: float
    sigmas: tuple[FloatArray, FloatArray, float, float]

    def log_rest_densities(self, noise: float) -> FloatArray:
        """Return the log densities (n, cases), but for a constant, of rest on the ground before the
        first detection.
        """
        span = _CASES_S
        climb = self.climb[:, None]
        acceleration = self.acceleration[:, None]
        square = span * span
        gained = span * (acceleration - 0.5 * self.jerk * span) - climb
        height = self.height[:, None] - _SITE_HEIGHT_M - climb * span
        height += square * (0.5 * acceleration - self.jerk / 6.0 * span)
        height_variance, covariance, speed_variance = self._variances(noise * noise)
        determinant = height_variance * speed_variance - covariance * covariance
        misfit = (
            speed_variance * height * height
            + 2.0 * covariance * height * gained
            + height_variance * gained * gained
        ) / determinant
        # Upwards height and velocity together; velocity along each axis of the ground alone.
        return -0.5 * (np.log(determinant) + misfit) - np.log(speed_variance)

    def _variances(self, noise: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the variances (n, cases) of height and velocity before the first detection, and
        their covariance.
        """
        span = _CASES_S
        place, speed, force, growth = (
            np.square(sigma)[..., None] for sigma in map(np.asarray, self.sigmas)
        )
        square = span * span
        speed_variance = (
            _REST_M_S**2
            + speed
            + square * (force + 0.25 * square * growth)
            + noise / 3.0 * square * span
        )
        by_force = square * (speed + square * (0.25 * force + square / 36.0 * growth))
        height_variance = _SITE_M2 + place + by_force
        height_variance = height_variance + noise / 20.0 * square * square * span
        covariance = -span * (speed + square * (0.5 * force + square / 12.0 * growth))
        covariance = covariance - noise / 8.0 * square * square
        return height_variance, covariance, speed_variance


class LaunchDelayPrior(NamedTuple):
    """What is known of launches (n,) before the first line.

    `at_once` (n, times) are the probabilities of each interval of `EDGES_S` before the first
    detection for a launch that is seen at once. With a prior probability of 1/2 it is, else the
    first detection is later by a uniform time up to 80 s. The path seen is followed back from the filter's
    estimate, which holds the prior `motion`: a start from rest is as likely as the ratio of its
    densities after and before the lines (Dickey, Annals of Mathematical Statistics 42, 1971).
    Without the ratio, late detections would seem earlier ones: what was known before is wider the
    longer the path is. A share `inland` of sites is as high as land is.
    """

    at_once: FloatArray
    motion: FirstMotion
    inland: float


def log_unreported(
    period_s: FloatArray,
    detection_probability: FloatArray,
    confirmation: Sequence[tuple[int, int]] | None = None,
) -> FloatArray:
    """Return the log probabilities (sensors, edges) that sensors have not yet reported a launch
    that they see from the ground, at the times `EDGES_S` after ignition.

    Sensors look every `period_s` (sensors,), from a time between ignition and a period later, and
    detect a launch with `detection_probability` (sensors,). One with a rule of `confirmation`,
    (M, N), reports once M of its last N looks detected, and its probability of detection is
    unknown.
    """
    looks = EDGES_S / period_s[:, None]
    if confirmation is None:
        full_scans = np.floor(looks)
        chance = detection_probability[:, None]
        part = np.log1p(-chance * (looks - full_scans))
        unseen: FloatArray = full_scans * np.log1p(-chance) + part
        return unseen
    return np.array(
        [
            _log_unconfirmed(row, needed, scans)
            for row, (needed, scans) in zip(looks, confirmation, strict=True)
        ]
    )


def _log_unconfirmed(looks: FloatArray, needed: int, scans: int) -> FloatArray:
    """Return the log probabilities (n,) that M of N looks have not yet detected after `looks` (n,),
    of which a part is that of the next one.
    """
    missing = confirming_looks(needed, scans)[:, None] - looks
    share = np.mean(np.clip(missing, 0.0, 1.0), axis=0)
    return np.log(np.maximum(share, _NEVER))


#: Probability of what cannot be, whose logarithm is finite.
_NEVER = 1e-300


@lru_cache(maxsize=16)
def confirming_looks(needed: int, scans: int) -> FloatArray:
    """Return draws (n,) of the number of looks until M of N have detected, inf for a source that
    stays dark.

    What is near to the threshold is seen now and then, most sources at each look or never: the
    probability of detection is drawn from its arcsine law, which is that of no information
    (Jeffreys, Proc. R. Soc. A 186, 1946).
    """
    rng = np.random.default_rng(14)
    chance = np.sin(0.5 * np.pi * (np.arange(_SOURCES) + 0.5) / _SOURCES)[:, None] ** 2
    gaps = rng.geometric(chance, (_SOURCES, needed + scans))
    hits = np.cumsum(gaps, axis=1)
    last = hits[:, needed - 1 :]
    is_enough = last - hits[:, : last.shape[1]] < scans
    first = last[np.arange(_SOURCES), is_enough.argmax(axis=1)]
    return np.where(is_enough.any(axis=1), first, np.inf)


#: Sources drawn for the looks of a confirmation.
_SOURCES = 4096


def delays_at_once(unreported: FloatArray, visible: BoolArray) -> FloatArray:
    """Return the prior (n, times) of the time from launch to first report of launches seen from the
    ground, in each of the intervals of `EDGES_S`.

    `unreported` (sensors, edges) are those of `log_unreported`; `visible` (n, sensors) are the
    sensors that see each track.
    """
    return -np.diff(np.exp(visible @ unreported), axis=1)


def delays_out_of_clouds(at_once: FloatArray) -> FloatArray:
    """Return the prior (n, times) of the time from launch to first report of launches hidden at
    first, uniformly up to `BEFORE_S`, of which the prior without clouds is `at_once` (n, times).
    """
    return at_once @ _CLOUDED


def launches(
    predicted: PredictedMeasurements,
    first_s: FloatArray,
    prior: LaunchDelayPrior,
    noise: float,
    biased: FloatArray | None = None,
) -> LaunchPoints:
    """Return launch points of boosts from rest on the ground at an unknown time before `first_s`
    (n,); nan if none.

    `first_s` is the time at which the light of the first detection was emitted, `noise` the
    process-noise density of the force, m/s²/√s, on the path followed back. Mean and covariance are
    moments of the mixture over times and sites. `biased` (n, 3, 3) is the position covariance due
    to sensor biases, along the whole path.
    """
    count = len(predicted.root)
    if not count:
        return LaunchPoints.nowhere(0)
    starts = _rest_likelihood(predicted, (first_s[:, None] - _MIDDLES_S).ravel(), noise, biased)
    when = (first_s[:, None] - _CASES_S).ravel()
    log_density = (starts.log - 0.5 * starts.misfit).reshape(count, -1)
    chance = _launch_chances(log_density - prior.motion.log_rest_densities(noise), prior)
    points = LaunchPoints(*moment_matched(*_places(starts, when), when, chance))
    points.covariance[:, 2, 2] += chance @ (_CASE_WIDTHS_S**2 / 12.0)
    row, column = np.tril_indices(3, -1)
    points.covariance[:, row, column] = points.covariance[:, column, row]
    nowhere = _without_launch(starts.misfit.reshape(count, -1), prior.inland)
    points.place[nowhere] = np.nan
    points.covariance[nowhere] = np.nan
    return points


def _without_launch(misfit: FloatArray, inland: float) -> BoolArray:
    """Return which tracks have no start from rest by their misfits (n, cases)."""
    possible = np.repeat(site_shares(inland) > 0.0, _TIMES)
    # Gate for a start from rest at the best time, with 4 degrees of freedom.
    without: BoolArray = misfit[:, possible].min(axis=1) >= 25.0
    return without


def _launch_chances(log_likelihood: FloatArray, prior: LaunchDelayPrior) -> FloatArray:
    """Return the probabilities (n, cases) of a launch at each kind of site in each of `EDGES_S`,
    given likelihoods.
    """
    hidden = delays_out_of_clouds(prior.at_once)
    delays = AT_ONCE * prior.at_once + (1.0 - AT_ONCE) * hidden
    weight = delays[:, None] * site_shares(prior.inland)[:, None]
    with np.errstate(divide="ignore"):
        log = log_likelihood + np.log(weight).reshape(len(weight), -1)
    chance: FloatArray = np.exp(log - log.max(axis=1, keepdims=True))
    return chance / chance.sum(axis=1, keepdims=True)


class _Starts(NamedTuple):
    """Paths at cases (m,): inertial position (3, m), its covariance (3, 3, m), and the likelihood
    of a start from rest.

    `white` (4, 4, m) is whitened: the first three columns are by the position, the last is the
    residual. `misfit` (m,) is the squared distance of a start from rest, `log` (m,) the logarithm
    of its normalisation.
    """

    place: FloatArray
    covariance: FloatArray
    white: FloatArray
    misfit: FloatArray
    log: FloatArray


def _rest_likelihood(
    predicted: PredictedMeasurements, when: FloatArray, noise: float, biased: FloatArray | None
) -> _Starts:
    """Return the likelihood of starts from rest at times (m,), those of `EDGES_S` per track, at
    each kind of site.
    """
    count = len(predicted.root)
    place, velocity, covariance = path_moments(predicted, when, noise, biased)
    points = _rest_rows(place, velocity, covariance)
    points, place, spread = (_at_sites(rows, count) for rows in (points, place, covariance[:3, :3]))
    points[0, -1] -= np.tile(_SITE_HEIGHT_M, count)
    log = _whitened(points, np.tile(_SITE_M2, count))
    white = points[:, 4:]
    misfit = np.add.reduce(white[:, 3] * white[:, 3])
    return _Starts(place, spread, white, misfit, log)


def _rest_rows(place: FloatArray, velocity: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the rows [S | B] (4, 8, m) of `_whitened` of paths: the covariances of height and
    velocity over the ground, those with the position, and height and velocity.
    """
    height, up = height_and_up(place, 1.0 / np.sqrt(np.add.reduce(place * place)))
    state = np.concatenate([place, velocity])[:, None]
    crossed = _height_and_velocity(covariance, up)
    columns = (
        _height_and_velocity(crossed.transpose(1, 0, 2), up),
        crossed[:, :3],
        _height_and_velocity(state, up),
    )
    rows = np.concatenate(columns, axis=1)
    rows[0, -1] = height
    return rows


def path_moments(
    predicted: PredictedMeasurements, when: FloatArray, noise: float, biased: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return inertial positions and velocities (3, m) and covariances (6, 6, m) at times (m,), as
    many per track.
    """
    count = len(predicted.root)
    weight = taylor_weights(when - predicted.time_s).T.reshape(5, count, -1).transpose(1, 0, 2)
    path = predicted.derivative.mT
    covariance = _covariances(predicted, weight)
    _add_noise(covariance, noise * noise, predicted.time_s - when)
    if biased is not None:
        covariance[:3, :3] += np.repeat(biased.transpose(1, 2, 0), len(when) // count, axis=2)
    return _rows(path @ weight), _rows(path[:, :, 1:] @ weight[:, :4]), covariance


def _at_sites(rows: FloatArray, count: int) -> FloatArray:
    """Return rows (..., count · times) for each kind of site, (..., count · cases)."""
    blocks = rows.reshape(*rows.shape[:-1], count, 1, _TIMES)
    return np.repeat(blocks, len(SITES), axis=-2).reshape(*rows.shape[:-1], -1)


def _whitened(rows: FloatArray, site_m2: FloatArray) -> FloatArray:
    """Replace rows [S | B] (4, 4 + c, m) by L⁻¹ B, L Lᵀ = S + the covariance at rest; return -log
    det L (m,).

    In place; S is overwritten. Each pivot is at least that of the covariance at rest: of the height
    of a site (m,), and of velocities.
    """
    log = np.zeros(rows.shape[2])
    for k, at_rest in enumerate((site_m2, *[_REST_M_S**2] * 3)):
        pivot = np.sqrt(np.maximum(rows[k, k] + at_rest, _REST_M_S**2))
        log -= np.log(pivot)
        rows[k, k + 1 :] /= pivot
        rows[k + 1 :, k + 1 :] -= rows[k, k + 1 : 4, None] * rows[k, None, k + 1 :]
    return log


def _places(starts: _Starts, when: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ECEF positions (3, m) and covariances (3, 3, m) of starts from rest."""
    white = starts.white[:, :3]
    off = starts.white[:, 3]
    place = starts.place - np.add.reduce(white * off[:, None])
    covariance = starts.covariance - np.add.reduce(white[:, :, None] * white[:, None])
    angle = EARTH_ROTATION_RAD_S * when
    sine = np.sin(angle)
    cosine = np.cos(angle)
    covariance = _to_ecef(covariance, sine, cosine).swapaxes(0, 1)
    return _to_ecef(place, sine, cosine), _to_ecef(covariance, sine, cosine)


def _to_ecef(rows: FloatArray, sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """Return rows x, y, z (3, ..., m) rotated backwards about z."""
    turned = rows.copy()
    turned[0] = cosine * rows[0] + sine * rows[1]
    turned[1] = cosine * rows[1] - sine * rows[0]
    return turned


def _height_and_velocity(rows: FloatArray, up: FloatArray) -> FloatArray:
    """Return heights and velocities over the ground, (4, c, m), from states (6, c, m), linearised;
    `up` (3, m).
    """
    gained = np.empty((4, *rows.shape[1:]))
    gained[0] = up[0] * rows[0] + up[1] * rows[1] + up[2] * rows[2]
    gained[1:] = rows[3:]
    gained[1] += EARTH_ROTATION_RAD_S * rows[1]
    gained[2] -= EARTH_ROTATION_RAD_S * rows[0]
    return gained


def _rows(blocks: FloatArray) -> FloatArray:
    """Return rows (c, m) from blocks of each track (n, c, t)."""
    return np.ascontiguousarray(blocks.transpose(1, 0, 2)).reshape(blocks.shape[1], -1)


def _covariances(predicted: PredictedMeasurements, weight: FloatArray) -> FloatArray:
    """Return the covariances (6, 6, m) of position and velocity at times with Taylor weights (n, 5,
    t).

    Each is a sum of products of two weights; the rounding error is of the size of the largest.
    """
    count, _, times = weight.shape
    share = np.zeros((count, 4, 2, times))
    share[:, :, 0] = weight[:, :4]
    share[:, 1:, 1] = weight[:, :3]
    products = share[:, :, None, :, None] * share[:, None, :, None]
    gram = predicted.root @ predicted.root.mT
    gram = gram.reshape(count, 4, 3, 4, 3).transpose(0, 2, 4, 1, 3)
    sums = gram.reshape(count, 9, 16) @ products.reshape(count, 16, 4 * times)
    # Tracks, two axes of space, position or velocity twice, times.
    blocks = sums.reshape(count, 3, 3, 2, 2, times).transpose(3, 1, 4, 2, 0, 5)
    return np.ascontiguousarray(blocks).reshape(6, 6, count * times)


def _add_noise(covariance: FloatArray, intensity: float, span_s: FloatArray) -> None:
    """Add to covariances (6, 6, m) the process noise of the force over spans (m,)."""
    square = span_s * span_s
    speed = (intensity / 3.0) * square * span_s
    cross = (-intensity / 8.0) * square * square
    place = square * speed * (3.0 / 20.0)
    for axis in range(3):
        covariance[axis, axis] += place
        covariance[axis, axis + 3] += cross
        covariance[axis + 3, axis] += cross
        covariance[axis + 3, axis + 3] += speed


def moment_matched(
    place: FloatArray, covariance: FloatArray, when: FloatArray, chance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return latitude_rad, longitude_rad and time (n, 3) and covariances (n, 3, 3) of mixtures over
    launch times.
    """
    count, times = chance.shape
    points = np.concatenate([place, when[None]]).reshape(4, count, times).transpose(1, 0, 2)
    weight = chance[:, :, None]
    mean = points @ weight
    offset = points - mean
    total = (chance[:, None] * offset) @ offset.mT
    spreads = covariance.reshape(9, count, times).transpose(1, 0, 2)
    total[:, :3, :3] += (spreads @ weight).reshape(count, 3, 3)
    return on_ground(mean[:, :, 0], total)


def on_ground(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return latitude_rad, longitude_rad and time (n, 3) and covariances (n, 3, 3) of ECEF position
    and time (n, 4).
    """
    points, level = _on_ground(mean[:, :3])
    points[:, 2] = mean[:, 3]
    flat = np.zeros((len(mean), 3, 4))
    flat[:, :2, :3] = level
    flat[:, 2, 3] = 1.0
    spread = flat @ covariance @ flat.mT
    # Rounding leaves the two halves of a product different.
    return points, 0.5 * (spread + spread.mT)


def _on_ground(place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes, rad, with a third column, and east and north axes (n, 2, 3)
    at positions (n, 3).

    One step of Bowring's formula (Survey Review 23, 1976): to 2e-13 rad within 10 km of the
    ellipsoid.
    """
    x, y, z = place.T
    out = np.maximum(np.hypot(x, y), 1e-3)
    rise, run = _normal(out, z)
    length = np.hypot(rise, run)
    sine = rise / length
    cosine = run / length
    points = np.empty((len(place), 3))
    points[:, 0] = np.arctan2(rise, run)
    points[:, 1] = np.arctan2(y, x)
    return points, _level_axes(x / out, y / out, sine, cosine)


def _level_axes(x: FloatArray, y: FloatArray, sine: FloatArray, cosine: FloatArray) -> FloatArray:
    """Return the east and north axes (n, 2, 3) at meridians (x, y) and latitudes."""
    level = np.zeros((len(x), 2, 3))
    level[:, 0, 0] = -y
    level[:, 0, 1] = x
    level[:, 1, 0] = -sine * x
    level[:, 1, 1] = -sine * y
    level[:, 1, 2] = cosine
    return level


def _normal(out: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the polar and the equatorial part (n,) of normals of the ellipsoid through points, of
    which both parts are given.
    """
    a = WGS84.equatorial_radius_m
    b = WGS84.polar_radius_m
    e2 = WGS84.eccentricity_squared
    length = np.hypot(a * z, b * out)
    sine = a * z / length
    cosine = b * out / length
    rise: FloatArray = z + e2 / (1.0 - e2) * b * sine**3
    run: FloatArray = out - e2 * a * cosine**3
    return rise, run
