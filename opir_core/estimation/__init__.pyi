from opir_core.estimation.directions import (
    FEW_ROWS as FEW_ROWS,
    dot as dot,
    matvec as matvec,
    tangent_axes as tangent_axes,
)
from opir_core.estimation.ellipses import (
    CONTAINMENT as CONTAINMENT,
    containment_ellipse as containment_ellipse,
)
from opir_core.estimation.motion import (
    BOOST as BOOST,
    COAST as COAST,
    FEW_STATES as FEW_STATES,
    GravityFunction as GravityFunction,
    Motion as Motion,
    gradient_of_one as gradient_of_one,
    integrator_noise as integrator_noise,
    noise_roots as noise_roots,
    stepped_one as stepped_one,
    substeps as substeps,
    taylor_of_one as taylor_of_one,
    taylor_positions as taylor_positions,
    taylor_weights as taylor_weights,
)
