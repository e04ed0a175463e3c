"""The Kafka sink: the command line, batches, partitions, settings, the document of the topic,
deadlines.
"""

import ast
import asyncio
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import kafka_broker
import opir_kafka
import pytest
import yaml
from aiokafka import errors
from command_line import main, run_command
from kafka_broker import PERMANENT_CODES, carrier, config, dead_address, kafka_sink, messages
from opir_kafka.document import asyncapi_document, asyncapi_text
from opir_kafka.failures import is_fatal
from opir_kafka.lanes import Shipment
from opir_kafka.transport import KafkaTransport
from repository import EXAMPLES
from spool_transports import ENCODER, SENSORS, window

from opir_core import compile_plan
from opir_core.errors import SceneError
from opir_core.output import deliver
from opir_core.output.spool.batches import EncodedBatcher
from opir_core.output.spool.transport_sink import Policy
from opir_core.plugin import Host, SinkModel, Transport
from opir_core.reading import load_scene

KAFKA = Host.discover().component(SinkModel, "kafka")
SCENE = str(EXAMPLES / "first_light.yaml")


@pytest.fixture(scope="module")
def broker() -> Iterator[Any]:
    with kafka_broker.broker() as made:
        yield made


def scene_with(settings: str) -> Any:
    return load_scene(SCENE, overrides=[f"outputs=[{{kafka: {settings}}}]"])


def test_the_carrier_keeps_the_protocol() -> None:
    made = carrier(dead_address(), "topic")
    assert isinstance(made, Transport)
    made.close(5.0)


def test_only_permanent_codes_of_the_protocol_end_the_sink() -> None:
    answers = {code: errors.for_code(code)() for code in range(-1, 130)}
    fatal = {code for code, answer in answers.items() if answer.errno == code and is_fatal(answer)}
    assert fatal == {*PERMANENT_CODES, 58}  # 58: SASL_AUTHENTICATION_FAILED


def test_the_command_line_sends_a_run_into_a_topic(
    broker: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    topic = broker.topic()
    where = [
        f"outputs[0].kafka.bootstrap_servers={broker.address}",
        f"outputs[0].kafka.topic={topic}",
    ]
    assert (
        main(
            ["run", SCENE, "--sink", "kafka", *(word for each in where for word in ("--set", each))]
        )
        == 0
    )
    assert "kafka: 750 events" in capsys.readouterr().out
    sent = messages(broker.address, topic)
    assert (
        len({json.loads(message.value())["detection_id"] for message in sent}) == len(sent) == 750
    )


@pytest.mark.slow
def test_without_a_broker_the_command_line_says_so_and_fails(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    spool = f"outputs[0].kafka.spool={{path: {tmp_path / 'spool'}}}"
    servers = f"outputs[0].kafka.bootstrap_servers={dead_address()}"
    run_command("run {} --sink kafka --set {} --set {}", SCENE, servers, spool)
    assert "kafka: 0 events, 750 spooled" in capsys.readouterr().out


@pytest.mark.parametrize("compression", ["gzip", "snappy", "lz4", "zstd"])
def test_batches_are_compressed(broker: Any, compression: str) -> None:
    topic = broker.topic()
    sink = kafka_sink(broker.address, topic, None, compression=compression)
    sink.write(window(2000))
    assert sink.close().delivered == 2000
    assert {message.value() for message in messages(broker.address, topic)} == set(
        ENCODER.encode(window(2000)).splitlines()
    )


def test_small_batches_keep_the_order(broker: Any) -> None:
    topic = broker.topic()
    sink = kafka_sink(broker.address, topic, None, batch_bytes=1024)
    sink.write(window(100))
    assert sink.close().delivered == 100
    scans = [
        json.loads(message.value())["timestamp"]
        for message in messages(broker.address, topic)
        if message.key() == b"S-0"
    ]
    assert scans == sorted(scans)
    assert len(scans) == 20


def test_partitions_of_sensors_follow_kafkas_rule(broker: Any) -> None:
    """librdkafka's murmur2 partitioner is the oracle: the one that Java clients use."""
    import confluent_kafka

    ours = broker.topic()
    theirs = broker.topic()
    sink = kafka_sink(broker.address, ours, None)
    sink.write(window(len(SENSORS)))
    assert sink.close().delivered == len(SENSORS)
    producer = confluent_kafka.Producer(
        {"bootstrap.servers": broker.address, "partitioner": "murmur2_random"}
    )
    for sensor in SENSORS:
        producer.produce(theirs, b"x", sensor.id.encode())
    producer.flush(10.0)
    placed = [
        {message.key(): message.partition() for message in messages(broker.address, each)}
        for each in (ours, theirs)
    ]
    assert placed[0] == placed[1]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("{bootstrap_servers: localhost}", "'localhost' is no host:port"),
        ("{bootstrap_servers: 'a:1,b:99999'}", "'b:99999' is no host:port"),
        ("{bootstrap_servers: ''}", "'' is no host:port"),
        ("{topic: 'a b'}", "'a b' is no topic"),
        ("{topic: ..}", "is no topic"),
        ("{compression: rar}", "is not one of none, gzip, snappy, lz4, zstd"),
        ("{acks: 1}", "unknown key"),
        ("{security: {protocol: SASL_SSL}}", "SASL_SSL needs username and password_variable"),
        (
            "{security: {username: me, password_variable: PW}}",
            "PLAINTEXT has no login; SASL_SSL has",
        ),
        (
            "{security: {protocol: SSL, key_file: k}}",
            "key_file is of no use without certificate_file",
        ),
        ("{security: {ca_file: c}}", "PLAINTEXT uses no certificates"),
    ],
)
def test_what_is_wrong_with_the_settings_is_reported(settings: str, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        scene_with(settings)
    assert message in str(caught.value)


@pytest.mark.parametrize("encoder", ["forge", "forge-c2", "udl"])
def test_a_message_is_what_the_document_of_the_topic_says(broker: Any, encoder: str) -> None:
    document = asyncapi_document()
    assert document["channels"]["detections"]["address"] == KAFKA.config().topic
    reported = document["components"]["messages"][encoder]
    topic = broker.topic()
    settings = f"bootstrap_servers: '{broker.address}', topic: {topic}, encoder: {encoder}"
    outcome = deliver(compile_plan(scene_with(f"{{{settings}}}")))
    sent = messages(broker.address, topic)
    assert outcome.report.sinks[0].delivered == len(sent) == 750
    for message in sent:
        headers = {name: value.decode() for name, value in message.headers()}
        jsonschema.Draft202012Validator(reported["headers"]).validate(headers)
        jsonschema.Draft202012Validator(reported["bindings"]["kafka"]["key"]).validate(
            message.key().decode()
        )
    payload = {**document, "$ref": f"#/components/messages/{encoder}/payload/schema"}
    jsonschema.Draft202012Validator(payload).validate(json.loads(sent[0].value()))


def test_every_reference_of_the_document_leads_somewhere() -> None:
    document = asyncapi_document()
    found_references = list(references(document))
    assert any("$defs" in reference for reference in found_references)
    for reference in found_references:
        sent: Any = document
        for step in reference.removeprefix("#/").split("/"):
            sent = sent[step]
    assert yaml.safe_load(asyncapi_text()) == document


def references(node: Any) -> Iterator[str]:
    """Yield the references in a document."""
    if isinstance(node, dict):
        if "$ref" in node:
            yield node["$ref"]
        for child in node.values():
            yield from references(child)
    if isinstance(node, list):
        for child in node:
            yield from references(child)


def test_pauses_grow_to_the_longest() -> None:
    pauses_s = KAFKA.config(longest_pause_s=0.3).pauses_s()
    assert pauses_s == [0.05, 0.1, 0.2, 0.3]
    assert KAFKA.config(longest_pause_s=0.05).pauses_s() == [0.05]


def test_a_shipment_is_done_when_every_row_is() -> None:
    from concurrent.futures import Future

    future: Future[None] = Future()
    shipment = Shipment(next(EncodedBatcher(ENCODER, SENSORS).batches(window(10))), future)
    rows = shipment.rows_by_partition(
        {b"S-0": 0, b"S-1": 0, b"S-2": 1, b"S-3": 1, b"S-4": 2}.__getitem__
    )
    assert rows == {0: [0, 1, 5, 6], 1: [2, 3, 7, 8], 2: [4, 9]}
    assert not shipment.acknowledge(rows[0])
    assert not shipment.acknowledge([2])
    assert shipment.rows_by_partition(lambda key: 7) == {7: [3, 4, 7, 8, 9]}
    assert shipment.acknowledge([3, 4, 7, 8, 9])
    assert future.done()


def test_closing_is_quick_whatever_the_state() -> None:
    import time

    began = time.monotonic()
    for address in (
        dead_address(),
        "192.0.2.1:9092",
    ):  # TEST-NET-1 (RFC 5737): nobody answers, nobody refuses
        made = carrier(address, "topic", connect_timeout_s=60.0)
        made.send(next(EncodedBatcher(ENCODER, SENSORS).batches(window(5))))
        made.close(5.0)
        made.close(5.0)
    assert time.monotonic() - began < 50.0  # of 60 s for each connection


def test_closing_twice_ends_the_thread_in_peace() -> None:
    is_closing = threading.Event()

    class Lost:
        """A producer whose connection is lost, and which takes its time to end."""

        client = SimpleNamespace(close=lambda: asyncio.sleep(0.0))

        async def partitions_for(self, _topic: str) -> set[int]:
            raise OSError("lost")

        async def stop(self) -> None:
            is_closing.set()
            await asyncio.sleep(0.3)

    async def connect() -> Any:
        return Lost()

    carrier = KafkaTransport(config(dead_address(), "t"), connect)
    assert is_closing.wait(10.0)
    carrier.close(5.0)  # an error of the thread is one of the test
    assert not carrier._thread.is_alive()


def test_the_default_is_the_papers_topic_on_this_machine() -> None:
    bare = KAFKA.config()
    assert (bare.topic, bare.servers) == ("forge.sensors.raw", ("localhost:9092",))
    assert config("a:1, [::1]:2", "t").servers == ("a:1", "[::1]:2")
    assert Policy().when_full == "wait"


def test_every_await_has_a_deadline() -> None:
    """Each is inside `asyncio.timeout`, is given one, waits for a step that has one, or for
    something to do.
    """
    own = Path(opir_kafka.__file__).parent
    sent = [
        f"{path.name}: {waited}"
        for path in sorted(own.glob("*.py"))
        for waited in awaits_without_a_deadline(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert not [each for each in sent if each.split(": ", 1)[1] not in AWAITS_THAT_END_THEMSELVES]


AWAITS_THAT_END_THEMSELVES = {
    *("self._registry.frame()", "result"),  # of a thread, within a deadline
    "self._one_connection()",  # steps with deadlines, and then the wait for a lane to fail
    "self._connect()",
    "self._partitioning(producer)",
    "asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)",  # lanes, each of whose sends has a deadline
    "lane.has_messages.wait()",  # for something to send
    "self._is_to_retry.wait()",  # until the sink tries again after a permanent error
    "asyncio.sleep(next(self._pauses_s))",
    "asyncio.gather(*tasks, *examining, return_exceptions=True)",  # cancelled tasks
    "close_producer(producer)",
    "asyncio.shield(asyncio.create_task(_close(producer), name=f'{OURS} closing'))",  # three steps with deadlines
    "_ended(producer.stop())",
    "_ended(producer.client.close())",
    "probe(config)",
    *("probe(self._config)", "probe(self._config, address)"),
    "self._probe(producer, partition)",
    *("self._topic_fault(producer)", "self._topic_fault(producer, partition)"),
    "self._leader_fault(producer, partition)",  # a probe
    # The callers of topic.py give it request_timeout_s.
    *(
        "_answer(client, MetadataRequest([topic]), within_s / 2)",
        "_answer(client, request, within_s)",
    ),
    "topic_settings(client, topic, within_s / 2)",
    "sending",  # which is done
}


def awaits_without_a_deadline(node: ast.AST, is_timed: bool = False) -> Iterator[str]:
    if isinstance(node, ast.AsyncWith):
        is_timed = is_timed or any("asyncio.timeout" in ast.unparse(item) for item in node.items)
    if isinstance(node, ast.Await) and not is_timed and "timeout=" not in ast.unparse(node):
        yield ast.unparse(node.value)
    for child in ast.iter_child_nodes(node):
        yield from awaits_without_a_deadline(child, is_timed)
