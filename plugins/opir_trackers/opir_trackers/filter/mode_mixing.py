"""Mode interaction of the IMM filter: mixing, mode probabilities, and a prior of the velocity.

The mixing is that of Blom and Bar-Shalom ("The interacting multiple model algorithm", IEEE Trans.
Automatic Control 33(8), 1988), by moment matching. Mode probabilities follow from detections and
missed detections.

One sensor alone does not observe the velocity along its line of sight. There the process noise of
the boost model accumulates, ever faster because thrust grows with itself, and estimates diverge. So
the velocity covariance is bounded by the prior covariance of all targets' velocities in every
direction; where measurements keep it below, nothing changes.

The `_of_one` functions compute the mode probabilities of one track with plain numbers.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import exp, expm1, sqrt

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.estimation import COAST, matvec, square_root
from opir_trackers.filter import burn_modes
from opir_trackers.filter.burn_modes import BurnModes, Burns, Gaussian
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.measurement_updates import measurement_update, moment_matched

#: Prior standard deviation of a target's velocity over the ground on any axis, m/s: 1.5 times the
#: root mean square of one component over the burns of the three classes' median profiles (1240
#: m/s), 0.75 times that at burnout (2700 m/s); notional.
SPEED_SIGMA_M_S = 2000.0


def have_uncertain_velocity(covariance: FloatArray) -> BoolArray:
    """Return which covariances (n, 6, 6) have a velocity variance above the prior in some
    direction.
    """
    loose: BoolArray = np.linalg.eigvalsh(covariance[:, 3:, 3:])[:, -1] > SPEED_SIGMA_M_S**2
    return loose


def with_velocity_prior(mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means (n, d) and information roots with the velocity covariance bounded by the prior.

    Each principal axis of the velocity covariance that is too long gets a pseudo-measurement of the
    ground velocity, with the variance that leads to the bound.
    """
    variance, axes = np.linalg.eigh(square_root.gram(square_root.inverse_root(root)[:, 3:6]))
    limit = SPEED_SIGMA_M_S**2
    inverse_sigma = np.sqrt(1.0 / limit - 1.0 / np.maximum(variance, limit))
    ground = EARTH_ROTATION_RAD_S * np.stack([-mean[:, 1], mean[:, 0], np.zeros(len(mean))], axis=1)
    rows = np.zeros((len(mean), 3, mean.shape[1] + 1))
    rows[:, :, 3:6] = axes.transpose(0, 2, 1) * inverse_sigma[:, :, None]
    rows[:, :, -1] = np.sum(rows[:, :, 3:6] * (ground - mean[:, 3:6])[:, None], axis=2)
    after, step, _ = measurement_update(root, np.zeros_like(mean), rows)
    return mean + step, after


Pair = tuple[float, float]


def mixing_of_one(weight: Pair, leave: Pair) -> tuple[Pair, Pair, Pair]:
    """Return the mode probabilities after a step, and the mixing probabilities into each mode.

    `leave` are the probabilities of leaving each mode. A burning target has not coasted before.
    """
    boost, coast = weight
    ends = boost * leave[0]
    begins = coast * leave[1]
    burning = boost - ends + begins
    coasting = coast - begins + ends
    into_boost = (1.0 - begins / burning, begins / burning) if burning > 0.0 else (0.0, 0.0)
    into_coast = (ends / coasting, 1.0 - ends / coasting) if coasting > 0.0 else (0.0, 0.0)
    if boost > 0.5 and leave[0] > 0.0:
        into_coast = (1.0, 0.0)
    return (burning, coasting), into_boost, into_coast


def detection_rate_of_one(
    detection_rate: Sequence[float],
    hits: float,
    silent_s: float,
    step_s: float,
    memory_s: float,
    pause_s: float,
) -> tuple[float, tuple[float, float, float]]:
    """Return the log likelihood of silence for the boost, and the detection rate after a slice.

    As `_silence_log_likelihood`.
    """
    if hits:
        fade = exp(-step_s / memory_s)
        pause = min(detection_rate[2], pause_s)
        spell = step_s if pause <= step_s else step_s + pause - silent_s
        return 0.0, (hits + fade * detection_rate[0], spell + fade * detection_rate[1], silent_s)
    return -detection_rate[0] / max(detection_rate[1], step_s) * step_s, (
        detection_rate[0],
        detection_rate[1],
        detection_rate[2] + step_s,
    )


def burnout_shift_of_one(
    detection_rate: Sequence[float], force: Sequence[float], scan_s: float
) -> tuple[list[float], list[float], tuple[float, float]]:
    """Return the shift of position and velocity, and its uncertainty, if the force ended after the
    last look.

    And that by a unit of force. As `coast_from_boost`.
    """
    hits, spell, silent = detection_rate
    pause = spell / max(hits, 1.0)
    later = max(pause - scan_s, 0.0)
    since = max(silent - (later + 0.5 * min(pause, scan_s)), 0.0)
    doubt = min(sqrt(scan_s * scan_s / 12.0 + pause * later), silent)
    times = (0.5 * since * since, since, since * doubt, doubt)
    shifts = [time * part for time in times for part in force]
    return shifts[:6], shifts[6:], times[:2]


def mode_weights_of_one(weight: Sequence[float], change: Pair, least: float) -> Pair:
    """Return weights times exp(change), normalised; a mode in use keeps at least `least`."""
    if weight[0] <= 0.0 or weight[1] <= 0.0:
        return weight[0], weight[1]
    most = max(change)
    boost = weight[0] * exp(change[0] - most)
    coast = weight[1] * exp(change[1] - most)
    floor = least * (boost + coast)
    boost = max(boost, floor)
    coast = max(coast, floor)
    return boost / (boost + coast), coast / (boost + coast)


#: Lower bound on mode probabilities, so that no mode is lost.
_LEAST_WEIGHT = 1e-6

#: Least mixing probability with which a mode takes part in a mixture.
_LEAST_SHARE = 1e-4

#: A target that coasts with this probability, without detection for this time, s, does not burn:
#: where it is lit again, it begins a new burn.
_RESTS_S = 3.0
_COASTS = 0.9

#: Where detections exclude coasts (`switching`), coasts less probable than this are neither
#: computed nor reported.
EXCLUDED_WEIGHT = 1e-3


def mixed(
    estimates: ModeEstimates,
    step_s: float,
    boost_s: float,
    coast_s: float,
    least: float,
    modes: BurnModes,
    scan_s: float = 0.0,
) -> ModeEstimates:
    """Return the estimates with modes mixed by the probability of a switch during a step.

    `boost_s` and `coast_s` are the mean times in each mode, inf for a mode that never ends. Coasts
    less probable than `least` after the step are not mixed, nor the boosts of targets that rest:
    see `relit`. `scan_s` is the shortest scan period.
    """
    leave = _leaving(step_s, boost_s, coast_s)
    if len(estimates.weight) == 1:
        return _mixed_alone(estimates, leave, least, modes, scan_s)
    weight, share = _shares(estimates.weight, leave)
    boost = (estimates.boost_mean, estimates.boost_root)
    coast = (estimates.coast_mean, estimates.coast_root)
    burns: Burns = estimates.burn_mean, estimates.burn_root, estimates.burn_share
    into_coast = ((share[:, 0, 1] > _LEAST_SHARE) & (weight[:, 1] >= least)).nonzero()[0]
    begins = (share[:, 1, 0] > modes.least_lit) & (estimates.weight[:, 1] >= EXCLUDED_WEIGHT)
    into_boost = (begins & ~_rest(estimates.detection_rate, weight)).nonzero()[0]
    if len(into_coast):
        coast = _put(
            coast,
            into_coast,
            _into_coast(estimates.part(into_coast), share[into_coast, :, 1], scan_s),
        )
    if len(into_boost):
        lit, parts = _into_boost(estimates.part(into_boost), share[into_boost, :, 0], modes)
        boost = _put(boost, into_boost, lit)
        burns = burn_modes.put(burns, into_boost, parts)
    return ModeEstimates(weight, *boost, *coast, estimates.detection_rate, *burns)


def _mixed_alone(
    estimates: ModeEstimates,
    leave: tuple[float, float],
    least: float,
    modes: BurnModes,
    scan_s: float,
) -> ModeEstimates:
    """Return `mixed` for one track."""
    boost, coast = estimates.weight[0].tolist()
    weight, into_boost, into_coast = mixing_of_one((boost, coast), leave)
    burning = (estimates.boost_mean, estimates.boost_root)
    coasting = (estimates.coast_mean, estimates.coast_root)
    burns: Burns = estimates.burn_mean, estimates.burn_root, estimates.burn_share
    if into_coast[0] > _LEAST_SHARE and weight[1] >= least:
        coasting = _into_coast(estimates, np.array([into_coast]), scan_s)
    rests = estimates.detection_rate[0, 2] > _RESTS_S and weight[1] > _COASTS
    if into_boost[1] > modes.least_lit and coast >= EXCLUDED_WEIGHT and not rests:
        burning, burns = _into_boost(estimates, np.array([into_boost]), modes)
    return ModeEstimates(np.array([weight]), *burning, *coasting, estimates.detection_rate, *burns)


@lru_cache(maxsize=64)
def _leaving(step_s: float, boost_s: float, coast_s: float) -> tuple[float, float]:
    """Return the probabilities of leaving boost and coast in a step."""
    return -expm1(-step_s / boost_s), -expm1(-step_s / coast_s)


def _shares(before: FloatArray, leave: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return mode probabilities (n, 2) after a step and mixing probabilities (n, 2, 2) into each
    mode (last).
    """
    switch = np.array([[1.0 - leave[0], leave[0]], [leave[1], 1.0 - leave[1]]])
    weight = before @ switch
    share = before[:, :, None] * switch / np.maximum(weight, 1e-300)[:, None]
    if leave[0] > 0.0:
        # A target that burns has not coasted before: what its coast mode made of the looks so far
        # is let go.
        share[before[:, 0] > 0.5, :, 1] = [1.0, 0.0]
    return weight, share


def _put(
    whole: tuple[FloatArray, FloatArray], rows: IntArray, part: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return means and roots with some rows replaced."""
    if len(rows) == len(whole[0]):
        return part
    mean = whole[0].copy()
    root = whole[1].copy()
    mean[rows], root[rows] = part
    return mean, root


def _into_coast(
    estimates: ModeEstimates, share: FloatArray, scan_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the coast's means and roots, mixed with probabilities (n, 2) from boost and coast."""
    burnt = coast_from_boost(estimates, scan_s)
    if not np.count_nonzero(share[:, 1]):
        return burnt
    return moment_matched(share, (burnt[0], estimates.coast_mean), (burnt[1], estimates.coast_root))


def _into_boost(
    estimates: ModeEstimates, share: FloatArray, modes: BurnModes
) -> tuple[Gaussian, Burns]:
    """Return boosts and their parts, mixed with probabilities (n, 2) from boost and coast.

    Of modes with stages, a burn after the dark begins anew.
    """
    if modes.stage is not None:
        return relit(estimates, estimates.coast_mean, estimates.coast_root, modes)
    means = (estimates.boost_mean, _extended_mean(estimates))
    roots = (estimates.boost_root, _extended_root(estimates))
    lit = moment_matched(share, means, roots)
    return lit, burn_modes.parts_of(lit)


def coast_from_boost(
    estimates: ModeEstimates, scan_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of boosts that ended soon after their last detection.

    With r detections per second of scans every T, a look detects with p = r T. The burn ended T / 2
    ± T / √12 after the last detection, T later for each look that missed it: T (1/p - 1/2) on
    average, with the variance T² (1/12 + (1 - p) / p²). Much faster scans than detections leave 1/r
    ± 1/r. Several sensors may look soon after one another, so the doubt is that of one. At a time u
    after burnout, velocity and position are less by f u and f u²/2 than with the force f still
    acting.
    """
    if len(estimates.detection_rate) == 1:
        return _coast_from_boost_alone(estimates, scan_s)
    hits, spell, silent = estimates.detection_rate.T
    pause = spell / np.maximum(hits, 1.0)
    later = np.maximum(pause - scan_s, 0.0)
    since = np.maximum(silent - (later + 0.5 * np.minimum(pause, scan_s)), 0.0)
    doubt = np.minimum(np.sqrt(scan_s * scan_s / 12.0 + pause * later), silent)
    times = np.array([0.5 * since * since, since, since * doubt, doubt]).reshape(2, 2, -1)
    shifts = (
        times.transpose(0, 2, 1)[:, :, :, None] * estimates.boost_mean[:, None, COAST : COAST + 3]
    )
    less, spread = shifts.reshape(2, -1, COAST)
    root = estimates.boost_root
    size = estimates.boost_root.shape[1]
    rows = np.zeros((len(estimates), size + 1, size + 1))
    rows[:, 0, 0] = 1.0
    rows[:, 1:, 0] = matvec(root[:, :, :COAST], spread)
    rows[:, 1:, 1:-COAST] = root[:, :, COAST:]
    rows[:, 1:, -COAST:] = root[:, :, :COAST]
    # A force that is not known has not acted since burnout either.
    by_force = 0.5 * since * since, since
    rows[:, 1:, 1:4] += (
        by_force[0][:, None, None] * root[:, :, :3]
        + by_force[1][:, None, None] * root[:, :, 3:COAST]
    )
    # What is known of the last columns whatever the first ones are.
    return estimates.boost_mean[:, :COAST] - less, square_root.triangular(rows)[:, -COAST:, -COAST:]


def _coast_from_boost_alone(
    estimates: ModeEstimates, scan_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return `coast_from_boost` for one track."""
    less, spread, by_force = burnout_shift_of_one(
        estimates.detection_rate[0].tolist(),
        estimates.boost_mean[0, COAST : COAST + 3].tolist(),
        scan_s,
    )
    root = estimates.boost_root[0]
    size = estimates.boost_root.shape[1]
    rows = np.zeros((1, size + 1, size + 1))
    rows[0, 0, 0] = 1.0
    rows[0, 1:, 0] = root[:, :COAST] @ np.array(spread)
    rows[0, 1:, 1:-COAST] = root[:, COAST:]
    rows[0, 1:, -COAST:] = root[:, :COAST]
    rows[0, 1:, 1:4] += by_force[0] * root[:, :3] + by_force[1] * root[:, 3:COAST]
    return estimates.boost_mean[:, :COAST] - np.array(less), square_root.triangular(rows)[
        :, -COAST:, -COAST:
    ]


def resting_rows(estimates: ModeEstimates) -> IntArray:
    """Return the rows of tracks without detection for so long that a burn would be a new one."""
    return _rest(estimates.detection_rate, estimates.weight).nonzero()[0]


def _rest(detection_rate: FloatArray, weight: FloatArray) -> BoolArray:
    resting: BoolArray = (detection_rate[:, 2] > _RESTS_S) & (weight[:, 1] > _COASTS)
    return resting


def relit(
    estimates: ModeEstimates, mean: FloatArray, root: FloatArray, modes: BurnModes
) -> tuple[Gaussian, Burns]:
    """Return boosts, and their parts, of targets that ignite where they coast, with means (n, 6)
    and roots (n, 6, 6).

    The old force is that of an earlier estimate. Propagated as a burn, the covariance of an
    unobserved boost would grow without bound: the turn of a force with a slow velocity is strongly
    nonlinear.
    """
    if modes.stage is not None:
        return modes.lit(
            (mean, root), (estimates.burn_mean, estimates.burn_root, estimates.burn_share)
        )
    after = ModeEstimates(
        estimates.weight,
        estimates.boost_mean,
        estimates.boost_root,
        mean,
        root,
        estimates.detection_rate,
    )
    lit = _extended_mean(after), _extended_root(after)
    return lit, burn_modes.parts_of(lit)


def _extended_mean(estimates: ModeEstimates) -> FloatArray:
    """Return the coast means with the boost's specific force and its rate."""
    return np.concatenate([estimates.coast_mean, estimates.boost_mean[:, COAST:]], axis=1)


def _extended_root(estimates: ModeEstimates) -> FloatArray:
    """Return the coast roots with the boost's marginal root of specific force and its rate."""
    root = np.zeros_like(estimates.boost_root)
    root[:, :COAST, :COAST] = estimates.coast_root
    root[:, COAST:, COAST:] = burn_modes.force_root(estimates.boost_root)
    return root


def mode_update_alone(
    estimates: ModeEstimates,
    hits: int,
    silent_s: float,
    change: tuple[float, float],
    step_s: float,
    memory_s: float,
    pause_s: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return `mode_update` for one track."""
    log, after = detection_rate_of_one(
        estimates.detection_rate[0].tolist(), hits, silent_s, step_s, memory_s, pause_s
    )
    weight = mode_weights_of_one(
        estimates.weight[0].tolist(), (change[0] + log, change[1]), _LEAST_WEIGHT
    )
    return np.array([weight]), np.array([after])


def mode_update(
    estimates: ModeEstimates,
    hits: FloatArray,
    silent_s: FloatArray,
    change: FloatArray,
    step_s: float,
    memory_s: float,
    pause_s: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return mode probabilities (n, 2) and detection rates (n, 3) after a slice with `hits` (n,)
    detections per track.

    `silent_s` (n,) is the time since the last detection, `change` (n, 2) the log likelihood of the
    detections. The rate forgets over slices with detections with time constant `memory_s`; pauses
    of up to `pause_s` between detections count as observed time.
    """
    missed, detection_rate = _silence_log_likelihood(
        estimates.detection_rate, hits, silent_s, step_s, memory_s, pause_s
    )
    change[:, 0] += missed
    return _normalised_weights(estimates.weight, change), detection_rate


def _silence_log_likelihood(
    detection_rate: FloatArray,
    hits: FloatArray,
    silent_s: FloatArray,
    step_s: float,
    memory_s: float,
    pause_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the boost's log likelihood (n,) of a slice without detection, and the detection rate
    (n, 3) after it.

    A burning target with r detections per second stays undetected for t with probability exp(-r t);
    a burnt-out one is never detected. For rows with `hits` (n,) in the slice, `silent_s` (n,) is
    the time since the last. Slices without a scan between two detections count as observed time.
    """
    silent = hits == 0.0
    after = np.empty_like(detection_rate)
    pause = np.minimum(detection_rate[:, 2], pause_s)
    after[:, 0] = hits
    after[:, 1] = np.where(pause > step_s, step_s + pause - silent_s, step_s)
    after[:, 2] = silent_s
    after[:, :2] += np.exp(-step_s / memory_s) * detection_rate[:, :2]
    log = np.zeros(len(detection_rate))
    if np.count_nonzero(silent):
        after[silent, :2] = detection_rate[silent, :2]
        after[silent, 2] = detection_rate[silent, 2] + step_s
        log[silent] = (
            -detection_rate[silent, 0] / np.maximum(detection_rate[silent, 1], step_s) * step_s
        )
    return log, after


def _normalised_weights(weight: FloatArray, change: FloatArray) -> FloatArray:
    """Return weights (n, 2) times exp(change), normalised; a mode in use keeps the least weight."""
    log = np.where(weight > 0.0, change, -np.inf)
    scaled = weight * np.exp(log - np.maximum(log[:, :1], log[:, 1:]))
    least = _LEAST_WEIGHT * (scaled[:, :1] + scaled[:, 1:])
    scaled = np.where(weight > 0.0, np.maximum(scaled, least), 0.0)
    total: FloatArray = scaled / (scaled[:, :1] + scaled[:, 1:])
    return total
