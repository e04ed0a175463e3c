"""The `protobuf` encoder: the detection event as a message of Protocol Buffers, and its `.proto`.

A number with decimals is an integer of its last one, and its name says so: `azimuth_deg_e9` is in
1e-9 deg.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from opir_core.plugin import EncoderContext
from opir_export.encoders.event_fields import (
    BinaryEncoder,
    Field,
    Values,
    event_fields,
    event_title,
    required_library,
    values_of,
)

_EVENT = "DetectionEvent"
_TYPES = {
    "id": "bytes",
    "time": "int64",
    "text": "string",
    "integer": "int64",
    "number": "double",
    "decimal": "sint64",
}


class ProtobufEncoder(BinaryEncoder):
    """Detections as messages of Protocol Buffers."""

    content_type = "application/x-protobuf"

    def __init__(self, context: EncoderContext) -> None:
        super().__init__(context)
        _parts()  # raises without protobuf

    def message(self, event: Mapping[str, Any]) -> bytes:
        """Return the message of an event, read from JSON."""
        message, values = _parts()
        encoded: bytes = message(**values(event)).SerializeToString()
        return encoded


def proto_text() -> str:
    """Return the definition of the message, a `.proto` file."""
    lines = [f"// {event_title()}"]
    lines += ['syntax = "proto3";', "package opir;"]
    for name, fields in _messages(_EVENT, event_fields()):
        lines += ["", f"message {name} {{"]
        for number, field in enumerate(fields, 1):
            if field.description:
                lines += [f"  // {field.description}"]
            label = "repeated" if field.is_list else "optional"
            lines += [f"  {label} {_type(field)} {_name(field)} = {number};"]
        lines += ["}"]
    return "\n".join(lines) + "\n"


def _messages(name: str, fields: Sequence[Field]) -> Iterator[tuple[str, Sequence[Field]]]:
    """Yield the messages, the inner ones first."""
    for field in fields:
        if field.members:
            yield from _messages(field.record, field.members)
    yield name, fields


def _type(field: Field) -> str:
    return _TYPES.get(field.kind, field.record)


def _name(field: Field) -> str:
    return f"{field.name}_e{field.decimals}" if field.kind == "decimal" else field.name


@cache
def _parts() -> tuple[Any, Values]:
    """Return the class of the message, and the values of events."""
    pool = required_library("google.protobuf.descriptor_pool", "protobuf", "protobuf")
    factory = required_library("google.protobuf.message_factory", "protobuf", "protobuf")
    own_pool = pool.DescriptorPool()
    own_pool.AddSerializedFile(file_descriptor().SerializeToString())
    event = own_pool.FindMessageTypeByName(f"opir.{_EVENT}")
    return factory.GetMessageClass(event), values_of(event_fields(), _name, int)


def file_descriptor() -> Any:
    """Return the descriptor of the `.proto` file."""
    library = required_library("google.protobuf.descriptor_pb2", "protobuf", "protobuf")
    file = library.FileDescriptorProto(name="opir.proto", package="opir", syntax="proto3")
    kinds = library.FieldDescriptorProto
    for name, fields in _messages(_EVENT, event_fields()):
        message = file.message_type.add(name=name)
        for number, field in enumerate(fields, 1):
            row = message.field.add(name=_name(field), number=number)
            row.label = kinds.LABEL_REPEATED if field.is_list else kinds.LABEL_OPTIONAL
            if field.members:
                row.type_name = f".opir.{field.record}"
                row.type = kinds.TYPE_MESSAGE
            else:
                row.type = getattr(kinds, f"TYPE_{_type(field).upper()}")
            if not field.is_list:
                row.proto3_optional = True
                row.oneof_index = len(message.oneof_decl)
                message.oneof_decl.add(name=f"_{row.name}")
    return file
