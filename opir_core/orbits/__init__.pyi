from opir_core.orbits.configs import (
    CircularConfig as CircularConfig,
    KeplerConfig as KeplerConfig,
    MolniyaConfig as MolniyaConfig,
    OmmFileConfig as OmmFileConfig,
    OrbitConfig as OrbitConfig,
    SlotConfig as SlotConfig,
    TundraConfig as TundraConfig,
    WalkerConfig as WalkerConfig,
)
from opir_core.orbits.elements import (
    CRITICAL_INCLINATION_RAD as CRITICAL_INCLINATION_RAD,
    Elements as Elements,
    circular_elements as circular_elements,
    highly_elliptical_elements as highly_elliptical_elements,
    orbit_block as orbit_block,
    slot_elements as slot_elements,
    synchronous_semi_major_axis_m as synchronous_semi_major_axis_m,
    walker_pattern as walker_pattern,
)
from opir_core.orbits.orbit_models import (
    GeostationaryOrbit as GeostationaryOrbit,
    elements_of as elements_of,
    orbit_of as orbit_of,
)
from opir_core.orbits.sun_events import (
    Eclipses as Eclipses,
    Outages as Outages,
    eclipse_intervals as eclipse_intervals,
    outage_intervals as outage_intervals,
)
