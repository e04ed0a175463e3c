from opir_trackers.initiation import (
    TrackCandidates as TrackCandidates,
)
from opir_trackers.onset.composition import (
    Composition as Composition,
)
from opir_trackers.onset.motion_statistics import (
    GROUND as GROUND,
    LAUNCH as LAUNCH,
)
from opir_trackers.parts import (
    Association as Association,
    AssociationProblem as AssociationProblem,
    Associator as Associator,
    Initiator as Initiator,
    PartContext as PartContext,
    Pruner as Pruner,
    TrackPicture as TrackPicture,
    made_part as made_part,
)
from opir_trackers.track_priors import (
    FIRST_CLIMB_M_S as FIRST_CLIMB_M_S,
    FIRST_FORCE_M_S2 as FIRST_FORCE_M_S2,
    prior_axes as prior_axes,
    prior_sigmas as prior_sigmas,
)
