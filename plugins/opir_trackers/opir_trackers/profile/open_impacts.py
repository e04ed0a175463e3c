"""Where targets come down while the end of their burn is open: along an arc of ends, and to both sides of each.

A longer burn, and a faster one, takes an impact the farther the farther it already goes: most of all at half an orbit's
speed and more. What is left where the end is known is so not normally distributed on the ground: along the way it is
taken through the flight itself, to second order, and across it is linear.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.profile import flight
from opir_trackers.profile.burnout_speed import Placed, moved_by_speed, placed
from opir_trackers.profile.containing import ContainingArcs
from opir_trackers.profile.family import SPEED, Priors
from opir_trackers.profile.fit import Hypotheses, family_of, plausible
from opir_trackers.profile.flight import HERMITE_NODES, HERMITE_WEIGHTS, Moments, off_ground, on_ground
from opir_trackers.profile.hypotheses import FitMemory
from opir_trackers.profile.parts import given_ends

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel

#: An impact of which less than this share comes down is not known.
_LEAST_KNOWN = 0.3

#: What is less certain than this share of the way flown is straight enough: at half an orbit's speed the bend is then a
#: thirtieth of it.
_STRAIGHT = 0.05

#: Logarithms of how much likelier places are go no farther than this.
_LARGEST = 10.0

#: Nothing is known better on the ground than this, m².
_LEAST_M2 = 1e-12


def open_impacts(
    hypotheses: Hypotheses,
    ends: Moments,
    gain: FloatArray,
    variance: FloatArray,
    priors: Priors,
    forces: "ForceModel",
    memory: FitMemory | None = None,
) -> tuple[Moments, ContainingArcs]:
    """Return impacts (n, 3), as `flight.impacts` does, of burns whose ends are open, and the arcs these lie along.

    `ends` are those of the hypotheses (n,), `variance` (n,) those of the logarithms of the burns' ends, the
    parameters' covariance with which is the gain (n, 10). Impacts are sums over when the burn may end; ends from which
    nothing comes down are left out: targets do. With `memory` all that is remembered is linearised anew at each end.
    """
    count, (nodes, weights) = len(variance), (hypotheses.end[:, 0], hypotheses.end[:, 1])
    parts, left, log = _by_ends(hypotheses, gain, variance, priors, memory)
    spots = _spots(parts, left, priors).by_end(count)
    log = log.reshape(-1, count).T
    log = log - np.log(np.sum(weights * np.exp(log), axis=1, keepdims=True))
    middle = flight.landed(ends.mean)
    centre = middle if forces == "kepler" else flight.forced_impacts(ends.mean, forces)
    known = np.isfinite(spots.point).all(axis=2) & np.isfinite(spots.sides).all(axis=(2, 3))
    known &= np.isfinite(middle[:, :1])
    told = _moments(spots, np.where(known, weights * np.exp(log), 0.0), middle)
    place = off_ground(on_ground(spots.point, middle[:, None]), centre[:, None])
    place[~known] = np.nan
    arcs = ContainingArcs.of(place, spots.sides[:, :, :2], spots.bend[:, :, :2], nodes, hypotheses.end_quantiles, log)
    return Moments(off_ground(told.mean, centre), told.covariance), arcs


def _by_ends(
    hypotheses: Hypotheses, gain: FloatArray, variance: FloatArray, priors: Priors, memory: FitMemory | None
) -> tuple[Hypotheses, FloatArray, FloatArray]:
    """Return hypotheses given when their burns end, all with their first end, and so on: (n k) in all.

    Beside them are the covariances (n k, 10, 10) of what is left, and logarithms (n k,) of how much likelier they are.
    """
    gain, width = gain / variance[:, None], np.sqrt(variance)
    left = hypotheses.spread - variance[:, None, None] * gain[:, :, None] * gain[:, None]
    again = np.tile(np.arange(len(width)), hypotheses.end.shape[2])
    away = width[again] * hypotheses.end[:, 0].T.ravel()
    parts = hypotheses.take(again)
    prior = priors.take(parts.kind)
    parameters = plausible(parts.parameters + gain[again] * away[:, None], prior)
    found = placed(parts.parameters, parameters, left[again], prior, parts.misfit)
    parts = evolve(parts, parameters=plausible(found.parameters, prior))
    if memory is not None:
        parts, found = _linearised_anew(hypotheses, again, parts, found, away, memory)
    return parts, found.spread, np.clip(found.log, -_LARGEST, _LARGEST)


def _linearised_anew(
    hypotheses: Hypotheses, origin: IntArray, parts: Hypotheses, found: Placed, away: FloatArray, memory: FitMemory
) -> tuple[Hypotheses, Placed]:
    """Return parts (m,) of hypotheses (n,), and what was found of them, anew where that is sound.

    `away` (m,) is by how much the logarithms of their burns' lengths differ from those of the hypotheses at `origin`.
    """
    stood = family_of(hypotheses, memory.priors)
    end_s = stood.start_s[origin] + stood.courses.burn_s[origin] * np.exp(away)
    anew = given_ends(hypotheses, origin, parts, end_s, memory)
    sound = np.isfinite(anew.parameters).all(axis=1) & np.isfinite(anew.spread).all(axis=(1, 2))
    sound &= np.isfinite(anew.log)
    found = Placed(
        np.where(sound[:, None], anew.parameters, parts.parameters),
        np.where(sound[:, None, None], anew.spread, found.spread),
        np.where(sound, anew.log, found.log),
    )
    return evolve(parts, parameters=found.parameters), found


class _Spots(NamedTuple):
    """Impacts (m, 3) of ends of burns, and how what is left moves them: east and north of them, m, and in time, s.

    That is two deviates, by `sides` (m, 3, 2), the square of the first, by `bend` (m, 3), and a variance of time (m,).
    The first one leads the way that speed does.
    """

    point: FloatArray
    sides: FloatArray
    bend: FloatArray
    late: FloatArray

    def by_end(self, count: int) -> "_Spots":
        """Return the spots of all first parts of n hypotheses, all second ones, and so on, by hypothesis, (n, k)."""
        return _Spots(*(np.moveaxis(each.reshape(-1, count, *each.shape[1:]), 0, 1) for each in self))


def _spots(parts: Hypotheses, spread: FloatArray, priors: Priors) -> _Spots:
    """Return the impacts of parts (m,), of whose parameters these covariances (m, 10, 10) are left."""
    family = family_of(parts, priors)
    ends, slope = flight.burnouts(family, spread)
    point, linear = flight.sloped_impacts(ends, slope)
    total = flight.through(linear, spread)
    along = linear[:, :2, SPEED] / np.hypot(linear[:, 0, SPEED], linear[:, 1, SPEED])[:, None]
    first = _side(total, along)
    rest = total - first[:, :, None] * first[:, None]
    second = _side(rest, np.stack([-along[:, 1], along[:, 0]], axis=1))
    sides = np.stack([first, second], axis=2)
    late = np.maximum(rest[:, 2, 2] - np.square(second[:, 2]), 0.0)
    spots = _Spots(point, sides, np.zeros_like(point), late)
    flown = on_ground(np.column_stack([*parts.anchors.places(parts.parameters), family.start_s]), point)
    length, way = (np.hypot(each[:, 0], each[:, 1]) for each in (first, flown))
    wide = np.flatnonzero(length > _STRAIGHT * way)
    if len(wide):
        by = np.sum(spread[wide] * np.sum(linear[wide, :2] * along[wide, :, None], axis=1)[:, None], axis=2)
        _bend(spots, wide, parts.take(wide), by / np.sum(first[wide, :2] * along[wide], axis=1)[:, None], priors)
    return spots


def _bend(spots: _Spots, rows: IntArray, parts: Hypotheses, by: FloatArray, priors: Priors) -> None:
    """Write first sides and bends of some spots: through where parts moved by steps (r, 10) either way come down."""
    count, sigmas = len(rows), float(HERMITE_NODES[2])
    parts = parts.take(np.tile(np.arange(count), 2))
    step = np.concatenate([sigmas * by, -sigmas * by])
    parameters = moved_by_speed(parts.parameters, step, sigmas, priors.take(parts.kind), parts.misfit)
    family = family_of(evolve(parts, parameters=parameters), priors)
    places = family.places(np.arange(2 * count), family.burnout_s)
    ends = np.column_stack([places.position_m, places.velocity_m_s, family.burnout_s])
    ahead, behind = on_ground(flight.landed(ends).reshape(2, count, 3), spots.point[rows])
    # What does not come down there, or once about the Earth, stays straight.
    known = np.isfinite(ahead + behind).all(axis=1) & (np.sum(ahead[:, :2] * behind[:, :2], axis=1) < 0.0)
    rows, ahead, behind = rows[known], ahead[known], behind[known]
    spots.sides[rows, :, 0] = (ahead - behind) / (2.0 * sigmas)
    spots.bend[rows] = (ahead + behind) / (2.0 * sigmas**2)


def _side(covariance: FloatArray, direction: FloatArray) -> FloatArray:
    """Return what a standard deviation in directions (m, 2) on the ground moves, (m, 3), by covariances (m, 3, 3)."""
    moved = np.einsum("nij,nj->ni", covariance[:, :, :2], direction)
    variance = np.sum(moved[:, :2] * direction, axis=1)
    side: FloatArray = moved / np.sqrt(np.maximum(variance, _LEAST_M2))[:, None]
    return side


def _moments(spots: _Spots, weights: FloatArray, middle: FloatArray) -> Moments:
    """Return means and covariances (n, 3), from `middle` (n, 3) on, of impacts at ends (n, k) of these weights."""
    total = weights.sum(axis=1)
    share = weights / np.where(total > _LEAST_KNOWN, total, np.nan)[:, None]
    known = share > 0.0
    first, second = (grid.ravel() for grid in np.meshgrid(HERMITE_NODES, HERMITE_NODES, indexing="ij"))
    turn, both = np.stack([first, second], axis=1), np.outer(HERMITE_WEIGHTS, HERMITE_WEIGHTS).ravel()
    moved = np.einsum("nkis,ps->nkpi", spots.sides, turn) + np.square(first)[:, None] * spots.bend[:, :, None]
    away = on_ground(off_ground(moved, spots.point[:, :, None]), middle[:, None, None])
    away[~known] = 0.0
    weight = share[:, :, None] * both
    mean = np.einsum("nkp,nkpi->ni", weight, away)
    apart = away - mean[:, None, None]
    covariance = np.einsum("nkp,nkpi,nkpj->nij", weight, apart, apart)
    covariance[:, 2, 2] += np.sum(share * np.where(known, spots.late, 0.0), axis=1)
    return Moments(mean, covariance)
