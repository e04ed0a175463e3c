"""Validation of values against JSON Schema: the keywords that the core's schemas use."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

Schema = Mapping[str, Any]

_TYPES: Mapping[str, Callable[[Any], bool]] = {
    "null": lambda value: value is None,
    "boolean": lambda value: isinstance(value, bool),
    "string": lambda value: isinstance(value, str),
    "array": lambda value: isinstance(value, list),
    "object": lambda value: isinstance(value, dict),
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value),
    "integer": lambda value: isinstance(value, int | float) and not isinstance(value, bool) and value == int(value),
}

_BOUNDS: Mapping[str, tuple[type | tuple[type, ...], Callable[[Any, Any], bool]]] = {
    "minimum": ((int, float), lambda value, bound: value >= bound),
    "maximum": ((int, float), lambda value, bound: value <= bound),
    "exclusiveMinimum": ((int, float), lambda value, bound: value > bound),
    "exclusiveMaximum": ((int, float), lambda value, bound: value < bound),
    "pattern": (str, lambda value, bound: re.search(bound, value) is not None),
    "maxItems": (list, lambda value, bound: len(value) <= bound),
    "minItems": (list, lambda value, bound: len(value) >= bound),
}

_KNOWN = {"type", "enum", "const", "properties", "required", "additionalProperties", "items", "anyOf", "$ref", *_BOUNDS}
_NOTES = {"$schema", "$id", "$defs", "title", "description", "format", "examples"}


def schema_errors(value: Any, schema: Schema) -> list[str]:
    """Return the errors of a value, each with its path; raises `ValueError` for an unsupported keyword."""
    return list(_errors(value, schema, schema, "event"))


def _errors(value: Any, schema: Schema, root: Schema, path: str) -> Iterator[str]:
    unknown = schema.keys() - _KNOWN - _NOTES
    if unknown:
        raise ValueError(f"the schema has {', '.join(sorted(unknown))}, which is not supported")
    if "$ref" in schema:
        yield from _errors(value, _resolved(schema["$ref"], root), root, path)
    if "anyOf" in schema and all(any(_errors(value, option, root, path)) for option in schema["anyOf"]):
        yield f"{path}: {value!r} matches none of the alternatives"
    yield from _own_errors(value, schema, path)
    if isinstance(value, dict):
        yield from _object_errors(value, schema, root, path)
    if isinstance(value, list) and "items" in schema:
        for place, item in enumerate(value):
            yield from _errors(item, schema["items"], root, f"{path}[{place}]")


def _own_errors(value: Any, schema: Schema, path: str) -> Iterator[str]:
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(_TYPES[kind](value) for kind in kinds):
        yield f"{path}: {value!r} is not {' or '.join(kinds)}"
        return
    if "enum" in schema and value not in schema["enum"]:
        yield f"{path}: {value!r} is not one of {schema['enum']}"
    if "const" in schema and value != schema["const"]:
        yield f"{path}: {value!r} is not {schema['const']!r}"
    for keyword, (kind, holds) in _BOUNDS.items():
        if keyword in schema and isinstance(value, kind) and not holds(value, schema[keyword]):
            yield f"{path}: {value!r} violates {keyword} {schema[keyword]!r}"


def _object_errors(value: dict[str, Any], schema: Schema, root: Schema, path: str) -> Iterator[str]:
    properties: Mapping[str, Schema] = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            yield f"{path}.{name}: is missing"
    for name, item in value.items():
        if name in properties:
            yield from _errors(item, properties[name], root, f"{path}.{name}")
        elif schema.get("additionalProperties") is False:
            yield f"{path}.{name}: is not in the schema"


def _resolved(reference: str, root: Schema) -> Schema:
    found: Any = root
    for step in reference.removeprefix("#/").split("/"):
        found = found[step]
    return found
