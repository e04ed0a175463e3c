from opir_core.simulation.interpolation import (
    ProbabilityInterpolant as ProbabilityInterpolant,
)
from opir_core.simulation.manifest import (
    components_used as components_used,
)
from opir_core.simulation.plan_checks import (
    plan_warnings as plan_warnings,
)
from opir_core.simulation.report_order import (
    ReportOrder as ReportOrder,
)
from opir_core.simulation.tracker_clock import (
    without_truth as without_truth,
)
