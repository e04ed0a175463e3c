"""Stages to come of particles, drawn from the law of vehicles given what earlier stages have
shown.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.forecast.particles import draws
from opir_trackers.forecast.vehicles import BURN, FORCE, GAP, RATIO, STAGES, VehicleModel


class Later(NamedTuple):
    """Stages to come of particles (p, STAGES): gaps before them, burn times (0: none),
    accelerations and growths c.
    """

    gap_s: FloatArray
    burn_s: FloatArray
    acceleration_m_s2: FloatArray
    growth_per_s: FloatArray


def later_burns(
    model: VehicleModel,
    family: IntArray,
    done: IntArray,
    total: FloatArray,
    number: FloatArray,
    draw: IntArray,
    hot: FloatArray,
    dark_s: FloatArray | None = None,
) -> Later:
    """Return the stages to come after `done` (p,) of particles with sums of scores; `hot` (p,)
    without a gap.

    With `dark_s` (p,) there is at least one, after a gap longer than that; without, their number is
    drawn.
    """
    lots = draws()
    uniform = lots.uniform[draw]
    stages = np.zeros((4, len(family), STAGES))
    chance = uniform[:, 3]
    least = model.more(done - 1)[np.arange(len(family)), family]
    for step in range(STAGES - 1):
        stage = np.minimum(done + step, STAGES - 1)
        mean, sigma = model.law(family, stage, total, number)
        more = model.more(done + step)[np.arange(len(family)), family]
        exists = (done + step < STAGES) & (chance * least < more)
        if dark_s is not None and step == 0:
            least = more
            exists = done < STAGES
        normal = lots.later[draw, step]
        logs = mean + sigma * normal
        gap = np.where(uniform[:, 5 + step] < hot, 0.0, np.exp(logs[:, GAP]))
        if dark_s is not None and step == 0:
            gap = _longer_gap(mean[:, GAP], sigma[:, GAP], dark_s, uniform[:, 4])
            logs[:, GAP] = np.log(gap)
        room = np.log(model.data["highest_m_s2"]) - logs[:, FORCE]
        ratio = np.maximum(np.minimum(logs[:, RATIO], room), 0.02)
        burn = np.exp(logs[:, BURN])
        first = np.exp(logs[:, FORCE])
        columns = gap, burn, first, -np.expm1(-ratio) / burn
        stages[:, :, step] = np.where(exists, np.stack(columns), 0.0)
        score = model.scores(family, stage, logs)
        total = total + score
        number = number + 1.0
    return Later(*stages)


def _longer_gap(
    mean: FloatArray, sigma: FloatArray, dark_s: FloatArray, share: FloatArray
) -> FloatArray:
    """Return draws (p,) of log-normal gaps longer than a time (p,), s."""
    below = ndtr((np.log(np.maximum(dark_s, 0.05)) - mean) / sigma)
    score = ndtri(np.minimum(below + (1.0 - below) * share, 1.0 - 1e-12))
    gap: FloatArray = np.maximum(np.exp(mean + sigma * score), dark_s)
    return gap
