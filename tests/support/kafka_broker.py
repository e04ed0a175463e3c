"""A stand for the Kafka sink: a broker to spoil, a topic of one's own, and a consumer that says
what is in it.
"""

import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path

import confluent_kafka
from opir_kafka.connection import connector
from opir_kafka.settings import KafkaConfig
from opir_kafka.transport import KafkaTransport
from spool_transports import ENCODER, SENSORS, take_for_ever, window
from waiting import within

from opir_core.output.spool.batches import EncodedBatcher, MemoryBacklog
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.transport_sink import Policy, TransportSink

#: A broker to test against instead of the mock one; what has to spoil the broker is then left out.
BOOTSTRAP = os.environ.get("KAFKA_BOOTSTRAP")
PARTITIONS = 3
#: Kafka's number of the API that takes messages.
PRODUCE = 0
METADATA = 3
INIT_PRODUCER_ID = 22
#: What closing may take: the policy's stall, the goodbyes of a connection, and a slow machine.
CLOSE_S = 8.0 + 6.0
#: Errors that the protocol's table (https://kafka.apache.org/protocol#protocol_error_codes) calls
#: not retriable, caused by the message, the request or the permission alone. 58, a refused login,
#: occurs only in connecting.
PERMANENT_CODES = {
    10: "MESSAGE_TOO_LARGE",
    17: "INVALID_TOPIC_EXCEPTION",
    18: "RECORD_LIST_TOO_LARGE",
    21: "INVALID_REQUIRED_ACKS",
    29: "TOPIC_AUTHORIZATION_FAILED",
    31: "CLUSTER_AUTHORIZATION_FAILED",
    32: "INVALID_TIMESTAMP",
    33: "UNSUPPORTED_SASL_MECHANISM",
    34: "ILLEGAL_SASL_STATE",
    35: "UNSUPPORTED_VERSION",
    42: "INVALID_REQUEST",
    43: "UNSUPPORTED_FOR_MESSAGE_FORMAT",
    44: "POLICY_VIOLATION",
    53: "TRANSACTIONAL_ID_AUTHORIZATION_FAILED",
    54: "SECURITY_DISABLED",
    76: "UNSUPPORTED_COMPRESSION_TYPE",
    87: "INVALID_RECORD",
}
_names = (f"opir-test-{os.getpid()}-{time.time_ns()}-{number}" for number in itertools.count())

#: Times short enough for tests; the sink's rules are those of its defaults.
BRISK = {
    "connect_timeout_s": 2.0,
    "request_timeout_s": 1.0,
    "acknowledgement_timeout_s": 1.5,
    "longest_pause_s": 0.2,
}


class MockBroker:
    """The process of a mock broker, or of several."""

    can_be_spoilt = True

    def __init__(self, brokers=1):
        program = str(Path(__file__).with_name("mock_broker.py"))
        self._process = subprocess.Popen(
            [sys.executable, program, str(brokers)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        assert self._process.stdout is not None
        self.address = within(30.0, self._process.stdout.readline).strip()

    def tell(self, *words):
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(" ".join(map(str, words)) + "\n")
        assert within(30.0, self._process.stdout.readline) == "done\n"

    def topic(self, partitions=PARTITIONS):
        name = next(_names)
        self.tell("topic", name, partitions)
        return name

    def heal(self):
        self.tell("up")
        self.tell("slow", 0)
        for api in (PRODUCE, METADATA, INIT_PRODUCER_ID):
            self.tell("clear", api)

    def freeze(self):
        """Stop answering, with every connection left open."""
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self):
        self._process.send_signal(signal.SIGCONT)

    def close(self):
        self._process.kill()
        self._process.communicate()


class NamedBroker:
    """The broker that KAFKA_BOOTSTRAP names."""

    can_be_spoilt = False

    def __init__(self, address):
        self.address = address

    def topic(self, partitions=PARTITIONS):
        """Return a topic that the broker makes because it is asked for, or else because it is
        instructed to.
        """
        from confluent_kafka.admin import AdminClient, NewTopic

        name = next(_names)
        client = confluent_kafka.Producer(
            {"bootstrap.servers": self.address, "allow.auto.create.topics": True}
        )
        give_up_at = time.monotonic() + 3.0
        while time.monotonic() < give_up_at:
            if client.list_topics(name, timeout=10.0).topics[name].partitions:
                return name
            time.sleep(0.05)
        admin = AdminClient({"bootstrap.servers": self.address})
        admin.create_topics([NewTopic(name, partitions, 1)])[name].result(30.0)
        return name

    def heal(self):
        """Do nothing: nothing was spoilt."""

    def close(self):
        """Leave it as it is."""


@contextmanager
def broker():
    named = NamedBroker(BOOTSTRAP) if BOOTSTRAP else MockBroker()
    try:
        yield named
    finally:
        named.close()


def dead_address():
    """Return a port of this machine on which nobody listens."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{bound.getsockname()[1]}"


def config(address, topic, **settings):
    return KafkaConfig(**{"bootstrap_servers": address, "topic": topic, **BRISK, **settings})


def carrier(address, topic, **settings):
    settings_record = config(address, topic, **settings)
    return KafkaTransport(settings_record, connector(settings_record))


def kafka_sink(address, topic, spool, policy=None, **settings):
    backlog = MemoryBacklog(64 << 20) if spool is None else Journal(str(spool), 64 << 20)
    transport = carrier(address, topic, **settings)
    return TransportSink(
        "kafka",
        transport,
        backlog,
        EncodedBatcher(ENCODER, SENSORS),
        policy or Policy(wait_s=1.0, stall_s=8.0),
    )


def messages(address, topic):
    """Return all messages of a topic, each partition's in order."""
    consumer = confluent_kafka.Consumer(
        {
            "bootstrap.servers": address,
            "group.id": next(_names),
            "enable.partition.eof": True,
            "enable.auto.commit": False,
            "fetch.wait.max.ms": 10,
            "log_level": 0,
        }
    )
    try:
        partitions = consumer.list_topics(topic, timeout=10.0).topics[topic].partitions
        consumer.assign(
            [confluent_kafka.TopicPartition(topic, partition, 0) for partition in partitions]
        )
        return list(_to_the_end(consumer, set(partitions)))
    finally:
        consumer.close()


def _to_the_end(consumer, partitions):
    give_up_at = time.monotonic() + 20.0
    while partitions:
        assert time.monotonic() < give_up_at, f"the end of partitions {partitions} was not reached"
        message = consumer.poll(0.1)
        if message is not None and message.error() is None:
            yield message
        elif (
            message is not None
            and message.error().code() == confluent_kafka.KafkaError._PARTITION_EOF
        ):
            partitions.discard(message.partition())


def kafka_for_ever(folder, first, address, topic):
    """Be a process that sends events through a spool for ever, to be killed."""
    take_for_ever(kafka_sink(address, topic, Path(folder) / "spool"), folder, first)


def examine(broker, topic, events):
    """Hold what is in a topic against the events 0 to `events` of `window`."""
    expected = defaultdict(list)
    for line in ENCODER.encode(window(events)).splitlines():
        expected[json.loads(line)["sensor_id"]].append(line)
    arrived = defaultdict(dict)
    for message in messages(broker.address, topic):
        value = message.value()
        event = json.loads(value)
        assert message.key() == event["sensor_id"].encode()
        assert arrived[event["sensor_id"]].setdefault(event["detection_id"], value) == value
    assert {sensor: list(result.values()) for sensor, result in arrived.items()} == expected


def closed(sink):
    began = time.monotonic()
    delivery = sink.close()
    assert time.monotonic() - began < CLOSE_S
    return delivery


def brief(stall_s=0.2):
    return Policy(when_full="refuse", stall_s=stall_s)
