"""Does a value follow a JSON Schema? Of the schema language, what the schemas of this house use, and nothing else."""

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


def faults_in(value: Any, schema: Schema) -> list[str]:
    """Return what is wrong with a value, each fault with its path; raises `ValueError` for a keyword not known here."""
    return list(_faults(value, schema, schema, "event"))


def _faults(value: Any, schema: Schema, root: Schema, path: str) -> Iterator[str]:
    unknown = schema.keys() - _KNOWN - _NOTES
    if unknown:
        raise ValueError(f"the schema has {', '.join(sorted(unknown))}, which is not looked at here")
    if "$ref" in schema:
        yield from _faults(value, _referred(schema["$ref"], root), root, path)
    if "anyOf" in schema and all(any(_faults(value, option, root, path)) for option in schema["anyOf"]):
        yield f"{path}: {value!r} is none of what it may be"
    yield from _own_faults(value, schema, path)
    if isinstance(value, dict):
        yield from _faults_in_object(value, schema, root, path)
    if isinstance(value, list) and "items" in schema:
        for place, item in enumerate(value):
            yield from _faults(item, schema["items"], root, f"{path}[{place}]")


def _own_faults(value: Any, schema: Schema, path: str) -> Iterator[str]:
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
            yield f"{path}: {value!r} breaks {keyword} {schema[keyword]!r}"


def _faults_in_object(value: dict[str, Any], schema: Schema, root: Schema, path: str) -> Iterator[str]:
    properties: Mapping[str, Schema] = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            yield f"{path}.{name}: is missing"
    for name, item in value.items():
        if name in properties:
            yield from _faults(item, properties[name], root, f"{path}.{name}")
        elif schema.get("additionalProperties") is False:
            yield f"{path}.{name}: is not in the schema"


def _referred(reference: str, root: Schema) -> Schema:
    found: Any = root
    for step in reference.removeprefix("#/").split("/"):
        found = found[step]
    schema: Schema = found
    return schema
