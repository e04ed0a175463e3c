"""Whole flights as ephemerides: boost, and the free flight from burnout to impact, in ECEF."""

from typing import TYPE_CHECKING

import numpy as np

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.aiming import Aim
from opir_core.flight.boost import BoostPath
from opir_core.flight.ephemeris import Ephemeris, Motion
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import eci_to_ecef_state

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel


#: How much longer arcs are integrated than they are flown, s.
_BREATH_S = 1e-3


def boost_ephemeris(path: BoostPath, tolerance_m: float = 0.01) -> Ephemeris:
    """Return the boost of n targets, ignition to burnout."""
    return Ephemeris.build(path.state, path.ignition_s, path.burnout_s, path.breakpoints_s(), tolerance_m)


def coast_ephemeris(flight: Aim, tolerance_m: float = 0.01, forces: "ForceModel" = "kepler") -> Ephemeris:
    """Return the free flight of n targets, burnout to impact, under the forces that it was aimed under."""
    inertial = _two_body(flight) if forces == "kepler" else _integrated(flight, forces, tolerance_m)

    def state(target: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        return eci_to_ecef_state(*inertial(target, time_s), time_s)

    return Ephemeris.build(state, flight.burnout_s, flight.impact_s, tolerance_m=tolerance_m)


def flight_ephemeris(flight: Aim, tolerance_m: float = 0.01, forces: "ForceModel" = "kepler") -> Ephemeris:
    """Return the flight of n targets, ignition to impact."""
    boost, coast = boost_ephemeris(flight.path, tolerance_m), coast_ephemeris(flight, tolerance_m, forces)
    return Ephemeris.joined([boost, coast])


def _two_body(flight: Aim) -> Motion:
    def state(target: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        position, velocity = flight.burnout_position_eci_m[target], flight.burnout_velocity_eci_m_s[target]
        return propagate_kepler(position, velocity, time_s - flight.burnout_s[target])

    return state


def _integrated(flight: Aim, forces: "ForceModel", tolerance_m: float) -> Motion:
    """Return the arcs integrated once, to a hundredth of the tolerance, so that the fit has a smooth motion to meet."""
    from opir_core.flight.dense_output import dense_arcs

    duration_s = flight.impact_s - flight.burnout_s
    states = flight.burnout_position_eci_m, flight.burnout_velocity_eci_m_s
    # A breath longer, so that rounding of times leaves none beyond the end.
    arcs = dense_arcs(*states, duration_s + _BREATH_S, forces, tolerance_m=0.01 * tolerance_m)
    return lambda target, time_s: arcs.state(target, np.maximum(time_s - flight.burnout_s[target], 0.0))
