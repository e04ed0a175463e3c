"""Mode interaction of the IMM filter: mixing, mode probabilities, and a prior of the velocity.

The mixing is that of Blom and Bar-Shalom ("The interacting multiple model algorithm", IEEE Trans.
Automatic Control 33(8), 1988), by moment matching. Mode probabilities follow from detections and
missed detections.

One sensor alone does not observe the velocity along its line of sight. There the process noise of
the boost model accumulates, ever faster because thrust grows with itself, and estimates diverge. So
the velocity covariance is bounded by the prior covariance of all targets' velocities in every
direction; where measurements keep it below, nothing changes.
"""

from functools import lru_cache, partial
from math import expm1
from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_estimation import square_root
from opir_estimation.directions import matvec
from opir_estimation.filter.burn_modes import LAW, BurnModes, resumed
from opir_estimation.filter.estimates import Burns, ModeEstimates, with_rows
from opir_estimation.filter.measurement_updates import (
    Gaussian,
    information_root,
    measurement_update,
    moment_matched,
)
from opir_estimation.formulas import Functions, Vector, arithmetic, scaled
from opir_estimation.lines_of_sight import ground_velocities
from opir_estimation.motion import COAST

#: Prior standard deviation of a target's velocity over the ground on any axis, m/s: 1.5 times the
#: root mean square of one component over the burns of the three classes' median profiles (1240
#: m/s), 0.75 times that at burnout (2700 m/s); notional.
SPEED_SIGMA_M_S = 2000.0

#: Lower bound on mode probabilities, so that no mode is lost.
_LEAST_WEIGHT = 1e-6

#: A target that coasts with this probability, without detection for this time, s, does not burn:
#: where it is lit again, it begins a new burn.
_RESTS_S = 3.0
_COASTS = 0.9

#: Where detections exclude coasts (`switching`), coasts less probable than this are neither
#: computed nor reported.
EXCLUDED_WEIGHT = 1e-3

#: Mode probabilities of a lone track are computed with plain numbers.
_ARITHMETIC = arithmetic(few=1)


def have_uncertain_velocity(covariance: FloatArray) -> BoolArray:
    """Return which covariances (n, 6, 6) have a velocity variance above the prior in some
    direction.
    """
    return np.linalg.eigvalsh(covariance[:, 3:, 3:])[:, -1] > SPEED_SIGMA_M_S**2


def with_velocity_prior(estimates: Gaussian) -> Gaussian:
    """Return estimates (n, d) with the velocity covariance bounded by the prior.

    Each principal axis of the velocity covariance that is too long gets a pseudo-measurement of the
    ground velocity, with the variance that leads to the bound.
    """
    mean, root = estimates
    variance, axes = np.linalg.eigh(square_root.gram(square_root.inverse_root(root)[:, 3:6]))
    limit = SPEED_SIGMA_M_S**2
    inverse_sigma = np.sqrt(1.0 / limit - 1.0 / np.maximum(variance, limit))
    ground = ground_velocities(mean[:, :3])
    rows = np.zeros((len(mean), 3, mean.shape[1] + 1))
    rows[:, :, 3:6] = axes.mT * inverse_sigma[:, :, None]
    rows[:, :, -1] = np.sum(rows[:, :, 3:6] * (ground - mean[:, 3:6])[:, None], axis=2)
    bounded, step, _ = measurement_update(root, np.zeros_like(mean), rows)
    return Gaussian(mean + step, bounded)


def mixed(
    estimates: ModeEstimates,
    step_s: float,
    boost_s: float,
    coast_s: float,
    least: float,
    modes: BurnModes,
    scan_s: float = 0.0,
    *,
    forgets_coasts: bool = True,
) -> ModeEstimates:
    """Return the estimates with modes mixed by the probability of a switch during a step.

    `boost_s` and `coast_s` are the mean times in each mode, inf for a mode that never ends. Coasts
    less probable than `least` after the step are not mixed, nor the boosts of targets that rest:
    see `relit`. `scan_s` is the shortest scan period. What burns has not coasted before: where no
    sensor sees bodies that coast (`forgets_coasts`), its coast begins anew in each step; else looks
    tell, as in any IMM.
    """
    boost, coast, burns = estimates.boost, estimates.coast, estimates.burns
    leave = _leaving(step_s, boost_s, coast_s)
    values = _ARITHMETIC.values(
        partial(_mixing, leave=leave, forgets_coasts=forgets_coasts), estimates.weight
    )
    weight = values[:, :2]
    if values.shape[0] > 1:
        # Sums of products of all rows: to the last bit, not those of a lone track.
        weight = estimates.weight @ np.array(
            [[1.0 - leave[0], leave[0]], [leave[1], 1.0 - leave[1]]]
        )
    lit_share = values[:, 2]
    ended_share = values[:, 3]
    rows = ((ended_share > LAW.least_share) & (weight[:, 1] >= least)).nonzero()[0]
    if rows.size:
        ended = _into_coast(estimates.part(rows), ended_share[rows], scan_s)
        coast = with_rows(coast, rows, ended)
    begins = (lit_share > modes.least_lit) & (estimates.weight[:, 1] >= EXCLUDED_WEIGHT)
    rows = (begins & ~_are_resting(estimates.detection_rate, weight)).nonzero()[0]
    if rows.size:
        lit, lit_burns = _into_boost(estimates.part(rows), lit_share[rows], modes)
        boost = with_rows(boost, rows, lit)
        burns = with_rows(burns, rows, lit_burns)
    return ModeEstimates(weight, *boost, *coast, estimates.detection_rate, *burns)


@lru_cache(maxsize=64)
def _leaving(step_s: float, boost_s: float, coast_s: float) -> tuple[float, float]:
    """Return the probabilities of leaving boost and coast in a step."""
    return -expm1(-step_s / boost_s), -expm1(-step_s / coast_s)


def _mixing(
    weight: Vector, functions: Functions, leave: tuple[float, float], forgets_coasts: bool
) -> list[Any]:
    """Return the mode probabilities after a step, and the probabilities that each mode was the
    other one before, given that it is now.
    """
    boost, coast = weight
    ends = boost * leave[0]
    begins = coast * leave[1]
    burning = boost - ends + begins
    coasting = coast - begins + ends
    lit = begins / functions.greatest(burning, 1e-300)
    ended = ends / functions.greatest(coasting, 1e-300)
    if forgets_coasts and leave[0] > 0.0:
        ended = functions.where(boost > 0.5, 1.0, ended)
    return [burning, coasting, lit, ended]


def _into_coast(estimates: ModeEstimates, ended: FloatArray, scan_s: float) -> Gaussian:
    """Return coasts mixed with boosts that ended, with probabilities (n,)."""
    burnt = coast_from_boost(estimates, scan_s)
    share = np.stack([ended, 1.0 - ended], axis=1)
    if not share[:, 1].any():
        return burnt
    coast = estimates.coast
    return moment_matched(share, (burnt.mean, coast.mean), (burnt.root, coast.root))


def _into_boost(
    estimates: ModeEstimates, lit: FloatArray, modes: BurnModes
) -> tuple[Gaussian, Burns]:
    """Return boosts and their parts, mixed with probabilities (n,) from coasts.

    Of modes with stages, a burn after the dark begins anew.
    """
    if modes.stage is not None:
        return relit(estimates, estimates.coast, modes)
    begun = resumed(estimates.coast, estimates.boost)
    share = np.stack([1.0 - lit, lit], axis=1)
    means = (estimates.boost_mean, begun.mean)
    boost = moment_matched(share, means, (estimates.boost_root, begun.root))
    return boost, Burns.of(boost)


def coast_from_boost(estimates: ModeEstimates, scan_s: float = 0.0) -> Gaussian:
    """Return position and velocity of boosts that ended soon after their last detection.

    With r detections per second of scans every T, a look detects with p = r T. The burn ended T / 2
    ± T / √12 after the last detection, T later for each look that missed it: T (1/p - 1/2) on
    average, with the variance T² (1/12 + (1 - p) / p²). Much faster scans than detections leave 1/r
    ± 1/r. Several sensors may look soon after one another, so the doubt is that of one. At a time u
    after burnout, velocity and position are less by f u and f u²/2 than with the force f still
    acting.
    """
    mean, root = estimates.boost
    shift = _ARITHMETIC.values(
        partial(_burnout_shift, scan_s=scan_s), estimates.detection_rate, mean[:, COAST : COAST + 3]
    )
    by_force = shift[:, 12:, None, None]
    rows = np.zeros((len(mean), mean.shape[1] + 1, mean.shape[1] + 1))
    rows[:, 0, 0] = 1.0
    rows[:, 1:, 0] = matvec(root[:, :, :COAST], shift[:, 6:12])
    rows[:, 1:, 1:-COAST] = root[:, :, COAST:]
    rows[:, 1:, -COAST:] = root[:, :, :COAST]
    # A force that is not known has not acted since burnout either.
    rows[:, 1:, 1:4] += by_force[:, 0] * root[:, :, :3] + by_force[:, 1] * root[:, :, 3:COAST]
    # The marginal of the last columns.
    coast_root = square_root.triangular(rows)[:, -COAST:, -COAST:]
    return Gaussian(mean[:, :COAST] - shift[:, :6], coast_root)


def _burnout_shift(
    detection_rate: Vector, force: Vector, functions: Functions, scan_s: float
) -> list[Any]:
    """Return the shift of position and velocity (6), its uncertainty (6), and shifts by a unit of
    force.
    """
    *_, silent = detection_rate
    mean_wait, wait_sigma = _burnout_wait(detection_rate, functions, scan_s)
    since = functions.greatest(silent - mean_wait, 0.0)
    sigma = functions.least(wait_sigma, silent)
    half_square = 0.5 * since * since
    times = (half_square, since, since * sigma, sigma)
    shifts = [component for time in times for component in scaled(time, force)]
    return [*shifts, half_square, since]


def _burnout_wait(detection_rate: Vector, functions: Functions, scan_s: float) -> list[Any]:
    """Return mean and standard deviation of the time from the last detection to burnout, s."""
    hits, spell, _ = detection_rate
    pause = spell / functions.greatest(hits, 1.0)
    later = functions.greatest(pause - scan_s, 0.0)
    mean = later + 0.5 * functions.least(pause, scan_s)
    return [mean, functions.sqrt(scan_s * scan_s / 12.0 + pause * later)]


def coasts_from_ends(ends: Gaussian, detection_rate: FloatArray, scan_s: float) -> Gaussian:
    """Return free flights (n, 6) as of the last looks of burns whose states (n, 9) then were these.

    The force acts on until burnout, as of `coast_from_boost`.
    """
    wait = _ARITHMETIC.values(partial(_burnout_wait, scan_s=scan_s), detection_rate)
    mean_s, sigma_s = wait.T[:, :, None]
    position, velocity, force = np.split(ends.mean, 3, axis=1)
    mean = np.concatenate([position - 0.5 * mean_s**2 * force, velocity + mean_s * force], axis=1)
    side = square_root.inverse_root(ends.root)
    moved = side[:, :3] - 0.5 * mean_s[:, :, None] ** 2 * side[:, 6:]
    sped = side[:, 3:6] + mean_s[:, :, None] * side[:, 6:]
    later = np.concatenate([-mean_s * sigma_s * force, sigma_s * force], axis=1)
    rows = np.concatenate([np.concatenate([moved, sped], axis=1), later[:, :, None]], axis=2)
    return Gaussian(mean, information_root(rows))


def resting_rows(estimates: ModeEstimates) -> IntArray:
    """Return the rows of tracks without detection for so long that a burn would be a new one."""
    return _are_resting(estimates.detection_rate, estimates.weight).nonzero()[0]


def _are_resting(detection_rate: FloatArray, weight: FloatArray) -> BoolArray:
    return (detection_rate[:, 2] > _RESTS_S) & (weight[:, 1] > _COASTS)


def relit(estimates: ModeEstimates, coast: Gaussian, modes: BurnModes) -> tuple[Gaussian, Burns]:
    """Return boosts, and their parts, of targets that ignite where they coast.

    The old force is that of an earlier estimate. Propagated as a burn, the covariance of an
    unobserved boost would grow without bound: the turn of a force with a slow velocity is strongly
    nonlinear.
    """
    if modes.stage is not None:
        return modes.lit(coast, estimates.burns)
    boost = resumed(coast, estimates.boost)
    return boost, Burns.of(boost)


class LookTimes(NamedTuple):
    """How long tracks (n,) were looked at in a slice, s: `expected_s` by all of their sensors
    together, in shares of their detections, `looked_s` by any.
    """

    expected_s: FloatArray
    looked_s: FloatArray


def mode_update(
    estimates: ModeEstimates,
    hits: FloatArray | IntArray,
    silent_s: FloatArray,
    change: FloatArray,
    step_s: float,
    memory_s: float,
    pause_s: float = 0.0,
    watched: LookTimes | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return mode probabilities (n, 2) and detection rates (n, 3) after a slice with `hits` (n,)
    detections per track.

    `silent_s` (n,) is the time since the last detection, `change` (n, 2) the log likelihood of the
    detections. The rate forgets over slices with detections with time constant `memory_s`; pauses
    of up to `pause_s` between detections count as observed time. Of a slice that is not `watched`
    throughout, the rest says nothing.
    """
    if watched is None:
        throughout = np.array([step_s] * len(silent_s))
        watched = LookTimes(throughout, throughout)
    formula = partial(_mode_values, step_s=step_s, memory_s=memory_s, pause_s=pause_s)
    values = _ARITHMETIC.values(
        formula, estimates.weight, change, estimates.detection_rate, hits, silent_s, *watched
    )
    return values[:, :2], values[:, 2:]


def _mode_values(
    weight: Vector,
    change: Vector,
    detection_rate: Vector,
    hits: Any,
    silent_s: Any,
    expected_s: Any,
    looked_s: Any,
    functions: Functions,
    **times_s: float,
) -> list[Any]:
    """Return mode probabilities and detection rate."""
    looks = hits, silent_s, expected_s, looked_s
    missed, *rate = _detection_rate(detection_rate, *looks, functions, **times_s)
    return [*_mode_weights(weight, change, missed, functions), *rate]


def _detection_rate(
    detection_rate: Vector,
    hits: Any,
    silent_s: Any,
    expected_s: Any,
    looked_s: Any,
    functions: Functions,
    step_s: float,
    memory_s: float,
    pause_s: float,
) -> list[Any]:
    """Return the boost's log likelihood of a slice without detection, and the detection rate after
    it.

    A burning target with r detections per second stays undetected for t with probability exp(-r t);
    a burnt-out one is never detected. Slices without a scan between two detections count as
    observed time, in the share of the sensors that look at the second one.
    """
    where = functions.where
    count, spell, silence_s = detection_rate
    is_seen = hits > 0.0
    fade = functions.exp(-step_s / memory_s)
    pause = functions.least(silence_s, pause_s)
    share = expected_s / max(step_s, 1e-300)
    observed = where(pause > step_s, share * (step_s + pause - silent_s), expected_s)
    missed = -count / functions.greatest(functions.greatest(spell, step_s), 1e-300) * expected_s
    return [
        where(is_seen, 0.0, missed),
        where(is_seen, hits + fade * count, count),
        where(is_seen, observed + fade * spell, spell),
        where(is_seen, silent_s, silence_s + looked_s),
    ]


def _mode_weights(
    weight: Vector, change: Vector, missed: Any, functions: Functions
) -> tuple[Any, Any]:
    """Return weights times exp(change), normalised; a mode in use keeps the least weight."""
    is_one = (weight[0] <= 0.0) | (weight[1] <= 0.0)
    log_boost = change[0] + missed
    greatest = functions.greatest(log_boost, change[1])
    boost = weight[0] * functions.exp(log_boost - greatest)
    coast = weight[1] * functions.exp(change[1] - greatest)
    floor = _LEAST_WEIGHT * (boost + coast)
    boost = functions.greatest(boost, floor)
    coast = functions.greatest(coast, floor)
    total = boost + coast
    return (
        functions.where(is_one, weight[0], boost / total),
        functions.where(is_one, weight[1], coast / total),
    )
