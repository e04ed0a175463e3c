"""Least-squares fit of Keplerian arcs to lines of sight: normal equations of the state at each
track's first emission.

The paper fits "a Keplerian ballistic arc to the observed positions" (section 5.2). A line of sight
determines a position in two directions; a second sensor in another direction gives the third.
Otherwise the height is assumed, vertically from the ground at constant acceleration. Each line is
linearised once, about the arc of that tick, so a tick costs only its own detections.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from opir_estimation import LinesOfSight, earth_rotated, emission_s

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight import propagate_kepler
from opir_core.geometry import intersection_with_ellipsoid
from opir_core.interfaces import Columns

#: Finite-difference steps, m and m/s; an arc is linear over them to parts in a million.
STEPS = np.array([10.0, 10.0, 10.0, 0.1, 0.1, 0.1])

#: Number of Chebyshev nodes of an arc within a tick; the interpolation error is 1e-6 m over a
#: minute.
_KNOTS = 8

#: Longest burn of the generic classes, s: until then the height of a target seen by one sensor is
#: assumed.
LONGEST_BURN_S = 250.0


@frozen(eq=False, repr=False)
class ArcFits(Columns):
    """Arcs, one row per track: number, time of the first emission, s, and the inertial state then,
    m and m/s.

    `across` and `along` (n, 7, 7) are normal equations of the six differences from `reference`,
    bordered by their right-hand sides and the sum of squared residuals: `across` from lines of
    sight, `along` from assumed heights. `looks` counts the detections, `seen` (n, sensors) marks
    their sensors, `last_s` is the last emission. `launch` and `launch_covariance` are as in
    `Tracks`.
    """

    number: IntArray
    epoch_s: FloatArray
    reference: FloatArray
    state: FloatArray
    across: FloatArray
    along: FloatArray
    looks: IntArray
    seen: BoolArray
    last_s: FloatArray
    launch: FloatArray
    launch_covariance: FloatArray

    @classmethod
    def none(cls, sensors: int) -> "ArcFits":
        """Return no arcs."""
        return cls.unfitted(np.empty(0, dtype=np.int64), sensors)

    @classmethod
    def unfitted(cls, number: IntArray, sensors: int) -> "ArcFits":
        """Return arcs of tracks without detections."""
        count = len(number)
        unknown = np.full((count, 6), np.nan)
        return cls(
            number=number,
            epoch_s=np.full(count, np.nan),
            reference=unknown,
            state=unknown.copy(),
            across=np.zeros((count, 7, 7)),
            along=np.zeros((count, 7, 7)),
            looks=np.zeros(count, dtype=np.int64),
            seen=np.zeros((count, sensors), dtype=np.bool_),
            last_s=np.full(count, -np.inf),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
        )

    @property
    def is_fitted(self) -> BoolArray:
        """Return which arcs (n,) have a state."""
        return np.asarray(np.isfinite(self.state).all(axis=1))

    def normal(self) -> FloatArray:
        """Return the bordered normal equations (n, 7, 7), with heights where lines do not determine
        the range.
        """
        place = self.across[:, :3, :3]
        eigenvalues = np.linalg.eigvalsh(np.where(np.isfinite(place), place, 0.0))
        # Several sensors count as one where their information along the line of sight is below this
        # share of that across: two equal sensors one degree apart.
        alone = (self.seen.sum(axis=1) < 2) | (eigenvalues[:, 0] < 1e-4 * eigenvalues[:, 2])
        return self.across + np.where(alone[:, None, None], self.along, 0.0)

    def discounted(self, share: float) -> "ArcFits":
        """Return the arcs with the weight of all earlier detections multiplied by a share."""
        return (
            self
            if share == 1.0
            else evolve(self, across=self.across * share, along=self.along * share)
        )


def solved(normal: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the solution of bordered normal equations (n, 7, 7), its covariance, and the residual
    sum of squares.

    These are (n, 6), (n, 6, 6) and (n,); nan where the equations are ill-conditioned.
    """
    size = np.sqrt(np.diagonal(normal[:, :6, :6], axis1=1, axis2=2))
    determined = np.logical_and((size > 0.0).all(axis=1), np.isfinite(normal).all(axis=(1, 2)))
    scale = np.where(determined[:, None], size, 1.0)
    scales = scale[:, :, None] * scale[:, None, :]
    matrix = np.where(determined[:, None, None], normal[:, :6, :6], np.eye(6)) / scales
    # With a larger condition number of the scaled equations the state is not determined.
    sound = (determined & (np.linalg.cond(matrix) < 1e12))[:, None, None]
    covariance = np.linalg.inv(np.where(sound, matrix, np.eye(6))) / scales
    covariance = np.where(sound, 0.5 * (covariance + covariance.transpose(0, 2, 1)), np.nan)
    step = (covariance @ normal[:, :6, 6:])[:, :, 0]
    misfit = np.maximum(normal[:, 6, 6] - np.sum(step * normal[:, :6, 6], axis=1), 0.0)
    return step, covariance, misfit


class AssumedHeights(NamedTuple):
    """Heights of targets seen by one sensor: launch times (n,), s, and the vertical acceleration,
    m/s².
    """

    launch_s: FloatArray
    climb_m_s2: float

    def ranges_m(self, lines: LinesOfSight, owner: IntArray, emitted_s: FloatArray) -> FloatArray:
        """Return the ranges (m,) of what lines show, at these heights; nan long after launch."""
        since_s = emitted_s - self.launch_s[owner]
        height = 0.5 * self.climb_m_s2 * since_s * np.maximum(since_s, 0.0)
        point = intersection_with_ellipsoid(lines.origin_ecef_m, lines.direction_ecef, height)
        return np.where(since_s <= LONGEST_BURN_S, lines.ranges_m(point), np.nan)


def initialised(
    arcs: ArcFits,
    lines: LinesOfSight,
    owner: IntArray,
    heights: AssumedHeights,
    light_time: bool,
) -> ArcFits:
    """Return arcs without a state fitted to their first lines (m,) with arcs `owner`.

    Arcs that the lines do not determine are unchanged.
    """
    started, emitted_s = _at_rest(arcs, lines, owner, light_time)
    paths = _straight_paths(started, owner, emitted_s)
    equations = _with_equations(started, lines, owner, emitted_s, paths, heights)
    started = _solved_state(started, equations)
    started = evolve(started, reference=started.state)
    determined = np.flatnonzero(started.is_fitted[owner])
    lines = lines.take(determined)
    return updated(started, lines, owner[determined], heights, light_time, rounds=8)


def _at_rest(
    arcs: ArcFits, lines: LinesOfSight, owner: IntArray, light_time: bool
) -> tuple[ArcFits, FloatArray]:
    """Return arcs that start at rest where their first lines meet the ground, and the emission
    times (m,), s, of lines.
    """
    origin = lines.origin_ecef_m
    ground = intersection_with_ellipsoid(origin, lines.direction_ecef)
    ground = np.where(np.isfinite(ground), ground, origin + 3.6e7 * lines.direction_ecef)
    emitted_s = emission_s(lines.time_s, lines.ranges_m(ground), light_time)
    rows = np.unique(owner, return_index=True)[1]
    epoch_s = arcs.epoch_s.copy()
    epoch_s[owner[rows]] = emitted_s[rows]
    place = np.full((len(arcs), 3), np.nan)
    place[owner[rows]] = earth_rotated(ground[rows], emitted_s[rows])
    turn = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
    state = np.concatenate([place, np.cross(turn, place)], axis=1)
    return evolve(arcs, epoch_s=epoch_s, reference=state, state=state), emitted_s


def updated(
    arcs: ArcFits,
    lines: LinesOfSight,
    owner: IntArray,
    heights: AssumedHeights,
    light_time: bool,
    rounds: int = 2,
) -> ArcFits:
    """Return the arcs after lines (m,) in order of time; undetermined ones have no state."""
    moved = arcs
    added = arcs
    emitted_s = lines.time_s
    for turn in range(rounds):
        emitted_s = _emission_times(moved, lines, owner, emitted_s, light_time, 1 if turn else 2)
        paths = kepler_paths(moved.state, moved.epoch_s, owner, emitted_s)
        trial = evolve(arcs, state=moved.state)
        added = _with_equations(trial, lines, owner, emitted_s, paths, heights)
        moved = _solved_state(trial, added)
        # Within 0.1 mm and 0.1 mm/s.
        if np.max(np.abs(moved.state - trial.state), initial=0.0) < 1e-4:
            break
    last_s = arcs.last_s.copy()
    # An arc that diverged has no emission times.
    np.fmax.at(last_s, owner, emitted_s)
    looks = arcs.looks + np.bincount(owner, minlength=len(arcs))
    return evolve(added, state=moved.state, last_s=last_s, looks=looks)


def _emission_times(
    arcs: ArcFits,
    lines: LinesOfSight,
    owner: IntArray,
    guess_s: FloatArray,
    light_time: bool,
    passes: int,
) -> FloatArray:
    """Return the emission times (m,), s, of lines from their arcs, from a first guess."""
    emitted_s = guess_s
    for _ in range(passes if light_time else 0):
        position = _positions_at(arcs.state[:, None], arcs.epoch_s, owner, emitted_s)[:, 0]
        offset = position - earth_rotated(lines.origin_ecef_m, emitted_s)
        range_m = np.sqrt(np.sum(offset * offset, axis=1))
        emitted_s = emission_s(lines.time_s, range_m, light_time)
    return emitted_s


def _solved_state(arcs: ArcFits, added: ArcFits) -> ArcFits:
    """Return the arcs with the solution of the equations of `added`, nan where undetermined."""
    return evolve(arcs, state=added.reference + solved(added.normal())[0])


def _with_equations(
    arcs: ArcFits,
    lines: LinesOfSight,
    owner: IntArray,
    emitted_s: FloatArray,
    paths: tuple[FloatArray, FloatArray],
    heights: AssumedHeights,
) -> ArcFits:
    """Return the arcs with the equations of lines added, linearised about positions (m, 3) with
    Jacobians (m, 3, 6).
    """
    position, slope = paths
    direction = earth_rotated(lines.direction_ecef, emitted_s)
    offset = position - earth_rotated(lines.origin_ecef_m, emitted_s)
    sigma_m = np.sum(offset * direction, axis=1) * lines.sigma_rad
    shift = slope @ (arcs.state - arcs.reference)[owner][:, :, None]
    bordered = np.concatenate([slope, shift - offset[:, :, None]], axis=2) / sigma_m[:, None, None]
    in_range = direction[:, None, :] @ bordered
    sideways = bordered - direction[:, :, None] * in_range
    across = arcs.across.copy()
    np.add.at(across, owner, sideways.transpose(0, 2, 1) @ sideways)
    range_m = heights.ranges_m(lines, owner, emitted_s)
    in_range[:, 0, 6] += range_m / sigma_m
    assumed = np.flatnonzero(np.isfinite(range_m))
    along = arcs.along.copy()
    np.add.at(along, owner[assumed], (in_range.transpose(0, 2, 1) @ in_range)[assumed])
    seen = arcs.seen.copy()
    seen[owner, lines.sensor] = True
    return evolve(arcs, across=across, along=along, seen=seen)


def _straight_paths(
    arcs: ArcFits, owner: IntArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return positions (m, 3) and Jacobians (m, 3, 6) at times (m,) of paths under constant
    gravity.
    """
    since = time_s - arcs.epoch_s[owner]
    place = arcs.state[owner, :3]
    speed = arcs.state[owner, 3:]
    radius = np.sqrt(np.sum(place * place, axis=1))[:, None]
    position = (
        place
        + speed * since[:, None]
        - 0.5 * EARTH_MU_M3_S2 * place / radius**3 * since[:, None] ** 2
    )
    unit = np.broadcast_to(np.eye(3), (len(owner), 3, 3))
    return position, np.concatenate([unit, since[:, None, None] * unit], axis=2)


def kepler_paths(
    state: FloatArray, epoch_s: FloatArray, owner: IntArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return positions (m, 3) at times (m,) of the arcs `owner` (m,), and Jacobians (m, 3, 6) by
    the state.
    """
    positions = _positions_at(trial_states(state), epoch_s, owner, time_s)
    return positions[:, 0], slopes_of(positions)


def trial_states(state: FloatArray) -> FloatArray:
    """Return states (n, 6), and those a step aside along each axis, (n, 7, 6)."""
    return state[:, None] + np.concatenate([np.zeros((1, 6)), np.diag(STEPS)])


def slopes_of(values: FloatArray) -> FloatArray:
    """Return the Jacobians (n, k, 6) of values (n, 7, k) at `trial_states`."""
    return ((values[:, 1:] - values[:, :1]) / STEPS[:, None]).transpose(0, 2, 1)


def _positions_at(
    trials: FloatArray, epoch_s: FloatArray, owner: IntArray, time_s: FloatArray
) -> FloatArray:
    """Return positions (m, v, 3) at times (m,) on the arcs through all states (n, v, 6) of the rows
    `owner` (m,).
    """
    middle, half = _spans(epoch_s, owner, time_s)
    knot_s = middle[:, None] + half[:, None] * np.cos(_ANGLES) - epoch_s[:, None]
    values = _values_at(trials, knot_s)
    place = np.clip((time_s - middle[owner]) / half[owner], -1.0, 1.0)
    weights = np.cos(np.arange(_KNOTS) * np.arccos(place)[:, None])[:, None, :] @ _TO_SERIES
    return (weights @ values[owner]).reshape(-1, trials.shape[1], 3)


def _spans(
    epoch_s: FloatArray, owner: IntArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the middles and half lengths (n,), s, of the spans of the times (m,) of rows `owner`;
    without any, at their epochs.
    """
    start = np.full(len(epoch_s), np.inf)
    end = np.full(len(epoch_s), -np.inf)
    np.fmin.at(start, owner, time_s)
    np.fmax.at(end, owner, time_s)
    idle = ~np.isfinite(start)
    start = np.where(idle, epoch_s, start)
    end = np.where(idle, epoch_s, end)
    return 0.5 * (start + end), np.maximum(0.5 * (end - start), 1e-3)


def _values_at(trials: FloatArray, since_s: FloatArray) -> FloatArray:
    """Return the positions (n, k, v · 3) of states (n, v, 6) after times (n, k)."""
    position = trials[:, :, None, :3]
    velocity = trials[:, :, None, 3:]
    flown = propagate_kepler(position, velocity, since_s[:, None])[0]
    return flown.transpose(0, 2, 1, 3).reshape(len(trials), _KNOTS, -1)


#: Angles of the Chebyshev nodes in [-1, 1], and the matrix from values at them to series
#: coefficients.
_ANGLES = (np.arange(_KNOTS) + 0.5) * np.pi / _KNOTS
_TO_SERIES = 2.0 / _KNOTS * np.cos(np.arange(_KNOTS)[:, None] * _ANGLES)
_TO_SERIES[0] *= 0.5
