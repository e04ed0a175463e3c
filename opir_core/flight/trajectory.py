"""Whole flights as ephemerides: boost, and the free flight from burnout to impact, in ECEF."""

from collections.abc import Callable

from opir_core.flight.aiming import Aim
from opir_core.flight.boost import BoostPath
from opir_core.flight.ephemeris import Ephemeris
from opir_core.flight.kepler import propagate_kepler
from opir_core.flight.pieces import Indices
from opir_core.geometry import eci_to_ecef_state
from opir_core.geometry.vectors import Floats

#: Inertial positions and velocities (m, 3) and durations (m,), s, to positions and velocities after them.
Propagator = Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]


def boost_ephemeris(path: BoostPath, tolerance_m: float = 0.01) -> Ephemeris:
    """Return the boost of n targets, ignition to burnout."""
    return Ephemeris.build(path.state, path.ignition_s, path.burnout_s, path.breakpoints_s(), tolerance_m)


def coast_ephemeris(flight: Aim, tolerance_m: float = 0.01, propagate: Propagator = propagate_kepler) -> Ephemeris:
    """Return the free flight of n targets, burnout to impact.

    `propagate` is to follow the forces that the flight was aimed under.
    """

    def state(target: Indices, time_s: Floats) -> tuple[Floats, Floats]:
        position, velocity = flight.burnout_position_eci_m[target], flight.burnout_velocity_eci_m_s[target]
        return eci_to_ecef_state(*propagate(position, velocity, time_s - flight.burnout_s[target]), time_s)

    return Ephemeris.build(state, flight.burnout_s, flight.impact_s, tolerance_m=tolerance_m)


def flight_ephemeris(flight: Aim, tolerance_m: float = 0.01, propagate: Propagator = propagate_kepler) -> Ephemeris:
    """Return the flight of n targets, ignition to impact."""
    boost, coast = boost_ephemeris(flight.path, tolerance_m), coast_ephemeris(flight, tolerance_m, propagate)
    return Ephemeris.joined([boost, coast])
