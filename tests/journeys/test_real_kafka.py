"""The Kafka sink before Apache Kafka itself: restarts, leaders, replicas, logins, permissions,
topics, sizes, quotas.

Each test ends with the examination of the fault campaign: an independent consumer (librdkafka)
finds all events, each sensor's in order by their first arrival, what is there twice unchanged.
"""

import json
import signal
import threading
import time
from collections import defaultdict
from contextlib import suppress

import confluent_kafka
import kafka_cluster
import pytest
from attrs import evolve
from confluent_kafka.admin import (
    AclBinding,
    AclBindingFilter,
    AclOperation,
    AclPermissionType,
    ResourcePatternType,
    ResourceType,
    ScramCredentialInfo,
    ScramMechanism,
    UserScramCredentialDeletion,
    UserScramCredentialUpsertion,
)
from kafka_broker import brief, closed, examine, kafka_sink, messages
from opir_kafka.settings import SecurityConfig
from spool_transports import fill
from waiting import until

from opir_core.interfaces.outputs import Delivery
from opir_core.output.spool.policy import Policy

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

PASSWORD = "not-a-real-one"
SCRAM = "listener.name.sasl_plaintext.scram-sha-512.sasl.jaas.config"
ONE_NODE = {
    "listeners": ("SASL_PLAINTEXT",),
    "settings": {
        "sasl.enabled.mechanisms": "SCRAM-SHA-512",
        SCRAM: "org.apache.kafka.common.security.scram.ScramLoginModule required;",
        "authorizer.class.name": "org.apache.kafka.metadata.authorizer.StandardAuthorizer",
        "super.users": "User:ANONYMOUS",
    },
}
PATIENT = Policy(wait_s=60.0, stall_s=90.0)


@pytest.fixture(scope="module")
def single_node(tmp_path_factory):
    """Return a broker with a listener that asks for a login and checks permissions."""
    if kafka_cluster.why_absent():
        pytest.skip(kafka_cluster.why_absent())
    with kafka_cluster.cluster(tmp_path_factory.mktemp("one"), **ONE_NODE) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """Return three brokers; a topic with three replicas takes messages while two of them are in
    sync.
    """
    if kafka_cluster.why_absent():
        pytest.skip(kafka_cluster.why_absent())
    with kafka_cluster.cluster(tmp_path_factory.mktemp("three"), 3) as cluster:
        yield cluster


@pytest.fixture
def spool(tmp_path):
    return tmp_path / "spool"


@pytest.fixture
def login(monkeypatch):
    monkeypatch.setenv("OPIR_TEST_PASSWORD", PASSWORD)
    return SecurityConfig(
        protocol="SASL_PLAINTEXT", username="opir", password_variable="OPIR_TEST_PASSWORD"
    )


def let_in(admin):
    """Make the user opir."""
    credential = ScramCredentialInfo(ScramMechanism.SCRAM_SHA_512, 4096)
    change = UserScramCredentialUpsertion("opir", credential, PASSWORD.encode())
    for done in admin.alter_user_scram_credentials([change]).values():
        done.result(30.0)


def shut_out(admin):
    """Take the user opir away, which another test may have made."""
    for done in admin.alter_user_scram_credentials(
        [UserScramCredentialDeletion("opir", ScramMechanism.SCRAM_SHA_512)]
    ).values():
        with suppress(confluent_kafka.KafkaException):  # there is none
            done.result(30.0)


def permission(topic):
    resource = ResourceType.TOPIC, topic, ResourcePatternType.LITERAL, "User:opir", "*"
    return AclBinding(*resource, AclOperation.WRITE, AclPermissionType.ALLOW)


def permit(admin, topic):
    for done in admin.create_acls([permission(topic)]).values():
        done.result(30.0)


def forbid(admin, topic):
    """Take the login's permission to write to a topic, or to any."""
    resource = ResourceType.TOPIC, topic, ResourcePatternType.LITERAL, "User:opir", "*"
    acl_filter = AclBindingFilter(*resource, AclOperation.ANY, AclPermissionType.ANY)
    for done in admin.delete_acls([acl_filter]).values():
        done.result(30.0)


@pytest.mark.parametrize("compression", ["none", "gzip", "lz4", "zstd", "snappy"])
def test_each_compression_is_read_by_others(single_node, spool, compression):
    topic = single_node.topic()
    sink = kafka_sink(single_node.address, topic, spool, compression=compression)
    fill(sink, 3, 700, 0, 0.0)
    assert closed(sink) == Delivery(delivered=2100)
    examine(single_node, topic, 2100)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_the_broker_restarts_under_a_run(single_node, spool, how):
    topic = single_node.topic()
    sink = kafka_sink(single_node.address, topic, spool, PATIENT)
    fill(sink, 10, 30, 0, 0.01)
    single_node.nodes[0].stop(how)
    fill(sink, 10, 30, 300, 0.05)
    single_node.nodes[0].start()
    fill(sink, 10, 30, 600, 0.05)
    until(lambda: sink.delivery_so_far().delivered == 900, within_s=120.0)
    assert sink.close() == Delivery(delivered=900)
    single_node.wait_for_brokers(1)
    examine(single_node, topic, 900)


def test_the_broker_is_stopped_for_a_while(single_node, spool):
    topic = single_node.topic()
    sink = kafka_sink(single_node.address, topic, spool, PATIENT)
    fill(sink, 5, 30, 0, 0.01)
    single_node.nodes[0].send(signal.SIGSTOP)
    fill(sink, 10, 30, 150, 0.3)
    single_node.nodes[0].send(signal.SIGCONT)
    fill(sink, 5, 30, 450, 0.01)
    until(lambda: sink.delivery_so_far().delivered == 600, within_s=120.0)
    assert sink.close() == Delivery(delivered=600)
    examine(single_node, topic, 600)


def lacks_a_login(admin, topic):
    shut_out(admin)
    permit(admin, topic)


def lacks_every_permission(admin, _topic):
    let_in(admin)
    forbid(admin, None)


@pytest.mark.parametrize(
    ("lacks", "reason", "mend"),
    [
        (lacks_a_login, "(code 58); see security.username", lambda admin, _topic: let_in(admin)),
        (lacks_every_permission, "(code 31); let this login write to the topic", permit),
    ],
    ids=["no login", "no permission at all"],
)
def test_a_login_is_refused_until_what_it_lacks_is_given(
    single_node, spool, login, lacks, reason, mend
):
    topic = single_node.topic()
    admin = single_node.admin()
    lacks(admin, topic)
    policy = evolve(brief(stall_s=30.0), retry_s=0.5)
    sink = kafka_sink(single_node.addresses("SASL_PLAINTEXT"), topic, spool, policy, security=login)
    fill(sink, 5, 20, 0, 0.0)
    until(lambda: sink.parked is not None)
    assert reason in (sink.parked or "")
    mend(admin, topic)
    until(lambda: sink.delivery_so_far().delivered == 100)
    assert closed(sink) == Delivery(delivered=100)
    examine(single_node, topic, 100)


def test_a_permission_is_missing_given_taken_and_given_back(single_node, spool, login):
    topic = single_node.topic()
    second_topic = single_node.topic()
    admin = single_node.admin()
    let_in(admin)
    permit(admin, second_topic)  # who may write to no topic at all gets no producer's number
    policy = evolve(brief(stall_s=30.0), retry_s=0.5)
    sink = kafka_sink(single_node.addresses("SASL_PLAINTEXT"), topic, spool, policy, security=login)
    fill(sink, 5, 20, 0, 0.0)
    until(lambda: sink.parked is not None)
    assert "(code 29); let this login write to the topic" in (sink.parked or "")
    permit(admin, topic)
    until(lambda: sink.delivery_so_far().delivered == 100)
    forbid(admin, topic)
    fill(sink, 5, 20, 100, 0.1)
    until(lambda: sink.parked is not None)
    permit(admin, topic)
    fill(sink, 5, 20, 200, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 300)
    assert closed(sink) == Delivery(delivered=300)
    examine(single_node, topic, 300)


def test_a_login_refused_after_a_good_one_is_parked(single_node, spool, login):
    topic = single_node.topic()
    admin = single_node.admin()
    let_in(admin)
    permit(admin, topic)
    policy = evolve(brief(stall_s=30.0), retry_s=0.5)
    sink = kafka_sink(single_node.addresses("SASL_PLAINTEXT"), topic, spool, policy, security=login)
    fill(sink, 5, 20, 0, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 100)
    shut_out(admin)
    single_node.nodes[0].stop()  # a connection that is open stays so
    single_node.nodes[0].start()
    single_node.wait_for_brokers(1)
    fill(sink, 5, 20, 100, 0.0)
    until(lambda: sink.parked is not None)
    assert "(code 58); see security.username" in (sink.parked or "")
    assert sink.attempts > 0
    let_in(admin)
    until(lambda: sink.delivery_so_far().delivered == 200)
    assert (sink.attempts, sink.trouble) == (0, None)
    assert closed(sink) == Delivery(delivered=200)
    examine(single_node, topic, 200)


def test_the_topic_is_made_late(single_node, spool):
    name = f"late-{time.time_ns()}"
    sink = kafka_sink(single_node.address, name, spool, PATIENT)
    fill(sink, 5, 20, 0, 0.2)
    assert sink.delivery_so_far().delivered == 0
    until(lambda: f"there is no topic {name}; make it" in (sink.trouble or ""))
    single_node.topic(name=name)
    fill(sink, 5, 20, 100, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 200)
    assert closed(sink) == Delivery(delivered=200)
    examine(single_node, name, 200)


def test_a_compacted_topic_is_told_at_the_start(single_node, spool, caplog):
    topic = single_node.topic(cleanup_policy="compact")
    sink = kafka_sink(single_node.address, topic, spool)
    fill(sink, 2, 20, 0, 0.0)
    until(lambda: any(f"topic {topic} is compacted" in line for line in caplog.messages))
    assert closed(sink) == Delivery(delivered=40)


def test_a_topic_that_keeps_all_is_not_told(single_node, spool, caplog):
    topic = single_node.topic()
    sink = kafka_sink(single_node.address, topic, spool)
    fill(sink, 2, 20, 0, 0.3)
    assert closed(sink) == Delivery(delivered=40)
    assert not any("compacted" in line for line in caplog.messages)


def test_the_topic_is_made_anew_with_fewer_partitions(single_node, spool):
    name = single_node.topic(3)
    sink = kafka_sink(single_node.address, name, spool)
    fill(sink, 5, 20, 0, 0.0)
    assert closed(sink) == Delivery(delivered=100)
    single_node.admin().delete_topics([name])[name].result(60.0)
    until(lambda: name not in single_node.admin().list_topics(timeout=10.0).topics)
    single_node.topic(1, name=name)
    # The topic is empty again, and takes all events of a run from the start.
    second = kafka_sink(single_node.address, name, spool.with_name("other"))
    fill(second, 5, 20, 0, 0.0)
    assert closed(second) == Delivery(delivered=100)
    assert {message.partition() for message in messages(single_node.address, name)} == {0}
    examine(single_node, name, 100)


def test_partitions_are_added_under_a_run(single_node, spool):
    name = single_node.topic(1)
    sink = kafka_sink(single_node.address, name, spool, PATIENT)
    fill(sink, 5, 20, 0, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 100)
    more = confluent_kafka.admin.NewPartitions(name, 4)
    single_node.admin().create_partitions([more])[name].result(60.0)
    fill(sink, 5, 20, 100, 0.05)
    assert closed(sink) == Delivery(delivered=200)
    assert len(messages(single_node.address, name)) == 200


def test_batches_larger_than_the_topic_takes_arrive_in_parts(single_node, spool):
    topic = single_node.topic(1, max_message_bytes="4000")
    sink = kafka_sink(single_node.address, topic, spool, PATIENT, compression="none")
    fill(sink, 3, 500, 0, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 1500)
    assert closed(sink) == Delivery(delivered=1500)
    examine(single_node, topic, 1500)


def test_a_topic_too_narrow_for_one_event_keeps_all_until_it_is_wider(single_node, spool):
    topic = single_node.topic(1, max_message_bytes="300")
    admin = single_node.admin()
    policy = evolve(brief(stall_s=30.0), retry_s=0.5)
    sink = kafka_sink(single_node.address, topic, spool, policy, compression="none")
    fill(sink, 2, 20, 0, 0.0)
    until(lambda: sink.parked is not None)
    assert "(code 10)" in (sink.parked or "")
    wider = confluent_kafka.admin.ConfigEntry(
        "max.message.bytes",
        "1000000",
        incremental_operation=confluent_kafka.admin.AlterConfigOpType.SET,
    )
    resource = confluent_kafka.admin.ConfigResource("topic", topic, incremental_configs=[wider])
    for done in admin.incremental_alter_configs([resource]).values():
        done.result(30.0)
    until(lambda: sink.delivery_so_far().delivered == 40)
    assert closed(sink) == Delivery(delivered=40)
    examine(single_node, topic, 40)


def test_a_quota_slows_and_loses_nothing(single_node, spool):
    topic = single_node.topic()
    client = ("--entity-type", "clients", "--entity-name", "slow")
    words = ("--bootstrap-server", single_node.address, "--alter", *client)
    kafka_cluster.java(
        "kafka.admin.ConfigCommand", *words, "--add-config", "producer_byte_rate=60000"
    )
    # In batches of 10 kB: the quota is an average, and a broker slows only what follows.
    sink = kafka_sink(
        single_node.address,
        topic,
        spool,
        PATIENT,
        client_id="slow",
        compression="none",
        batch_bytes=10_000,
    )
    began = time.monotonic()
    fill(sink, 4, 500, 0, 0.0)
    until(lambda: sink.delivery_so_far().delivered == 2000, within_s=200.0)
    assert time.monotonic() - began > 3.0  # without the quota 0.3 s
    assert closed(sink) == Delivery(delivered=2000)
    examine(single_node, topic, 2000)


def test_a_group_of_consumers_rebalances_under_a_run_and_misses_nothing(single_node, spool):
    topic = single_node.topic(4)
    result = defaultdict(list)
    stop = threading.Event()
    group = f"group-{time.time_ns()}"

    def consume(until_stopped):
        settings = {
            "group.id": group,
            "auto.offset.reset": "earliest",
            "enable.auto.commit": False,
            "log_level": 0,
        }
        consumer = confluent_kafka.Consumer({"bootstrap.servers": single_node.address, **settings})
        consumer.subscribe([topic])
        while not until_stopped.is_set():
            message = consumer.poll(0.2)
            if message is not None and message.error() is None:
                result[message.partition()].append((message.offset(), message.value()))
                consumer.commit(message, asynchronous=False)
        consumer.close()

    leaves = threading.Event()
    ends = [stop, stop, leaves]
    threads = [threading.Thread(target=consume, args=(end,)) for end in ends]
    threads[0].start()
    sink = kafka_sink(single_node.address, topic, spool, PATIENT)
    fill(sink, 10, 20, 0, 0.05)
    threads[1].start()
    threads[2].start()
    fill(sink, 20, 20, 200, 0.1)
    leaves.set()
    fill(sink, 10, 20, 600, 0.05)
    assert closed(sink) == Delivery(delivered=800)

    def ids():
        values = (value for rows in result.values() for _, value in rows)
        return {json.loads(value)["detection_id"] for value in values}

    try:
        until(lambda: len(ids()) == 800, within_s=120.0)
    finally:
        stop.set()
        leaves.set()
        for thread in threads:
            thread.join(30.0)
    examine(single_node, topic, 800)


def test_leaders_change_under_a_run(three, spool):
    topic = three.topic(3, 3, min_insync_replicas="2")
    sink = kafka_sink(three.address, topic, spool, PATIENT)
    fill(sink, 10, 30, 0, 0.01)
    gone = three.nodes[three.partitions(topic)[0].leader - 1]
    gone.stop(signal.SIGKILL)
    fill(sink, 20, 30, 300, 0.2)
    until(lambda: sink.delivery_so_far().delivered == 900, within_s=120.0)
    gone.start()
    three.wait_for_brokers(3)
    fill(sink, 5, 20, 900, 0.05)
    until(lambda: sink.delivery_so_far().delivered == 1000, within_s=120.0)
    assert sink.close() == Delivery(delivered=1000)
    examine(three, topic, 1000)


def test_a_rolling_restart_loses_nothing(three, spool):
    topic = three.topic(3, 3, min_insync_replicas="2")
    sink = kafka_sink(three.address, topic, spool, PATIENT)
    for number, node in enumerate(three.nodes):
        fill(sink, 10, 30, 600 * number, 0.01)
        node.stop()
        fill(sink, 10, 30, 600 * number + 300, 0.05)
        node.start()
        three.wait_for_brokers(3)
        until(
            lambda: all(len(partition.isrs) == 3 for partition in three.partitions(topic).values()),
            within_s=120.0,
        )
    until(lambda: sink.delivery_so_far().delivered == 1800, within_s=120.0)
    assert sink.close() == Delivery(delivered=1800)
    examine(three, topic, 1800)


def test_too_few_replicas_acknowledge_nothing_and_nothing_is_lost(three, spool):
    topic = three.topic(1, 3, min_insync_replicas="3")
    sink = kafka_sink(three.address, topic, spool, PATIENT)
    fill(sink, 5, 20, 0, 0.01)
    until(lambda: sink.delivery_so_far().delivered == 100)
    leader = three.partitions(topic)[0].leader
    gone = three.nodes[leader % 3]
    gone.stop(signal.SIGKILL)
    until(lambda: len(three.partitions(topic)[0].isrs) == 2, within_s=120.0)
    fill(sink, 10, 20, 100, 0.2)
    assert sink.delivery_so_far().delivered == 100
    reason = f"topic {topic}: partition 0 has 2 replicas in sync, where min.insync.replicas asks"
    until(lambda: reason in (sink.trouble or ""), within_s=60.0)
    assert f"brokers away or behind: {leader % 3 + 1}" in sink.trouble
    gone.start()
    until(lambda: sink.delivery_so_far().delivered == 300, within_s=200.0)
    assert sink.close() == Delivery(delivered=300)
    three.wait_for_brokers(3)
    examine(three, topic, 300)
