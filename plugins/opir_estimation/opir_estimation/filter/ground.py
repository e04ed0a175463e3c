"""No target burns below the ground: a truncated normal height, for estimates that lie below it.

One sensor alone does not observe the position along its line of sight, so the mean of a track may
sink below the ground while its target climbs. The height of such an estimate is then known to be
positive: its mean and variance are those of the truncated normal density, and all else follows by
its correlation with the height.
"""

from math import pi

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic
from opir_estimation import square_root
from opir_estimation.directions import dot
from opir_estimation.filter.measurement_updates import Gaussian, measurement_update

#: Heights further below the ground than this, in standard deviations, count as this far: their
#: density is rounding.
_FARTHEST = -5.0


def raised_above_ground(estimates: Gaussian) -> Gaussian:
    """Return estimates (n, d) whose heights are positive; nothing changes above the ground."""
    height = ecef_to_geodetic(estimates.mean[:, :3]).height_m
    low = (height < 0.0).nonzero()[0]
    if not low.size:
        return estimates
    mean = estimates.mean.copy()
    root = estimates.root.copy()
    mean[low], root[low] = _truncated(mean[low], root[low], height[low])
    return Gaussian(mean, root)


def _truncated(mean: FloatArray, root: FloatArray, height: FloatArray) -> Gaussian:
    """Return estimates after a look at the height that leaves it the moments of the truncated
    normal density.
    """
    up, sigma = up_and_sigma(mean, root)
    shift, share = _truncated_moments(height / sigma)
    # A look of variance r leaves the share r / (1 + r) of a unit variance, and 1 / (1 + r) of its
    # residual.
    variance = share / (1.0 - share)
    rows = np.zeros((len(mean), 1, mean.shape[1] + 1))
    rows[:, 0, :3] = up / (sigma * np.sqrt(variance))[:, None]
    rows[:, 0, -1] = shift * (1.0 + variance) / np.sqrt(variance)
    truncated, step, _ = measurement_update(root, np.zeros_like(mean), rows)
    return Gaussian(mean + step, truncated)


def _truncated_moments(height: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the shift of the mean and the remaining share of the variance (n,) of a unit normal
    density about heights (n,), in standard deviations, truncated to positive ones.
    """
    from scipy.special import erfcx

    depth = np.maximum(height, _FARTHEST)
    # Ratio of the normal density to the share above the ground, at the ground: the inverse Mills
    # ratio.
    ratio = np.sqrt(2.0 / pi) / erfcx(-depth / np.sqrt(2.0))
    return depth + ratio - height, 1.0 - ratio * (ratio + depth)


def up_and_sigma(mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions (n, 3) away from the Earth's centre, and the standard deviations (n,)
    of positions along them.
    """
    up = mean[:, :3] / np.sqrt(dot(mean[:, :3], mean[:, :3]))[:, None]
    side = (up[:, None, :] @ square_root.inverse_root(root)[:, :3])[:, 0]
    return up, np.sqrt(dot(side, side))
