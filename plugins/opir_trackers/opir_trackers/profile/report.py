"""What the profile fit tells of its tracks: state, launch, burnout and impact with covariances, and the type.

Estimates of a track's hypotheses are blended by their probabilities; the covariance holds what they differ by. Beside
the impact's covariance is told how far its ellipses reach that hold what they say (`containing`), and beside the
state's, its ellipsoids (`holding`).

By how much states at rest, and of upright flight, are less certain than slopes say.

How far ellipsoids of states reach that hold what they say, where a state's distribution is a mixture.

Mean and covariance of what one sensor knows are its own, and yet most states lie nearer than those of a normal
distribution and a few far off. The squared distance of a normal distribution from another's middle is a sum of χ²
variables, which is told by its first three cumulants (Hall, Buckley and Eagleson; Buckley and Eagleson, Austral. J.
Statist. 30A, 1988, 150): exact where both are one, and to a hundredth of what is held where a mixture differs.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.records import TRACK_CONTAINMENTS, Tracks
from opir_trackers.profile import flight
from opir_trackers.profile.containing import ContainingArcs, containing_sigmas
from opir_trackers.profile.family import EAST, LIFT, NORTH, RADIUS_M, START, Family, Priors
from opir_trackers.profile.fit import Hypotheses, family_of
from opir_trackers.profile.flight import Moments, off_ground, on_ground
from opir_trackers.profile.hypotheses import FitMemory
from opir_trackers.profile.open_impacts import open_impacts
from opir_trackers.profile.thrust_end import with_ends

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel

#: How fast a boost sets out, m/s², about, and the least doubt about when it did, s.
_ACCELERATION_M_S2 = 15.0
_START_DOUBT_S = 0.05


def doubts(hypotheses: Hypotheses, family: Family, tick_s: float, state: FloatArray, priors: Priors) -> FloatArray:
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


#: Squared distances at which is counted what they hold: of six dimensions, no more than a twentieth lies beyond 120.
_SQUARES = np.geomspace(0.5, 130.0, 64)

#: No direction of a correlation is known better than this.
_LEAST_CORRELATION = 1e-12


def holding_sigmas(parts: Moments, weight: FloatArray, row: IntArray, told: Moments) -> FloatArray:
    """Return the radii (count, 3) of ellipsoids of told states that hold `TRACK_CONTAINMENTS` of their parts' mixture.

    They are in standard deviations of the told covariances (count, d, d); parts (n,) belong to the told ones of `row`
    (n,), with weights (n,). nan where there is one part, which is normally distributed, or one that is not known.
    """
    from scipy.special import gammainc

    count = len(told)
    found = np.full((count, len(TRACK_CONTAINMENTS)), np.nan)
    known = [
        np.isfinite(each.mean).all(axis=1) & np.isfinite(each.covariance).all(axis=(1, 2)) for each in (parts, told)
    ]
    unknown = np.bincount(row, ~known[0], count) > 0
    mixed = known[1] & ~unknown & (np.bincount(row, minlength=count) > 1)
    used = np.flatnonzero(mixed[row])
    if not len(used):
        return found
    one, two, three = _cumulants(parts.take(used), told.take(row[used]))
    freedom = two**3 / three**2
    scaled = (_SQUARES - one[:, None]) * np.sqrt(freedom / two)[:, None] + freedom[:, None]
    held = gammainc(0.5 * freedom[:, None], 0.5 * np.maximum(scaled, 0.0))
    total = np.zeros((count, len(_SQUARES)))
    np.add.at(total, row[used], weight[used, None] * held)
    share = np.bincount(row[used], weight[used], count)
    for mine in np.flatnonzero(mixed).tolist():
        found[mine] = np.interp(TRACK_CONTAINMENTS, total[mine] / share[mine], np.sqrt(_SQUARES))
    return found


def _cumulants(parts: Moments, told: Moments) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Σ λʲ (1 + j b²), j = 1, 2, 3, (n,) of parts' squared distances Σ λ (z + b)² from what is told."""
    sigma = np.sqrt(np.diagonal(told.covariance, axis1=1, axis2=2))
    scale = sigma[:, :, None] * sigma[:, None]
    value, axes = np.linalg.eigh(told.covariance / scale)
    white = axes / np.sqrt(np.maximum(value, _LEAST_CORRELATION))[:, None]
    away = np.sum(white * ((parts.mean - told.mean) / sigma)[:, :, None], axis=1)
    spread = white.transpose(0, 2, 1) @ (parts.covariance / scale) @ white
    square = spread @ spread
    moved = np.sum(spread * away[:, None], axis=2)
    one = np.trace(spread, axis1=1, axis2=2) + np.sum(away * away, axis=1)
    two = np.trace(square, axis1=1, axis2=2) + 2.0 * np.sum(away * moved, axis=1)
    three = np.sum(square * spread, axis=(1, 2)) + 3.0 * np.sum(moved * moved, axis=1)
    return one, two, three


#: A hypothesis less probable than this is left out of the blend.
_LEAST = 1e-3

#: Semi-axes of an ellipse that holds 95 %, standard deviations: the root of χ² of two degrees of freedom.
_SEMI_AXES_95 = np.sqrt(-2.0 * np.log(0.05))


class Basis(NamedTuple):
    """What estimates are worked out with: the priors of classes, the forces in free flight, and what a bank remembers.

    Without memory nothing is linearised anew. An impact whose 95 % ellipse has a semi-axis longer than
    `largest_impact_m` is not told, nor that of a track which is not among `falls`, tracks by number; None stands for
    all.
    """

    priors: Priors
    forces: "ForceModel"
    memory: FitMemory | None = None
    largest_impact_m: float = np.inf
    falls: IntArray | None = None


def report(
    hypotheses: Hypotheses,
    probability: FloatArray,
    tick_s: float,
    basis: Basis,
    parts: tuple[Hypotheses, FloatArray] | None = None,
) -> Tracks:
    """Return the estimates at a tick of tracks whose hypotheses (n,) have these probabilities, by track.

    `parts` are hypotheses (m,) that stand for those of the same tracks in state and launch, and their probabilities
    (m,).
    """
    number, whole = _blend(hypotheses, probability, basis.priors)
    state, state_sigmas, launch = _stands(whole if parts is None else _blend(*parts, basis.priors)[1], tick_s, basis)
    burnout = _blended(whole.ends, whole.mixture, False)
    impact, impact_sigmas = _falling(number, whole, basis)
    return Tracks(
        tick_s=np.full(len(number), tick_s),
        track=number,
        state=state.mean,
        state_covariance=state.covariance,
        launch=launch.mean,
        launch_covariance=launch.covariance,
        impact=impact.mean,
        impact_covariance=impact.covariance,
        type_probability=whole.mixture.sums(np.eye(4)[whole.hypotheses.kind]),
        burnout=burnout.mean,
        burnout_covariance=burnout.covariance,
        impact_sigmas=impact_sigmas,
        state_sigmas=state_sigmas,
    )


class _Blend(NamedTuple):
    """Hypotheses (n,) that count, how they are mixed, their paths, and where their burns end, with slopes."""

    hypotheses: Hypotheses
    mixture: "_Mixture"
    family: Family
    ends: Moments
    slope: FloatArray

    def of(self, tracks: IntArray, priors: Priors) -> "_Blend":
        """Return what is blended of tracks by place."""
        rows = np.flatnonzero(np.isin(self.mixture.row, tracks))
        row = np.searchsorted(tracks, self.mixture.row[rows])
        mixture, hypotheses = _Mixture(self.mixture.weight[rows], row, len(tracks)), self.hypotheses.take(rows)
        return _Blend(hypotheses, mixture, family_of(hypotheses, priors), self.ends.take(rows), self.slope[rows])


def _blend(hypotheses: Hypotheses, probability: FloatArray, priors: Priors) -> tuple[IntArray, _Blend]:
    """Return the numbers of the tracks of hypotheses (n,), and those of them that count."""
    kept = np.flatnonzero(probability >= _LEAST)
    number, row = np.unique(hypotheses.track[kept], return_inverse=True)
    weight, hypotheses = probability[kept], hypotheses.take(kept)
    mixture = _Mixture(weight / np.bincount(row, weight)[row], row, len(number))
    family = family_of(hypotheses, priors)
    return number, _Blend(hypotheses, mixture, family, *flight.burnouts(family, hypotheses.spread))


def _stands(blend: _Blend, tick_s: float, basis: Basis) -> tuple[Moments, FloatArray, Moments]:
    """Return states at a tick, the radii of their ellipsoids, and launches, by track."""
    states, mixture = _states(blend, tick_s, basis), blend.mixture
    state = _blended(states, mixture, False)
    sigmas = holding_sigmas(states, mixture.weight, mixture.row, state)
    return state, sigmas, _blended(_launches(blend.hypotheses, blend.family), mixture, True)


def _falling(number: IntArray, blend: _Blend, basis: Basis) -> tuple[Moments, FloatArray]:
    """Return impacts of tracks by number (n,), of those that are to be told, and the radii of their ellipses."""
    if basis.falls is None:
        return _fallen(blend, basis)
    count, tracks = len(number), np.flatnonzero(np.isin(number, basis.falls))
    impact, sigmas = Moments.unknown(count, 3), np.full((count, len(TRACK_CONTAINMENTS)), np.nan)
    if len(tracks):
        found, sigmas[tracks] = _fallen(blend.of(tracks, basis.priors), basis)
        impact.overwrite(tracks, found)
    return impact, sigmas


def _fallen(blend: _Blend, basis: Basis) -> tuple[Moments, FloatArray]:
    """Return impacts by track, those that are told, and the radii of their ellipses."""
    impacts, arcs = _impacts(blend, basis)
    impact, sigmas = _contained(impacts, arcs, blend.mixture)
    rows = _to_be_linearised(blend, basis, _semi_axis_95(impact.covariance, sigmas[:, -1]))
    if len(rows):
        gain, variance = blend.family.with_end(blend.hypotheses.spread)
        apart = blend.hypotheses.take(rows), blend.ends.take(rows), gain[rows], variance[rows]
        anew = open_impacts(*apart, basis.priors, basis.forces, basis.memory)
        impacts.overwrite(rows, anew[0])
        arcs.overwrite(rows, anew[1])
        impact, sigmas = _contained(impacts, arcs, blend.mixture)
    _withhold_vague(impact, sigmas, basis.largest_impact_m)
    return impact, sigmas


def _contained(impacts: Moments, arcs: ContainingArcs, mixture: "_Mixture") -> tuple[Moments, FloatArray]:
    """Return impacts by track, and the radii of their ellipses, of those of hypotheses (n,)."""
    impact = _blended(impacts, mixture, True)
    return impact, containing_sigmas(arcs, mixture.weight, mixture.row, impact)


def _to_be_linearised(blend: _Blend, basis: Basis, semi_axis_m: FloatArray) -> IntArray:
    """Return which hypotheses are to be linearised anew at the ends of their burns, where these are open.

    That is those of what one sensor alone has seen, where the ellipse, semi-axes by track, may be told.
    """
    if basis.memory is None:
        return np.empty(0, dtype=np.int64)
    may = ~(semi_axis_m > _SHRINKS * basis.largest_impact_m)[blend.mixture.row]
    _, variance = blend.family.with_end(blend.hypotheses.spread)
    may &= (variance > _OPEN**2) & basis.memory.seen.seen_by_one_sensor(blend.hypotheses.track)
    return np.flatnonzero(may)


#: No ellipse that is linearised anew is taken to be smaller than it was by more than this: of 3302 flights of all
#: classes none shrank by more than 1.5.
_SHRINKS = 2.0


class _Mixture(NamedTuple):
    """The weights (n,) of hypotheses, and to which of `tracks` tracks each belongs, `row` (n,)."""

    weight: FloatArray
    row: IntArray
    tracks: int

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the weighted sums (tracks, ...) of values (n, ...)."""
        found = np.zeros((self.tracks, *values.shape[1:]))
        np.add.at(found, self.row, self.weight.reshape(-1, *(1,) * (values.ndim - 1)) * values)
        return found


def _impacts(blend: _Blend, basis: Basis) -> tuple[Moments, ContainingArcs]:
    """Return impacts; where the end of the burn is open, as sums over when it may come, along arcs."""
    hypotheses, ends, spread = blend.hypotheses, blend.ends, blend.hypotheses.spread
    gain, variance = blend.family.with_end(spread)
    opens = variance > _OPEN**2
    rows, closed = np.flatnonzero(opens), np.flatnonzero(~opens)
    parts = []
    if len(closed):
        found = flight.impacts(ends.take(closed), blend.slope[closed], spread[closed], basis.forces)
        parts.append((found, ContainingArcs.still(found, hypotheses.end[closed, 0], hypotheses.end_quantiles[closed])))
    if len(rows):
        apart = hypotheses.take(rows), ends.take(rows), gain[rows], variance[rows]
        parts.append(open_impacts(*apart, basis.priors, basis.forces))
    order = np.argsort(np.concatenate([closed, rows]))
    impacts, arcs = zip(*parts, strict=True)
    return Moments.concatenate(impacts).take(order), ContainingArcs.concatenate(arcs).take(order)


#: A burn whose length is less certain than this, of it, has an open end.
_OPEN = 0.01


def _withhold_vague(impact: Moments, sigmas: FloatArray, largest_m: float) -> None:
    """Take away impacts whose 95 % ellipses are larger than told, m, or of no size."""
    vague = ~(_semi_axis_95(impact.covariance, sigmas[:, -1]) <= largest_m)
    impact.mean[vague], impact.covariance[vague] = np.nan, np.nan


def _semi_axis_95(covariance: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Return the larger semi-axes (n,) of ellipses on the ground of radii told, or of 95 % of a normal distribution."""
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    largest = 0.5 * (east + north) + np.hypot(0.5 * (east - north), both)
    semi_axis: FloatArray = np.where(np.isnan(sigmas), _SEMI_AXES_95, sigmas) * np.sqrt(np.maximum(largest, 0.0))
    return semi_axis


def _states(blend: _Blend, tick_s: float, basis: Basis) -> Moments:
    """Return states (n, 6) at a tick; of what one sensor alone has seen, with what is open of the ends of burns."""
    hypotheses, family = blend.hypotheses, blend.family
    state = flight.states(family, hypotheses.spread, tick_s, blend.ends, blend.slope, basis.forces)
    alone = np.flatnonzero(np.count_nonzero(hypotheses.weight > 0.0, axis=1) < 2)
    state = with_ends(state, hypotheses, family, alone, tick_s)
    state.covariance[...] += doubts(hypotheses, family, tick_s, state.mean, basis.priors)
    return state


def _launches(hypotheses: Hypotheses, family: Family) -> Moments:
    latitude, longitude = hypotheses.anchors.places(hypotheses.parameters)
    chosen = [EAST, NORTH, START]
    covariance = hypotheses.spread[:, chosen][:, :, chosen].copy()
    # A parameter's metres are those of the anchor's circle of latitude.
    shrunk = np.cos(latitude) * RADIUS_M / family.across_m
    covariance[:, 0] *= shrunk[:, None]
    covariance[:, :, 0] *= shrunk[:, None]
    return Moments(np.stack([latitude, longitude, family.start_s], axis=1), covariance)


def _blended(parts: Moments, mixture: _Mixture, are_places: bool) -> Moments:
    """Return means (count, d) and covariances (count, d, d) of mixtures.

    Parts that are not known, as the impact of a flight that does not come down, leave the whole unknown where they
    are no small part of it.
    """
    weight, row, count = mixture
    known = np.isfinite(parts.mean).all(axis=1) & np.isfinite(parts.covariance).all(axis=(1, 2))
    share = np.bincount(row[known], weight[known], count)
    values, spread, weight, row = parts.mean[known], parts.covariance[known], weight[known], row[known]
    nothing = Moments.unknown(count, parts.mean.shape[1])
    if not len(values):
        return nothing
    mixture = _Mixture(weight / share[row], row, count)
    heaviest = np.zeros(count, dtype=np.int64)
    order = np.argsort(mixture.weight, kind="stable")
    heaviest[row[order]] = order
    about = values[heaviest][row]
    away = on_ground(values, about) if are_places else values - about
    mean = mixture.sums(away)
    apart = away - mean[row]
    total = mixture.sums(spread + apart[:, :, None] * apart[:, None, :])
    first = values[heaviest]
    told = off_ground(mean, first) if are_places else first + mean
    enough = share > _KNOWN
    total = 0.5 * (total + total.transpose(0, 2, 1))
    nothing.mean[enough], nothing.covariance[enough] = told[enough], total[enough]
    return nothing


#: A mixture is told if parts of it that weigh more than this are.
_KNOWN = 0.9
