"""How the modes of the stereo filter interact: mixed by the chance of having switched, weighed by looks and by silence.

The mixing is that of Blom and Bar-Shalom ("The interacting multiple model algorithm", IEEE Trans. Automatic Control
33(8), 1988), by first and second moments.

What nothing measures stays no less certain than targets are known to be: the velocity along a single line of sight.

One sensor alone sees no motion along its line of sight. There the noise of the boost model adds up, and does so faster
and faster, for thrust grows with itself: estimates run off, of a sensor in a low orbit right through the sensor. But
whatever is forgotten of a target's past, its velocity is one of those that targets have. So in no direction does the
velocity become less certain than that; where looks keep it there by themselves, nothing is done.

What `mode_mixing` works out of the weights of modes for columns of tracks, for one track's numbers.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import exp, expm1

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.estimation import square_root
from opir_core.estimation.lines_of_sight import along
from opir_core.estimation.motion import COAST
from opir_trackers.filter.estimates import ModeEstimates

#: The standard deviation of targets' velocities over the ground along any axis, m/s: half as much again as the root
#: mean square of one component through the burns of the three classes' median profiles (1240 m/s), three quarters of
#: that at their ends (2700 m/s); notional.
SPEED_SIGMA_M_S = 2000.0


def are_loose(covariance: FloatArray) -> BoolArray:
    """Return which covariances (n, 6, 6) leave velocities less certain, in some direction, than all targets' are."""
    loose: BoolArray = np.linalg.eigvalsh(covariance[:, 3:, 3:])[:, -1] > SPEED_SIGMA_M_S**2
    return loose


def restrained(mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means (n, d) and roots of information whose velocities are no less certain than those of all targets.

    As if the components along the axes of a velocity's ellipsoid that are too long were measured, as badly as leads to
    the bound, and found to be those of the ground.
    """
    variance, axes = np.linalg.eigh(square_root.squared(square_root.spread(root)[:, 3:6]))
    limit = SPEED_SIGMA_M_S**2
    told = np.sqrt(1.0 / limit - 1.0 / np.maximum(variance, limit))
    ground = EARTH_ROTATION_RAD_S * np.stack([-mean[:, 1], mean[:, 0], np.zeros(len(mean))], axis=1)
    rows = np.zeros((len(mean), 3, mean.shape[1] + 1))
    rows[:, :, 3:6] = axes.transpose(0, 2, 1) * told[:, :, None]
    rows[:, :, -1] = np.sum(rows[:, :, 3:6] * (ground - mean[:, 3:6])[:, None], axis=2)
    after, step, _ = square_root.updated(root, np.zeros_like(mean), rows)
    return mean + step, after


Pair = tuple[float, float]


def shared_of_one(weight: Pair, leave: Pair) -> tuple[Pair, Pair, Pair]:
    """Return the weights of boost and coast after a step, and of what shares of both modes each is mixed.

    `leave` are the chances of leaving each mode. A target that burns has not coasted before.
    """
    boost, coast = weight
    ends, begins = boost * leave[0], coast * leave[1]
    burning, coasting = boost - ends + begins, coast - begins + ends
    into_boost = (1.0 - begins / burning, begins / burning) if burning > 0.0 else (0.0, 0.0)
    into_coast = (ends / coasting, 1.0 - ends / coasting) if coasting > 0.0 else (0.0, 0.0)
    if boost > 0.5 and leave[0] > 0.0:
        into_coast = (1.0, 0.0)
    return (burning, coasting), into_boost, into_coast


def paced_of_one(
    pace: Sequence[float], hits: float, silent_s: float, step_s: float, memory_s: float, pause_s: float
) -> tuple[float, tuple[float, float, float]]:
    """Return what a slice takes from the boost's log weight, and the pace after it, as `mode_mixing._missed`."""
    if hits:
        fade, pause = exp(-step_s / memory_s), min(pace[2], pause_s)
        spell = step_s if pause <= step_s else step_s + pause - silent_s
        return 0.0, (hits + fade * pace[0], spell + fade * pace[1], silent_s)
    return -pace[0] / max(pace[1], step_s) * step_s, (pace[0], pace[1], pace[2] + step_s)


def burnt_out_of_one(pace: Sequence[float], force: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return by how much position and velocity are less, and their doubt, had the force ended after the last look."""
    hits, spell, silent = pace
    pause = spell / max(hits, 1.0)
    since, doubt = max(silent - pause, 0.0), min(pause, silent)
    times = 0.5 * since * since, since, since * doubt, doubt
    shifts = [time * part for time in times for part in force]
    return shifts[:6], shifts[6:]


def reweighed_of_one(weight: Sequence[float], change: Pair, least: float) -> Pair:
    """Return weights times exp(change), normalised, none of a mode in use below the least."""
    if weight[0] <= 0.0 or weight[1] <= 0.0:
        return weight[0], weight[1]
    most = max(change)
    boost, coast = weight[0] * exp(change[0] - most), weight[1] * exp(change[1] - most)
    floor = least * (boost + coast)
    boost, coast = max(boost, floor), max(coast, floor)
    return boost / (boost + coast), coast / (boost + coast)


#: Mode weights stay above this, so that no mode is ever lost.
_LEAST_WEIGHT = 1e-6

#: A mode takes part in a mixture from this share on.
_LEAST_SHARE = 1e-4

#: A target that coasts with this probability, unseen for so long, s, does not burn: longer than stages are dark.
_RESTS_S, _COASTS = 30.0, 0.9

#: Where looks can shut out coasts (`switching`), those less probable than this are not worked out, nor told of.
SHUT_OUT = 1e-3


def mixed(bank: ModeEstimates, step_s: float, boost_s: float, coast_s: float, least: float = 0.0) -> ModeEstimates:
    """Return a bank whose modes are mixed by the chance of having switched during a step.

    `boost_s` and `coast_s` are the mean times spent in each mode, inf for one that never ends. Coasts that are less
    probable than `least` after the step stay as they were.
    """
    leave = _leaving(step_s, boost_s, coast_s)
    if len(bank.weight) == 1:
        return _mixed_alone(bank, leave, least)
    weight, share = _shares(bank.weight, leave)
    boost, coast = (bank.boost_mean, bank.boost_root), (bank.coast_mean, bank.coast_root)
    into_coast = ((share[:, 0, 1] > _LEAST_SHARE) & (weight[:, 1] >= least)).nonzero()[0]
    into_boost = ((share[:, 1, 0] > _LEAST_SHARE) & (bank.weight[:, 1] >= SHUT_OUT)).nonzero()[0]
    if len(into_coast):
        coast = _put(coast, into_coast, _into_coast(bank.part(into_coast), share[into_coast, :, 1]))
    if len(into_boost):
        boost = _put(boost, into_boost, _into_boost(bank.part(into_boost), share[into_boost, :, 0]))
    return ModeEstimates(weight, *boost, *coast, bank.pace)


def _mixed_alone(bank: ModeEstimates, leave: tuple[float, float], least: float) -> ModeEstimates:
    """Return what `mixed` does, of one track."""
    boost, coast = bank.weight[0].tolist()
    weight, into_boost, into_coast = shared_of_one((boost, coast), leave)
    burning, coasting = (bank.boost_mean, bank.boost_root), (bank.coast_mean, bank.coast_root)
    if into_coast[0] > _LEAST_SHARE and weight[1] >= least:
        coasting = _into_coast(bank, np.array([into_coast]))
    if into_boost[1] > _LEAST_SHARE and coast >= SHUT_OUT:
        burning = _into_boost(bank, np.array([into_boost]))
    return ModeEstimates(np.array([weight]), *burning, *coasting, bank.pace)


@lru_cache(maxsize=64)
def _leaving(step_s: float, boost_s: float, coast_s: float) -> tuple[float, float]:
    """Return the chances of leaving boost and coast in a step."""
    return -expm1(-step_s / boost_s), -expm1(-step_s / coast_s)


def _shares(before: FloatArray, leave: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return weights (n, 2) after a step, and the shares (n, 2, 2) that each mode (last) is mixed of."""
    switch = np.array([[1.0 - leave[0], leave[0]], [leave[1], 1.0 - leave[1]]])
    weight = before @ switch
    share = before[:, :, None] * switch / np.maximum(weight, 1e-300)[:, None]
    if leave[0] > 0.0:
        # A target that burns has not coasted before: what its coast mode made of the looks so far is let go.
        share[before[:, 0] > 0.5, :, 1] = [1.0, 0.0]
    return weight, share


def _put(
    whole: tuple[FloatArray, FloatArray], rows: IntArray, part: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return means and roots with some rows replaced."""
    if len(rows) == len(whole[0]):
        return part
    mean, root = whole[0].copy(), whole[1].copy()
    mean[rows], root[rows] = part
    return mean, root


def _into_coast(bank: ModeEstimates, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the coast's means and roots, of which shares (n, 2) come from boost and coast."""
    burnt = burnt_out(bank)
    if not np.count_nonzero(share[:, 1]):
        return burnt
    return square_root.mixed(share, (burnt[0], bank.coast_mean), (burnt[1], bank.coast_root))


def _into_boost(bank: ModeEstimates, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the boost's means and roots, of which shares (n, 2) come from boost and coast."""
    means, roots = (bank.boost_mean, _extended_mean(bank)), (bank.boost_root, _extended_root(bank))
    return square_root.mixed(share, means, roots)


def burnt_out(bank: ModeEstimates) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of boosts that ended soon after they were last seen.

    Of a target seen r times a second the burn ended 1/r ± 1/r after the last look. A time u after the end, velocity and
    position are less by f u and f u²/2 than had the force f gone on.
    """
    if len(bank.pace) == 1:
        return _burnt_out_alone(bank)
    hits, spell, silent = bank.pace.T
    pause = spell / np.maximum(hits, 1.0)
    since, doubt = np.maximum(silent - pause, 0.0), np.minimum(pause, silent)
    times = np.array([0.5 * since * since, since, since * doubt, doubt]).reshape(2, 2, -1)
    shifts = times.transpose(0, 2, 1)[:, :, :, None] * bank.boost_mean[:, None, COAST : COAST + 3]
    less, spread = shifts.reshape(2, -1, COAST)
    root, size = bank.boost_root, bank.boost_root.shape[1]
    rows = np.zeros((len(bank), size + 1, size + 1))
    rows[:, 0, 0] = 1.0
    rows[:, 1:, 0] = along(root[:, :, :COAST], spread)
    rows[:, 1:, 1:-COAST], rows[:, 1:, -COAST:] = root[:, :, COAST:], root[:, :, :COAST]
    # What is known of the last columns whatever the first ones are.
    return bank.boost_mean[:, :COAST] - less, square_root.triangular(rows)[:, -COAST:, -COAST:]


def _burnt_out_alone(bank: ModeEstimates) -> tuple[FloatArray, FloatArray]:
    """Return what `burnt_out` does, of one track."""
    less, spread = burnt_out_of_one(bank.pace[0].tolist(), bank.boost_mean[0, COAST : COAST + 3].tolist())
    root, size = bank.boost_root[0], bank.boost_root.shape[1]
    rows = np.zeros((1, size + 1, size + 1))
    rows[0, 0, 0] = 1.0
    rows[0, 1:, 0] = root[:, :COAST] @ np.array(spread)
    rows[0, 1:, 1:-COAST], rows[0, 1:, -COAST:] = root[:, COAST:], root[:, :COAST]
    return bank.boost_mean[:, :COAST] - np.array(less), square_root.triangular(rows)[:, -COAST:, -COAST:]


def resting(bank: ModeEstimates) -> IntArray:
    """Return the rows of tracks that have been dark for so long that a burn would be a new one."""
    rows: IntArray = ((bank.pace[:, 2] > _RESTS_S) & (bank.weight[:, 1] > _COASTS)).nonzero()[0]
    return rows


def begun_anew(bank: ModeEstimates, mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the boost of targets that would begin to burn where they coast, with means (n, 6) and roots (n, 6, 6).

    Of its force a bank of a while ago tells. Moved on as if they had burnt since, unseen boosts know less and less,
    without bound: how a force turns with a slow velocity is far from linear.
    """
    after = ModeEstimates(bank.weight, bank.boost_mean, bank.boost_root, mean, root, bank.pace)
    return _extended_mean(after), _extended_root(after)


def _extended_mean(bank: ModeEstimates) -> FloatArray:
    """Return the coast means with the boost's specific force and its rate."""
    return np.concatenate([bank.coast_mean, bank.boost_mean[:, COAST:]], axis=1)


def _extended_root(bank: ModeEstimates) -> FloatArray:
    """Return the coast roots with what the boost knows of specific force and its rate alone."""
    root = np.zeros_like(bank.boost_root)
    root[:, :COAST, :COAST] = bank.coast_root
    root[:, COAST:, COAST:] = square_root.root_of_spread(square_root.spread(bank.boost_root)[:, COAST:])
    return root


def weighed_alone(
    bank: ModeEstimates,
    hits: int,
    silent_s: float,
    change: tuple[float, float],
    step_s: float,
    memory_s: float,
    pause_s: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return what `weighed` does, of one track."""
    log, after = paced_of_one(bank.pace[0].tolist(), hits, silent_s, step_s, memory_s, pause_s)
    told = reweighed_of_one(bank.weight[0].tolist(), (change[0] + log, change[1]), _LEAST_WEIGHT)
    return np.array([told]), np.array([after])


def weighed(
    bank: ModeEstimates,
    hits: FloatArray,
    silent_s: FloatArray,
    change: FloatArray,
    step_s: float,
    memory_s: float,
    pause_s: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return weights (n, 2) and pace (n, 3) after a slice with `hits` (n,) looks of each track.

    `silent_s` (n,) is the time since the last of them, `change` (n, 2) what they say of the log weights. The pace
    fades over slices with looks that last `memory_s` together; pauses of up to `pause_s` between looks are part of it.
    """
    missed, paced = _missed(bank.pace, hits, silent_s, step_s, memory_s, pause_s)
    change[:, 0] += missed
    return _reweighed(bank.weight, change), paced


def _missed(
    pace: FloatArray, hits: FloatArray, silent_s: FloatArray, step_s: float, memory_s: float, pause_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return what a silent slice takes from the boost's log weight (n,), and the pace (n, 3) after it.

    A burning target that was seen r times a second stays unseen for t with the chance exp(-r t); one whose burn is
    over is not seen at all. Of rows with `hits` (n,) in the slice `silent_s` (n,) is the time since the last. Where
    slices are shorter than scans, those between two looks have none: they count as time in which it was seen.
    """
    silent = hits == 0.0
    after = np.empty_like(pace)
    pause = np.minimum(pace[:, 2], pause_s)
    after[:, 0], after[:, 1], after[:, 2] = hits, np.where(pause > step_s, step_s + pause - silent_s, step_s), silent_s
    after[:, :2] += np.exp(-step_s / memory_s) * pace[:, :2]
    log = np.zeros(len(pace))
    if np.count_nonzero(silent):
        after[silent, :2], after[silent, 2] = pace[silent, :2], pace[silent, 2] + step_s
        log[silent] = -pace[silent, 0] / np.maximum(pace[silent, 1], step_s) * step_s
    return log, after


def _reweighed(weight: FloatArray, change: FloatArray) -> FloatArray:
    """Return weights (n, 2) times exp(change), normalised, none of a mode in use below the least."""
    log = np.where(weight > 0.0, change, -np.inf)
    scaled = weight * np.exp(log - np.maximum(log[:, :1], log[:, 1:]))
    least = _LEAST_WEIGHT * (scaled[:, :1] + scaled[:, 1:])
    scaled = np.where(weight > 0.0, np.maximum(scaled, least), 0.0)
    total: FloatArray = scaled / (scaled[:, :1] + scaled[:, 1:])
    return total
