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
from opir_core.estimation.formulas import (
    Arithmetic as Arithmetic,
    Functions as Functions,
    Vector as Vector,
    arithmetic as arithmetic,
    inner as inner,
    plus as plus,
    scaled as scaled,
)
from opir_core.estimation.motion import (
    BOOST as BOOST,
    COAST as COAST,
    FEW_STATES as FEW_STATES,
    Motion as Motion,
    chain_roots as chain_roots,
    gravity_gradient as gravity_gradient,
    noise_roots as noise_roots,
    stepped_state as stepped_state,
    substeps as substeps,
    taylor_positions as taylor_positions,
    taylor_series as taylor_series,
    taylor_weights as taylor_weights,
)
