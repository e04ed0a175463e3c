"""Flight: two-body arcs, aimed boosts, numerical propagation, and trajectories as piecewise polynomials.

Each name is imported when it is first used, so that a scene with two-body motion imports no numerical propagation.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.flight.aiming import Aim, aim, boost_ephemeris, coast_ephemeris, flight_ephemeris
    from opir_core.flight.boost import boost_profile, boost_profiles
    from opir_core.flight.conic_impact import kepler_impact
    from opir_core.flight.ephemeris import Ephemeris
    from opir_core.flight.forces import Drag, Forces
    from opir_core.flight.kepler import KeplerStatus, kepler_status, propagate_kepler
    from opir_core.flight.lambert_solver import lambert
    from opir_core.flight.propagation import impact, propagate
    from opir_core.scene.target_classes import BoostProfile

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "aiming": "Aim aim boost_ephemeris coast_ephemeris flight_ephemeris",
    "boost": "BoostProfile boost_profile boost_profiles",
    "conic_impact": "kepler_impact",
    "ephemeris": "Ephemeris",
    "forces": "Drag Forces",
    "kepler": "KeplerStatus kepler_status propagate_kepler",
    "lambert_solver": "lambert",
    "propagation": "impact propagate",
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
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.flight.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.flight' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
