"""Hypotheses and impacts of launched tracks: one weighted ensemble of particles for each.

Some of the particles burn, in proportion to the filter's probability of a burn; the others are
dark, with or without another burn to come. All fly on, and fall, reach an orbit or glide.
Hypotheses, regions, and the probabilities of relights and of coming down are sums over the same
weights.
"""

from collections.abc import Iterator
from itertools import pairwise, starmap

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces
from opir_forecast.burning_particles import burning_particles
from opir_forecast.conditional_impacts import Descents, Impacts, impacts_by_condition
from opir_forecast.dark_particles import dark_particles
from opir_forecast.estimates import BoostEstimates
from opir_forecast.fates import Fates, fates_of, features, glide_ends
from opir_forecast.launch_forecasts import LaunchForecasts
from opir_forecast.outcomes import Outcomes
from opir_forecast.particles import LAW, BurnState, Particles
from opir_forecast.stage_history import StageHistory
from opir_forecast.vehicles import FAMILIES, NONE, SPACE


def forecasts(
    outcomes: Outcomes,
    estimates: BoostEstimates,
    history: StageHistory,
    dark_s: FloatArray,
    time_s: float,
    forces: Forces,
) -> LaunchForecasts:
    """Return the forecasts of tracks (n,) with stages at a time; `dark_s` (n,) is the time since
    the burn ended, if it did.
    """
    particles, burning, relights = _ensemble(outcomes, estimates, history, dark_s, time_s)
    fates = fates_of(outcomes, particles, estimates.launch, dark_s, time_s, forces)
    weight = _hypotheses(outcomes, particles, fates, relights[particles.track, SPACE])
    log_likelihood = estimates.log_likelihood
    weight *= np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))[particles.track]
    weight = weight * (particles.weight * _flying_factors(particles, fates.flies))[:, None]
    weight = _normalised(weight, particles, burning)
    return _gathered(outcomes, particles, fates, weight, burning, forces)


def _burning(estimates: BoostEstimates) -> FloatArray:
    """Return the probabilities (n,) of a burn; improbable modes have none."""
    burning = estimates.burning.copy()
    burning[burning < LAW.least_mode] = 0.0
    burning[burning > 1.0 - LAW.least_mode] = 1.0
    return burning


def _ensemble(
    outcomes: Outcomes,
    estimates: BoostEstimates,
    history: StageHistory,
    dark_s: FloatArray,
    time_s: float,
) -> tuple[Particles, FloatArray, FloatArray]:
    """Return the particles, in order of tracks, the probabilities (n,) of a burn, and of a relight
    by family.
    """
    burning = _burning(estimates)
    model = outcomes.model
    prior = outcomes.families
    relights = np.zeros((len(burning), len(prior)))
    ensembles = []
    lit = np.flatnonzero(burning > 0.0)
    if len(lit):
        particles = burning_particles(model, estimates.take(lit), history.take(lit), prior, time_s)
        ensembles.append(particles.of_tracks(lit))
    dark = np.flatnonzero(burning < 1.0)
    if len(dark):
        particles, relights[dark] = dark_particles(
            model, estimates.take(dark), history.take(dark), prior, dark_s[dark], time_s
        )
        ensembles.append(particles.of_tracks(dark))
    return _in_order_of_tracks(ensembles), burning, relights


def _in_order_of_tracks(ensembles: list[Particles]) -> Particles:
    particles = Particles.concatenate(ensembles)
    return particles.take(np.argsort(particles.track, kind="stable"))


def _hypotheses(
    outcomes: Outcomes, particles: Particles, fates: Fates, relight: FloatArray
) -> FloatArray:
    """Return the densities (p, H) of hypotheses for each particle over those of its family.

    `relight` (p,) is the probability of another burn if the particle is a space launcher.
    """
    missile, orbit, glide, none = outcomes.groups.tolist()
    # Of the vehicles of the broad law, some are of known classes.
    odd = outcomes.odd / max((missile + orbit) * (outcomes.odd + none), 1e-12)
    share = missile / max(missile + glide, 1e-300)
    failure = outcomes.model.data["failure_probability"]
    is_missile, is_launcher, is_broad = np.eye(len(FAMILIES))[particles.family].T
    ends = features(fates.burnt)
    reach = is_launcher * (1.0 - failure) + is_broad * (odd * orbit)
    densities = {
        "missile": (is_missile * share + is_broad * (odd * missile))[:, None]
        * _missile_densities(outcomes, fates, ends[1]),
        "glide": (outcomes.gliding(*ends) * (is_missile * (1.0 - share)))[:, None],
        "orbit": (reach * fates.reach)[:, None],
    }
    density = np.zeros((len(particles), len(outcomes.hypotheses)))
    for group, values in densities.items():
        columns = outcomes.columns(group)
        density[:, columns] = values / (1 if group == "missile" else max(len(columns), 1))
    _put_unlike(density, outcomes, particles, np.isfinite(fates.when_s), relight)
    return density


def _put_unlike(
    density: FloatArray,
    outcomes: Outcomes,
    particles: Particles,
    falls: BoolArray,
    relight: FloatArray,
) -> None:
    """Write the densities (p, H) of `none`, and those of space launches by particles in orbit."""
    none = outcomes.groups[3]
    unlike = none / max(outcomes.odd + none, 1e-12) * np.where(falls, 1.0, LAW.none_orbits)
    unlike *= particles.family == NONE
    is_dark = particles.lit == BurnState.DARK
    launchers = outcomes.columns("orbit")
    if launchers:
        # A particle in orbit is a space launch, whatever has brought it there.
        in_orbit = is_dark & ~falls
        density[:, launchers] += (unlike * in_orbit / len(launchers))[:, None]
        # A stage that has gone out may have been the last one of a failure.
        lost = np.where(is_dark, np.where(falls, 1.0 + relight, 0.0), 1.0)
        failure = outcomes.model.data["failure_probability"]
        unlike = (particles.family == SPACE) * failure * lost + unlike * ~in_orbit
    density[:, outcomes.columns("none")] = unlike[:, None]


def _missile_densities(outcomes: Outcomes, fates: Fates, angle_rad: FloatArray) -> FloatArray:
    """Return the densities (p, classes) of missile classes over that of all boosts."""
    if not outcomes.columns("missile"):
        return np.zeros((len(fates), 0))
    climbing = outcomes.climbing(fates.range_m, angle_rad)
    density = outcomes.missiles(fates.range_m) * climbing[:, None]
    density[np.isnan(fates.range_m) & np.isfinite(fates.when_s)] = outcomes.unknown_range
    return density


def _flying_factors(particles: Particles, flies: BoolArray) -> FloatArray:
    """Return factors (p,): 0 for burns into the ground, more for others, so that each family keeps
    its weight.

    A program that ends in the ground is a bad draw, and no evidence against its family.
    """
    group = (particles.track * len(FAMILIES) + particles.family) * 3 + particles.lit
    drawn = np.bincount(group, particles.weight)
    flying = np.bincount(group, particles.weight * flies)
    factor = flies * drawn[group] / np.maximum(flying[group], 1e-300)
    return np.where(flying[group] > 0.0, factor, 1.0)


def _normalised(weight: FloatArray, particles: Particles, burning: FloatArray) -> FloatArray:
    """Return weights (p, H) that sum to the probability of the filter over the burning, and the
    dark ones of a track."""
    lit = (particles.lit == BurnState.LIT).astype(np.int64)
    group = 2 * particles.track + lit
    total = np.bincount(group, weight.sum(axis=1), 2 * len(burning))
    goal = np.stack([1.0 - burning, burning], axis=1).ravel()
    return weight * (goal / np.maximum(total, 1e-300))[group, None]


def _gathered(
    outcomes: Outcomes,
    particles: Particles,
    fates: Fates,
    weight: FloatArray,
    burning: FloatArray,
    forces: Forces,
) -> LaunchForecasts:
    """Return the forecasts of tracks with weights (p, H) of their particles."""
    count = len(burning)
    missile, orbit, glide, none = (
        weight[:, outcomes.columns(group)].sum(axis=1)
        for group in ("missile", "orbit", "glide", "none")
    )
    is_dark = particles.lit == BurnState.DARK
    # Vehicles of `none` burn on to anywhere: they have no region, but for failed space launchers
    # and dark ones.
    none = none * ((particles.family == SPACE) | is_dark)
    down = np.where(np.isfinite(fates.when_s), missile + none, 0.0)
    relit = weight.sum(axis=1) * (particles.lit == BurnState.RELIT)
    relights, comes_down, in_orbit = (
        _sums(particles.track, values, count) for values in (relit, down + glide, orbit * is_dark)
    )
    given_launch = _given_launch(outcomes, particles.track, weight, count)
    result = LaunchForecasts.without_impacts(given_launch, burning, relights, comes_down, in_orbit)
    falls = np.where(particles.is_free, 0.0, down)
    descents = _descents(outcomes, particles, fates, falls, glide)
    for number, track in enumerate(descents):
        _put_impacts(result, number, impacts_by_condition(track, burning[number], forces))
    return result


def _descents(
    outcomes: Outcomes, particles: Particles, fates: Fates, falls: FloatArray, glide: FloatArray
) -> Iterator[Descents]:
    """Yield the descents of each track, by weights (p,) of ballistic impacts and glides."""
    tracks = np.arange(particles.track[-1] + 2)
    for rows in starmap(slice, pairwise(np.searchsorted(particles.track, tracks).tolist())):
        ends = fates.take(rows)
        glides = glide_ends(outcomes, ends.burnt, ends.burnt_s, glide[rows], falls[rows])
        yield Descents(particles.lit[rows], ends, falls[rows], glides)


def _put_impacts(result: LaunchForecasts, number: int, impacts: list[Impacts]) -> None:
    """Write the impacts of the track with a number into a result."""
    regions = tuple(region for impact in impacts for region in impact.regions)
    result.impact_regions[number] = regions
    if impacts:
        mean, covariance, sigmas = impacts[0].moments
        result.impact[number] = mean
        result.impact_covariance[number] = covariance
        result.impact_sigmas[number] = sigmas


def _given_launch(
    outcomes: Outcomes, track: IntArray, weight: FloatArray, count: int
) -> FloatArray:
    """Return the probabilities (count, H) of hypotheses, by weights (p, H) of tracks' particles."""
    sums = np.stack([_sums(track, column, count) for column in weight.T], axis=1)
    total = sums.sum(axis=1, keepdims=True)
    # No particle explains the track: no class does.
    none = np.eye(sums.shape[1])[outcomes.columns("none")[0]]
    return np.where(total > 1e-9, sums / np.maximum(total, 1e-300), none)


def _sums(track: IntArray, weight: FloatArray, count: int) -> FloatArray:
    """Return the sums (count,) of the weights of each track's particles."""
    return np.bincount(track, weight, count).astype(np.float64)
