"""Where satellites are: geosynchronous slots, Kepler elements, Molniya, circular orbits, Walker patterns, TLE and OMM.

Each name is imported when it is first used. None of them imports numpy, so that plugins may name orbits in their
catalogues; `orbit_of` imports what an orbit needs when it makes one.
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
    from opir_core.orbits.elements import Elements, orbit_block
    from opir_core.orbits.families import (
        CRITICAL_INCLINATION_RAD,
        circular_elements,
        highly_elliptical_elements,
        slot_elements,
        synchronous_semi_major_axis_m,
        walker_pattern,
    )
    from opir_core.orbits.making import elements_of, orbit_of

_HOMES = {
    "CRITICAL_INCLINATION_RAD": "families",
    "CircularConfig": "configs",
    "Elements": "elements",
    "KeplerConfig": "configs",
    "MolniyaConfig": "configs",
    "OmmFileConfig": "configs",
    "OrbitConfig": "configs",
    "SlotConfig": "configs",
    "TundraConfig": "configs",
    "WalkerConfig": "configs",
    "circular_elements": "families",
    "elements_of": "making",
    "highly_elliptical_elements": "families",
    "orbit_block": "elements",
    "orbit_of": "making",
    "slot_elements": "families",
    "synchronous_semi_major_axis_m": "families",
    "walker_pattern": "families",
}

__all__ = [
    "CRITICAL_INCLINATION_RAD",
    "CircularConfig",
    "Elements",
    "KeplerConfig",
    "MolniyaConfig",
    "OmmFileConfig",
    "OrbitConfig",
    "SlotConfig",
    "TundraConfig",
    "WalkerConfig",
    "circular_elements",
    "elements_of",
    "highly_elliptical_elements",
    "orbit_block",
    "orbit_of",
    "slot_elements",
    "synchronous_semi_major_axis_m",
    "walker_pattern",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.orbits' has no attribute {name!r}")
    value = getattr(import_module(f"opir_core.orbits.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
