"""States of many bodies in free flight, after a time, under the forces chosen."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.flight.forces import J2, ForceModel, forces_of

#: The error of position, m, that propagation allows an arc unless told otherwise.
TOLERANCE_M = 1e-3


def propagate(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    forces: ForceModel = J2,
    *,
    tolerance_m: ArrayLike = TOLERANCE_M,
) -> tuple[FloatArray, FloatArray]:
    """Return positions, m, and velocities, m/s, both (..., 3), after the durations, s, of either sign.

    States are inertial, in axes that are those of ECEF at the epoch: z is the Earth's axis. Leading axes of states,
    durations, tolerances and the ballistic coefficient broadcast against one another. `forces` is a `Forces` or
    "kepler", which is solved in closed form by `propagate_kepler`.

    Every arc is integrated by itself with adaptive steps of DOP853, so that its error of position at the end is about
    `tolerance_m` at most, as estimated: local errors of velocity times the time left, added up. Below 1e-7 m rounding
    takes over (over days: rounding grows with the time flown); above 0.1 m is taken as 0.1 m. With drag, steps end at
    the seams of the atmosphere and are bounded in height, so the onset of drag is not missed at any tolerance. A
    result does not depend, to the last bit, on which other arcs are in the call.

    The Earth's surface does not stop an arc: use `impact`. `nan` where the start or duration is not finite, where an
    arc with drag is more than 5 km below the ellipsoid at any time (there is no air model), and where an arc falls
    into the Earth's centre.
    """
    forces = forces_of(forces)
    if forces.is_kepler:
        from opir_core.flight.kepler import propagate_kepler

        return propagate_kepler(position_m, velocity_m_s, duration_s, forces.gravity.mu_m3_s2)
    from opir_core.flight.blocks import columns_of, integrations

    columns = columns_of(position_m, velocity_m_s, duration_s, tolerance_m, forces)
    position, velocity = np.empty((columns.duration.size, 3)), np.empty((columns.duration.size, 3))
    for part, integration in integrations(columns, forces):
        ends = integration.ends()
        position[part], velocity[part] = ends.position.T, ends.velocity.T
    return position.reshape(*columns.shape, 3), velocity.reshape(*columns.shape, 3)
