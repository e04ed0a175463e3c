"""Impacts of tracks as regions: an ensemble of what a target may be and may still do, flown on to the ground.

A part of the particles burns, in proportion to the probability of the filter's modes; the others are dark now. Each
follows a boost of the prior that fits its track (`matching`): it flies on through the burns that remain, or none, and
falls. So a region of a dark target includes relights as long as a gap between stages may last, and one of a burning
target all burnouts that its motion allows.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray, ObjectArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.estimation.square_root import inverse_root
from opir_core.flight import Forces
from opir_core.geometry import AzimuthalEquidistant, ecef_to_geodetic, great_circle_m, unit_vectors
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import TARGET_TYPES
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast import matching
from opir_trackers.forecast.burning_on import STEPS, TILT_S, flown_on, remaining
from opir_trackers.forecast.prior_boosts import STAGES, class_codes, longest_gap_s, prior_boosts
from opir_trackers.forecast.regions import regions
from opir_trackers.lines_of_sight import earth_rotated

#: Particles of a track.
PARTICLES = 256

#: Standard deviation of the tilt of the thrust from a program, least and largest, rad: log-uniform over particles.
TILT_RAD = np.radians([0.3, 4.0])

#: A boost goes on with at least and at most this share of the acceleration of the prior's one.
_SCALES = 0.7, 1.4

#: Width of the kernel of the range, of its logarithm, and a region above which forces other than a point mass's do not
#: count, m.
RANGE, _WIDE_M = 0.3, 200e3

#: Times since ignition from this on mark particles without a boost.
_NO_BOOST_S = 1e5

#: Modes less probable than this get no particles.
_LEAST_MODE = 0.01

#: A region is known if this share of the particles comes down.
_LEAST_DOWN = 0.5


class Forecasts(NamedTuple):
    """Impacts of tracks (n,): latitude_rad, longitude_rad, time_s with covariance and radii as in `Tracks`, regions.

    `probability_relights` (n,), and `by_class` (n, classes): the probability of the classes by range.
    """

    impact: FloatArray
    covariance: FloatArray
    sigmas: FloatArray
    regions: ObjectArray
    probability_burning: FloatArray
    probability_relights: FloatArray
    by_class: FloatArray


class _Particles(NamedTuple):
    """States (p, 10 or 6) of one track's particles, programs, times since ignition, ratios of force, and dark ones."""

    state: FloatArray
    boost: IntArray
    since_s: FloatArray
    scale: FloatArray


def forecasts(
    estimates: ModeEstimates,
    dark_s: FloatArray,
    launch: FloatArray,
    launch_sigma_s: FloatArray,
    type_log_likelihood: FloatArray,
    time_s: float,
    forces: Forces,
) -> Forecasts:
    """Return the forecasts of tracks (n,) with launches (n, 3), nan where unknown, at a time.

    `dark_s` (n,) is the time since the burn ended, if it did, `type_log_likelihood` (n, types) that of the types that
    sensors reported.
    """
    count, prior = len(estimates), prior_boosts()
    parts, relights = list[_Particles](), np.zeros(count)
    for number in range(count):
        since = time_s - float(launch[number, 2]), float(launch_sigma_s[number])
        some, relights[number] = _particles(
            estimates, number, since, float(dark_s[number]), type_log_likelihood[number]
        )
        parts.append(some)
    track = np.repeat(np.arange(count), [len(some.boost) for some in parts])
    boost, since_s, scale = (
        np.concatenate([getattr(some, name) for some in parts]) for name in ("boost", "since_s", "scale")
    )
    state = np.concatenate([some.state for some in parts])
    burns = remaining(prior.programs.take(boost), since_s, scale)
    tilts = np.concatenate([_tilts()[:, :, : len(some.boost)] for some in parts], axis=2)
    out, later_s = flown_on(state, burns, tilts)
    place, when_s = _impacts(out, time_s + later_s, forces)
    range_m = great_circle_m(np.where(np.isfinite(launch), launch, 0.0)[track], place)
    weight = np.where(
        np.isfinite(launch[track, 0]) & (since_s < _NO_BOOST_S), _fits(range_m, prior.range_m[boost]), 1.0
    )
    weight = np.where(np.isfinite(when_s), weight, 0.0)
    bent = out if not forces.is_kepler else None
    return _gathered(track, place, when_s, weight, range_m, estimates, relights, bent, time_s + later_s, forces)


def _fits(range_m: FloatArray, prior_m: FloatArray) -> FloatArray:
    """Return weights (p,) of ranges about those of their boosts: a feature with a kernel, like those at the tick."""
    away = np.log(np.maximum(range_m, 1e3) / prior_m) / RANGE
    weight: FloatArray = np.exp(-0.5 * away * away)
    return weight


def _particles(
    estimates: ModeEstimates, number: int, since: tuple[float, float], dark_s: float, types: FloatArray
) -> tuple[_Particles, float]:
    """Return the particles of a track with the time since ignition and its error, and the probability of a relight."""
    burning = float(estimates.weight[number, 0])
    burning = 0.0 if burning < _LEAST_MODE else 1.0 if burning > 1.0 - _LEAST_MODE else burning
    count = round(PARTICLES * burning)
    parts, relights = list[_Particles](), 0.0
    if count:
        parts.append(_burning(estimates, number, since, types, count))
    if count < PARTICLES:
        dark, share = _dark(estimates, number, since, dark_s, types, PARTICLES - count)
        parts.append(dark)
        relights = share * (1.0 - burning)
    return _Particles(*(np.concatenate(column) for column in zip(*parts, strict=True))), relights


def _burning(
    estimates: ModeEstimates, number: int, since: tuple[float, float], types: FloatArray, count: int
) -> _Particles:
    prior = prior_boosts()
    state, side = estimates.boost_mean[number], inverse_root(estimates.boost_root[number : number + 1])[0]
    parts = matching.parts_of(state, side)
    log = (prior.log_weight + types[prior.class_code])[prior.boost]
    matches = matching.matched(prior, log, parts, since, 4)
    if not len(matches.row):
        return _ballistic(state[:6], side[:6], count)
    picked = _picked(matches.probability, count)
    row = matches.row[picked]
    normal = _normal()[:count, : len(state) + 4]
    states = matching.drawn_states(parts, matches.part[picked], prior.features[row], normal, matches.width)
    scale = np.clip(matching.features_of(states)[:, 3] / prior.features[row, 3], *_SCALES)
    return _Particles(states[:, :6], prior.boost[row], prior.time_s[row], scale)


def _dark(
    estimates: ModeEstimates, number: int, since: tuple[float, float], dark_s: float, types: FloatArray, count: int
) -> tuple[_Particles, float]:
    prior, ends = prior_boosts(), prior_boosts().ends
    state, side = estimates.coast_mean[number], inverse_root(estimates.coast_root[number : number + 1])[0]
    hits, spell, silent_s = estimates.detection_rate[number].tolist()
    if dark_s > longest_gap_s() and silent_s < dark_s:
        # Seen in free flight for so long, it needs no prior.
        return _ballistic(state, side, count), 0.0

    def burnt_out(states: FloatArray) -> FloatArray:
        return _moved_back(states, dark_s)

    parts = matching.parts_of(state, side, burnt_out)
    gap = prior.programs.gap_s[ends.boost, ends.stage]
    final = (ends.stage == STAGES - 1) | (
        prior.programs.burn_s[ends.boost, np.minimum(ends.stage + 1, STAGES - 1)] == 0.0
    )
    log = np.where(final | (gap >= dark_s), (prior.log_weight + types[prior.class_code])[ends.boost], -np.inf)
    burned = since[0] - dark_s, float(np.hypot(since[1], spell / max(hits, 1.0) + 1.0))
    matches = matching.matched(ends, log, parts, burned, 3)
    if not len(matches.row):
        return _ballistic(state, side, count), 0.0
    picked = _picked(matches.probability, count)
    row = matches.row[picked]
    normal = _normal()[PARTICLES - count :, : len(state) + 3]
    chosen = ends.features[row, :3]
    states = matching.drawn_states(parts, matches.part[picked], chosen, normal, matches.width, burnt_out)
    relights = float(np.sum(matches.probability[~final[matches.row]]))
    return _Particles(states, ends.boost[row], ends.time_s[row] + dark_s, np.ones(count)), relights


def _ballistic(state: FloatArray, side: FloatArray, count: int) -> _Particles:
    """Return particles that no boost of the prior fits: in free flight."""
    states = state + _normal()[:count, : side.shape[1]] @ side.T
    return _Particles(states, np.zeros(count, dtype=np.int64), np.full(count, 1e6), np.ones(count))


def _moved_back(state: FloatArray, span_s: float) -> FloatArray:
    """Return free flights' states (n, 6) a few seconds before, to the second power of time."""
    place, velocity = state[:, :3], state[:, 3:6]
    pull = -EARTH_MU_M3_S2 / np.sum(place * place, axis=1, keepdims=True) ** 1.5 * place
    return np.concatenate([place - span_s * velocity + 0.5 * span_s * span_s * pull, velocity - span_s * pull], axis=1)


def _picked(probability: FloatArray, count: int) -> IntArray:
    """Return indices drawn in proportion to probabilities, at equal steps, in a fixed random order."""
    steps = (np.arange(count) + 0.5) / count
    chosen = np.minimum(np.searchsorted(np.cumsum(probability), steps), len(probability) - 1)
    return chosen[np.argsort(_normal()[:count, -1], kind="stable")]


@cache
def _normal() -> FloatArray:
    """Return standard normal numbers (particles, 20): the same for all tracks and ticks, so regions change smoothly."""
    return np.random.default_rng(1).normal(size=(PARTICLES, 20))


@cache
def _tilts() -> FloatArray:
    """Return angles (STAGES, STEPS, particles, 2), rad: first-order Gauss-Markov processes from step to step."""
    rng = np.random.default_rng(2)
    sigma = np.exp(rng.uniform(np.log(TILT_RAD[0]), np.log(TILT_RAD[1]), PARTICLES))[:, None]
    noise = rng.normal(size=(STAGES * STEPS, PARTICLES, 2))
    keep = np.exp(-10.0 / TILT_S)
    tilt = np.empty_like(noise)
    tilt[0] = noise[0]
    for step in range(1, len(tilt)):
        tilt[step] = keep * tilt[step - 1] + np.sqrt(1.0 - keep * keep) * noise[step]
    angles: FloatArray = (tilt * sigma).reshape(STAGES, STEPS, PARTICLES, 2)
    return angles


def _impacts(
    state: FloatArray, time_s: FloatArray, forces: Forces, tolerance_m: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes (p, 2), rad, and times (p,) of the impacts of free flights; nan without one.

    Without a tolerance, under the gravity of a point mass.
    """
    from opir_core.flight import impact

    if tolerance_m is None:
        flight, fell = impact(state[:, :3], state[:, 3:], forces=Forces(zonal=(), gravity=forces.gravity))
    else:
        flight, fell = impact(state[:, :3], state[:, 3:], forces=forces, tolerance_m=tolerance_m)
    when = time_s + flight
    down = ecef_to_geodetic(earth_rotated(fell, -when))
    return np.stack([down.latitude_rad, down.longitude_rad], axis=1), when


def _gathered(
    track: IntArray,
    place: FloatArray,
    when_s: FloatArray,
    weight: FloatArray,
    range_m: FloatArray,
    estimates: ModeEstimates,
    relights: FloatArray,
    bent: FloatArray | None,
    out_s: FloatArray,
    forces: Forces,
) -> Forecasts:
    """Return forecasts from particles (p,) with weights, ranges, and, under other forces, states at times `out_s`."""
    count = len(estimates)
    impact, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    sigmas, found = np.full((count, 3), np.nan), np.empty(count, dtype=np.object_)
    found.fill(())
    by_class = np.zeros((count, len(TARGET_TYPES)))
    edges = np.searchsorted(track, np.arange(count + 1))
    for number in range(count):
        mine = np.arange(edges[number], edges[number + 1])
        mine = mine[weight[mine] > 0.0]
        if len(mine) < _LEAST_DOWN * PARTICLES:
            continue
        points, share = place[mine], weight[mine] / weight[mine].sum()
        by_class[number] = np.bincount(class_codes(range_m[mine]), share, len(TARGET_TYPES))
        if bent is not None:
            points = _shifted(points, share, bent[mine], out_s[mine], forces)
        found[number] = regions(points, share)
        impact[number], covariance[number], sigmas[number] = _moments(points, when_s[mine], share)
    return Forecasts(impact, covariance, sigmas, found, estimates.weight[:, 0], relights, by_class)


def _shifted(
    place: FloatArray, weight: FloatArray, state: FloatArray, time_s: FloatArray, forces: Forces
) -> FloatArray:
    """Return points (n, 2) moved as those of the middle particle are by the scene's forces.

    Wide regions stay: the shift is some kilometres.
    """
    chart = AzimuthalEquidistant.about(weight @ unit_vectors(place))
    plane = chart.points(place)
    middle = weight @ plane
    if weight @ np.sum((plane - middle) ** 2, axis=1) > _WIDE_M**2:
        return place
    row = int(np.argmin(np.sum((plane - middle) ** 2, axis=1)))
    there, _ = _impacts(state[row : row + 1], time_s[row : row + 1], forces, 1.0)
    if not np.isfinite(there).all():
        return place
    return chart.places(plane + chart.points(there) - plane[row])


def _moments(place: FloatArray, when_s: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, covariance, and the radii of ellipses that contain the points in the shares `TRACK_CONTAINMENTS`."""
    chart = AzimuthalEquidistant.about(weight @ unit_vectors(place))
    plane = chart.points(place)
    mean = weight @ plane
    columns = np.column_stack([plane - mean, when_s - weight @ when_s])
    covariance = (weight[:, None] * columns).T @ columns + np.diag([1.0, 1.0, 1e-6])
    covariance = 0.5 * (covariance + covariance.T)
    distance = np.sqrt(np.sum(columns[:, :2] * np.linalg.solve(covariance[:2, :2], columns[:, :2].T).T, axis=1))
    order = np.argsort(distance)
    radii = np.interp(TRACK_CONTAINMENTS, np.cumsum(weight[order]), distance[order])
    latitude, longitude = chart.places(mean[None])[0]
    return np.array([latitude, longitude, weight @ when_s]), covariance, radii
