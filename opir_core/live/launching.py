"""When a launch goes up that is asked of a run: scene time counts from the scene's epoch, a lap's plan from its own."""

from collections.abc import Mapping
from typing import Any

from attrs import frozen

from opir_core.live.laps import Place
from opir_core.live.turns import PastError

_NS = 1_000_000_000


@frozen
class Launched:
    """A launch that was taken in: its target's id, its moment of scene time, and the first cycle that may see it."""

    target_id: str
    time_s: float
    cycle: int


def timed(block: Mapping[str, Any], target_id: str, place: Place, soonest_ns: int) -> tuple[dict[str, Any], bool]:
    """Return a launch's block with an id and a time of the lap, and whether the time is ours to choose.

    A block without an id gets `target_id`, one without a time the millisecond after `soonest_ns` of the lap. Raises
    `PastError` for a time before the lap.
    """
    whole, before_ns = {"id": target_id, **block}, place.shift.time_ns
    launch = whole.get("launch")
    if not isinstance(launch, Mapping):
        return whole, False
    if launch.get("time_s") is None:
        return {**whole, "launch": {**launch, "time_s": -(-soonest_ns // 1_000_000) / 1000}}, True
    time_s = launch["time_s"]
    if isinstance(time_s, int | float) and not isinstance(time_s, bool) and before_ns:
        if time_s < before_ns / _NS:
            raise past(place.time_ns)
        whole["launch"] = {**launch, "time_s": time_s - before_ns / _NS}
    return whole, False


def past(time_ns: int) -> PastError:
    """Return the refusal of a launch that comes too late at a moment of scene time."""
    return PastError(f"launch.time_s is past: the scene's clock is at {time_ns / _NS:.3f} s; leave it out for now")
