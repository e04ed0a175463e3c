"""Flight: two-body arcs, aimed boosts, numerical propagation, and trajectories as piecewise polynomials.

Each name is imported when it is first used, so that a scene with two-body motion imports no numerical propagation.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.flight.aiming import Aim, aim
    from opir_core.flight.boost import BoostProfile, boost_profile, boost_profiles
    from opir_core.flight.conic_impact import kepler_impact
    from opir_core.flight.ephemeris import Ephemeris
    from opir_core.flight.forces import Drag, Forces
    from opir_core.flight.impact_event import impact
    from opir_core.flight.kepler import KeplerStatus, kepler_status, propagate_kepler
    from opir_core.flight.lambert_solver import lambert
    from opir_core.flight.propagation import propagate
    from opir_core.flight.trajectory import boost_ephemeris, coast_ephemeris, flight_ephemeris

_HOMES = {
    "Aim": "aiming",
    "BoostProfile": "boost",
    "Drag": "forces",
    "Ephemeris": "ephemeris",
    "Forces": "forces",
    "KeplerStatus": "kepler",
    "aim": "aiming",
    "boost_ephemeris": "trajectory",
    "boost_profile": "boost",
    "boost_profiles": "boost",
    "coast_ephemeris": "trajectory",
    "flight_ephemeris": "trajectory",
    "impact": "impact_event",
    "kepler_impact": "conic_impact",
    "kepler_status": "kepler",
    "lambert": "lambert_solver",
    "propagate": "propagation",
    "propagate_kepler": "kepler",
}

__all__ = [
    "Aim",
    "BoostProfile",
    "Drag",
    "Ephemeris",
    "Forces",
    "KeplerStatus",
    "aim",
    "boost_ephemeris",
    "boost_profile",
    "boost_profiles",
    "coast_ephemeris",
    "flight_ephemeris",
    "impact",
    "kepler_impact",
    "kepler_status",
    "lambert",
    "propagate",
    "propagate_kepler",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.flight' has no attribute {name!r}")
    value = getattr(import_module(f"opir_core.flight.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
