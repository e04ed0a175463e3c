"""The books of a sink: its own counts, held against the events that were handed to it."""

from typing import Any

from attrs import evolve

from opir_core.interfaces.protocols import Delivery

#: The counts of a `Delivery`.
COUNTS = ("delivered", "spooled", "dropped", "withheld", "recovered")
#: The fates of events, those a sink is least believed in first.
_FATES = ("delivered", "dropped", "withheld", "spooled")


def balanced(told: Delivery, handed: int, *, is_final: bool) -> tuple[Delivery, int]:
    """Return a sink's counts, made to add up, and by how many events they did not.

    `handed` events were handed to the sink. What it tells beyond these and the recovered ones is taken away; a count
    below 0, or that is no whole number, is 0. Of events that are missing at the end, when `is_final`, it is not known
    what became of them: they are dropped.
    """
    counts: dict[str, Any] = {name: _whole(getattr(told, name)) for name in COUNTS}
    wrong = sum(counts[name] != getattr(told, name) for name in COUNTS)
    due = handed + counts["recovered"]
    beyond = sum(counts[name] for name in _FATES) - due
    if beyond > 0:
        left = beyond
        for name in _FATES:
            taken = min(left, counts[name])
            counts[name], left = counts[name] - taken, left - taken
    elif is_final:
        counts["dropped"] -= beyond
    else:
        beyond = 0
    return (evolve(told, **counts), max(abs(beyond), wrong)) if beyond or wrong else (told, 0)


def _whole(count: object) -> int:
    return count if type(count) is int and count > 0 else 0
