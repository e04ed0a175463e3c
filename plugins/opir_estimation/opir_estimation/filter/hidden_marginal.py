"""Estimates whose motion along an axis is replaced by what is known of it from elsewhere.

All else follows: given what is along the axis, it is as likely as before (Jeffrey's rule).
"""

import numpy as np

from opir_core.arrays import FloatArray
from opir_estimation import square_root
from opir_estimation.filter.measurement_updates import Gaussian, information_root


def replaced(
    burn: Gaussian, axis: FloatArray, along: FloatArray, covariance: FloatArray
) -> Gaussian:
    """Return burns or coasts (n, d) with position, velocity and force along axes (n, 3) of given
    moments, (n, 3) and (n, 3, 3); of coasts, (n, 2) and (n, 2, 2), without force.
    """
    count, size = burn.mean.shape
    orders = along.shape[1]
    rows = np.zeros((count, orders, size))
    for order in range(orders):
        rows[:, order, 3 * order : 3 * order + 3] = axis
    side = square_root.inverse_root(burn.root)
    projected = rows @ side
    gain = np.linalg.solve(projected @ projected.mT, projected @ side.mT).mT
    shift = (gain @ (along[:, :, None] - rows @ burn.mean[:, :, None]))[:, :, 0]
    spread = gain @ np.linalg.cholesky(covariance)
    wide = np.concatenate([side - gain @ projected, spread], axis=2)
    return Gaussian(burn.mean + shift, information_root(wide))
