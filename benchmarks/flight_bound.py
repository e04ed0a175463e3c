"""Cramér–Rao bounds of flights that a few parameters describe, as a gravity turn's stages and
pitch-over.

A state is a function of the parameters, so the Fisher information of all looks so far is a sum over
parameters, and the bound of a state or an impact at any time follows by their slopes. With a prior
this is the posterior (van Trees) bound. Biases of sensors are further parameters.
"""

from typing import NamedTuple

import numpy as np
from opir_estimation import tangent_axes

from opir_core.arrays import FloatArray


class KnownValues(NamedTuple):
    """Values (k,) that become known at times: `row` (k, p) are their slopes by the parameters over
    their errors.
    """

    time_s: FloatArray
    row: FloatArray


def central_slopes(values, parameters, step):
    """Return the slopes (..., p) of values by parameters (p,), by central differences with steps
    (p,).

    `values` takes rows (m, p) of parameters and returns (m, ...) values.
    """
    shift = np.diag(step)
    place = values(np.concatenate([parameters + shift, parameters - shift]))
    count = len(step)
    return np.moveaxis(place[:count] - place[count:], 0, -1) / (2.0 * step)


def parameter_bound(
    tick_s,
    detected,
    slope,
    prior_sigma,
    known=None,
):
    """Return the bound's covariances (ticks, p, p) of parameters, given the looks before each tick.

    `slope` (n, 3, p) are the slopes of the target's ECEF position at the looks by the parameters,
    `prior_sigma` (p,) the standard deviations of the parameters before the first look. Source: Van
    Trees, "Detection, Estimation, and Modulation Theory" I (1968), 2.4.2, for a normal prior;
    biases are parameters of unit variance.
    """
    size = slope.shape[2]
    biases = detected.turn_ecef_rad.shape[1]
    line_m = detected.target_ecef_m - detected.sensor_ecef_m
    range_m = np.sqrt(np.sum(line_m * line_m, axis=1))
    across = (
        tangent_axes(line_m / range_m[:, None])[:, :2]
        / (range_m * detected.sigma_rad)[:, None, None]
    )
    turned = np.cross(detected.turn_ecef_rad, line_m[:, None]).transpose(0, 2, 1)
    # Parameters in units of their prior: they differ by orders of magnitude.
    scale = np.concatenate([prior_sigma, np.ones(biases)])
    rows = across @ np.concatenate([slope, turned], axis=2) * scale
    times, row = KnownValues(np.empty(0), np.empty((0, size))) if known is None else known
    more = np.concatenate([row, np.zeros((len(times), biases))], axis=1) * scale
    bounds = np.empty((len(tick_s), size, size))
    for number, tick in enumerate(tick_s.tolist()):
        looks = rows[detected.look_s <= tick].reshape(-1, size + biases)
        root = np.linalg.qr(
            np.concatenate([np.eye(size + biases), looks, more[times <= tick]]), mode="r"
        )
        side = scale[:, None] * np.linalg.inv(root)
        bounds[number] = (side @ side.T)[:size, :size]
    return bounds


def bound_of(bounds, slope):
    """Return the bound's covariances (n, k, k) of values with slopes (n, k, p) by parameters of
    bounds (n, p, p).
    """
    return slope @ bounds @ slope.transpose(0, 2, 1)
