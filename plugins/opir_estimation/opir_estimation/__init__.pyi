from opir_estimation.assignment import (
    belief_propagation as belief_propagation,
    cheapest_assignment as cheapest_assignment,
    components as components,
    group_maxima as group_maxima,
    group_minima as group_minima,
    group_sums as group_sums,
    ranks as ranks,
    scan_numbers as scan_numbers,
    unambiguous as unambiguous,
)
from opir_estimation.directions import (
    dot as dot,
    matvec as matvec,
    tangent_axes as tangent_axes,
)
from opir_estimation.filter.burn_ends import (
    BURN_MEMORY_S as BURN_MEMORY_S,
    BurnEnd as BurnEnd,
    BurnPrior as BurnPrior,
    burn_end as burn_end,
)
from opir_estimation.filter.burn_modes import (
    FreeBurn as FreeBurn,
    NewStage as NewStage,
)
from opir_estimation.filter.dynamics import (
    AtmosphericDescent as AtmosphericDescent,
    Dynamics as Dynamics,
)
from opir_estimation.filter.estimates import (
    ModeEstimates as ModeEstimates,
    PredictedMeasurements as PredictedMeasurements,
)
from opir_estimation.filter.free_thrust import (
    FreeThrust as FreeThrust,
)
from opir_estimation.filter.gliding import (
    glide_drag_m_s2 as glide_drag_m_s2,
    glided as glided,
)
from opir_estimation.filter.measurement_updates import (
    Gaussian as Gaussian,
    information_root as information_root,
)
from opir_estimation.filter.mode_mixing import (
    SPEED_SIGMA_M_S as SPEED_SIGMA_M_S,
    LookTimes as LookTimes,
    have_uncertain_velocity as have_uncertain_velocity,
)
from opir_estimation.filter.motion_model import (
    MotionModel as MotionModel,
)
from opir_estimation.filter.switching import (
    ImmFilter as ImmFilter,
)
from opir_estimation.filter.thrust import (
    Thrust as Thrust,
    air_velocity as air_velocity,
)
from opir_estimation.gating import (
    FEW_PAIRS as FEW_PAIRS,
    GatedPairs as GatedPairs,
    candidates as candidates,
    gated as gated,
    neighbour_pairs as neighbour_pairs,
)
from opir_estimation.labels import (
    LabelPosterior as LabelPosterior,
    SharedLooks as SharedLooks,
    equivalent_pairs as equivalent_pairs,
    label_posterior as label_posterior,
    place_probabilities as place_probabilities,
)
from opir_estimation.law_files import (
    law_parameters as law_parameters,
)
from opir_estimation.lines_of_sight import (
    SPIN as SPIN,
    AngleMeasurements as AngleMeasurements,
    LinesOfSight as LinesOfSight,
    earth_rotated as earth_rotated,
    emission_s as emission_s,
    ground_velocities as ground_velocities,
    no_lines_of_sight as no_lines_of_sight,
    no_measurements as no_measurements,
)
from opir_estimation.motion import (
    BOOST as BOOST,
    COAST as COAST,
    Motion as Motion,
    taylor_positions as taylor_positions,
    taylor_weights as taylor_weights,
)
from opir_estimation.registration.error_filter import (
    ErrorFilter as ErrorFilter,
)
from opir_estimation.registration.health import (
    sensor_health as sensor_health,
)
from opir_estimation.registration.innovations import (
    OUTLIER_SIGMAS as OUTLIER_SIGMAS,
    explained_looks as explained_looks,
)
from opir_estimation.registration.registration import (
    Followed as Followed,
    Registration as Registration,
    registered as registered,
    shifted as shifted,
)
from opir_estimation.registration.shared_errors import (
    ERRORS as ERRORS,
    Vantages as Vantages,
)
from opir_estimation.triangulation import (
    FAR_M as FAR_M,
    FIRST_HEIGHT_M as FIRST_HEIGHT_M,
    GRAZING_SINE as GRAZING_SINE,
    HIGHEST_M as HIGHEST_M,
    LOWEST_M as LOWEST_M,
    are_low_orbits as are_low_orbits,
    geostationary_directions as geostationary_directions,
    mean_directions as mean_directions,
    points_near_ground as points_near_ground,
    ranges_m as ranges_m,
    triangulated as triangulated,
)
