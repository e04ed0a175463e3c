from opir_core.estimation.ellipses import (
    CONTAINMENT as CONTAINMENT,
    containment_ellipse as containment_ellipse,
)
