from opir_trackers.initiation import (
    TrackCandidates as TrackCandidates,
)
from opir_trackers.lines_of_sight import (
    AngleMeasurements as AngleMeasurements,
    LinesOfSight as LinesOfSight,
    TangentPlanes as TangentPlanes,
    earth_rotated as earth_rotated,
    emission_s as emission_s,
)
from opir_trackers.track_priors import (
    FIRST_CLIMB_M_S as FIRST_CLIMB_M_S,
    FIRST_FORCE_M_S2 as FIRST_FORCE_M_S2,
    prior_axes as prior_axes,
    prior_sigmas as prior_sigmas,
)
from opir_trackers.triangulation import (
    FIRST_HEIGHT_M as FIRST_HEIGHT_M,
)
from opir_trackers.parts import (
    Association as Association,
    AssociationProblem as AssociationProblem,
    Associator as Associator,
    Initiator as Initiator,
    MotionModel as MotionModel,
    PartContext as PartContext,
    Pruner as Pruner,
    Settled as Settled,
    TrackPicture as TrackPicture,
)
