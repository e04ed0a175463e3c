"""Estimates whose motion along an axis is replaced by what is known of it from elsewhere.

All else follows: given what is along the axis, it is as likely as before (Jeffrey's rule).
"""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.estimation import COAST, square_root
from opir_trackers.filter.burn_modes import Gaussian
from opir_trackers.filter.measurement_updates import information_root


def replaced(
    mean: FloatArray, root: FloatArray, axis: FloatArray, along: FloatArray, covariance: FloatArray
) -> Gaussian:
    """Return burns (n, d) with position, velocity and force along axes (n, 3) of given moments, (n,
    3) and (n, 3, 3).

    `root` (n, d, d) are information roots.
    """
    count, size = mean.shape
    rows = np.zeros((count, 3, size))
    for order, first in enumerate((0, 3, COAST)):
        rows[:, order, first : first + 3] = axis
    side = square_root.inverse_root(root)
    seen = rows @ side
    gain = np.linalg.solve(
        seen @ seen.transpose(0, 2, 1), seen @ side.transpose(0, 2, 1)
    ).transpose(0, 2, 1)
    after = mean + (gain @ (along[:, :, None] - rows @ mean[:, :, None]))[:, :, 0]
    wide = np.concatenate([side - gain @ seen, gain @ np.linalg.cholesky(covariance)], axis=2)
    return after, information_root(wide)
