"""Another legal value of each setting of a configuration class, in the layout of a scene's
block.
"""

import math
from collections.abc import Mapping

from opir_core.scene.field_rows import field_rows


def other_values(config_class):
    """Yield the dotted key of each setting with a plain value, and another legal value."""
    for row in field_rows(config_class):
        value = _other(row)
        if value is not None:
            yield row.key, value


def nested(key, value):
    """Return the block that sets a dotted key."""
    name, _, remainder = key.partition(".")
    return {name: nested(remainder, value) if remainder else value}


def _other(row):
    default = row.default
    if isinstance(default, bool):
        return not default
    if row.choices:
        return next((choice for choice in reversed(row.choices) if choice != default), None)
    if isinstance(default, int | float):
        return _number(row, default)
    if default is None and row.kind.startswith(("number", "whole number")):
        return _number(row, _plausible_middle(row))
    if not isinstance(default, Mapping) or not default or "block" in row.kind:
        return None
    is_numbers = all(isinstance(value, float) for value in default.values())
    return {key: 0.9 * value for key, value in default.items()} if is_numbers else None


def _number(row, default):
    """Return a number near the default, in the allowed interval."""
    total = row.kind.startswith("whole")
    for value in (
        default * 1.5 + (1 if total else 0.0),
        default * 0.5,
        default + 1.0,
        default - 1.0,
        0.5,
        1.0,
    ):
        number = int(value) if total else float(value)
        if number != default and _inside(row.interval, number):
            return number
    return None


def _plausible_middle(row):
    """Return the geometric mean of the plausible range of a setting without a default, 10 without
    one.
    """
    if not row.plausible:
        return 10.0
    low, high = (float(word) for word in row.plausible.removeprefix("plausible ").split(" to "))
    return math.sqrt(low * high)


def _inside(interval, value):
    if not interval:
        return True
    low, high = (float(word) for word in interval[1:-1].split(", "))
    above = value >= low if interval[0] == "[" else value > low
    return above and (value <= high if interval[-1] == "]" else value < high)
