"""Flight: two-body arcs, aimed boosts, numerical propagation, and trajectories as piecewise polynomials.

Each name is imported when it is first used, so that a scene with two-body motion imports no numerical propagation.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.flight.aim import Aim, aim
    from opir_core.flight.ephemeris import Ephemeris
    from opir_core.flight.kepler import propagate_kepler
    from opir_core.flight.kepler_impact import kepler_impact
    from opir_core.flight.lambert_arc import lambert
    from opir_core.flight.profiles import BoostProfile, boost_profile, boost_profiles

_HOMES = {
    "Aim": "aim",
    "BoostProfile": "profiles",
    "Ephemeris": "ephemeris",
    "aim": "aim",
    "boost_profile": "profiles",
    "boost_profiles": "profiles",
    "kepler_impact": "kepler_impact",
    "lambert": "lambert_arc",
    "propagate_kepler": "kepler",
}

__all__ = [
    "Aim",
    "BoostProfile",
    "Ephemeris",
    "aim",
    "boost_profile",
    "boost_profiles",
    "kepler_impact",
    "lambert",
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
