"""What nothing measures stays no less certain than targets are known to be: the velocity along a single line of sight.

One sensor alone sees no motion along its line of sight. There the noise of the boost model adds up, and does so faster
and faster, for thrust grows with itself: estimates run off, of a sensor in a low orbit right through the sensor. But
whatever is forgotten of a target's past, its velocity is one of those that targets have. So in no direction does the
velocity become less certain than that; where looks keep it there by themselves, nothing is done.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.tracking.filter import square_root

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
