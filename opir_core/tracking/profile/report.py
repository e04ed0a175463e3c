"""What the profile fit tells of its tracks: state, launch, burnout and impact with covariances, and the type.

Estimates of a track's hypotheses are blended by their probabilities; the covariance holds what they differ by.
"""

from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve

from opir_core.records import FloatArray, IntArray, Tracks
from opir_core.tracking.profile import flight
from opir_core.tracking.profile.family import BURN, EAST, LIFT, NORTH, RADIUS_M, SIZE, START, Family, Priors
from opir_core.tracking.profile.fit import Hypotheses, family_of
from opir_core.tracking.profile.flight import Moments, off_ground, on_ground

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel

#: A hypothesis less probable than this is left out of the blend.
_LEAST = 1e-3

#: Semi-axes of an ellipse that holds 95 %, standard deviations: the root of χ² of two degrees of freedom.
_SEMI_AXES_95 = np.sqrt(-2.0 * np.log(0.05))


def report(
    hypotheses: Hypotheses,
    probability: FloatArray,
    tick_s: float,
    priors: Priors,
    forces: "ForceModel",
    largest_impact_m: float,
) -> Tracks:
    """Return the estimates at a tick of tracks whose hypotheses (n,) have these probabilities, by track.

    An impact whose 95 % ellipse has a semi-axis longer than `largest_impact_m` is not told.
    """
    kept = np.flatnonzero(probability >= _LEAST)
    hypotheses, weight = hypotheses.take(kept), probability[kept]
    number, row = np.unique(hypotheses.track, return_inverse=True)
    weight = weight / np.bincount(row, weight)[row]
    family = family_of(hypotheses, priors)
    ends, slope = flight.burnouts(family, hypotheses.spread)
    state = flight.states(family, hypotheses.spread, tick_s, ends, slope, forces)
    state.covariance[...] += _doubts(hypotheses, family, tick_s, state.mean, priors)
    places = _launches(hypotheses, family), _impacts(hypotheses, family, ends, slope, priors, forces)
    launch, impact = (_blended(each, weight, row, len(number), True) for each in places)
    state, ends = (_blended(each, weight, row, len(number), False) for each in (state, ends))
    types = np.zeros((len(number), 4))
    np.add.at(types, (row, hypotheses.kind), weight)
    _withhold_vague(impact, largest_impact_m)
    return Tracks(
        tick_s=np.full(len(number), tick_s),
        track=number,
        state=state.mean,
        state_covariance=state.covariance,
        launch=launch.mean,
        launch_covariance=launch.covariance,
        impact=impact.mean,
        impact_covariance=impact.covariance,
        type_probability=types,
        burnout=ends.mean,
        burnout_covariance=ends.covariance,
    )


def _impacts(
    hypotheses: Hypotheses, family: Family, ends: Moments, slope: FloatArray, priors: Priors, forces: "ForceModel"
) -> Moments:
    """Return impacts; where the end of the burn is open, as sums over when it may come."""
    spread, by_end = hypotheses.spread, np.zeros((len(hypotheses), SIZE))
    by_end[:, START], by_end[:, BURN] = 1.0 / family.courses.burn_s, 1.0
    gain = np.sum(spread * by_end[:, None], axis=2)
    variance = np.sum(gain * by_end, axis=1)
    opens = variance > _OPEN**2
    rows, closed = np.flatnonzero(opens), np.flatnonzero(~opens)
    if not len(rows):
        return flight.impacts(ends, slope, spread, forces)
    gain, sigma = gain[rows] / variance[rows, None], np.sqrt(variance[rows])
    left = spread[rows] - variance[rows, None, None] * gain[:, :, None] * gain[:, None]
    nodes, weights = hypotheses.end[rows, 0], hypotheses.end[rows, 1]
    again = np.tile(np.arange(len(rows)), nodes.shape[1])
    parts, left = hypotheses.take(rows[again]), left[again]
    parameters = parts.parameters + gain[again] * (sigma[again] * nodes.T.ravel())[:, None]
    there = flight.burnouts(family_of(evolve(parts, parameters=parameters), priors), left)
    others = flight.open_impacts(ends.take(rows), *there, left, weights, forces)
    if not len(closed):
        return others
    found = flight.impacts(ends.take(closed), slope[closed], spread[closed], forces)
    every = Moments.concatenate([found, others])
    return every.take(np.argsort(np.concatenate([closed, rows])))


#: A burn whose length is less certain than this, of it, has an open end.
_OPEN = 0.01


def _withhold_vague(impact: Moments, largest_m: float) -> None:
    """Take away impacts whose 95 % ellipses are larger than told, m, or of no size."""
    vague = ~(_semi_axis_95(impact.covariance) <= largest_m)
    impact.mean[vague], impact.covariance[vague] = np.nan, np.nan


def _semi_axis_95(covariance: FloatArray) -> FloatArray:
    """Return the larger semi-axes (n,) of the ellipses on the ground that hold 95 %, m; nan of none."""
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    largest = 0.5 * (east + north) + np.hypot(0.5 * (east - north), both)
    semi_axis: FloatArray = _SEMI_AXES_95 * np.sqrt(np.maximum(largest, 0.0))
    return semi_axis


def _doubts(hypotheses: Hypotheses, family: Family, tick_s: float, state: FloatArray, priors: Priors) -> FloatArray:
    """Return the covariances (n, 6, 6) by which states at rest and upright are less certain than slopes say."""
    # What has no heading yet tells no turn either: it is the class's.
    turn_rad = np.where(hypotheses.is_bent > 0, family.courses.turn_rad, priors.turn_rad[hypotheses.kind])
    spread = hypotheses.spread
    return _at_rest(family, spread, tick_s) + _upright(family, spread, tick_s, state, turn_rad)


def _at_rest(family: Family, spread: FloatArray, tick_s: float) -> FloatArray:
    """Return the covariances (n, 6, 6) by which states at rest are less certain than their slopes say.

    A target that is estimated to start later may have started already: it then moves by the time in doubt.
    """
    doubt_s = np.sqrt(spread[:, START, START]) + _START_DOUBT_S
    waits = tick_s <= family.start_s + doubt_s
    sigma = np.concatenate([np.full(3, 0.5 * _ACCELERATION_M_S2), np.full(3, _ACCELERATION_M_S2)])
    times = doubt_s[:, None] ** np.array([2, 2, 2, 1, 1, 1])
    variance = np.where(waits[:, None], np.square(sigma * times), 0.0)
    more: FloatArray = variance[:, :, None] * np.eye(6)
    return more


def _upright(family: Family, spread: FloatArray, tick_s: float, state: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Return the covariances (n, 6, 6) by which states of upright flight are less certain than their slopes say.

    A target that is estimated to pitch over later may have done so already: it then leans by what the time in doubt
    bends it, of the whole turn (n,).
    """
    flown = family.courses
    pitch_s = flown.lift * flown.burn_s
    both = spread[:, START, START] + 2.0 * pitch_s * spread[:, START, LIFT]
    doubt_s = np.sqrt(np.maximum(both + np.square(pitch_s) * spread[:, LIFT, LIFT], 0.0))
    upright = tick_s <= family.start_s + pitch_s + doubt_s
    share = np.minimum(doubt_s / flown.burn_s, 1.0) ** flown.pitch_exponent
    lean = turn_rad * np.sin(0.5 * np.pi * share)
    sideways = 0.5 * lean * np.sqrt(np.sum(np.square(state[:, 3:]), axis=1))
    sigma = np.stack([0.5 * sideways * doubt_s] * 3 + [sideways] * 3, axis=1)
    variance = np.where(upright[:, None], np.square(sigma), 0.0)
    more: FloatArray = variance[:, :, None] * np.eye(6)
    return more


#: How fast a boost sets out, m/s², about, and the least doubt about when it did, s.
_ACCELERATION_M_S2 = 15.0
_START_DOUBT_S = 0.05


def _launches(hypotheses: Hypotheses, family: Family) -> Moments:
    latitude, longitude = hypotheses.anchors.places(hypotheses.parameters)
    chosen = [EAST, NORTH, START]
    covariance = hypotheses.spread[:, chosen][:, :, chosen].copy()
    # A parameter's metres are those of the anchor's circle of latitude.
    shrunk = np.cos(latitude) * RADIUS_M / family.across_m
    covariance[:, 0] *= shrunk[:, None]
    covariance[:, :, 0] *= shrunk[:, None]
    return Moments(np.stack([latitude, longitude, family.start_s], axis=1), covariance)


def _blended(parts: Moments, weight: FloatArray, row: IntArray, count: int, are_places: bool) -> Moments:
    """Return means (count, d) and covariances (count, d, d) of mixtures: `row` says which each part belongs to.

    Parts that are not known, as the impact of a flight that does not come down, leave the whole unknown where they
    are no small part of it.
    """
    known = np.isfinite(parts.mean).all(axis=1) & np.isfinite(parts.covariance).all(axis=(1, 2))
    share = np.bincount(row[known], weight[known], count)
    values, spread, weight, row = parts.mean[known], parts.covariance[known], weight[known], row[known]
    size = parts.mean.shape[1]
    nothing = Moments(np.full((count, size), np.nan), np.full((count, size, size), np.nan))
    if not len(values):
        return nothing
    weight = weight / share[row]
    heaviest = np.zeros(count, dtype=np.int64)
    order = np.argsort(weight, kind="stable")
    heaviest[row[order]] = order
    about = values[heaviest][row]
    away = on_ground(values, about) if are_places else values - about
    mean = np.zeros((count, size))
    np.add.at(mean, row, weight[:, None] * away)
    apart = away - mean[row]
    total = np.zeros((count, size, size))
    np.add.at(total, row, weight[:, None, None] * (spread + apart[:, :, None] * apart[:, None, :]))
    first = values[heaviest]
    told = off_ground(mean, first) if are_places else first + mean
    enough = share > _KNOWN
    nothing.mean[enough], nothing.covariance[enough] = told[enough], total[enough]
    return nothing


#: A mixture is told if parts of it that weigh more than this are.
_KNOWN = 0.9
