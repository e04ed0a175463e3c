"""The warnings about a plan, which runs all the same."""

from opir_core.planning.plan import Plan
from opir_core.scene.plausibility import REMEDY, implausible_values
from opir_core.simulation.scan_alignment import alignment_warnings

#: Implausible values that are listed one by one.
_LISTED = 8


def plan_warnings(plan: Plan) -> list[str]:
    """Return the warnings: scan instants that coincide with events of targets, and implausible values."""
    return [*alignment_warnings(plan), *_implausible(plan)]


def _implausible(plan: Plan) -> list[str]:
    found = [] if plan.scene.allow_implausible else implausible_values(plan.scene)
    more = [f"and {len(found) - _LISTED} more implausible values"] if len(found) > _LISTED else []
    return [*(f"{problem}; {REMEDY}" for problem in found[:_LISTED]), *more]
