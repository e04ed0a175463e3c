"""The detection event for binary encoders: its fields, from the JSON Schema, and its values, from the
encoder `forge`.

So all encodings have the same definition, and the same digits.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import cache, lru_cache
from importlib import import_module
from typing import Any

import msgspec
from attrs import frozen

from opir_core.errors import ModelError, PluginError, install_command
from opir_core.output import (
    DEGREE_DECIMALS,
    METRE_DECIMALS,
    POINT_DECIMALS,
    SCHEMA_VERSION,
    SHARE_DECIMALS,
    SNR_DECIMALS,
    ForgeEncoder,
    binary_body,
    detection_schema,
)
from opir_core.plugin import Encoder, EncoderContext, Window

#: The fields of an event in the order of their numbers, with the decimals of their numbers; new ones
#: are appended.
FIELDS: Mapping[str, int | None] = {
    "detection_id": None,
    "timestamp": None,
    "sensor_id": None,
    "sensor_type": None,
    "orbital_slot": DEGREE_DECIMALS,
    "target_type": None,
    "launch_point": POINT_DECIMALS,
    "impact_point": POINT_DECIMALS,
    "confidence": SHARE_DECIMALS,
    "schema_version": None,
    "reported_at": None,
    "track_id": None,
    "azimuth_deg": DEGREE_DECIMALS,
    "elevation_deg": DEGREE_DECIMALS,
    "line_of_sight_sigma_urad": None,
    "bands": None,
    "snr": SNR_DECIMALS,
    "sensor_position_ecef_m": METRE_DECIMALS,
    "path": None,
    "type_probability": SHARE_DECIMALS,
}

#: Digits of a number with decimals: as many as a double holds.
PRECISION = 15

_decode_lines = msgspec.json.Decoder().decode_lines
_UNIX_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)


@frozen
class Field:
    """A field of a record: `kind` is id, time, text, integer, number, decimal or record.

    `members` are the fields of a record, which is called `record`.
    """

    name: str
    kind: str
    description: str
    decimals: int | None
    is_nullable: bool
    is_list: bool
    record: str
    members: tuple["Field", ...]


@cache
def event_fields() -> tuple[Field, ...]:
    """Return the fields of an event."""
    schema = detection_schema()
    return _fields(FIELDS, schema, schema["$defs"])


def event_title() -> str:
    """Return the first line of a schema."""
    schema = detection_schema()
    return f"{schema['title']}, {schema['$id']}. Times are microseconds since 1970-01-01, UTC."


def _fields(
    decimals: Mapping[str, int | None], schema: Mapping[str, Any], definitions: Mapping[str, Any]
) -> tuple[Field, ...]:
    return tuple(
        _field(name, count, schema["properties"][name], definitions, name in schema["required"])
        for name, count in decimals.items()
    )


def _field(
    name: str,
    decimals: int | None,
    rule: Mapping[str, Any],
    definitions: Mapping[str, Any],
    is_required: bool,
) -> Field:
    """Return the field of a property's rule."""
    choices = rule.get("anyOf", [rule])
    reference = choices[0].get("$ref", "").rpartition("/")[2]
    type_rule = definitions.get(reference, rule)
    types = [type_rule["type"]] if isinstance(type_rule["type"], str) else type_rule["type"]
    is_record = types[0] == "object"
    numbers = dict.fromkeys(type_rule["required"], decimals) if is_record else {}
    item = type_rule.get("items", type_rule)
    return Field(
        name=name,
        kind="record" if is_record else _kind(item, types[0], decimals),
        description=rule.get("description", ""),
        decimals=decimals,
        is_nullable=not is_required or "null" in types or {"type": "null"} in choices,
        is_list=types[0] == "array",
        record=reference.capitalize(),
        members=_fields(numbers, type_rule, definitions),
    )


def _kind(item: Mapping[str, Any], type_name: str, decimals: int | None) -> str:
    name = item["type"] if type_name == "array" else type_name
    if name == "string":
        return {"uuid": "id", "date-time": "time"}.get(item.get("format", ""), "text")
    if name == "number":
        return "number" if decimals is None else "decimal"
    return "integer"


Values = Callable[[Mapping[str, Any]], dict[str, Any]]


def values_of(
    fields: Sequence[Field], name_of: Callable[[Field], str], decimal: Callable[[int], Any]
) -> Values:
    """Return the function that turns an event, read from JSON, into values by `name_of` a field.

    Ids become bytes, times µs since 1970-01-01; numbers with decimals become integers of the last
    one, and then what `decimal` returns. Raises `ModelError` for one of more than 15 digits.
    """
    parts = [(each.name, name_of(each), _conversion(each, name_of, decimal)) for each in fields]

    def values(event: Mapping[str, Any]) -> dict[str, Any]:
        return {
            name: None if (value := event.get(key)) is None else convert(value)
            for key, name, convert in parts
        }

    return values


def _conversion(
    field: Field, name_of: Callable[[Field], str], decimal: Callable[[int], Any]
) -> Callable[[Any], Any]:
    """Return the function that converts the values of a field that are not null."""
    scale = 10 ** (field.decimals or 0)

    def scaled(value: float) -> Any:
        units = round(value * scale)
        if abs(units) >= 10**PRECISION:
            raise ModelError(
                f"{field.name} {value} has more than {PRECISION} digits, and cannot be encoded;"
                f" the encoder forge writes it"
            )
        return decimal(units)

    convert: Callable[[Any], Any]
    if field.kind == "record":
        convert = values_of(field.members, name_of, decimal)
    elif field.kind == "decimal":
        convert = scaled
    else:
        convert = _CONVERSIONS.get(field.kind, _same)
    return (lambda values: [convert(value) for value in values]) if field.is_list else convert


def _same(value: Any) -> Any:
    return value


def _id_bytes(text: str) -> bytes:
    return bytes.fromhex(text.replace("-", ""))


@lru_cache  # the looks of a scan have one time
def _microseconds(text: str) -> int:
    return (datetime.fromisoformat(text) - _UNIX_EPOCH) // _MICROSECOND


_CONVERSIONS: Mapping[str, Callable[[Any], Any]] = {
    "id": _id_bytes,
    "time": _microseconds,
    "number": float,
}


class BinaryEncoder(Encoder):
    """The events of the encoder `forge` as binary messages."""

    schema_version = SCHEMA_VERSION

    def __init__(self, context: EncoderContext) -> None:
        self._forge = ForgeEncoder(context)

    @abstractmethod
    def message(self, event: Mapping[str, Any]) -> bytes:
        """Return the message of an event, read from JSON."""

    def encode(self, window: Window) -> bytes:
        """Return the window's detections as messages after their lengths; invalid values raise
        `ModelError`.
        """
        events = _decode_lines(self._forge.encode(window))
        return binary_body(map(self.message, events))


def required_library(module: str, library: str, encoder: str) -> Any:
    """Return a module of an optional library; `PluginError` if it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        remedy = install_command("opir-export", encoder)
        raise PluginError(f"the encoder {encoder} needs {library}; {remedy}") from error
