from opir_core.flight.aiming import (
    Aim as Aim,
    aim as aim,
    boost_ephemeris as boost_ephemeris,
    coast_ephemeris as coast_ephemeris,
)
from opir_core.flight.atmosphere_density import (
    LOWEST_HEIGHT_M as LOWEST_HEIGHT_M,
    density_kg_m3 as density_kg_m3,
)
from opir_core.flight.boost import (
    BoostPath as BoostPath,
    ascent as ascent,
    boost_path as boost_path,
    boost_profile as boost_profile,
    boost_profiles as boost_profiles,
    launch_site as launch_site,
)
from opir_core.flight.burns import (
    joined_burns_s as joined_burns_s,
    plain_gaps_s as plain_gaps_s,
)
from opir_core.flight.conic_impact import (
    kepler_impact as kepler_impact,
)
from opir_core.flight.ephemeris import (
    Ephemeris as Ephemeris,
)
from opir_core.flight.forces import (
    Drag as Drag,
    ForceModel as ForceModel,
    Forces as Forces,
    forces_of as forces_of,
)
from opir_core.flight.free_flight import (
    free_flight_ephemeris as free_flight_ephemeris,
)
from opir_core.flight.glide import (
    GlidePath as GlidePath,
    GlideShape as GlideShape,
)
from opir_core.flight.gravity_and_drag import (
    Gravity as Gravity,
    height_and_up as height_and_up,
    height_m as height_m,
)
from opir_core.flight.kepler import (
    propagate_kepler as propagate_kepler,
)
from opir_core.flight.propagation import (
    ImpactReason as ImpactReason,
    ImpactStates as ImpactStates,
    impact as impact,
    impact_states_eci as impact_states_eci,
    propagate as propagate,
)
from opir_core.scene.target_classes import (
    BoostProfile as BoostProfile,
)
