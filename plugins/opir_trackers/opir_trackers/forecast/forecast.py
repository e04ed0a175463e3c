"""What launched tracks are and where they come down: one weighted ensemble of particles for each.

A part of the particles burns, in proportion to the filter's probability of a burn; the others are
dark now, with or without another burn to come. All fly on, and fall, reach an orbit or glide.
Hypotheses, regions, and the probabilities of relights and of coming down are sums over the same
weights.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray, ObjectArray
from opir_core.flight import Forces
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast import gliders
from opir_trackers.forecast.burning_particles import burning_particles
from opir_trackers.forecast.conditional_impacts import impacts_by_condition
from opir_trackers.forecast.dark_particles import dark_particles
from opir_trackers.forecast.fates import Fates, fates_of, features
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.particles import Particles
from opir_trackers.forecast.stage_history import StageHistory
from opir_trackers.forecast.vehicles import FAMILIES, NONE, SPACE

#: Relative weight of what is none of these and does not fall: of such boosts a third gains more
#: than an orbit needs.
_NONE_ORBITS = 0.3

#: A mode that is less probable gets no particles.
_LEAST_MODE = 0.01


class Forecasts(NamedTuple):
    """What tracks (n,) are, given that they were launched, and where they come down.

    `given_launch` (n, H) are the probabilities of the hypotheses: 0 for those that are no launch,
    but `none`. `impact` and its moments are those of the most probable condition, whose `regions`
    come first. The probabilities are of a burn now, of another one later, of coming down, and of an
    orbit in which nothing burns any more.
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
    """Return the forecasts of tracks (n,) with stages and launches (n, 3), nan where unknown, at a
    time.

    `dark_s` (n,) is the time since the burn ended, if it did, `log_likelihood` (n, H) that of what
    sensors reported.
    """
    particles, burning, relights = _ensemble(outcomes, estimates, history, dark_s, time_s)
    fates = fates_of(outcomes, particles, launch, dark_s, time_s, forces)
    weight = _hypotheses(outcomes, particles, fates, relights, log_likelihood)
    weight = _normalised(weight, particles, burning)
    return _gathered(outcomes, particles, fates, weight, burning, forces)


def _ensemble(
    outcomes: Outcomes,
    estimates: ModeEstimates,
    history: StageHistory,
    dark_s: FloatArray,
    time_s: float,
) -> tuple[Particles, FloatArray, FloatArray]:
    """Return the particles, in order of tracks, the probabilities (n,) of a burn, and of a relight
    by family.
    """
    burning = estimates.weight[:, 0].copy()
    burning[burning < _LEAST_MODE] = 0.0
    burning[burning > 1.0 - _LEAST_MODE] = 1.0
    model = outcomes.model
    prior = outcomes.families
    relights = np.zeros((len(burning), len(outcomes.families)))
    parts = []
    on = np.flatnonzero(burning > 0.0)
    off = np.flatnonzero(burning < 1.0)
    if len(on):
        part = burning_particles(model, estimates.take(on), history.take(on), prior, time_s)
        parts.append(part.of_tracks(on))
    if len(off):
        part, relights[off] = dark_particles(
            model, estimates.take(off), history.take(off), prior, dark_s[off], time_s
        )
        parts.append(part.of_tracks(off))
    every = Particles.concatenate(parts)
    return every.take(np.argsort(every.track, kind="stable")), burning, relights


def _hypotheses(
    outcomes: Outcomes,
    particles: Particles,
    fates: Fates,
    relights: FloatArray,
    log_likelihood: FloatArray,
) -> FloatArray:
    """Return the weights (p, H) of hypotheses for each particle; those of failed space launchers
    are of `none`.
    """
    missile, orbit, glide, none = outcomes.groups.tolist()
    columns = {group: outcomes.columns(group) for group in ("missile", "orbit", "glide", "none")}
    weight = np.zeros((len(particles), len(outcomes.hypotheses)))
    space = particles.family == SPACE
    broad = particles.family == NONE
    first = ~space & ~broad
    # Of the vehicles of the broad law, some are of known classes.
    odd = outcomes.odd / max((missile + orbit) * (outcomes.odd + none), 1e-12)
    if missile + glide > 0.0:
        share = missile / (missile + glide)
        unknown = np.isnan(fates.range_m) & np.isfinite(fates.when_s)
        ends = features(fates.burnt)
        by_class = (
            outcomes.missiles(fates.range_m) * outcomes.climbing(fates.range_m, ends[1])[:, None]
        )
        by_class[unknown] = outcomes.unknown_range
        weight[np.ix_(first, columns["missile"])] = share * by_class[first]
        weight[np.ix_(broad, columns["missile"])] = odd * missile * by_class[broad]
        if columns["glide"]:
            each = outcomes.gliding(*ends) * (1.0 - share) / len(columns["glide"])
            weight[np.ix_(first, columns["glide"])] = each[first, None]
    if columns["orbit"]:
        # A stage that has gone out may have been the last one of a failure.
        failure = outcomes.model.data["failure_probability"]
        weight[np.ix_(space, columns["orbit"])] = (
            (1.0 - failure) * fates.reach / len(columns["orbit"])
        )[space, None]
        over = space & (particles.lit == 0)
        lost = np.where(
            over,
            np.where(np.isfinite(fates.when_s), 1.0 + relights[particles.track, SPACE], 0.0),
            1.0,
        )
        weight[np.ix_(space, columns["none"])] = (failure * lost)[space, None]
        weight[np.ix_(broad, columns["orbit"])] = (
            odd * orbit * fates.reach / len(columns["orbit"])
        )[broad, None]
    other = (
        none
        / max(outcomes.odd + none, 1e-12)
        * np.where(np.isfinite(fates.when_s), 1.0, _NONE_ORBITS)
    )
    # What is in orbit is a space launch, whatever has brought it there.
    up = broad & (particles.lit == 0) & np.isnan(fates.when_s) & bool(columns["orbit"])
    weight[np.ix_(up, columns["orbit"])] += other[up, None] / max(len(columns["orbit"]), 1)
    weight[np.ix_(broad & ~up, columns["none"])] = other[broad & ~up, None]
    weight *= np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))[particles.track]
    return weight * (particles.weight * _of_flying(particles, fates.flies))[:, None]


def _of_flying(particles: Particles, flies: BoolArray) -> FloatArray:
    """Return factors (p,): 0 for burns into the ground, more for others, so that each family keeps
    its weight.

    A program that ends in the ground is a bad draw, and says nothing against its family.
    """
    group = (particles.track * len(FAMILIES) + particles.family) * 3 + particles.lit
    drawn = np.bincount(group, particles.weight)
    left = np.bincount(group, particles.weight * flies)
    factor: FloatArray = np.where(
        left[group] > 0.0, flies * drawn[group] / np.maximum(left[group], 1e-300), 1.0
    )
    return factor


def _normalised(weight: FloatArray, particles: Particles, burning: FloatArray) -> FloatArray:
    """Return weights (p, H) that sum to the probability of the filter over the burning, and the
    dark ones of a track."""
    lit = (particles.lit == 1).astype(np.int64)
    group = 2 * particles.track + lit
    total = np.bincount(group, weight.sum(axis=1), 2 * len(burning))
    goal = np.stack([1.0 - burning, burning], axis=1).ravel()
    scaled: FloatArray = weight * (goal / np.maximum(total, 1e-300))[group, None]
    return scaled


def _gathered(
    outcomes: Outcomes,
    particles: Particles,
    fates: Fates,
    weight: FloatArray,
    burning: FloatArray,
    forces: Forces,
) -> Forecasts:
    count = len(burning)
    given = np.stack([_sums(particles.track, column, count) for column in weight.T], axis=1)
    whole = given.sum(axis=1, keepdims=True)
    # No particle explains the track: none of these does.
    nothing = np.eye(given.shape[1])[outcomes.columns("none")[0]]
    given = np.where(whole > 1e-9, given / np.maximum(whole, 1e-300), nothing)
    orbit, glide = (weight[:, outcomes.columns(group)].sum(axis=1) for group in ("orbit", "glide"))
    # What is none of these burns on to anywhere: it has no region, but for failed space launchers
    # and what is dark.
    other = weight[:, outcomes.columns("none")].sum(axis=1) * (
        (particles.family == SPACE) | (particles.lit == 0)
    )
    down = np.where(
        np.isfinite(fates.when_s), weight[:, outcomes.columns("missile")].sum(axis=1) + other, 0.0
    )
    falls = np.where(particles.is_free, 0.0, down)
    found = Forecasts(
        given,
        np.full((count, 3), np.nan),
        np.full((count, 3, 3), np.nan),
        np.full((count, 3), np.nan),
        np.empty(count, dtype=np.object_),
        burning,
        _sums(particles.track, weight.sum(axis=1) * (particles.lit == 2), count),
        _sums(particles.track, down + glide, count),
        _sums(particles.track, orbit * (particles.lit == 0), count),
    )
    edges = np.searchsorted(particles.track, np.arange(count + 1)).tolist()
    for number, rows in enumerate(map(slice, edges[:-1], edges[1:])):
        glided = gliders.reached(
            outcomes, fates.burnt[rows], fates.burnt_s[rows], glide[rows], falls[rows]
        )
        impacts = impacts_by_condition(
            particles.lit[rows], burning[number], rows, fates, falls, glided, forces
        )
        found.regions[number] = tuple(region for one in impacts for region in one.regions)
        if impacts:
            found.impact[number], found.covariance[number], found.sigmas[number] = impacts[
                0
            ].moments
    return found


def _sums(track: IntArray, weight: FloatArray, count: int) -> FloatArray:
    """Return the sums (count,) of the weights of each track's particles."""
    return np.bincount(track, weight, count).astype(np.float64)
