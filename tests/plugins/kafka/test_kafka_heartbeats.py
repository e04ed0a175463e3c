"""Heartbeats in a topic: after the events of their sensor, in no book, and read by `opir track`."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import kafka_broker
import pytest
from command_line import main
from kafka_broker import messages
from opir_kafka.document import asyncapi_document
from watched_scene import SCENE, TARGET


@pytest.fixture(scope="module")
def broker() -> Iterator[Any]:
    with kafka_broker.broker() as broker_process:
        yield broker_process


def test_a_consumed_topic_says_which_sensors_watched(
    broker: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    topic = broker.topic()
    kafka = f"{{bootstrap_servers: '{broker.address}', topic: {topic}, heartbeat_s: 2}}"
    scene = tmp_path / "run.yaml"
    scene.write_text(f"{SCENE}{TARGET}outputs:\n  - kafka: {kafka}\n")
    assert main(["run", str(scene)]) == 0
    (count,) = re.findall(r"kafka: (\d+) events", capsys.readouterr().out)

    sent = messages(broker.address, topic)
    beats = [message for message in sent if headers(message)["schema-version"] == "heartbeat-1.0"]
    assert len(sent) - len(beats) == int(count)
    assert len(beats) == 2 * (20 + 4)
    schema = asyncapi_document()["components"]["messages"]["heartbeat"]["payload"]["schema"]
    for message in beats:
        beat = json.loads(message.value())
        jsonschema.validate(beat, schema)
        assert message.key().decode() == beat["sensor_id"]
        assert headers(message)["content-type"] == "application/json"
    for sensor in ("WEST", "EAST"):
        require_order(
            [json.loads(message.value()) for message in sent if message.key().decode() == sensor]
        )

    dump = tmp_path / "dump.jsonl"
    dump.write_bytes(b"".join(message.value() + b"\n" for message in sent))
    sensors = tmp_path / "sensors.yaml"
    sensors.write_text(SCENE)
    arguments = ["--sensors", str(sensors), "--out", str(tmp_path / "tracked.jsonl")]
    assert main(["track", str(dump), *arguments]) == 0
    assert "WEST watched 0.0–40.0 and 52.0–60.0 s" in capsys.readouterr().out


def headers(message: Any) -> dict[str, str]:
    return {name: value.decode() for name, value in message.headers()}


def require_order(records: list[dict[str, Any]]) -> None:
    """Require that no event of a sensor follows the heartbeat of its look."""
    watched_to = ""
    for record in records:
        if "record" in record:
            watched_to = max(watched_to, record["watched_to"])
        else:
            assert record["timestamp"] >= watched_to


def test_heartbeats_need_an_encoder_of_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "run.yaml"
    kafka = "{bootstrap_servers: 'localhost:1', heartbeat_s: 2, encoder: avro}"
    scene.write_text(f"{SCENE}{TARGET}outputs:\n  - kafka: {kafka}\n")
    assert main(["run", str(scene)]) != 0
    words = "kafka: heartbeat_s needs an encoder of JSON, for heartbeats are JSON"
    assert words in capsys.readouterr().err
