"""JSON Schemas of requests and of detections: those of classes of the core, with their limits."""

import json
from typing import Annotated, Any, Literal

from attrs import NOTHING, Attribute, fields
from msgspec import UNSET, Meta, UnsetType

from opir_core.builtin import BallisticConfig
from opir_core.output import detection_schema
from opir_core.reading import ID_RULE
from opir_core.scene import (
    BY_OBSERVATION,
    BY_REPORT,
    CLASS_TYPES,
    PAPER_TYPES,
    WorkLimits,
    core_target_classes,
    info_of,
)
from opir_http.answers import SCHEMAS, Closed, Count, Schema, Time
from opir_http.settings import HttpSettings

_TEXT: Schema = {"type": "string"}
_KINDS = {float: "number", int: "integer", str: "string", bool: "boolean"}
_BOUNDS = {
    "minimum": "minimum",
    "maximum": "maximum",
    "above": "exclusiveMinimum",
    "below": "exclusiveMaximum",
}


_Span = Annotated[list[float], Meta(min_length=2, max_length=2)]


def trigger() -> Schema:
    """Return the schema of a launch: a target of the model `ballistic`, with optional id and
    time.
    """
    schema = _schema_of_class(BallisticConfig)
    launch = schema["properties"]["launch"]
    launch["properties"]["time_s"] = _or_null(launch["properties"]["time_s"]) | {
        "description": "ignition, s after the scene's epoch, not in the past; default: the earliest"
        " possible"
    }
    schema["properties"]["type"]["examples"] = list(core_target_classes())
    schema["properties"] |= {
        "id": {**_TEXT, "pattern": r"^[A-Za-z0-9._:\-]{1,64}$", "description": ID_RULE},
        "model": {
            **_TEXT,
            "enum": ["ballistic"],
            "description": "target model; any installed one is accepted; default: that of the"
            " target class",
        },
    }
    return schema


def detection() -> Schema:
    """Return the core's schema of a detection, and of the parts that it refers to."""
    text = json.dumps(detection_schema()).replace("#/$defs/", f"{SCHEMAS}detection-")
    schema: Schema = json.loads(text, object_hook=_without_listed_numbers)
    definitions = {f"detection-{name}": value for name, value in schema["$defs"].items()}
    return {
        "Detection": {key: value for key, value in schema.items() if not key.startswith("$")},
        **definitions,
    }


def _without_listed_numbers(schema: Schema) -> Schema:
    """Return a schema with bounds in place of listed fractions: generators of clients know no
    such `enum`.
    """
    values = schema.get("enum")
    if not isinstance(values, list) or not all(isinstance(value, float) for value in values):
        return schema
    del schema["enum"]
    return {"type": "number", **schema, "minimum": min(values), "maximum": max(values)}


def _schema_of_class(config: type) -> Schema:
    """Return the schema of a configuration class, from its fields."""
    attributes = fields(config)
    return _closed(
        {attribute.name: _schema_of_field(attribute) for attribute in attributes},
        [attribute.name for attribute in attributes if attribute.default is NOTHING],
    )


def _schema_of_field(attribute: "Attribute[Any]") -> Schema:
    info = info_of(attribute)
    kind: Any = attribute.type
    description = {"description": f"{info.help}{f', {info.unit}' if info.unit else ''}"}
    if hasattr(kind, "__attrs_attrs__"):
        return _schema_of_class(kind) | description
    plain = next(plain for plain in _KINDS if kind in (plain, plain | None))
    schema: Schema = {"type": _KINDS[plain]}
    for name, word in _BOUNDS.items():
        if getattr(info, name) is not None:
            schema[word] = getattr(info, name)
    if info.choices:
        schema["enum"] = list(info.choices)
    return (schema if kind == plain else _or_null(schema)) | description


def _closed(properties: Schema, required: list[str]) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def _or_null(schema: Schema) -> Schema:
    return {"anyOf": [schema, {"type": "null"}]}


def _settings(config: type, **more: Any) -> Any:
    """Return the type of a mapping with the settings of a configuration class."""
    return Annotated[Schema, Meta(extra_json_schema=_schema_of_class(config) | more)]


def _model(name: str) -> Any:
    """Return the type of the choice of a model."""
    return Annotated[
        Schema | str | UnsetType, Meta(description=f"{name} model: its name, or a block")
    ]


class Config(Closed, kw_only=True):
    """The configuration: the settings of a scene; blocks of components are not specified."""

    scene: str
    epoch: Time
    duration_s: Annotated[float, Meta(gt=0)]
    seed: Count | UnsetType = UNSET
    light_time: bool | UnsetType = UNSET
    reported_types: Literal[PAPER_TYPES, CLASS_TYPES] | UnsetType = UNSET  # type: ignore[valid-type]
    forces: Annotated[Any, Meta(description="forces in free flight")] = UNSET
    limits: _settings(WorkLimits) | UnsetType = UNSET  # type: ignore[valid-type]
    allow_implausible: bool | UnsetType = UNSET
    sensors: Annotated[list[Schema], Meta(min_length=1)]
    watched_s: dict[str, list[_Span]] | UnsetType = UNSET
    faults: list[Schema] | UnsetType = UNSET
    links: Schema | UnsetType = UNSET
    director: _model("director") = UNSET  # type: ignore[valid-type]
    detection: _model("detection") = UNSET  # type: ignore[valid-type]
    classification: _model("classification") = UNSET  # type: ignore[valid-type]
    confidence: _model("confidence") = UNSET  # type: ignore[valid-type]
    tracker: _model("tracker") = UNSET  # type: ignore[valid-type]
    atmosphere: _model("atmosphere") = UNSET  # type: ignore[valid-type]
    background: _model("background") = UNSET  # type: ignore[valid-type]
    tracking_order: Literal[BY_OBSERVATION, BY_REPORT] | UnsetType = UNSET  # type: ignore[valid-type]
    tracking_lag_s: Annotated[float, Meta(ge=0)] | UnsetType | None = UNSET
    outputs: list[Schema | str] | UnsetType = UNSET
    http: _settings(HttpSettings, required=[attribute.name for attribute in fields(HttpSettings)])  # type: ignore[valid-type]
