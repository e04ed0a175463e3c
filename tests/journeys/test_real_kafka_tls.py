"""The Kafka sink and TLS before Apache Kafka itself: what comes through, and what is said of what
does not.
"""

from pathlib import Path
from typing import NamedTuple

import kafka_cluster
import pytest
from certificates import WHY_ABSENT, Authority
from kafka_broker import brief, closed, examine, kafka_sink
from kafka_cluster import Cluster
from opir_kafka.settings import SecurityConfig
from spool_transports import fill
from waiting import until

from opir_core.interfaces.outputs import Delivery

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

#: A listener with TLS, one that asks for the client's certificate, and one that asks for a login.
LISTENERS = ("SSL", "MUTUAL", "SASL_PLAINTEXT")
#: What the broker's certificate is made out to: `localhost` is another name.
ADDRESS = "127.0.0.1"


class BrokerWithTls(NamedTuple):
    """A broker, and the files that clients may have: PEM."""

    cluster: Cluster
    ca: str
    other_ca: str
    client: dict[str, str]
    other_client: dict[str, str]


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    if why := kafka_cluster.why_absent() or WHY_ABSENT:
        pytest.skip(why)
    folder = tmp_path_factory.mktemp("tls")
    trusted = Authority(folder, "trusted")
    untrusted = Authority(folder, "untrusted")
    certificate, key = trusted.signed("broker", f"IP:{ADDRESS}")
    store = folder / "store.pem"
    store.write_text(key.read_text() + certificate.read_text())
    settings = _settings(store, trusted.certificate)
    with kafka_cluster.cluster(folder / "nodes", listeners=LISTENERS, settings=settings) as cluster:
        files = [
            dict(
                zip(("certificate_file", "key_file"), map(str, authority.signed("me")), strict=True)
            )
            for authority in (trusted, untrusted)
        ]
        yield BrokerWithTls(cluster, str(trusted.certificate), str(untrusted.certificate), *files)


def _settings(store, trusted):
    """Return the settings of the listeners; Kafka reads PEM files itself."""
    pem = {
        "keystore.type": "PEM",
        "keystore.location": store,
        "truststore.type": "PEM",
        "truststore.location": trusted,
    }
    scram = "org.apache.kafka.common.security.scram.ScramLoginModule required;"
    return {
        "listener.security.protocol.map": "PLAINTEXT:PLAINTEXT,CONTROLLER:PLAINTEXT,SSL:SSL,MUTUAL:SSL,"
        "SASL_PLAINTEXT:SASL_PLAINTEXT",
        **{
            f"listener.name.{name}.ssl.{key}": str(file)
            for name in ("ssl", "mutual")
            for key, file in pem.items()
        },
        "listener.name.mutual.ssl.client.auth": "required",
        "sasl.enabled.mechanisms": "SCRAM-SHA-512",
        "listener.name.sasl_plaintext.scram-sha-512.sasl.jaas.config": scram,
    }


@pytest.mark.parametrize("listener", ["SSL", "MUTUAL"])
def test_events_arrive_through_tls(stand, tmp_path, listener):
    topic = stand.cluster.topic()
    files = stand.client if listener == "MUTUAL" else {}
    security = SecurityConfig(protocol="SSL", ca_file=stand.ca, **files)
    sink = kafka_sink(
        stand.cluster.addresses(listener), topic, tmp_path / "spool", security=security
    )
    fill(sink, 3, 700, 0, 0.0)
    assert closed(sink) == Delivery(delivered=2100)
    examine(stand.cluster, topic, 2100)


@pytest.mark.parametrize(
    ("listener", "host", "security", "reason"),
    [
        ("SSL", ADDRESS, lambda stand: {"ca_file": stand.other_ca}, "see security.ca_file"),
        ("SSL", ADDRESS, lambda _: {}, "see security.ca_file"),
        (
            "SSL",
            "localhost",
            lambda stand: {"ca_file": stand.ca},
            "not valid for 'localhost'; write a name of the certificate in bootstrap_servers",
        ),
        (
            "MUTUAL",
            ADDRESS,
            lambda stand: {"ca_file": stand.ca},
            "see security.certificate_file and security.key_file",
        ),
        (
            "MUTUAL",
            ADDRESS,
            lambda stand: {"ca_file": stand.ca, **stand.other_client},
            "refuses the client's certificate, or that there is none",
        ),
        (
            "PLAINTEXT",
            ADDRESS,
            lambda stand: {"ca_file": stand.ca},
            "closes encrypted connections at their start",
        ),
        ("SSL", ADDRESS, lambda _: {"protocol": "PLAINTEXT"}, "speaks TLS; see security.protocol"),
        (
            "SASL_PLAINTEXT",
            ADDRESS,
            lambda _: {"protocol": "PLAINTEXT"},
            "for want of a login; see security.protocol",
        ),
    ],
    ids=[
        "another authority",
        "the system's authorities",
        "another name",
        "no client certificate",
        "another authority's client",
        "TLS to plain text",
        "plain text to TLS",
        "no login",
    ],
)
def test_the_reason_and_the_remedy_are_in_the_message(stand, listener, host, security, reason):
    address = stand.cluster.addresses(listener).replace(ADDRESS, host)
    inputs = SecurityConfig(**{"protocol": "SSL", **security(stand)})
    sink = kafka_sink(address, "topic", None, brief(stall_s=1.0), security=inputs)
    fill(sink, 1, 5, 0, 0.0)
    until(lambda: reason in (sink.trouble or ""))
    delivery = closed(sink)
    assert delivery.dropped == 5
    assert reason in (delivery.complaint or "")
    assert "no broker answers" not in (delivery.complaint or "")


def test_a_certificate_that_is_refused_is_mended_under_a_run(stand, tmp_path):
    topic = stand.cluster.topic()
    trusted = tmp_path / "ca.pem"
    trusted.write_text(Path(stand.other_ca).read_text())
    security = SecurityConfig(protocol="SSL", ca_file=str(trusted))
    policy = brief(stall_s=30.0)
    sink = kafka_sink(
        stand.cluster.addresses("SSL"), topic, tmp_path / "spool", policy, security=security
    )
    fill(sink, 5, 20, 0, 0.0)
    until(lambda: sink.parked is not None)
    assert "see security.ca_file" in (sink.parked or "")
    assert closed(sink).spooled == 100
    trusted.write_text(Path(stand.ca).read_text())
    second = kafka_sink(
        stand.cluster.addresses("SSL"), topic, tmp_path / "spool", security=security
    )
    until(lambda: second.delivery_so_far().recovered == 100)
    assert closed(second).recovered == 100
    examine(stand.cluster, topic, 100)
