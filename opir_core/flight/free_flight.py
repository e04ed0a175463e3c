"""Ephemerides of free flight: two-body arcs, or arcs under more forces, from states at given
times.
"""

from typing import TYPE_CHECKING

import numpy as np

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.ephemeris import Ephemeris, Motion
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import eci_to_ecef_state
from opir_core.geometry.vectors import FloatPair

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel


def free_flight_ephemeris(
    start_s: FloatArray,
    end_s: FloatArray,
    position_eci_m: FloatArray,
    velocity_eci_m_s: FloatArray,
    *,
    forces: "ForceModel" = "kepler",
    tolerance_m: float = 0.01,
) -> Ephemeris:
    """Return the ECEF ephemeris of n targets in free flight from states (n, 3) at times (n,) to
    later times (n,).

    ECI is ECEF frozen at scene epoch; `forces` as in `aim`.
    """
    is_kepler = forces == "kepler" or forces.is_kepler
    inertial: Motion
    if is_kepler:

        def inertial(target: RowArray, time_s: FloatArray) -> FloatPair:
            return propagate_kepler(
                position_eci_m[target], velocity_eci_m_s[target], time_s - start_s[target]
            )

    else:
        from opir_core.flight.dense_output import dense_arcs

        # Integrated once, to a hundredth of the tolerance, so that the motion is smooth for the
        # fit.
        # Arcs are integrated this much beyond their end, s, so that rounded times lie within
        # them.
        duration_s = end_s - start_s + 1e-3
        arcs = dense_arcs(
            position_eci_m, velocity_eci_m_s, duration_s, forces, tolerance_m=0.01 * tolerance_m
        )

        def inertial(target: RowArray, time_s: FloatArray) -> FloatPair:
            return arcs.state(target, np.maximum(time_s - start_s[target], 0.0))

    def state(target: RowArray, time_s: FloatArray) -> FloatPair:
        return eci_to_ecef_state(*inertial(target, time_s), time_s)

    return Ephemeris.build(state, start_s, end_s, tolerance_m=tolerance_m)
