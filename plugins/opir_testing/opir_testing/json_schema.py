"""Validation of events against their JSON Schema."""

import math
from collections.abc import Mapping
from typing import Any

from jsonschema import Draft202012Validator
from jsonschema.validators import extend


def _is_finite_number(_checker: Any, value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


#: JSON has no NaN and no infinity, though Python reads and writes them.
_Validator = extend(
    Draft202012Validator,
    type_checker=Draft202012Validator.TYPE_CHECKER.redefine("number", _is_finite_number),
)


def schema_errors(value: Any, schema: Mapping[str, Any]) -> list[str]:
    """Return the errors of a value, each with its path."""
    return [
        f"event{error.json_path.removeprefix('$')}: {error.message}"
        for error in _Validator(schema).iter_errors(value)
    ]
