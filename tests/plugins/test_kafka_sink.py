"""The Kafka sink: settings, secrets, what failures are called, the command line."""

import ast
import json
import logging
import shutil
import socket
import ssl
import struct
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jsonschema
import kafka_stand
import opir_kafka
import pytest
import yaml
from aiokafka import errors
from kafka_stand import carrier, config, dead_address, kafka_sink, messages
from opir_kafka.connection import connector
from opir_kafka.document import asyncapi_document, asyncapi_text
from opir_kafka.failures import FATAL_CODES, is_fatal, words
from opir_kafka.lanes import Shipment
from opir_kafka.settings import KafkaConfig, SecurityConfig
from spool_stand import ENCODER, SENSORS, window

from opir_core.cli import main
from opir_core.delivery import deliver
from opir_core.errors import SceneError, SinkError
from opir_core.plan import compile_plan
from opir_core.reading import load_scene
from opir_core.spool.carriers import Carrier
from opir_core.spool.dispatch import Policy
from opir_core.spool.parcels import Packer

SCENE = str(Path(__file__).resolve().parents[2] / "examples" / "first_light.yaml")
SECRET = "correct horse battery staple"
LOGIN = {
    "protocol": "SASL_PLAINTEXT",
    "mechanism": "PLAIN",
    "username": "opir",
    "password_variable": "OPIR_TEST_PASSWORD",
}


@pytest.fixture(scope="module")
def broker() -> Iterator[Any]:
    with kafka_stand.broker() as made:
        yield made


@pytest.fixture
def secret(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("OPIR_TEST_PASSWORD", SECRET)
    return SECRET


def scene_with(settings: str) -> Any:
    return load_scene(SCENE, overrides=[f"outputs=[{{kafka: {settings}}}]"])


def test_the_carrier_keeps_the_protocol() -> None:
    made = carrier(dead_address(), "topic")
    assert isinstance(made, Carrier)
    made.close(5.0)


def test_the_command_line_sends_a_run_into_a_topic(broker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    topic = broker.topic()
    where = [f"outputs[0].kafka.bootstrap_servers={broker.address}", f"outputs[0].kafka.topic={topic}"]
    assert main(["run", SCENE, "--sink", "kafka", *(word for each in where for word in ("--set", each))]) == 0
    assert "kafka: 750 events" in capsys.readouterr().out
    found = messages(broker.address, topic)
    assert len({json.loads(message.value())["detection_id"] for message in found}) == len(found) == 750


def test_without_a_broker_the_command_line_says_so_and_fails(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    spool = f"outputs[0].kafka.spool={{path: {tmp_path / 'spool'}}}"
    servers = f"outputs[0].kafka.bootstrap_servers={dead_address()}"
    assert main(["run", SCENE, "--sink", "kafka", "--set", servers, "--set", spool]) == 0
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


def test_a_sensor_goes_to_the_partition_that_kafka_s_own_rule_gives(broker: Any) -> None:
    """librdkafka's murmur2 partitioner is the oracle: the one that Java clients use."""
    import confluent_kafka

    ours, theirs = broker.topic(), broker.topic()
    sink = kafka_sink(broker.address, ours, None)
    sink.write(window(len(SENSORS)))
    assert sink.close().delivered == len(SENSORS)
    producer = confluent_kafka.Producer({"bootstrap.servers": broker.address, "partitioner": "murmur2_random"})
    for sensor in SENSORS:
        producer.produce(theirs, b"x", sensor.id.encode())
    producer.flush(10.0)
    placed = [
        {message.key(): message.partition() for message in messages(broker.address, each)} for each in (ours, theirs)
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
        ("{security: {username: me, password_variable: PW}}", "PLAINTEXT has no login; SASL_SSL has"),
        ("{security: {protocol: SSL, key_file: k}}", "key_file is of no use without certificate_file"),
        ("{security: {ca_file: c}}", "PLAINTEXT uses no certificates"),
    ],
)
def test_what_is_wrong_with_the_settings_is_told(settings: str, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        scene_with(settings)
    assert message in str(caught.value)


@pytest.mark.parametrize("key", ["password_variable", "key_password_variable", "password", "sasl_password", "token"])
def test_a_secret_in_a_scene_is_refused_and_not_repeated(key: str, tmp_path: Path) -> None:
    block = f"{{protocol: SASL_SSL, username: me, {key}: hunter2}}"
    path = tmp_path / "scene.yaml"
    path.write_text(Path(SCENE).read_text().split("outputs:")[0] + f"outputs:\n  - kafka: {{security: {block}}}\n")
    override = ["outputs=[{kafka: {}}]", f"outputs[0].kafka.security.{key}=hunter2"]
    for read in (lambda: load_scene(str(path)), lambda: load_scene(SCENE, overrides=override)):
        with pytest.raises(SceneError) as caught:
            read()
        assert "hunter2" not in str(caught.value)


def test_a_secret_that_is_not_in_the_environment_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for value in (None, ""):
        monkeypatch.delenv("OPIR_TEST_PASSWORD", raising=False)
        if value is not None:
            monkeypatch.setenv("OPIR_TEST_PASSWORD", value)
        with pytest.raises(SinkError, match=r"variable that security\.password_variable names is not set"):
            connector(KafkaConfig(security=SecurityConfig(**LOGIN)))


def test_a_secret_is_in_no_manifest_message_or_log(
    secret: str, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    caplog.set_level(logging.DEBUG)
    manifest = tmp_path / "manifest.json"
    with door(58) as address:
        setting = f"outputs[0].kafka={{bootstrap_servers: '{address}', security: {json.dumps(LOGIN)}}}"
        code = main(["run", SCENE, "--sink", "kafka", "--set", setting, "--manifest", str(manifest)])
    assert code == 5
    told = capsys.readouterr()
    assert "OPIR_TEST_PASSWORD" in manifest.read_text()
    assert "aiokafka" in caplog.text
    for text in (manifest.read_text(), told.out, told.err, caplog.text):
        assert secret not in text


def test_a_refused_login_fails_at_once_and_says_what_to_see_to(secret: str) -> None:
    with door(58) as address:
        sink = kafka_sink(address, "topic", None, security=SecurityConfig(**LOGIN))
        sink.write(window(5))
        told = sink.close()
    assert told.dropped == 5
    assert f"kafka: {address} answers SaslAuthenticationFailed (code 58); see security.username" in (
        told.complaint or ""
    )


def test_once_let_in_a_refused_login_may_pass() -> None:
    refused = errors.SaslAuthenticationFailed()
    assert is_fatal(refused, was_connected=False)
    assert not is_fatal(refused, was_connected=True)


@pytest.mark.parametrize("code", sorted(FATAL_CODES))
def test_a_fatal_code_is_told_with_its_number(code: int) -> None:
    error = errors.for_code(code)()
    assert is_fatal(error, was_connected=False)
    assert f"code {code}" in words(error, "broker:9092")


@pytest.mark.parametrize(
    "error",
    [TimeoutError(), ConnectionResetError(), errors.KafkaConnectionError(), errors.KafkaError(), OSError(29, "x")],
)
def test_what_is_no_answer_of_the_broker_may_pass(error: Exception) -> None:
    assert not is_fatal(error, was_connected=False)
    assert "broker:9092" in words(error, "broker:9092")


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a self-signed certificate for localhost and its key, with the password `SECRET`."""
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl to make a certificate with")
    folder = tmp_path_factory.mktemp("tls")
    subject = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"]
    command = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-keyout",
        "key",
        "-out",
        "cert",
        "-days",
        "2",
        *subject,
    ]
    subprocess.run([*command, "-passout", f"pass:{SECRET}"], cwd=folder, check=True, capture_output=True)
    return folder


def test_an_unknown_certificate_is_refused_at_once(certificate: Path) -> None:
    with door(0, certificate) as address:
        sink = kafka_sink(
            address.replace("127.0.0.1", "localhost"), "topic", None, security=SecurityConfig(protocol="SSL")
        )
        sink.write(window(5))
        told = sink.close()
    assert "no encrypted connection to localhost" in (told.complaint or "")
    assert "see security.ca_file" in (told.complaint or "")


def test_a_known_certificate_and_a_login_come_through(certificate: Path, secret: str) -> None:
    security = SecurityConfig(
        **{**LOGIN, "protocol": "SASL_SSL"},
        ca_file=str(certificate / "cert"),
        certificate_file=str(certificate / "cert"),
        key_file=str(certificate / "key"),
        key_password_variable="OPIR_TEST_PASSWORD",
    )
    with door(29, certificate) as address:
        made = carrier(address.replace("127.0.0.1", "localhost"), "topic", security=security)
        future = made.carry(next(Packer(ENCODER, SENSORS).parcels(window(5))))
        with pytest.raises(SinkError, match="code 29"):
            future.result(10.0)
        made.close(5.0)


@pytest.mark.parametrize("password", ["", "wrong"])
def test_a_key_that_cannot_be_read_is_told(certificate: Path, monkeypatch: pytest.MonkeyPatch, password: str) -> None:
    monkeypatch.setenv("OPIR_TEST_PASSWORD", password or "x")
    security = SecurityConfig(
        protocol="SSL",
        certificate_file=str(certificate / "cert"),
        key_file=str(certificate / "key"),
        key_password_variable="OPIR_TEST_PASSWORD" if password else None,
    )
    with pytest.raises(SinkError, match="the certificates of security cannot be used"):
        connector(KafkaConfig(security=security))


def test_missing_certificates_are_told() -> None:
    with pytest.raises(SinkError, match="no such file or directory"):
        connector(KafkaConfig(security=SecurityConfig(protocol="SSL", ca_file="missing.pem")))


def test_a_missing_codec_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from aiokafka import codec

    monkeypatch.setattr(codec, "has_zstd", lambda: False)
    with pytest.raises(SinkError, match="zstd is not installed"):
        connector(KafkaConfig(compression="zstd"))


@pytest.mark.parametrize("encoder", ["forge", "forge-c2", "udl"])
def test_a_message_is_what_the_document_of_the_topic_says(broker: Any, encoder: str) -> None:
    document = asyncapi_document()
    assert document["channels"]["detections"]["address"] == KafkaConfig().topic
    told = document["components"]["messages"][encoder]
    topic = broker.topic()
    settings = f"bootstrap_servers: '{broker.address}', topic: {topic}, encoder: {encoder}"
    outcome = deliver(compile_plan(scene_with(f"{{{settings}}}")))
    found = messages(broker.address, topic)
    assert outcome.report.sinks[0].delivered == len(found) == 750
    for message in found:
        headers = {name: value.decode() for name, value in message.headers()}
        jsonschema.Draft202012Validator(told["headers"]).validate(headers)
        jsonschema.Draft202012Validator(told["bindings"]["kafka"]["key"]).validate(message.key().decode())
    jsonschema.Draft202012Validator(told["payload"]["schema"]).validate(json.loads(found[0].value()))


def test_every_reference_of_the_document_leads_somewhere() -> None:
    document = asyncapi_document()
    payloads = {id(each["payload"]["schema"]) for each in document["components"]["messages"].values()}
    for reference in references(document, payloads):
        found: Any = document
        for step in reference.removeprefix("#/").split("/"):
            found = found[step]
    assert yaml.safe_load(asyncapi_text()) == document


def references(node: Any, left_out: set[int]) -> Iterator[str]:
    """Yield the references in a document, but for those in the schemas of payloads, which are documents themselves."""
    if id(node) in left_out:
        return
    if isinstance(node, dict):
        if "$ref" in node:
            yield node["$ref"]
        for child in node.values():
            yield from references(child, left_out)
    if isinstance(node, list):
        for child in node:
            yield from references(child, left_out)


def test_pauses_grow_to_the_longest() -> None:
    pauses_s = KafkaConfig(longest_pause_s=0.3).pauses_s()
    assert pauses_s == [0.05, 0.1, 0.2, 0.3]
    assert KafkaConfig(longest_pause_s=0.05).pauses_s() == [0.05]


def test_a_shipment_is_done_when_every_row_is() -> None:
    from concurrent.futures import Future

    future: Future[None] = Future()
    shipment = Shipment(next(Packer(ENCODER, SENSORS).parcels(window(10))), future)
    rows = shipment.rows_by_partition({b"S-0": 0, b"S-1": 0, b"S-2": 1, b"S-3": 1, b"S-4": 2}.__getitem__)
    assert rows == {0: [0, 1, 5, 6], 1: [2, 3, 7, 8], 2: [4, 9]}
    assert not shipment.acknowledge(rows[0])
    assert not shipment.acknowledge([2])
    assert shipment.rows_by_partition(lambda key: 7) == {7: [3, 4, 7, 8, 9]}
    assert shipment.acknowledge([3, 4, 7, 8, 9])
    assert future.done()


def test_closing_is_quick_whatever_the_state() -> None:
    import time

    began = time.monotonic()
    for address in (dead_address(), "192.0.2.1:9092"):  # TEST-NET-1 (RFC 5737): nobody answers, nobody refuses
        made = carrier(address, "topic", connect_timeout_s=60.0)
        made.carry(next(Packer(ENCODER, SENSORS).parcels(window(5))))
        made.close(5.0)
        made.close(5.0)
    assert time.monotonic() - began < 8.0


def test_the_bare_configuration_is_the_paper_s_topic_on_this_machine() -> None:
    bare = KafkaConfig()
    assert (bare.topic, bare.servers) == ("forge.sensors.raw", ("localhost:9092",))
    assert config("a:1, [::1]:2", "t").servers == ("a:1", "[::1]:2")
    assert Policy().when_full == "wait"


def test_every_await_has_a_deadline() -> None:
    """Each is inside `asyncio.timeout`, is given one, waits for a step that has one, or for something to do."""
    own = Path(opir_kafka.__file__).parent
    found = [
        f"{path.name}: {waited}"
        for path in sorted(own.glob("*.py"))
        for waited in awaits_without_a_deadline(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert not [each for each in found if each.split(": ", 1)[1] not in AWAITS_THAT_END_THEMSELVES]


AWAITS_THAT_END_THEMSELVES = {
    "self._one_connection()",  # steps with deadlines, and then the wait for a lane to fail
    "self._connect()",
    "self._partitioning(producer)",
    "asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)",  # lanes, each of whose sends has a deadline
    "lane.has_some.wait()",  # for something to send
    "asyncio.sleep(next(self._pauses_s))",
    "asyncio.gather(*tasks, return_exceptions=True)",  # cancelled tasks
    "goodbye(producer)",
    "asyncio.shield(asyncio.create_task(_let_go(producer), name=f'{OURS} goodbye'))",  # three steps with deadlines
    "_by(_GOODBYE_S, producer.stop())",
    "_by(_GOODBYE_S, producer.client.close())",
    "_raise_why(config, security)",
}


def awaits_without_a_deadline(node: ast.AST, is_timed: bool = False) -> Iterator[str]:
    if isinstance(node, ast.AsyncWith):
        is_timed = is_timed or any("asyncio.timeout" in ast.unparse(item) for item in node.items)
    if isinstance(node, ast.Await) and not is_timed and "timeout=" not in ast.unparse(node):
        yield ast.unparse(node.value)
    for child in ast.iter_child_nodes(node):
        yield from awaits_without_a_deadline(child, is_timed)


@contextmanager
def door(code: int, certificate: Path | None = None) -> Iterator[str]:
    """Be a broker that speaks as far as the login, and answers that with a code (0: welcome), the rest with 29.

    Sources: the protocol's own pages of ApiVersions (18), SaslHandshake (17), SaslAuthenticate (36) and Metadata (3).
    """
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    tls = None
    if certificate is not None:
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(certificate / "cert", certificate / "key", SECRET)

    def serve() -> None:
        while True:
            try:
                caller, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=talk, args=(caller, tls, code, port), daemon=True).start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"127.0.0.1:{port}"
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(5.0)


def talk(caller: socket.socket, tls: ssl.SSLContext | None, code: int, port: int) -> None:
    caller.settimeout(10.0)
    try:
        with caller if tls is None else tls.wrap_socket(caller, server_side=True) as spoken:
            while length := spoken.recv(4):
                request = spoken.recv(struct.unpack(">i", length)[0])
                api, version, number = struct.unpack(">hhi", request[:8])
                body = struct.pack(">i", number) + answer(api, version, code, port)
                spoken.sendall(struct.pack(">i", len(body)) + body)
    except OSError:
        return


def answer(api: int, version: int, code: int, port: int) -> bytes:
    if api == 18:
        known = ((0, 0, 7), (3, 0, 1), (17, 0, 1), (18, 0, 2), (22, 0, 0), (36, 0, 0))
        rows = b"".join(struct.pack(">hhh", *each) for each in known)
        return struct.pack(">hi", 0, len(known)) + rows + (b"" if version == 0 else bytes(4))
    if api == 17:
        return struct.pack(">hih", 0, 1, 5) + b"PLAIN"
    if api == 36:
        return struct.pack(">hhi", code if code == 58 else 0, -1, 0)
    if api == 3:
        host = b"localhost"
        one_broker = struct.pack(">iih", 1, 0, len(host)) + host + struct.pack(">ih", port, -1)
        return one_broker + struct.pack(">i", 0) + struct.pack(">i", 0)
    return struct.pack(">ihqh", 0, code, -1, 0)
