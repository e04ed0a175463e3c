"""Particles of tracks: each has a family, a state of the filter and the burns that remain to it.

All draws are the same quantiles for all tracks and ticks, so regions change smoothly.
"""

from enum import IntEnum
from functools import cache
from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from opir_estimation import SPEED_SIGMA_M_S, law_parameters
from scipy.special import ndtr, ndtri

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_forecast.burning_on import RemainingBurns
from opir_forecast.vehicles import GAP, STAGES, VehicleModel, VehicleStages

LAW = law_parameters("opir_forecast", "particles")

#: Numbers of the draws of burning particles, of those whose burn is over, and of those that burn
#: again.
BURNING = np.arange(LAW.burning)
OVER = len(BURNING) + np.arange(LAW.over)
AGAIN = len(BURNING) + len(OVER) + np.arange(LAW.again)
DRAWS = len(BURNING) + len(OVER) + len(AGAIN)


class BurnState(IntEnum):
    """States of particles: dark, burning, or dark with another burn to come."""

    DARK = 0
    LIT = 1
    RELIT = 2


@frozen(eq=False, repr=False)
class Particles(RemainingBurns):
    """Particles (p,) of tracks (rows of the forecast) with families, inertial states (p, 6), and
    remaining burns.

    `lit` is 1 for those that burn at present, 2 for those that burn again, 0 for dark ones whose
    burn is over (`BurnState`); `weight` sums to one over each of a track's burning and dark particles.
    `draw` is the number of a particle's draws, `force` (p, 3) its specific force, 0 in the dark.
    `is_free` (p,) says whether it thrusts in another direction than along the velocity, which no
    program continues.
    """

    track: IntArray
    family: IntArray
    lit: IntArray
    draw: IntArray
    weight: FloatArray
    state: FloatArray
    force: FloatArray
    is_free: BoolArray

    def of_tracks(self, rows: IntArray) -> "Particles":
        """Return the particles with the numbers of their tracks among others."""
        return evolve(self, track=rows[self.track])


class Draws(NamedTuple):
    """Numbers of draws: normal ones of states (m, 10) and of later stages (m, STAGES, 4), uniform
    ones (m, 5 + STAGES)."""

    state: FloatArray
    later: FloatArray
    uniform: FloatArray


@cache
def draws() -> Draws:
    """Return the draws of all tracks: a Latin hypercube of uniform numbers, and normal ones of zero
    mean.
    """
    rng = np.random.default_rng(1)
    state = rng.normal(size=(DRAWS, 10))
    steps = np.stack([rng.permutation(DRAWS) for _ in range(5 + STAGES)], axis=1)
    later = rng.normal(size=(DRAWS, STAGES, 4))
    return Draws(state, later, (steps + rng.random(steps.shape)) / DRAWS)


def widened(root: FloatArray) -> FloatArray:
    """Return triangular covariance roots (n, d, d), wider where the velocity is known by the filter's
    prior alone.

    Their diagonals are positive: signs of columns are LAPACK's, and draws shall not depend on them.
    That prior is of all times of a burn (`mode_mixing.SPEED_SIGMA_M_S`); late stages are up to four
    times as fast. One sensor does not see the velocity along its line of sight.
    """
    spread = np.sqrt(np.sum(root[:, 3:6] ** 2, axis=(1, 2))) / SPEED_SIGMA_M_S
    factor = 1.0 + np.clip((spread - LAW.looks_share) / (1.0 - LAW.looks_share), 0.0, 1.0)
    sign = np.where(np.diagonal(root, axis1=1, axis2=2) < 0.0, -1.0, 1.0)
    return root * (factor[:, None] * sign)[:, None, :]


def shares_in_numbers(share: FloatArray, size: int) -> IntArray:
    """Return numbers (n, families) of particles that add up to `size`, nearly in proportion to
    shares.
    """
    share = share / np.maximum(share.sum(axis=1, keepdims=True), 1e-300)
    share = np.where(share > LAW.negligible, np.maximum(share, LAW.least_shares), 0.0)
    share /= share.sum(axis=1, keepdims=True)
    ends = np.rint(np.cumsum(share, axis=1) * size).astype(np.int64)
    return np.diff(ends, axis=1, prepend=0)


def families_of_particles(number: IntArray, size: int) -> IntArray:
    """Return the families (n, size) of particles, in their order, by numbers (n, families)."""
    ends = np.cumsum(number, axis=1)[:, :, None]
    return np.sum(np.arange(size) >= ends, axis=1).clip(0, number.shape[1] - 1)


class FlownVehicles(NamedTuple):
    """Vehicles (p,) of particles: families, numbers of stages that are over, and draws.

    `total` and `number` (p, 4) are the sums of the scores of these stages, and how many are known;
    `hot` (p,) is the probability that the next stage ignites without a gap.
    """

    family: IntArray
    done: IntArray
    total: FloatArray
    number: FloatArray
    hot: FloatArray
    draw: IntArray


def later_burns(
    model: VehicleModel, vehicles: FlownVehicles, dark_s: FloatArray | None = None
) -> VehicleStages:
    """Return the stages to come of vehicles (p,).

    With `dark_s` (p,) there is at least one, after a gap longer than that; without, their number is
    drawn.
    """
    family, done, total, number, hot, draw = vehicles
    uniform = draws().uniform[draw]
    rows = np.arange(len(family))
    stages = np.zeros((4, len(family), STAGES))
    at_least = model.more(done - 1)[rows, family]
    for step in range(STAGES - 1):
        stage = np.minimum(done + step, STAGES - 1)
        mean, sigma = model.law(family, stage, total, number)
        logs = mean + sigma * draws().later[draw, step]
        more = model.more(done + step)[rows, family]
        exists = (done + step < STAGES) & (uniform[:, 3] * at_least < more)
        gap = np.where(uniform[:, 5 + step] < hot, 0.0, np.exp(logs[:, GAP]))
        if dark_s is not None and not step:
            at_least = more
            exists = done < STAGES
            gap = _longer_gap(mean[:, GAP], sigma[:, GAP], dark_s, uniform[:, 4])
            logs[:, GAP] = np.log(gap)
        stages[:, :, step] = np.where(exists, [gap, *model.figures(logs)], 0.0)
        total = total + model.scores(family, stage, logs)
        number = number + 1.0
    return VehicleStages(*stages)


def _longer_gap(
    mean: FloatArray, sigma: FloatArray, dark_s: FloatArray, share: FloatArray
) -> FloatArray:
    """Return draws (p,) of log-normal gaps longer than a time (p,), s."""
    below = ndtr((np.log(np.maximum(dark_s, 0.05)) - mean) / sigma)
    score = ndtri(np.minimum(below + (1.0 - below) * share, 1.0 - 1e-12))
    return np.maximum(np.exp(mean + sigma * score), dark_s)
