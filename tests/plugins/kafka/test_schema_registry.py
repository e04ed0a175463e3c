"""The schema registry: what it is asked, what becomes of its answers, and messages with its number."""

import asyncio
import json
import re
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import fastavro
import kafka_broker
import pytest
from command_line import main
from kafka_broker import dead_address, messages
from opir_kafka.failures import RegistryRefusalError
from opir_kafka.registry import SchemaRegistry
from opir_kafka.settings import KafkaConfig, RegistryConfig
from repository import EXAMPLES
from schema_registry import Double

from opir_core.plugin import EventEncoder, Host

SCENE = str(EXAMPLES / "first_light.yaml")


@pytest.fixture(scope="module")
def broker() -> Iterator[Any]:
    with kafka_broker.broker() as broker_process:
        yield broker_process


@pytest.fixture
def registry() -> Iterator[Double]:
    double = Double()
    yield double
    double.close()


def sent(address: str, topic: str, encoder: str, url: str, login: str = "", more: str = "") -> int:
    kafka = (
        f"{{bootstrap_servers: '{address}', topic: {topic}, encoder: {encoder},"
        f" longest_pause_s: 0.05, registry: {{url: '{url}'{login}}}{more}}}"
    )
    return main(["run", SCENE, "-q", "--set", f"outputs=[{{kafka: {kafka}}}]"])


@pytest.mark.parametrize(
    ("encoder", "schema_type"), [("avro", "AVRO"), ("protobuf", "PROTOBUF"), ("forge", "JSON")]
)
def test_a_schema_is_registered_once_and_its_number_is_in_each_message(
    broker: Any, registry: Double, encoder: str, schema_type: str
) -> None:
    topic = broker.topic()
    assert sent(broker.address, topic, encoder, registry.address) == 0
    ((path, login, document),) = registry.requests
    assert (path, login) == (f"/subjects/{topic}-value/versions", None)
    component = Host.discover().component(EventEncoder, encoder)
    assert component.schema is not None
    assert document == {"schemaType": schema_type, "schema": component.schema()}
    values = [message.value() for message in messages(broker.address, topic)]
    assert len(values) == 750
    assert {value[:5] for value in values} == {b"\0\0\0\0\7"}


def test_a_message_is_the_record_of_the_registered_schema(broker: Any, registry: Double) -> None:
    topic = broker.topic()
    assert sent(broker.address, topic, "avro", registry.address) == 0
    schema = fastavro.parse_schema(json.loads(registry.requests[0][2]["schema"]))
    for message in messages(broker.address, topic):
        stream = BytesIO(message.value()[5:])
        record = fastavro.schemaless_reader(stream, schema, None)
        assert isinstance(record, dict)
        assert not stream.read()
        assert record["sensor_id"] == message.key().decode()
        assert len(message.value()) <= 160


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (
            (409, {"error_code": 409, "message": "incompatible\nfield x"}),
            "answers 409 for the subject .*-value: incompatible field x; the subject has a schema",
        ),
        ((404, {"message": "no such route"}), "answers 404 .*: no such route; see registry.url"),
        ((404, b"<html>"), r"answers 404 for the subject \S*; see registry.url"),
        ((401, b""), "answers 401 .*; see registry.username and the variable of its password"),
        ((403, b""), "answers 403 .*; let this login write to the subject"),
        ((422, {"message": "odd"}), "answers 422 .*: odd; this registry cannot read the schema"),
        ((200, b"hello"), "answers no number of a schema; see registry.url"),
        ((200, {"ids": [1]}), "answers no number of a schema; see registry.url"),
    ],
)
def test_a_refusal_ends_the_output_in_words(
    registry: Double, answer: Any, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    registry.answers = [answer]
    assert sent(dead_address(), "t", "avro", registry.address) == 5
    errors = capsys.readouterr().err
    assert re.search(f"the schema registry {registry.address} {words}", errors)
    assert "Traceback" not in errors
    assert len(registry.requests) == 1


@pytest.mark.parametrize("code", [500, 503, 429])
def test_a_registry_that_is_troubled_is_asked_again(
    broker: Any, registry: Double, code: int
) -> None:
    registry.answers = [(code, {"message": "later"}), (code, b""), (200, {"id": 300})]
    topic = broker.topic()
    assert sent(broker.address, topic, "forge", registry.address) == 0
    assert len(registry.requests) == 3
    sent_values = [message.value() for message in messages(broker.address, topic)]
    assert {value[:5] for value in sent_values} == {b"\0\0\0\1\x2c"}
    assert len({json.loads(value[5:])["detection_id"] for value in sent_values}) == 750


def test_events_wait_in_the_spool_while_the_registry_is_away(
    broker: Any, registry: Double, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    topic = broker.topic()
    spool = f", spool: {{path: {tmp_path / 'spool'}}}"
    away = f"http://{dead_address()}"
    assert sent(broker.address, topic, "avro", away, more=spool) == 0
    words = f"750 events wait in its spool: the schema registry {away} does not answer: "
    assert words in caplog.text
    assert sent(broker.address, topic, "avro", registry.address, more=spool) == 0
    values = [message.value() for message in messages(broker.address, topic)]
    assert len(set(values)) == 750
    assert {value[:5] for value in values} == {b"\0\0\0\0\7"}


def test_the_password_comes_from_the_environment(
    broker: Any,
    registry: Double,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    login = ", subject: events, username: opir, password_variable: OPIR_TEST_REGISTRY"
    topic = broker.topic()
    monkeypatch.delenv("OPIR_TEST_REGISTRY", raising=False)
    assert sent(broker.address, topic, "avro", registry.address, login) != 0
    assert "variable that registry.password_variable names is not set" in capsys.readouterr().err
    monkeypatch.setenv("OPIR_TEST_REGISTRY", "open:sesame")
    assert sent(broker.address, topic, "avro", registry.address, login) == 0
    # RFC 7617: base64 of opir:open:sesame.
    path, authorization, _ = registry.requests[0]
    assert (path, authorization) == ("/subjects/events/versions", "Basic b3BpcjpvcGVuOnNlc2FtZQ==")
    assert "sesame" not in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"url": "http://opir:secret@host"}, "without a login"),
        ({"url": "localhost:8081"}, "give http://HOST:PORT"),
        ({"url": "http://h", "username": "opir"}, "needs username and password_variable"),
        (
            {"url": "http://h", "username": "opir", "password_variable": "sesame"},
            "never the secret",
        ),
        ({"subject": "events"}, "of no use without url"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused(
    settings: dict[str, str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    kafka = json.dumps({"registry": settings})
    assert main(["run", SCENE, "-q", "--set", f"outputs=[{{kafka: {kafka}}}]"]) == 2
    assert words in capsys.readouterr().err


def test_messages_of_another_schema_are_refused(
    registry: Double,
) -> None:
    config = KafkaConfig(registry=RegistryConfig(url=registry.address))
    schema = Host.discover().component(EventEncoder, "avro").schema
    assert schema is not None
    frame = asyncio.run(SchemaRegistry(config, "AVRO", schema()).frame())
    with pytest.raises(RegistryRefusalError, match="messages of another schema"):
        frame(b"\xc3\x01" + bytes(8) + b"record")


def test_heartbeats_and_a_registry_exclude_each_other() -> None:
    with pytest.raises(ValueError, match="leave out heartbeat_s or registry"):
        KafkaConfig(heartbeat_s=1.0, registry=RegistryConfig(url="http://h"))
