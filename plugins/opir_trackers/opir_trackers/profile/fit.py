"""The fit of boost profiles: maximum a posteriori, by Gauss and Newton, recursive in time.

Each hypothesis (a track, a class and a mode) keeps the normal equations of its rows, linearised where it then stood. A
new row is linearised at the present estimate and added: that costs the row, not the history. From time to time a
hypothesis is reviewed (`bank`): all its rows, a bounded number, are linearised anew.

The normal equations are sums of squares and priors, scaled to a unit diagonal before they are solved: nothing is ever
taken away from them but what biases explain, which the rows themselves put in.

What the priors of its class and the window it sees through add to the normal equations of a hypothesis.

Sums of the products of rows with themselves, by groups: normal equations of many estimates at once.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.columns import Columns
from opir_trackers.profile.end import normal_quantiles, normal_rule
from opir_trackers.profile.family import (
    BURN,
    LIFT,
    PITCH,
    SHAPE,
    SIZE,
    STRAIGHT_RAD,
    TURN_EAST,
    TURN_NORTH,
    Anchors,
    Family,
    Natural,
    Places,
    Priors,
    fitted,
    natural,
)
from opir_trackers.profile.rows import Rows


def squares(told: FloatArray, first: IntArray) -> FloatArray:
    """Return the sums (g, k, k) of the products of rows (m, 2, k) with themselves, of groups that begin at `first`.

    Groups are padded with zeros to the length of the longest of about their length, and multiplied as matrices.
    """
    length = np.diff(np.append(first, len(told)))
    squares = np.empty((len(first), told.shape[2], told.shape[2]))
    for size in np.unique(np.ceil(np.log2(length))).tolist():
        some = np.flatnonzero(np.ceil(np.log2(length)) == size)
        row = np.repeat(np.arange(len(some)), length[some])
        place = np.arange(len(row)) - np.repeat(np.cumsum(length[some]) - length[some], length[some])
        padded = np.zeros((len(some), int(length[some].max()), 2, told.shape[2]))
        padded[row, place] = told[first[some][row] + place]
        flat = padded.reshape(len(some), -1, told.shape[2])
        squares[some] = flat.transpose(0, 2, 1) @ flat
    return squares


#: The distance of neighbouring windows, of their standard deviation: their sum is 1 to a thousandth.
SPACING = 1.0 / 0.6


def with_priors(
    hypotheses: "Hypotheses", prior: Priors, normal: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the normal equations with the priors, the priors' sum of squares at 0 and the log of their height.

    The priors are of natural parameters, linearised where the hypotheses stand. The turn's length is normal about the
    class's along its present direction, which is as likely as any other.
    """
    found = natural(hypotheses.parameters, prior)
    slope, here = found.slope(), hypotheses.parameters
    information = prior.information()
    bent = hypotheses.is_bent > 0
    information[~bent, TURN_EAST] = information[~bent, TURN_NORTH] = 2.0 / np.square(prior.turn_rad[~bent])
    wanted = np.sum(slope * here[:, None], axis=2) - found.parameters
    weighed = slope * information[:, :, None]
    normal = normal + np.sum(weighed[:, :, :, None] * slope[:, :, None], axis=1)
    right = right + np.sum(weighed * wanted[:, :, None], axis=1)
    constant = np.sum(information * wanted * wanted, axis=1)
    sums = normal, right, constant
    height, ring = _with_turn(sums, found, slope, here, prior, bent)
    linear = np.delete(np.log(information), [TURN_EAST, TURN_NORTH], axis=1).sum(axis=1)
    free = np.log(information[:, [TURN_EAST, TURN_NORTH]]).sum(axis=1)
    log = height + 0.5 * linear + np.where(bent, ring, 0.5 * free)
    return normal, right, constant, log + _windowed(hypotheses.window, normal, right, constant)


def _with_turn(
    sums: tuple[FloatArray, FloatArray, FloatArray],
    found: Natural,
    slope: FloatArray,
    here: FloatArray,
    prior: Priors,
    bent: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """Add the prior of the turn to normal equations, right sides and constants, and what makes headings alike.

    Return the logarithms of the density's height (n,): of the lean and the crowding of headings, and of the ring.
    """
    turn = found.parameters[:, [TURN_EAST, TURN_NORTH]]
    length = np.maximum(np.hypot(turn[:, 0], turn[:, 1]), STRAIGHT_RAD)
    along = turn / length[:, None]
    share = np.where(bent, 1.0 / np.square(prior.turn_sigma_rad), 0.0)
    by_length = np.sum(along[:, :, None] * slope[:, [TURN_EAST, TURN_NORTH]], axis=1)
    missing = prior.turn_rad - length + np.sum(by_length * here, axis=1)
    _add_rows(sums, share, by_length, missing)
    # Farther out than the class's length, as windows beyond it are, headings are told apart: the ring bends away.
    bend = share * np.maximum(1.0 - prior.turn_rad / length, 0.0)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    by_heading = np.sum(aside[:, :, None] * slope[:, [TURN_EAST, TURN_NORTH]], axis=1)
    _add_rows(sums, bend, by_heading, np.sum(by_heading * here, axis=1))
    # Every heading alike: the density in the plane is that of the length over the length; the lean's over its share.
    crowding = np.where(bent, 1.0 / length, 0.0)[:, None] * by_length
    crowding[:, [BURN, PITCH, LIFT]] += 2.0 * found.lean_slope
    right = sums[1]
    right -= crowding
    height = -2.0 * np.log(found.lean) + np.sum(crowding * here, axis=1)
    ring = -np.log(length) - np.log(prior.turn_sigma_rad) - 0.5 * np.log(2.0 * np.pi)
    return height, ring


def _add_rows(
    sums: tuple[FloatArray, FloatArray, FloatArray], weight: FloatArray, slope: FloatArray, value: FloatArray
) -> None:
    """Add to normal equations, right sides and constants one row each: a value (n,) that goes with slopes (n, 10)."""
    normal, right, constant = sums
    normal += (weight[:, None] * slope)[:, :, None] * slope[:, None]
    right += (weight * value)[:, None] * slope
    constant += weight * value * value


def _windowed(window: FloatArray, normal: FloatArray, right: FloatArray, constant: FloatArray) -> FloatArray:
    """Add the windows (n, 4) through which hypotheses see the lean to their normal equations; return their log heights.

    Windows of one direction are normal curves, evenly spaced, that add up to 1: each hypothesis is the part of the
    whole that its window lets through.
    """
    narrow = window[:, 3]
    for i, row in enumerate((TURN_EAST, TURN_NORTH)):
        right[:, row] += narrow * window[:, i] * window[:, 2]
        for j, column in enumerate((TURN_EAST, TURN_NORTH)):
            normal[:, row, column] += narrow * window[:, i] * window[:, j]
    constant += narrow * np.square(window[:, 2])
    height: FloatArray = np.where(narrow > 0.0, np.log(SPACING / np.sqrt(2.0 * np.pi)), 0.0)
    return height


#: The largest change of a parameter in one step.
LARGEST = np.array([60e3, 60e3, 10.0, 0.4, 0.4, 0.3, 0.3, 0.3, 0.3, 0.3])

#: An estimate stays within so many standard deviations of its prior.
_WITHIN = 4.0


@frozen(eq=False)
class Hypotheses(Columns):
    """One row a track, class and mode: the estimate and its normal equations.

    `normal` (n, 10, 10), `right` (n, 10) and `square` (n,) sum up the rows: Σ HᵀH, Σ Hᵀρ, Σ ρᵀρ with whitened rows
    ρ = H x; `pull` (n, sensors, 10, 2), `pulled` (n, sensors, 2) and `weight` (n, sensors) are Σ Hᵀ/σ, Σ ρ/σ and
    Σ 1/σ² by sensor, through which its bias works; `rows` counts them. `spread` (n, 10, 10) is the covariance of the
    estimate and `evidence` (n,) the logarithm of the marginal likelihood; `misfit` (n,) is by how much
    the rows' squares exceed what their errors explain, 1 where they do not; `stood`
    (n, 10) is the estimate at the last review. While `is_bent` is False the turn has no
    direction yet, and its prior none either. `window` (n, 4) is what the lean is seen through: direction, place and
    1/σ², all 0 of none; `end` (n, 2, nodes) are nodes, in standard deviations, and weights for the end of the burn,
    `end_quantiles` (n, deviates) its quantiles.
    """

    track: IntArray
    kind: IntArray
    anchor_latitude_rad: FloatArray
    anchor_longitude_rad: FloatArray
    anchor_s: FloatArray
    parameters: FloatArray
    normal: FloatArray
    right: FloatArray
    square: FloatArray
    pull: FloatArray
    pulled: FloatArray
    weight: FloatArray
    rows: FloatArray
    spread: FloatArray
    evidence: FloatArray
    misfit: FloatArray
    stood: FloatArray
    is_bent: IntArray
    window: FloatArray
    end: FloatArray
    end_quantiles: FloatArray

    @property
    def anchors(self) -> Anchors:
        """Return what the parameters count from."""
        return Anchors(self.anchor_latitude_rad, self.anchor_longitude_rad, self.anchor_s)

    def cleared(self) -> "Hypotheses":
        """Return the hypotheses without their rows."""
        names = ("normal", "right", "square", "pull", "pulled", "weight", "rows")
        return evolve(self, **{name: np.zeros_like(getattr(self, name)) for name in names})

    def faded(self, share: FloatArray) -> "Hypotheses":
        """Return the hypotheses with what their rows say weakened to shares (n,)."""
        names = ("normal", "right", "square", "pull", "pulled", "weight", "rows")
        columns = {name: getattr(self, name) for name in names}
        return evolve(self, **{k: v * share.reshape(-1, *(1,) * (v.ndim - 1)) for k, v in columns.items()})


def blank(count: int, sensors: int) -> Hypotheses:
    """Return hypotheses of the first class, without rows, that stand at the middle of their priors."""
    whole, real, many = np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros((count, sensors))
    vector, square = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    return Hypotheses(
        track=whole,
        kind=whole,
        anchor_latitude_rad=real,
        anchor_longitude_rad=real,
        anchor_s=real,
        parameters=vector,
        normal=square,
        right=vector,
        square=real,
        pull=np.zeros((count, sensors, SIZE, 2)),
        pulled=np.zeros((count, sensors, 2)),
        weight=many,
        rows=real,
        spread=square,
        evidence=real,
        misfit=np.ones(count),
        stood=vector,
        is_bent=whole,
        window=np.zeros((count, 4)),
        end=np.stack(normal_rule(count), axis=1),
        end_quantiles=normal_quantiles(count),
    )


def family_of(hypotheses: Hypotheses, priors: Priors) -> Family:
    """Return the paths of hypotheses, whose classes have these priors, one row a class."""
    return Family.of(hypotheses.parameters, hypotheses.anchors, priors.take(hypotheses.kind))


def with_rows(hypotheses: Hypotheses, family: Family, rows: Rows, owner: IntArray, share: FloatArray) -> Hypotheses:
    """Return the hypotheses with rows (m,) added, each to the hypothesis `owner`, linearised where that stands.

    Owners come sorted; `share` (m,) weakens rows. `family` are the paths of the hypotheses.
    """
    if not len(rows):
        return hypotheses
    expected, slope = linearised(family, rows, owner)
    per_sigma = np.sqrt(share) / rows.sigma_rad
    wanted = _times(slope, hypotheses.parameters[owner]) - expected
    told = np.concatenate([slope, wanted[:, :, None]], axis=2) * per_sigma[:, None, None]
    first = np.flatnonzero(np.append(True, np.diff(owner) != 0))
    mine, products = owner[first], squares(told, first)
    added = {
        "normal": products[:, :SIZE, :SIZE],
        "right": products[:, :SIZE, SIZE],
        "square": products[:, SIZE, SIZE],
        "rows": np.add.reduceat(share, first),
    }
    key = owner * hypotheses.weight.shape[1] + rows.sensor
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.append(True, np.diff(key[order]) != 0))
    whose = owner[order[first]], rows.sensor[order[first]]
    pulls = np.add.reduceat((told * per_sigma[:, None, None]).take(order, axis=0), first, axis=0)
    by_sensor = {
        "pull": pulls[:, :, :SIZE].transpose(0, 2, 1),
        "pulled": pulls[:, :, SIZE],
        "weight": np.add.reduceat((per_sigma * per_sigma)[order], first),
    }
    columns = {}
    for places, values in ((mine, added), (whose, by_sensor)):
        for name, sums in values.items():
            columns[name] = getattr(hypotheses, name).copy()
            columns[name][places] += sums
    return evolve(hypotheses, **columns)


def linearised(family: Family, rows: Rows, owner: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions (m, 2) at which rows' paths are expected, from the mean seen, and slopes (m, 2, 10)."""
    places = _shared(family, rows.time_s, owner)
    line = places.position_m - rows.origin_ecef_m
    local = rows.axes[:, :, 0] * line[:, :1] + rows.axes[:, :, 1] * line[:, 1:2] + rows.axes[:, :, 2] * line[:, 2:]
    seen = local[:, :2] / local[:, 2:]
    across = (rows.axes[:, :2] - seen[:, :, None] * rows.axes[:, None, 2]) / local[:, 2, None, None]
    slope = across[:, :, None, 0] * places.slope[:, None, :, 0]
    for axis in (1, 2):
        slope += across[:, :, None, axis] * places.slope[:, None, :, axis]
    return seen, slope


def _shared(family: Family, time_s: FloatArray, owner: IntArray) -> Places:
    """Return where paths are at times (m,): read at the middle of a short span for all rows in it, and carried on.

    Sensors see a target at nearly the same times. Half the span's square times half of 100 m/s² is 0.8 m.
    """
    span = np.floor(time_s / _SHARED_S).astype(np.int64)
    low = int(span.min(initial=0))
    key, place = np.unique(owner * (int(span.max(initial=0)) - low + 1) + span - low, return_inverse=True)
    lead = np.zeros(len(key), dtype=np.int64)
    lead[place[::-1]] = np.arange(len(place))[::-1]
    middle = _SHARED_S * (span[lead].astype(np.float64) + 0.5)
    places = family.places(owner[lead], middle)
    away = time_s - middle[place]
    # Before the start a path rests: what moves it on is its mean velocity over the way.
    velocity = np.where(middle[place, None] > family.start_s[owner, None], places.velocity_m_s[place], 0.0)
    return Places(places.position_m[place] + away[:, None] * velocity, velocity, places.slope[place])


#: Rows within such a span share one reading of their path, s.
_SHARED_S = 0.25


class Solved(NamedTuple):
    """Solutions (n, 10) of the normal equations with priors, covariances (n, 10, 10), evidence (n,), misfit (n,)."""

    parameters: FloatArray
    spread: FloatArray
    evidence: FloatArray
    misfit: FloatArray


def solved(hypotheses: Hypotheses, priors: Priors, bias_sigma_rad: FloatArray) -> Solved:
    """Return the solutions of hypotheses, with sensors' biases (sensors,) of unknown size in them (marginalised)."""
    normal, right, square = _unbiased(hypotheses, bias_sigma_rad)
    prior = priors.take(hypotheses.kind)
    total, wanted, constant, log_prior = with_priors(hypotheses, prior, normal, right)
    scale = 1.0 / np.sqrt(np.diagonal(total, axis1=1, axis2=2))
    scaled = total * scale[:, :, None] * scale[:, None, :]
    inverse = np.linalg.inv(scaled)
    spread = 0.5 * (inverse + inverse.transpose(0, 2, 1)) * scale[:, :, None] * scale[:, None, :]
    parameters = _times(spread, wanted)
    _, log = np.linalg.slogdet(scaled)
    log_determinant = log - 2.0 * np.log(scale).sum(axis=1)
    left = np.maximum(square + constant - np.sum(wanted * parameters, axis=1), 0.0)
    evidence = log_prior - 0.5 * (left + log_determinant)
    bent = np.sum(parameters * _times(normal, parameters), axis=1)
    residual = np.maximum(square - 2.0 * np.sum(right * parameters, axis=1) + bent, 0.0)
    return Solved(parameters, spread, evidence, _misfit(residual, hypotheses.rows))


def _unbiased(hypotheses: Hypotheses, bias_sigma_rad: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normal equations and sum of squares of which sensors' biases, normal and unknown, are taken out."""
    normal, right, square = hypotheses.normal, hypotheses.right, hypotheses.square
    for sensor in np.flatnonzero(bias_sigma_rad > 0.0).tolist():
        variance = bias_sigma_rad[sensor] ** 2
        factor = variance / (1.0 + variance * hypotheses.weight[:, sensor])
        pull, pulled = hypotheses.pull[:, sensor], hypotheses.pulled[:, sensor]
        normal = normal - factor[:, None, None] * np.einsum("nak,nbk->nab", pull, pull)
        right = right - factor[:, None] * np.einsum("nak,nk->na", pull, pulled)
        square = square - factor * np.sum(pulled * pulled, axis=1)
    return normal, right, square


def _misfit(residual_square: FloatArray, rows: FloatArray) -> FloatArray:
    """Return by how much (n,) the mean square residual exceeds what the errors explain; 1 where it does not."""
    freedom = np.maximum(2.0 * rows - SIZE, 1.0)
    # A mean of n squares wanders by √(2/n): only what is beyond three times that counts.
    excess = residual_square / freedom - 3.0 * np.sqrt(2.0 / freedom)
    growth: FloatArray = np.maximum(excess, 1.0)
    return growth


#: Steps that end nearer than this, in standard deviations, were not cut short; rounding, beside a correlation.
_CUT, _ROUNDING = 1e-3, 1e-12


def moved(hypotheses: Hypotheses, target: FloatArray, priors: Priors) -> FloatArray:
    """Return the parameters (n, 10) on the way to others, no farther off than a step may go, and near their priors."""
    step = np.clip(target - hypotheses.parameters, -LARGEST, LARGEST)
    return within(hypotheses.parameters + step, priors.take(hypotheses.kind))


def within(parameters: FloatArray, prior: Priors) -> FloatArray:
    """Return parameters (n, 10) no farther from their priors, one row each, than an estimate may be."""
    limit = _WITHIN / np.sqrt(prior.information())
    return fitted(np.clip(natural(parameters, prior).parameters, -limit, limit), prior)


def plausible(parameters: FloatArray, prior: Priors) -> FloatArray:
    """Return parameters (n, 10), moved along their covariances, with burns that their classes have.

    Of a fit that is far from its rows they may be off so far that no course can be worked out. What is within its prior
    stays as it is.
    """
    found = parameters.copy()
    for column, sigma in ((BURN, prior.burn_sigma), (SHAPE, prior.burn_sigma + prior.shape_sigma)):
        found[:, column] = np.clip(found[:, column], -_WITHIN * sigma, _WITHIN * sigma)
    return found


def shortfall(solution: Solved, parameters: FloatArray) -> FloatArray:
    """Return by how much (n,) the evidence is less where steps that were cut short ended, as the linear problem has it.

    A hypothesis that is still on its way does not fit as well as where it is bound for.
    """
    variance = np.diagonal(solution.spread, axis1=1, axis2=2)
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.inf))
    away = (solution.parameters - parameters) / sigma
    scaled = solution.spread / (sigma[:, :, None] * sigma[:, None]) + _ROUNDING * np.eye(away.shape[1])
    less = np.zeros(len(away))
    cut = np.flatnonzero(np.any(np.abs(away) > _CUT, axis=1) & np.isfinite(scaled).all(axis=(1, 2)))
    if len(cut):
        back = np.linalg.solve(scaled[cut], away[cut, :, None])[:, :, 0]
        less[cut] = 0.5 * solution.misfit[cut] * np.maximum(np.sum(away[cut] * back, axis=1), 0.0)
    return less


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the products (n, r) of matrices (n, r, c) and vectors (n, c)."""
    product: FloatArray = np.sum(matrix * vector[:, None], axis=2)
    return product
