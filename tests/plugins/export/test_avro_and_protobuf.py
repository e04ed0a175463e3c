"""The encoders `avro` and `protobuf`: decoded by their libraries, events are those of `forge`."""

import json
from datetime import UTC, datetime
from errno import ENOSPC
from functools import cache
from io import BytesIO
from uuid import UUID

import fastavro
import numpy as np
import pytest
from avro_values import json_value
from command_line import run_command
from file_sinks import sink
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from json_lines import json_lines
from opir_export.encoders import avro, event_fields, protobuf
from opir_testing import EncoderContract, stub_window
from opir_testing.contracts.outputs import edge_case_windows
from repository import DATA, EXAMPLES

from opir_core.builtin import sinks
from opir_core.builtin.sinks import LineFile
from opir_core.errors import ModelError, PluginError, SinkError
from opir_core.interfaces.records import Batch
from opir_core.output import binary_body, detection_schema, framed_messages
from opir_core.output.spool.batches import EncodedBatcher
from opir_core.plugin import Delivery, EventEncoder, Host

SCHEMA = fastavro.parse_schema(avro.avro_schema())


def encoder_of(name):
    """Return an encoder for the sensors of the test scene."""
    return type("Built", (EncoderContract,), {"name": name}).encoder()


FORGE, AVRO, PROTOBUF = map(encoder_of, ("forge", "avro", "protobuf"))


def windows():
    return [*edge_case_windows().values(), *TestAvroEncoder.windows()]


def messages_of(encoder, window):
    body = encoder.encode(window)
    messages = framed_messages(body)
    assert b"".join(messages) == body
    return [message[4:] for message in messages]


def time_text(unix_us):
    seconds, microseconds = divmod(unix_us, 1_000_000)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{microseconds:06d}Z"


def from_avro(message):
    """Return the event of an Avro message, as JSON has it."""
    assert message[:2] == b"\xc3\x01"
    canonical = fastavro.schema.to_parsing_canonical_form(avro.avro_schema())
    assert message[2:10].hex() == fastavro.schema.fingerprint(canonical, "CRC-64-AVRO")
    stream = BytesIO(message[10:])
    record = fastavro.schemaless_reader(stream, SCHEMA, None)
    assert not stream.read()
    return {name: json_value(value) for name, value in record.items()}


def protobuf_class():
    """Return the class of the message, from the descriptor alone."""
    file = descriptor_pb2.FileDescriptorProto()
    file.ParseFromString(protobuf.file_descriptor().SerializeToString())
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("opir.DetectionEvent"))


MESSAGE = protobuf_class()


def from_protobuf(message, fields):
    """Return the event of a message of Protocol Buffers, as JSON has it."""
    event = {}
    for field in fields:
        name = field.name if field.decimals is None or field.members else None
        name = name or f"{field.name}_e{field.decimals}"
        value = getattr(message, name)
        if field.is_list:
            event[field.name] = [scaled(field, each) for each in value]
        elif not message.HasField(name):
            event[field.name] = None
        elif field.members:
            event[field.name] = from_protobuf(value, field.members)
        else:
            event[field.name] = scaled(field, value)
    return event


def scaled(field, value):
    if field.kind == "id":
        return str(UUID(bytes=value))
    if field.kind == "time":
        return time_text(value)
    return value / 10**field.decimals if field.kind == "decimal" else value


class TestAvroEncoder(EncoderContract):
    name = "avro"


class TestProtobufEncoder(EncoderContract):
    name = "protobuf"


def test_both_encodings_decode_to_the_events_of_forge():
    count = 0
    for window in windows():
        events = [json.loads(line) for line in FORGE.encode(window).splitlines()]
        every = list(
            zip(events, messages_of(AVRO, window), messages_of(PROTOBUF, window), strict=True)
        )
        for event, avro_message, protobuf_message in every:
            absent = dict.fromkeys(("path", "type_probability"))
            assert from_avro(avro_message) == {**absent, **event}
            decoded = from_protobuf(
                MESSAGE.FromString(protobuf_message), event_fields.event_fields()
            )
            assert {**decoded, "path": decoded["path"] or None} == {**absent, **event}
        count += len(every)
    assert count > 300


@pytest.mark.parametrize("encoder", [AVRO, PROTOBUF], ids=["avro", "protobuf"])
def test_an_event_takes_at_most_160_bytes(encoder):
    messages = [
        message for window in TestAvroEncoder.windows() for message in messages_of(encoder, window)
    ]
    assert np.mean([len(message) for message in messages]) <= 160


def test_every_field_of_forge_is_encoded_and_those_of_later_versions_are_optional():
    assert set(detection_schema()["required"]) <= set(event_fields.FIELDS)
    added = list(event_fields.event_fields())[len(detection_schema()["required"]) :]
    assert [field.name for field in added] == ["path", "type_probability"]
    assert all(field.is_nullable for field in added)
    assert [field.get("default", 0) for field in SCHEMA["fields"]][-2:] == [None, None]


def test_a_reader_of_an_older_schema_reads_a_newer_message():
    older = avro.avro_schema()
    older["fields"] = older["fields"][:-2]
    message = messages_of(AVRO, stub_window(1))[0]
    record = fastavro.schemaless_reader(BytesIO(message[10:]), SCHEMA, older)
    assert "path" not in record
    stream = BytesIO()
    fastavro.schemaless_writer(stream, older, record)
    stream.seek(0)
    assert fastavro.schemaless_reader(stream, older, SCHEMA)["path"] is None


def test_the_proto_text_has_the_numbers_and_names_of_the_descriptor():
    text = protobuf.proto_text()
    for field in MESSAGE.DESCRIPTOR.fields:
        assert f" {field.name} = {field.number};" in text
    assert text == Host.discover().component(EventEncoder, "protobuf").schema()


def test_a_number_of_more_than_15_digits_is_refused():
    with pytest.raises(ModelError, match="snr 1e\\+20 has more than 15 digits"):
        AVRO.encode(stub_window(1, snr=1e20))


@pytest.mark.parametrize(("name", "library"), [("avro", "fastavro"), ("protobuf", "protobuf")])
def test_a_missing_library_is_named_with_its_extra(monkeypatch, name, library):
    def missing(module):
        raise ImportError(module)

    monkeypatch.setattr(event_fields, "import_module", missing)
    with pytest.raises(PluginError, match=rf"{name} needs {library}; .*opir_export\[{name}\]"):
        event_fields.required_library("x", library, name)


def test_binary_messages_keep_their_bounds_whatever_bytes_they_have():
    messages = [b"\n", b"\0\n\0", b"x" * 300]
    batch = Batch(
        body=binary_body(messages),
        keys=("S-1",),
        key_of=np.zeros(3, dtype=np.uint16),
        content_type="application/avro",
        schema_version="2.0",
    )
    assert batch.messages() == messages
    assert batch.take([2, 0]).messages() == [messages[2], messages[0]]


def test_an_incomplete_message_is_removed_from_the_end_of_a_file(tmp_path):
    path = tmp_path / "events.pb"
    whole = PROTOBUF.encode(stub_window(3))
    for torn in (b"", b"\0", b"\0\0\0\x99abc", b"\0" * 4096):
        path.write_bytes(whole + torn)
        LineFile(str(path), PROTOBUF, appends=True).close()
        assert path.read_bytes() == whole


def records_of(content):
    """Return the events of an Avro object container file, as JSON has them."""
    return [json_value(record) for record in fastavro.reader(BytesIO(content))]


@cache
def avro_file():
    """Return the blocks of a file, after its head, and the events of each."""
    container = AVRO.container
    pieces = [window(count, 10 * count) for count in (3, 1, 40)]
    blocks = [container.block(AVRO.encode(piece)) for piece in pieces]
    events = [[json.loads(line) for line in FORGE.encode(piece).splitlines()] for piece in pieces]
    return [container.head, *blocks], events


def window(count, first_scan):
    return stub_window(count, first_scan=first_scan)


def with_absent(events):
    return [{**dict.fromkeys(("path", "type_probability")), **event} for event in events]


def test_a_run_writes_an_avro_container_with_the_events_of_forge(tmp_path):
    runs = {}
    for name, encoder, workers in (("j", "forge", 1), ("a", "avro", 1), ("b", "avro", 2)):
        path = tmp_path / f"{name}.avro"
        words = (
            f"run {{}} -q --workers {workers} --out {path} --set outputs[0].jsonl.encoder={encoder}"
        )
        run_command(words, EXAMPLES / "first_light.yaml")
        runs[name] = path.read_bytes()
    events = [json.loads(line) for line in runs["j"].splitlines()]
    assert runs["a"][:4] == b"Obj\x01"
    assert records_of(runs["a"]) == with_absent(events)
    assert len(events) == 750
    assert len(runs["a"]) / len(events) <= 160
    assert records_of(runs["b"]) == records_of(runs["a"])


def test_a_file_of_a_released_version_is_read_with_the_schema_of_today():
    """`tests/data/formats` is never renewed: its schema is in it, ours is the reader's."""
    golden = DATA / "formats"
    events = json_lines(golden / "run-2" / "events.jsonl")
    content = (golden / "avro-2" / "events.avro").read_bytes()
    records = [json_value(record) for record in fastavro.reader(BytesIO(content), SCHEMA)]
    assert records == with_absent(events)
    older = avro.avro_schema()
    older["fields"] = older["fields"][:-2]
    today = AVRO.container.head + AVRO.container.block(AVRO.encode(stub_window(3)))
    assert [record["confidence"] for record in fastavro.reader(BytesIO(today), older)]


def test_a_container_that_was_cut_anywhere_goes_on_after_its_last_whole_block(tmp_path):
    path = tmp_path / "events.avro"
    pieces, events = avro_file()
    ends = np.cumsum(list(map(len, pieces))).tolist()
    content = b"".join(pieces)
    cuts = {*range(0, len(content), 211), *ends, *(end - 1 for end in ends), ends[0] + 1}
    for cut in sorted(cuts):
        for torn in (content[:cut], content[:cut] + b"\0" * 100):
            path.write_bytes(torn)
            out = LineFile(str(path), AVRO, appends=True)
            out.write(window(2, 900))
            assert out.close() == Delivery(delivered=2)
            blocks = sum(end <= cut for end in ends[1:])
            expected = [event for block in events[:blocks] for event in block]
            records = records_of(path.read_bytes())
            assert records[:-2] == with_absent(expected)
            assert len(records) == len(expected) + 2


def test_a_block_that_the_disk_takes_in_part_is_removed_and_counted_as_lost(tmp_path, monkeypatch):
    pieces, events = avro_file()
    real = sinks._written
    room = [sum(map(len, pieces[:3])) + 9]

    def short(descriptor, lines):
        taken = real(descriptor, lines[: room[0]]) if room[0] else 0
        if not taken:
            raise OSError(ENOSPC, "no space")
        room[0] -= taken
        return taken

    monkeypatch.setattr(sinks, "_written", short)
    path = tmp_path / "events.avro"
    out = LineFile(str(path), AVRO)
    out.write(window(3, 30))
    out.write(window(1, 10))
    with pytest.raises(SinkError, match="after 4 events were delivered"):
        out.write(window(40, 400))
    assert out.close() == Delivery(delivered=4, dropped=40)
    assert path.read_bytes() == b"".join(pieces[:3])
    assert records_of(path.read_bytes()) == with_absent([*events[0], *events[1]])


def test_events_do_not_follow_those_of_another_schema(tmp_path):
    path = tmp_path / "events.avro"
    schema = {"type": "record", "name": "Other", "fields": [{"name": "x", "type": "long"}]}
    with path.open("wb") as file:
        fastavro.writer(file, schema, [{"x": 1}])
    content = path.read_bytes()
    with pytest.raises(SinkError, match=r"events.avro is no Avro file with this schema.*give ano"):
        LineFile(str(path), AVRO, appends=True)
    assert path.read_bytes() == content


@pytest.mark.parametrize("encoder", [AVRO, PROTOBUF], ids=["avro", "protobuf"])
def test_batches_of_a_large_window_have_its_messages(encoder):
    window = stub_window(3000)
    batches = list(EncodedBatcher(encoder, TestAvroEncoder.plan().sensors).batches(window))
    assert len(batches) == 3
    messages = [message for batch in batches for message in batch.messages()]
    assert messages == messages_of(encoder, window)


def test_heartbeats_are_not_mixed_with_binary_messages(tmp_path):
    path = str(tmp_path / "events.avro")
    with pytest.raises(SinkError, match="heartbeat_s needs an encoder of JSON"):
        sink("jsonl", make_encoder=lambda: AVRO, path=path, heartbeat_s=1.0)
