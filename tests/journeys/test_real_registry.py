"""Apicurio Registry itself: a consumer decodes a topic with nothing but the registry's schemas."""

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import fastavro
import httpx
import kafka_broker
import pytest
import schema_registry
from avro_values import json_value
from command_line import main
from kafka_broker import messages
from repository import EXAMPLES

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

SCENE = str(EXAMPLES / "first_light.yaml")


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Any:
    if schema_registry.why_absent():
        pytest.skip(schema_registry.why_absent())
    with schema_registry.apicurio(tmp_path_factory.mktemp("registry")) as address:
        yield address


@pytest.fixture(scope="module")
def broker() -> Any:
    with kafka_broker.broker() as broker_process:
        yield broker_process


def values(broker: Any, registry: str, encoder: str, topic: str, code: int = 0) -> list[bytes]:
    kafka = (
        f"{{bootstrap_servers: '{broker.address}', topic: {topic}, encoder: {encoder},"
        f" registry: {{url: '{registry}'}}}}"
    )
    assert main(["run", SCENE, "-q", "--set", f"outputs=[{{kafka: {kafka}}}]"]) == code
    return [message.value() for message in messages(broker.address, topic)]


def schema_of(registry: str, value: bytes) -> Any:
    """Return the registry's answer for the number in a message."""
    assert value[0] == 0
    answer = httpx.get(f"{registry}/schemas/ids/{int.from_bytes(value[1:5], 'big')}", timeout=30.0)
    return answer.raise_for_status().json()


def known(event: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of an event that have a value."""
    return {name: value for name, value in event.items() if value is not None}


def test_avro_is_decoded_with_the_schema_of_the_registry(
    broker: Any, registry: str, tmp_path: Path
) -> None:
    sent = values(broker, registry, "avro", broker.topic())
    schema = fastavro.parse_schema(json.loads(schema_of(registry, sent[0])["schema"]))
    records = [fastavro.schemaless_reader(BytesIO(value[5:]), schema, None) for value in sent]
    decoded = [known(json_value(record)) for record in records]
    path = tmp_path / "events.jsonl"
    assert main(["run", SCENE, "-q", "--out", str(path)]) == 0
    events = [json.loads(line) for line in path.read_text().splitlines()]
    expected = [known(event) for event in events]
    by_id = {event["detection_id"]: event for event in decoded}
    assert [by_id[event["detection_id"]] for event in expected] == expected
    assert len(decoded) == len(expected) == 750


@pytest.mark.parametrize(("encoder", "kind"), [("protobuf", "PROTOBUF"), ("forge", "JSON")])
def test_other_schemas_are_taken_and_kept(
    broker: Any, registry: str, encoder: str, kind: str
) -> None:
    topic = broker.topic()
    sent = values(broker, registry, encoder, topic)
    answer = schema_of(registry, sent[0])
    assert answer["schemaType"] == kind
    assert {value[:5] for value in sent} == {sent[0][:5]}
    assert httpx.get(f"{registry}/subjects/{topic}-value/versions", timeout=30.0).json() == [1]


def test_an_incompatible_subject_refuses_the_schema(
    broker: Any, registry: str, capsys: pytest.CaptureFixture[str]
) -> None:
    topic = broker.topic()
    fields = [{"name": "x", "type": "long"}]
    schema = {"type": "record", "name": "DetectionEvent", "namespace": "opir", "fields": fields}
    subject = f"{registry}/subjects/{topic}-value/versions"
    httpx.post(subject, json={"schema": json.dumps(schema)}, timeout=30.0).raise_for_status()
    rule = {"compatibility": "BACKWARD"}
    httpx.put(f"{registry}/config/{topic}-value", json=rule, timeout=30.0).raise_for_status()
    assert values(broker, registry, "avro", topic, code=5) == []
    assert f"answers 409 for the subject {topic}-value" in capsys.readouterr().err
