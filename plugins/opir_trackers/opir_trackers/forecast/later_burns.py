"""Stages to come of particles, drawn from the law of vehicles given the earlier stages."""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.forecast.particles import draws
from opir_trackers.forecast.vehicles import GAP, STAGES, VehicleModel, VehicleStages


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
        if dark_s is not None and step == 0:
            at_least = more
            exists = done < STAGES
            gap = _longer_gap(mean[:, GAP], sigma[:, GAP], dark_s, uniform[:, 4])
            logs[:, GAP] = np.log(gap)
        stages[:, :, step] = np.where(exists, np.stack([gap, *model.figures(logs)]), 0.0)
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
