"""What launched tracks are and where they come down: one weighted ensemble of particles for each.

A part of the particles burns, in proportion to the filter's probability of a burn; the others are dark now, with or
without another burn to come. All fly on, and fall, reach an orbit or glide. Hypotheses, regions, and the probabilities
of relights and of coming down are sums over the same weights.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray, ObjectArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from opir_core.estimation import dot
from opir_core.flight import Forces
from opir_core.geometry import AzimuthalEquidistant, ecef_to_geodetic, great_circle_m, unit_vectors
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.thrust import air_velocity
from opir_trackers.forecast import gliders
from opir_trackers.forecast.burning_on import STEPS, TILT_S, Steering, drawn_steering, flown_on
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.particles import AGAIN, BURNING, OVER, Particles, burning_particles, dark_particles
from opir_trackers.forecast.regions import regions
from opir_trackers.forecast.stage_history import StageHistory
from opir_trackers.forecast.vehicles import FAMILIES, NONE, SPACE, STAGES, VehicleModel
from opir_trackers.lines_of_sight import earth_rotated

#: Standard deviation of the tilt of the thrust from a program, least and largest, rad: log-uniform over particles. And
#: its share sidewards: boosts keep to their plane. Notional.
TILT_RAD, SIDEWARDS = np.radians([0.3, 4.0]), 0.5

#: A tilt of the filter counts up to this angle, rad, above this speed, m/s.
_TILT_MOST, _FAST_M_S = np.radians(15.0), 150.0

#: Programs that each particle chooses from; how well the filter knows the angle of the thrust, rad, and the share of it
#: by which it is wrong, as it expects none.
CHOICES, _STRIDE, _LEAD_RAD, _LEAD_SHARE = 8, 61, np.radians(1.5), 0.25

#: A burn that leads this far below the ground, m, is none.
_BELOW_M = 300.0

#: A region above this size, m, is not moved by forces other than a point mass's.
_WIDE_M = 200e3

#: A condition with less probability, or with fewer effective samples, has no region.
LEAST_PROBABILITY, LEAST_SAMPLES = 0.02, 8.0

#: Relative weight of what is none of these and does not fall: of such boosts a third gains more than an orbit needs.
_NONE_ORBITS = 0.3

#: A mode that is less probable gets no particles; a particle with a lesser share of the largest weight does not count.
_LEAST_MODE, _LEAST_WEIGHT = 0.01, 1e-4


class Forecasts(NamedTuple):
    """What tracks (n,) are, given that they were launched, and where they come down.

    `given_launch` (n, H) are the probabilities of the hypotheses: 0 for those that are no launch, but `none`. `impact`
    and its moments are those of the most probable condition, whose `regions` come first. The probabilities are of a
    burn now, of another one later, of coming down, and of an orbit in which nothing burns any more.
    """

    given_launch: FloatArray
    impact: FloatArray
    covariance: FloatArray
    sigmas: FloatArray
    regions: ObjectArray
    probability_burning: FloatArray
    probability_relights: FloatArray
    probability_comes_down: FloatArray
    in_orbit: FloatArray


def forecasts(
    outcomes: Outcomes,
    estimates: ModeEstimates,
    history: StageHistory,
    dark_s: FloatArray,
    launch: FloatArray,
    log_likelihood: FloatArray,
    time_s: float,
    forces: Forces,
) -> Forecasts:
    """Return the forecasts of tracks (n,) with stages and launches (n, 3), nan where unknown, at a time.

    `dark_s` (n,) is the time since the burn ended, if it did, `log_likelihood` (n, H) that of what sensors reported.
    """
    particles, burning, relights = _ensemble(outcomes, estimates, history, dark_s, time_s)
    fates = _fates(outcomes, particles, launch, time_s, forces)
    weight = _hypotheses(outcomes, particles, fates, relights, log_likelihood)
    weight = _normalised(weight, particles, burning)
    return _gathered(outcomes, particles, fates, weight, burning, forces)


def _ensemble(
    outcomes: Outcomes, estimates: ModeEstimates, history: StageHistory, dark_s: FloatArray, time_s: float
) -> tuple[Particles, FloatArray, FloatArray]:
    """Return the particles, in order of tracks, the probabilities (n,) of a burn, and of a relight by family."""
    burning = estimates.weight[:, 0].copy()
    burning[burning < _LEAST_MODE], burning[burning > 1.0 - _LEAST_MODE] = 0.0, 1.0
    model, prior, relights = outcomes.model, outcomes.families, np.zeros((len(burning), len(outcomes.families)))
    parts = []
    on, off = np.flatnonzero(burning > 0.0), np.flatnonzero(burning < 1.0)
    if len(on):
        part = burning_particles(model, estimates.take(on), history.take(on), prior, time_s)
        parts.append(part.of_tracks(on))
    if len(off):
        part, relights[off] = dark_particles(model, estimates.take(off), history.take(off), prior, dark_s[off], time_s)
        parts.append(part.of_tracks(off))
    every = Particles.concatenate(parts)
    return every.take(np.argsort(every.track, kind="stable")), burning, relights


class _Fates(NamedTuple):
    """What becomes of particles (p,): inertial states at the ends of their burns, times and places of impact, ranges.

    `place` (p, 2) and `when_s`, since the scene's start, are nan where nothing falls; `range_m` is nan too without a
    launch. `origin` (p, 2) is the place of the particle's track now. `reach` (p,) is the relative probability of an
    orbit, `flies` says whether the burn stays above the ground.
    """

    state: FloatArray
    out_s: FloatArray
    place: FloatArray
    when_s: FloatArray
    range_m: FloatArray
    reach: FloatArray
    flies: BoolArray
    origin: FloatArray


def _fates(outcomes: Outcomes, particles: Particles, launch: FloatArray, time_s: float, forces: Forces) -> _Fates:
    space, able = particles.family == SPACE, (particles.family == SPACE) | (particles.family == NONE)
    reach = np.zeros(len(particles))
    mine = np.flatnonzero(able & (particles.lit > 0))
    reach[mine] = outcomes.reaching(particles.state[mine], particles.take(mine))
    angle = _thrust_angles(particles)
    steering = _steered(_steering(outcomes.model), particles, angle)
    own = angle - np.where(particles.lit == 1, steering.leads(particles.since_s), 0.0)[:, None] * [1.0, 0.0]
    tilt = _tilts()[:, :, particles.draw] + _DECAY[:, :, None, None] * np.clip(own, -_TILT_MOST, _TILT_MOST)
    # What falls of a space launcher has failed, at any time.
    flown = particles.cut_off(np.where(space, _SHARES[particles.draw], 1.0))
    out, later_s, least_m = flown_on(particles.state, flown, steering, tilt)
    place, when_s = _impacts(out, time_s + later_s, forces)
    known = np.isfinite(launch[:, 0])
    start = np.where(known[:, None], launch, 0.0)[particles.track]
    range_m = np.where(known[particles.track], great_circle_m(start, place), np.nan)
    dark = able & (particles.lit == 0)
    reach[dark] = np.where(np.isfinite(when_s[dark]), 0.0, 1.0 / outcomes.model.data["marginal"]["orbit"])
    flies = space | (least_m > local_radius_m(out) - _BELOW_M)
    return _Fates(out, time_s + later_s, place, when_s, range_m, reach, flies, _below(particles, time_s))


def _hypotheses(
    outcomes: Outcomes, particles: Particles, fates: _Fates, relights: FloatArray, log_likelihood: FloatArray
) -> FloatArray:
    """Return the weights (p, H) of hypotheses for each particle; those of failed space launchers are of `none`."""
    missile, orbit, glide, none = outcomes.groups.tolist()
    columns = {group: outcomes.columns(group) for group in ("missile", "orbit", "glide", "none")}
    weight = np.zeros((len(particles), len(outcomes.hypotheses)))
    space, broad = particles.family == SPACE, particles.family == NONE
    first = ~space & ~broad
    # Of the vehicles of the broad law, some are of known classes.
    odd = outcomes.odd / max((missile + orbit) * (outcomes.odd + none), 1e-12)
    if missile + glide > 0.0:
        share = missile / (missile + glide)
        unknown = np.isnan(fates.range_m) & np.isfinite(fates.when_s)
        by_class = outcomes.missiles(fates.range_m) * outcomes.lofting(fates.range_m, fates.state)[:, None]
        by_class[unknown] = outcomes.unknown_range
        weight[np.ix_(first, columns["missile"])] = share * by_class[first]
        weight[np.ix_(broad, columns["missile"])] = odd * missile * by_class[broad]
        if columns["glide"]:
            each = outcomes.gliding(*features(fates.state)) * (1.0 - share) / len(columns["glide"])
            weight[np.ix_(first, columns["glide"])] = each[first, None]
    if columns["orbit"]:
        # A stage that has gone out may have been the last one of a failure.
        failure = outcomes.model.data["failure_probability"]
        weight[np.ix_(space, columns["orbit"])] = ((1.0 - failure) * fates.reach / len(columns["orbit"]))[space, None]
        over = space & (particles.lit == 0)
        lost = np.where(over, np.where(np.isfinite(fates.when_s), 1.0 + relights[particles.track, SPACE], 0.0), 1.0)
        weight[np.ix_(space, columns["none"])] = (failure * lost)[space, None]
        weight[np.ix_(broad, columns["orbit"])] = (odd * orbit * fates.reach / len(columns["orbit"]))[broad, None]
    other = none / max(outcomes.odd + none, 1e-12) * np.where(np.isfinite(fates.when_s), 1.0, _NONE_ORBITS)
    weight[np.ix_(broad, columns["none"])] = other[broad, None]
    weight *= np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))[particles.track]
    return weight * (particles.weight * _of_flying(particles, fates.flies))[:, None]


def _of_flying(particles: Particles, flies: BoolArray) -> FloatArray:
    """Return factors (p,): 0 for burns into the ground, more for others, so that each family keeps its weight.

    A program that ends in the ground is a bad draw, and says nothing against its family.
    """
    group = (particles.track * len(FAMILIES) + particles.family) * 3 + particles.lit
    drawn, left = np.bincount(group, particles.weight), np.bincount(group, particles.weight * flies)
    factor: FloatArray = np.where(left[group] > 0.0, flies * drawn[group] / np.maximum(left[group], 1e-300), 1.0)
    return factor


def _normalised(weight: FloatArray, particles: Particles, burning: FloatArray) -> FloatArray:
    """Return weights (p, H) that sum to the probability of the filter over the burning, and the dark ones of a
    track."""
    lit = (particles.lit == 1).astype(np.int64)
    group = 2 * particles.track + lit
    total = np.bincount(group, weight.sum(axis=1), 2 * len(burning))
    goal = np.stack([1.0 - burning, burning], axis=1).ravel()
    scaled: FloatArray = weight * (goal / np.maximum(total, 1e-300))[group, None]
    return scaled


def _gathered(
    outcomes: Outcomes, particles: Particles, fates: _Fates, weight: FloatArray, burning: FloatArray, forces: Forces
) -> Forecasts:
    count = len(burning)
    given = np.stack([np.bincount(particles.track, column, count) for column in weight.T], axis=1)
    whole = given.sum(axis=1, keepdims=True)
    # No particle explains the track: none of these does.
    nothing = np.eye(given.shape[1])[outcomes.columns("none")[0]]
    given = np.where(whole > 1e-9, given / np.maximum(whole, 1e-300), nothing)
    orbit, glide = (weight[:, outcomes.columns(group)].sum(axis=1) for group in ("orbit", "glide"))
    # What is none of these comes down anywhere, or not: it has no region, but for failed space launchers.
    failed = weight[:, outcomes.columns("none")].sum(axis=1) * (particles.family == SPACE)
    falls = np.where(np.isfinite(fates.when_s), weight[:, outcomes.columns("missile")].sum(axis=1) + failed, 0.0)
    sums: Any = np.bincount
    found = Forecasts(
        given,
        np.full((count, 3), np.nan),
        np.full((count, 3, 3), np.nan),
        np.full((count, 3), np.nan),
        np.empty(count, dtype=np.object_),
        burning,
        sums(particles.track, weight.sum(axis=1) * (particles.lit == 2), count),
        sums(particles.track, falls + glide, count),
        sums(particles.track, orbit * (particles.lit == 0), count),
    )
    edges = np.searchsorted(particles.track, np.arange(count + 1)).tolist()
    for number, rows in enumerate(map(slice, edges[:-1], edges[1:])):
        glided = gliders.reached(outcomes, fates.state[rows], fates.out_s[rows], glide[rows], falls[rows])
        impacts = _by_condition(particles.lit[rows], burning[number], rows, fates, falls, glided, forces)
        found.regions[number] = tuple(region for one in impacts for region in one.regions)
        if impacts:
            found.impact[number], found.covariance[number], found.sigmas[number] = impacts[0].moments
    return found


def _by_condition(lit: IntArray, burning: float, *rest: Any) -> "list[_Impacts]":
    """Return the impacts of a track under each condition, the most probable first.

    What probably burns comes down or not. What is dark comes down as it is, or burns on: again, or still.
    """
    if burning > 0.5:
        sets = [(IMPACT_CONDITIONS[0], np.ones(len(lit), dtype=np.bool_))]
    else:
        sets = [(IMPACT_CONDITIONS[1], lit == 0), (IMPACT_CONDITIONS[2], lit > 0)]
    impacts = (_conditional(condition, mine, *rest) for condition, mine in sets)
    return sorted((one for one in impacts if one is not None), key=lambda one: -one.probability)


class _Impacts(NamedTuple):
    """Regions and moments of the impacts under a condition, and its probability."""

    probability: float
    regions: tuple[ImpactRegion, ...]
    moments: tuple[FloatArray, FloatArray, FloatArray]


def _conditional(
    condition: str,
    mine: BoolArray,
    rows: slice,
    fates: _Fates,
    falls: FloatArray,
    glided: "gliders.GlideEnds | None",
    forces: Forces,
) -> _Impacts | None:
    """Return the impacts of a track's particles `mine`, or None if they are improbable or too few count."""
    weight = np.where(mine, falls[rows], 0.0)
    glides = np.zeros(0) if glided is None else np.where(mine, glided.weight, 0.0)
    probability = float(weight.sum() + glides.sum())
    if not probability > LEAST_PROBABILITY:
        return None
    samples = probability**2 / float(np.sum(weight * weight) + np.sum(glides * glides))
    if samples < LEAST_SAMPLES:
        return None
    kept = np.flatnonzero(weight > _LEAST_WEIGHT * weight.max(initial=0.0))
    points, when_s, share = fates.place[rows][kept], fates.when_s[rows][kept], weight[kept]
    if not forces.is_kepler and len(kept):
        points = _shifted(points, share / share.sum(), fates.state[rows][kept], fates.out_s[rows][kept], forces)
    if glided is not None and glides.any():
        which = np.flatnonzero(glides > 0.0)
        points = np.concatenate([points, glided.place[which]])
        when_s, share = np.concatenate([when_s, glided.when_s[which]]), np.concatenate([share, glides[which]])
    share = share / share.sum()
    found = regions(points, share, condition, probability, samples, fates.origin[rows.start])
    return _Impacts(probability, found, _moments(points, when_s, share))


@cache
def _steering(model: VehicleModel) -> Steering:
    """Return the steering of all draws."""
    return drawn_steering(BURNING + OVER + AGAIN, model.data, 3)


#: Shares of the remaining burn after which failed launches go dark, by draw.
_SHARES = np.random.default_rng(4).random(BURNING + OVER + AGAIN)

#: Numbers by which programs are chosen, by draw.
_PICKS = np.random.default_rng(6).random(BURNING + OVER + AGAIN)

_KEEP = np.exp(-10.0 / TILT_S)

#: What is left of a present tilt (STAGES, STEPS) in each step.
_DECAY = _KEEP ** (1.0 + np.arange(STAGES * STEPS).reshape(STAGES, STEPS))


@cache
def _tilts() -> FloatArray:
    """Return angles (STAGES, STEPS, draws, 2), rad: Gauss-Markov processes from step to step that begin at 0."""
    rng = np.random.default_rng(2)
    size = BURNING + OVER + AGAIN
    sigma = (TILT_RAD[0] * (TILT_RAD[1] / TILT_RAD[0]) ** rng.random(size))[:, None]
    noise = rng.normal(size=(STAGES * STEPS, size, 2))
    tilt = np.zeros_like(noise)
    for step in range(len(tilt)):
        tilt[step] = _KEEP * (tilt[step - 1] if step else 0.0) + np.sqrt(1.0 - _KEEP * _KEEP) * noise[step]
    angles: FloatArray = (tilt * sigma * [1.0, SIDEWARDS]).reshape(STAGES, STEPS, size, 2)
    return angles


def _thrust_angles(particles: Particles) -> FloatArray:
    """Return the angles (p, 2), rad, of the thrust from the velocity, downwards and sidewards; 0 in the dark or
    slow."""
    rows = np.flatnonzero(particles.lit == 1)
    angle = np.zeros((len(particles), 2))
    state, force = particles.state[rows], particles.force[rows]
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity) + 1.0)
    side = np.cross(velocity, state[:, :3])
    down = np.cross(velocity, side)
    ahead = np.maximum(dot(force, velocity) / speed, 1.0)
    parts = [dot(force, axis) / np.sqrt(dot(axis, axis) + 1.0) for axis in (down, side)]
    angle[rows] = np.arctan2(np.stack(parts, axis=1), ahead[:, None]) * (speed > _FAST_M_S)[:, None]
    return angle


def _steered(every: Steering, particles: Particles, angle: FloatArray) -> Steering:
    """Return the programs (p,) of particles: of some draws for each, one that fits the present angle of its thrust."""
    choice = (particles.draw[:, None] + _STRIDE * np.arange(CHOICES)) % len(every)
    leads = every.take(choice.ravel()).leads(np.repeat(particles.since_s, CHOICES)).reshape(choice.shape)
    sigma = _LEAD_RAD + _LEAD_SHARE * np.abs(leads)
    away = (angle[:, :1] - leads) / sigma
    weight = np.where((particles.lit == 1)[:, None], np.exp(-0.5 * away * away) / sigma + 1e-9, 1.0)
    total = np.cumsum(weight, axis=1)
    picked = np.sum(total < total[:, -1:] * _PICKS[particles.draw, None], axis=1).clip(0, CHOICES - 1)
    return every.take(choice[np.arange(len(choice)), picked])


def features(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heights m, flight-path angles rad and speeds m/s through the air of inertial states (p, 6)."""
    radius = np.sqrt(dot(state[:, :3], state[:, :3]))
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity))
    climb = dot(state[:, :3], velocity) / np.maximum(radius * speed, 1.0)
    return radius - local_radius_m(state), np.arcsin(np.clip(climb, -1.0, 1.0)), speed


def _below(particles: Particles, time_s: float) -> FloatArray:
    """Return the latitudes and longitudes (p, 2), rad, below the first particles of each one's track now."""
    first = np.searchsorted(particles.track, np.unique(particles.track))
    now = ecef_to_geodetic(earth_rotated(particles.state[first, :3], np.full(len(first), -time_s)))
    place = np.stack([now.latitude_rad, now.longitude_rad], axis=1)
    return place[np.cumsum(np.diff(particles.track, prepend=particles.track[:1]) > 0)]


def local_radius_m(state: FloatArray) -> FloatArray:
    """Return the radius (p,), m, of the ellipsoid below states (p, 6), to 50 m: a(1 - f sin² φ)."""
    sine = state[:, 2] / np.sqrt(dot(state[:, :3], state[:, :3]))
    radius: FloatArray = EARTH_EQUATORIAL_RADIUS_M * (1.0 - EARTH_FLATTENING * sine * sine)
    return radius


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
