"""The words for a component that cannot be built, or builds what is not what its kind owes."""

from typing import Any

from opir_core.errors import ModelError
from opir_core.plugin.host import Host
from opir_core.plugin.validation import described_error
from opir_core.scene.scene import Choice

#: What trackers owe, as `opir_core.interfaces.protocols.Tracker` has it.
_TRACKER_METHODS = ("associate(detections)", "step(tick_s, detections)")


def build_error(host: Host, choice: Choice, error: Exception) -> ModelError:
    """Return the complaint about a component whose `build` raised."""
    return ModelError(f"{owner_text(host, choice)}: build raised {described_error(error)}")


def require_tracker(host: Host, choice: Choice, part: Any) -> None:
    """Raise `ModelError` where what a tracker's component built is no tracker."""
    fault = _fault_in_tracker(part)
    if fault:
        raise ModelError(f"{owner_text(host, choice)}: {fault}; {to_check(choice.name)}")


def owner_text(host: Host, choice: Choice) -> str:
    """Return a component and its owner, after its place in the scene, as messages begin with them."""
    kind, owner = host.component(choice.hook, choice.name).kind, host.provenance(choice.hook, choice.name)
    return f"{choice.path}: the {kind} {choice.name!r} of {owner}"


def to_check(name: str) -> str:
    """Return what finds out what a component owes and does not keep."""
    return f"`opir check {name}` says what it owes"


def _fault_in_tracker(part: Any) -> str:
    missing = [method for method in _TRACKER_METHODS if not callable(getattr(part, method.partition("(")[0], None))]
    if missing:
        return f"build made {_one(part)} without {' and '.join(missing)}"
    if not hasattr(part, "cadence_s"):
        return f"build made {_one(part)} without cadence_s, the seconds between two ticks"
    cadence_s = part.cadence_s
    try:
        is_time = cadence_s is None or 0.0 < cadence_s < float("inf")
    except TypeError:
        is_time = False
    return "" if is_time else f"cadence_s is {cadence_s!r}, neither a positive number of seconds nor None"


def _one(part: Any) -> str:
    name = type(part).__name__
    return "None" if part is None else f"{'an' if name[:1] in 'AEIOUaeiou' else 'a'} {name}"
