"""The `avro` encoder: the detection event in Avro's single-object encoding, and its schema.

A message is C3 01, the fingerprint of the schema (CRC-64-AVRO), and the record
(avro.apache.org/docs/1.12.0/specification, Single-object encoding). A file is an object container
file: a head with the schema, then blocks of records.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from hashlib import blake2b
from io import BytesIO
from typing import Any, BinaryIO

from opir_core.errors import SinkError
from opir_core.output import binary_body, framed_messages
from opir_core.plugin import EncoderContext
from opir_export.encoders.event_fields import (
    PRECISION,
    BinaryEncoder,
    Field,
    Values,
    event_fields,
    event_title,
    required_library,
    values_of,
)

_MARKER = b"\xc3\x01"
_TYPES: Mapping[str, Any] = {
    "id": {"type": "fixed", "name": "Uuid", "size": 16},
    "time": {"type": "long", "logicalType": "timestamp-micros"},
    "text": "string",
    "integer": "long",
    "number": "double",
}


class AvroEncoder(BinaryEncoder):
    """Detections as Avro messages."""

    content_type = "application/avro"

    def __init__(self, context: EncoderContext) -> None:
        super().__init__(context)
        _parts()  # raises without fastavro

    def message(self, event: Mapping[str, Any]) -> bytes:
        """Return the message of an event, read from JSON."""
        write, schema, header, values = _parts()
        stream = BytesIO(header)
        stream.seek(len(header))
        write(stream, schema, values(event))
        return stream.getvalue()

    @property
    def container(self) -> "AvroContainer":
        """The object container file."""
        return AvroContainer()


class AvroContainer:
    """Avro's object container file, without compression.

    The sync marker is a hash of the schema, so that a run that is repeated has the same bytes.
    """

    def __init__(self) -> None:
        _, schema, header, _ = _parts()
        self._avro = required_library("fastavro", "fastavro", "avro")
        self._skipped = len(binary_body([header]))  # before the record of a message
        self._sync = blake2b(json.dumps(schema).encode(), digest_size=16).digest()
        stream = BytesIO()
        self._avro.writer(stream, schema, [], sync_marker=self._sync)
        self.head = stream.getvalue()

    def block(self, body: bytes) -> bytes:
        """Return the block of messages: their number, the length of the records, these, the sync
        marker.
        """
        records = [message[self._skipped :] for message in framed_messages(body)]
        data = b"".join(records)
        return b"".join((self._long(len(records)), self._long(len(data)), data, self._sync))

    def _long(self, value: int) -> bytes:
        stream = BytesIO()
        self._avro.schemaless_writer(stream, "long", value)
        return stream.getvalue()

    def whole(self, file: BinaryIO) -> int:
        """Return how many bytes of a file its head and its whole blocks are; `SinkError` for a file
        with another head.
        """
        head = file.read(len(self.head))
        if head != self.head:
            if self.head.startswith(head.rstrip(b"\0")):  # a power cut leaves zeros
                return 0
            raise SinkError(
                f"avro: {file.name} is no Avro file with this schema, and no events can follow what"
                f" it has; give another path"
            )
        file.seek(0)
        end = len(head)
        with suppress(Exception):  # whatever fastavro raises: the next block is not whole
            for block in self._avro.block_reader(file):
                end = block.offset + block.size
        return end


def avro_schema_text() -> str:
    """Return the Avro schema as JSON text."""
    return json.dumps(avro_schema(), indent=2, ensure_ascii=False) + "\n"


def avro_schema() -> dict[str, Any]:
    """Return the Avro schema of the detection event."""
    record = _record("DetectionEvent", event_fields())
    return {"namespace": "opir", "doc": event_title(), **record}


def _record(name: str, fields: Sequence[Field]) -> dict[str, Any]:
    return {"type": "record", "name": name, "fields": [_field(field) for field in fields]}


def _field(field: Field) -> dict[str, Any]:
    item = _type(field)
    kind = {"type": "array", "items": item} if field.is_list else item
    words = {"name": field.name, "doc": field.description}
    return (
        {**words, "type": ["null", kind], "default": None}
        if field.is_nullable
        else {**words, "type": kind}
    )


def _type(field: Field) -> Any:
    if field.kind == "record":
        return _record(field.record, field.members)
    if field.kind == "decimal":
        return {
            "type": "bytes",
            "logicalType": "decimal",
            "precision": PRECISION,
            "scale": field.decimals,
        }
    return _TYPES[field.kind]


@cache
def _parts() -> tuple[Any, Any, bytes, Values]:
    """Return fastavro's writer, its schema, the beginning of messages, and the values of events."""
    fastavro = required_library("fastavro", "fastavro", "avro")
    canonical = fastavro.schema.to_parsing_canonical_form(avro_schema())
    fingerprint = bytes.fromhex(fastavro.schema.fingerprint(canonical, "CRC-64-AVRO"))
    values = values_of(event_fields(), lambda field: field.name, _decimal_bytes)
    schema = fastavro.parse_schema(avro_schema())
    return fastavro.schemaless_writer, schema, _MARKER + fingerprint, values


def _decimal_bytes(units: int) -> bytes:
    """Return an integer in two's complement, big endian, in as few bytes as hold it."""
    return units.to_bytes(units.bit_length() // 8 + 1, "big", signed=True)
