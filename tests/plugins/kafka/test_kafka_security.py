"""Secrets, logins and certificates of the Kafka sink: what is refused, in which words, and what is
never repeated.
"""

import json
import logging
import socket
import ssl
import struct
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from aiokafka import errors
from attrs import fields_dict
from certificates import WHY_ABSENT, Authority
from command_line import main
from kafka_broker import carrier, kafka_sink
from opir_kafka.failures import FATAL_CODES, is_fatal, words
from repository import EXAMPLES
from spool_transports import ENCODER, SENSORS, window
from waiting import until

from opir_core.errors import SceneError, SinkError
from opir_core.output.spool.batches import EncodedBatcher
from opir_core.plugin import Host, SinkModel
from opir_core.reading import load_scene

KAFKA = Host.discover().component(SinkModel, "kafka")
SecurityConfig = fields_dict(KAFKA.config)["security"].type
SCENE = str(EXAMPLES / "first_light.yaml")
SECRET = "correct horse battery staple"
LOGIN = {
    "protocol": "SASL_PLAINTEXT",
    "mechanism": "PLAIN",
    "username": "opir",
    "password_variable": "OPIR_TEST_PASSWORD",
}


@pytest.fixture
def secret(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("OPIR_TEST_PASSWORD", SECRET)
    return SECRET


@pytest.mark.parametrize(
    "key", ["password_variable", "key_password_variable", "password", "sasl_password", "token"]
)
def test_a_secret_in_a_scene_is_refused_and_not_repeated(key: str, tmp_path: Path) -> None:
    block = f"{{protocol: SASL_SSL, username: me, {key}: hunter2}}"
    path = tmp_path / "scene.yaml"
    path.write_text(
        Path(SCENE).read_text().split("outputs:")[0]
        + f"outputs:\n  - kafka: {{security: {block}}}\n"
    )
    override = ["outputs=[{kafka: {}}]", f"outputs[0].kafka.security.{key}=hunter2"]
    for read in (lambda: load_scene(str(path)), lambda: load_scene(SCENE, overrides=override)):
        with pytest.raises(SceneError) as caught:
            read()
        assert "hunter2" not in str(caught.value)


def test_a_secret_that_is_not_in_the_environment_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for value in (None, ""):
        monkeypatch.delenv("OPIR_TEST_PASSWORD", raising=False)
        if value is not None:
            monkeypatch.setenv("OPIR_TEST_PASSWORD", value)
        with pytest.raises(
            SinkError, match=r"variable that security\.password_variable names is not set"
        ):
            KAFKA.build(KAFKA.config(security=SecurityConfig(**LOGIN)), None)


def test_a_secret_is_in_no_manifest_message_or_log(
    secret: str,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    caplog.set_level(logging.DEBUG)
    manifest = tmp_path / "manifest.json"
    with door(58) as address:
        setting = (
            f"outputs[0].kafka={{bootstrap_servers: '{address}', security: {json.dumps(LOGIN)}}}"
        )
        code = main(
            ["run", SCENE, "--sink", "kafka", "--set", setting, "--manifest", str(manifest)]
        )
    assert code == 5
    reported = capsys.readouterr()
    assert "OPIR_TEST_PASSWORD" in manifest.read_text()
    assert "aiokafka" in caplog.text
    for text in (manifest.read_text(), reported.out, reported.err, caplog.text):
        assert secret not in text


def test_a_refused_login_fails_at_once_and_says_what_to_see_to(secret: str) -> None:
    with door(58) as address:
        sink = kafka_sink(address, "topic", None, security=SecurityConfig(**LOGIN))
        sink.write(window(5))
        reported = sink.close()
    assert reported.dropped == 5
    assert (
        f"kafka: {address} answers SaslAuthenticationFailed (code 58); see security.username"
        in (reported.complaint or "")
    )


@pytest.mark.parametrize("code", sorted(FATAL_CODES))
def test_a_fatal_code_is_reported_with_its_number(code: int) -> None:
    error = errors.for_code(code)()
    assert is_fatal(error)
    assert f"code {code}" in words(error, "broker:9092")


@pytest.mark.parametrize(
    "error",
    [
        TimeoutError(),
        ConnectionResetError(),
        errors.KafkaConnectionError(),
        errors.KafkaError(),
        OSError(29, "x"),
    ],
)
def test_what_is_no_answer_of_the_broker_may_pass(error: Exception) -> None:
    assert not is_fatal(error)
    assert "broker:9092" in words(error, "broker:9092")


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a self-signed certificate for localhost and its key, with the password
    `SECRET`.
    """
    if WHY_ABSENT:
        pytest.skip(WHY_ABSENT)
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
    subprocess.run(
        [*command, "-passout", f"pass:{SECRET}"], cwd=folder, check=True, capture_output=True
    )
    return folder


def test_an_unknown_certificate_is_refused_at_once(certificate: Path) -> None:
    with door(0, certificate) as address:
        sink = kafka_sink(
            address.replace("127.0.0.1", "localhost"),
            "topic",
            None,
            security=SecurityConfig(protocol="SSL"),
        )
        sink.write(window(5))
        reported = sink.close()
    assert "no encrypted connection to localhost" in (reported.complaint or "")
    assert "see security.ca_file" in (reported.complaint or "")


def test_a_known_certificate_and_a_login_come_through(certificate: Path, secret: str) -> None:
    security = SecurityConfig(
        **{**LOGIN, "protocol": "SASL_SSL"},
        ca_file=str(certificate / "cert"),
        certificate_file=str(certificate / "cert"),
        key_file=str(certificate / "key"),
        key_password_variable="OPIR_TEST_PASSWORD",
    )
    with door(29, certificate) as address:
        transport = carrier(address.replace("127.0.0.1", "localhost"), "topic", security=security)
        future = transport.send(next(EncodedBatcher(ENCODER, SENSORS).batches(window(5))))
        with pytest.raises(SinkError, match="code 29"):
            future.result(10.0)
        transport.close(5.0)


@pytest.mark.parametrize("password", ["", "wrong"])
def test_a_key_that_cannot_be_read_is_reported(
    certificate: Path, monkeypatch: pytest.MonkeyPatch, password: str
) -> None:
    monkeypatch.setenv("OPIR_TEST_PASSWORD", password or "x")
    security = SecurityConfig(
        protocol="SSL",
        certificate_file=str(certificate / "cert"),
        key_file=str(certificate / "key"),
        key_password_variable="OPIR_TEST_PASSWORD" if password else None,
    )
    with pytest.raises(SinkError, match="the certificates of security cannot be used"):
        KAFKA.build(KAFKA.config(security=security), None)


def test_missing_certificates_are_reported() -> None:
    with pytest.raises(SinkError, match="no such file or directory"):
        KAFKA.build(
            KAFKA.config(security=SecurityConfig(protocol="SSL", ca_file="missing.pem")), None
        )


def test_a_missing_codec_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    from aiokafka import codec

    monkeypatch.setattr(codec, "has_zstd", lambda: False)
    with pytest.raises(SinkError, match="zstd is not installed"):
        KAFKA.build(KAFKA.config(compression="zstd"), None)


@pytest.mark.parametrize(
    ("name", "days", "reason"),
    [
        (
            "IP:127.0.0.2",
            2,
            "not valid for '127.0.0.1'; write a name of the certificate in bootstrap_servers",
        ),
        ("IP:127.0.0.1", -1, "certificate has expired; renew the broker's certificate"),
    ],
)
def test_what_is_wrong_with_a_certificate_is_in_the_message(
    authority: Authority, tmp_path: Path, name: str, days: int, reason: str
) -> None:
    for source, target in zip(
        authority.signed("broker", name, days=days), ("cert", "key"), strict=True
    ):
        (tmp_path / target).write_bytes(source.read_bytes())
    with door(0, tmp_path) as address:
        assert reason in refusal(
            address, SecurityConfig(protocol="SSL", ca_file=str(authority.certificate))
        )


@pytest.mark.parametrize(
    ("extensions", "lacking"),
    [
        pytest.param((), "CA cert does not include key usage extension", id="no key usage"),
        pytest.param(
            ("keyUsage=critical,keyCertSign", "basicConstraints=CA:TRUE"),
            "Basic Constraints of CA cert not marked critical",
            id="constraints not critical",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ("basicConstraints=critical,CA:FALSE",),
            "invalid CA certificate",
            id="no authority",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_command_in_the_message_mends_an_authority(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extensions: tuple[str, ...], lacking: str
) -> None:
    if WHY_ABSENT:
        pytest.skip(WHY_ABSENT)
    usual = ssl.create_default_context
    monkeypatch.setattr(
        ssl, "create_default_context", lambda **words: verifying_strictly(usual(**words))
    )
    authority = Authority(tmp_path, "own", extensions)
    for source, target in zip(
        authority.signed("broker", "DNS:localhost"), ("cert", "key"), strict=True
    ):
        (tmp_path / target).write_bytes(source.read_bytes())
    security = SecurityConfig(protocol="SSL", ca_file=str(authority.certificate))
    with door(29, tmp_path) as address:
        address = address.replace("127.0.0.1", "localhost")
        reported = refusal(address, security)
        assert lacking in reported
        files = {
            "CA.key": str(authority.key),
            "CA.pem": str(authority.certificate),
            "/CN=NAME": "/CN=own",
        }
        command = reported.partition("openssl ")[2].split(" (")[0].split()
        subprocess.run(
            ["openssl", *(files.get(word, word) for word in command)],
            check=True,
            capture_output=True,
        )
        assert "answers TopicAuthorizationFailed" in refusal(address, security)


def verifying_strictly(context: ssl.SSLContext) -> ssl.SSLContext:
    """Return a context that verifies as the default one of Python 3.13 and later does."""
    context.verify_flags |= ssl.VERIFY_X509_STRICT
    return context


def test_a_missing_client_certificate_is_in_the_message(
    certificate: Path,
) -> None:
    security = SecurityConfig(protocol="SSL", ca_file=str(certificate / "cert"))
    with door(0, certificate, is_mutual=True) as address:
        reported = refusal(address.replace("127.0.0.1", "localhost"), security)
    assert "refuses the client's certificate, or that there is none" in reported
    assert "see security.certificate_file and security.key_file" in reported


def refusal(address: str, security: Any) -> str:
    """Return the complaint of a sink whose events do not arrive."""
    sink = kafka_sink(address, "topic", None, security=security)
    sink.write(window(5))
    until(lambda: sink.attempts > 0)
    return sink.close().complaint or ""


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    if WHY_ABSENT:
        pytest.skip(WHY_ABSENT)
    return Authority(tmp_path_factory.mktemp("authority"), "ours")


@contextmanager
def door(code: int, certificate: Path | None = None, *, is_mutual: bool = False) -> Iterator[str]:
    """Be a broker that speaks as far as the login, and answers that with a code (0: welcome), the
    rest with 29.

    Sources: the protocol's own pages of ApiVersions (18), SaslHandshake (17), SaslAuthenticate (36)
    and Metadata (3).
    """
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    tls = None
    if certificate is not None:
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(certificate / "cert", certificate / "key", SECRET)
        tls.verify_mode = ssl.CERT_REQUIRED if is_mutual else ssl.CERT_NONE

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
        versions = ((0, 0, 7), (3, 0, 1), (17, 0, 1), (18, 0, 2), (22, 0, 0), (36, 0, 0))
        rows = b"".join(struct.pack(">hhh", *version_range) for version_range in versions)
        return struct.pack(">hi", 0, len(versions)) + rows + (b"" if version == 0 else bytes(4))
    if api == 17:
        return struct.pack(">hih", 0, 1, 5) + b"PLAIN"
    if api == 36:
        return struct.pack(">hhi", code if code == 58 else 0, -1, 0)
    if api == 3:
        host = b"localhost"
        one_broker = struct.pack(">iih", 1, 0, len(host)) + host + struct.pack(">ih", port, -1)
        return one_broker + struct.pack(">i", 0) + struct.pack(">i", 0)
    return struct.pack(">ihqh", 0, code, -1, 0)
