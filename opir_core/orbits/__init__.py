"""Where satellites are: geosynchronous slots, Kepler elements, Molniya, circular orbits, Walker patterns, TLE and OMM.

And when they are in the Earth's shadow or look towards the Sun.

Each name is imported when it is first used. Configurations and elements import no numpy, so that plugins may name
orbits in their catalogues.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.orbits.configs import (
        CircularConfig,
        KeplerConfig,
        MolniyaConfig,
        OmmFileConfig,
        OrbitConfig,
        SlotConfig,
        TundraConfig,
        WalkerConfig,
    )
    from opir_core.orbits.elements import (
        CRITICAL_INCLINATION_RAD,
        Elements,
        circular_elements,
        highly_elliptical_elements,
        orbit_block,
        slot_elements,
        synchronous_semi_major_axis_m,
        walker_pattern,
    )
    from opir_core.orbits.orbit_models import elements_of, orbit_of
    from opir_core.orbits.sun_events import Eclipses, Outages, eclipse_intervals, outage_intervals

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "configs": (
        "CircularConfig KeplerConfig MolniyaConfig OmmFileConfig OrbitConfig SlotConfig TundraConfig WalkerConfig"
    ),
    "elements": (
        "CRITICAL_INCLINATION_RAD Elements circular_elements highly_elliptical_elements orbit_block "
        "slot_elements synchronous_semi_major_axis_m walker_pattern"
    ),
    "orbit_models": "elements_of orbit_of",
    "sun_events": "Eclipses Outages eclipse_intervals outage_intervals",
}

__all__ = [
    "CRITICAL_INCLINATION_RAD",
    "CircularConfig",
    "Eclipses",
    "Elements",
    "KeplerConfig",
    "MolniyaConfig",
    "OmmFileConfig",
    "OrbitConfig",
    "Outages",
    "SlotConfig",
    "TundraConfig",
    "WalkerConfig",
    "circular_elements",
    "eclipse_intervals",
    "elements_of",
    "highly_elliptical_elements",
    "orbit_block",
    "orbit_of",
    "outage_intervals",
    "slot_elements",
    "synchronous_semi_major_axis_m",
    "walker_pattern",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.orbits.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.orbits' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
