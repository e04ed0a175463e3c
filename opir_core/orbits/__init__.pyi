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
from opir_core.orbits.contacts import (
    contact_intervals as contact_intervals,
    crosslink_intervals as crosslink_intervals,
)
from opir_core.orbits.elements import (
    CRITICAL_INCLINATION_RAD as CRITICAL_INCLINATION_RAD,
    Elements as Elements,
    circular_elements as circular_elements,
    highly_elliptical_elements as highly_elliptical_elements,
    slot_elements as slot_elements,
    synchronous_semi_major_axis_m as synchronous_semi_major_axis_m,
    walker_pattern as walker_pattern,
)
from opir_core.orbits.mean_elements import (
    age_warning as age_warning,
    omm_complaint as omm_complaint,
    omm_epoch as omm_epoch,
    omm_name as omm_name,
    tle_complaint as tle_complaint,
)
from opir_core.orbits.orbit_models import (
    GeostationaryOrbit as GeostationaryOrbit,
    MovingOrbit as MovingOrbit,
    elements_of as elements_of,
    orbit_of as orbit_of,
)
from opir_core.orbits.sgp4_motion import (
    Sgp4Motion as Sgp4Motion,
    satellite_of_omm as satellite_of_omm,
    satellite_of_tle as satellite_of_tle,
)
from opir_core.orbits.sun_events import (
    Eclipses as Eclipses,
    Outages as Outages,
    eclipse_intervals as eclipse_intervals,
    outage_intervals as outage_intervals,
)
