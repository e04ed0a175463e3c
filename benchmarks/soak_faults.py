"""Faults of a soak test: of the broker, of the reader of a pipe, and of the disk; and the events
that arrive in spite of them.
"""

import contextlib
import json
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
import kafka_cluster
from kafka_broker import PRODUCE, MockBroker
from waiting import until

#: The mock broker keeps 5 MiB of each partition, which the consumer must have read by then: batches
#: are compressed, for two sensors see most of it, and a fault of 12 s at full speed fills their
#: partitions otherwise.
PARTITIONS = 12
#: Codes of Kafka that a broker may refuse messages with: the first park the output.
REFUSALS = (29, 6, 7, 19, 2)

READER = """
import json, sys, time
sys.path.insert(0, sys.argv[1])
from soak_faults import Recent
lines = 0
recent, reported_s = Recent(), time.monotonic()
for line in open(sys.argv[2], "rb"):
    lines += 1
    recent.add(json.loads(line)["detection_id"])
    if time.monotonic() - reported_s > 0.2:
        reported_s = time.monotonic()
        print(lines, recent.repeated, flush=True)
print(lines, recent.repeated, flush=True)
"""


class Recent:
    """Ids seen lately, at most `size`; `repeated` counts those that came twice."""

    def __init__(self, size=200_000):
        self.repeated = 0
        self.ids = {}
        self._size = size

    def add(self, name):
        """Add an id; return whether it is new."""
        is_new = name not in self.ids
        self.repeated += not is_new
        self.ids[name] = None
        if len(self.ids) > self._size:
            for old in list(self.ids)[: self._size // 2]:
                del self.ids[old]
        return is_new


class PipeReader:
    """A process that reads lines from a pipe; `lines` and `repeated` are its counts."""

    def __init__(self, path):
        self.lines = 0
        self.repeated = 0
        command = [sys.executable, "-c", READER, str(Path(__file__).parent), str(path)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.thread = threading.Thread(target=self._follow, daemon=True)
        self.thread.start()

    def _follow(self):
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines, self.repeated = map(int, line.split())

    def close(self):
        """End the process."""
        self.process.kill()
        self.process.wait()


class TopicReader:
    """A thread that consumes a topic from its beginning; `messages` are counted once.

    `disordered` are messages that came for the first time after a later one of their sensor. A
    consumer that is too late for the broker's memory fails: `error` says so.
    """

    def __init__(self, address, topic, size=200_000):
        from confluent_kafka import OFFSET_BEGINNING, Consumer, TopicPartition

        self.messages = 0
        self.disordered = 0
        self.recent = Recent(size)
        self.error = None
        settings = {
            "bootstrap.servers": address,
            "group.id": "soak",
            "enable.auto.commit": False,
            "auto.offset.reset": "error",
            "log_level": 0,
            "reconnect.backoff.max.ms": 500,
        }
        self._consumer = Consumer(settings)
        self._parts = [
            TopicPartition(topic, number, OFFSET_BEGINNING) for number in range(PARTITIONS)
        ]
        self._consumer.assign(self._parts)
        self._is_over = threading.Event()
        self._newest = {}
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        while not self._is_over.is_set():
            for message in self._consumer.consume(2000, 0.2):
                if message.error() is None:
                    self._count(json.loads(message.value()))
                elif "offset" in str(message.error()).lower():
                    self.error = str(message.error())

    def _count(self, event):
        if self.recent.add(event["detection_id"]):
            sensor = event["sensor_id"]
            self.messages += 1
            self.disordered += event["timestamp"] < self._newest.get(sensor, "")
            self._newest[sensor] = event["timestamp"]

    def wait_for_end(self):
        """Wait until all messages that are in the topic are read."""
        ends = [self._consumer.get_watermark_offsets(part, 60.0)[1] for part in self._parts]
        until(lambda: self.messages + self.recent.repeated >= sum(ends), within_s=300.0)

    def close(self):
        """Stop reading."""
        self._is_over.set()
        self._thread.join(10.0)
        self._consumer.close()


class Faults:
    """Faults of random kind and duration, one at a time, each followed by a time without.

    `broker_faults` takes the source of random numbers and returns how each kind of fault of the
    broker begins and ends, by its name.
    """

    def __init__(self, seed, process, broker_faults, reader):
        def limit(size):
            with contextlib.suppress(ProcessLookupError):
                limits = (size, resource.RLIM_INFINITY)
                resource.prlimit(process, resource.RLIMIT_FSIZE, limits)

        def send(number):
            return lambda: reader.send_signal(number)

        self._rng = random.Random(seed)
        self._kinds = broker_faults(self._rng) | {
            "reader stopped (SIGSTOP)": (send(signal.SIGSTOP), send(signal.SIGCONT)),
            "disk takes nothing (EFBIG)": (
                lambda: limit(4096),
                lambda: limit(resource.RLIM_INFINITY),
            ),
        }
        self.counts = dict.fromkeys(self._kinds, 0)
        self.kind = None
        self._next_s = time.monotonic() + 20.0

    def step(self):
        """Begin or end a fault, if it is time."""
        if time.monotonic() < self._next_s:
            return
        if self.kind is not None:
            self.end()
            self._next_s = time.monotonic() + self._rng.uniform(10.0, 25.0)
            return
        self.kind = self._rng.choice(list(self.counts))
        self._kinds[self.kind][0]()
        self.counts[self.kind] += 1
        self._next_s = time.monotonic() + self._rng.uniform(2.0, 12.0)

    def end(self):
        """End the present fault."""
        if self.kind is not None:
            self._kinds[self.kind][1]()
            self.kind = None


@contextmanager
def mock_kafka(topic):
    """Yield the address and the faults of librdkafka's mock broker, in a process of its own, with a
    topic.
    """
    broker = MockBroker()
    broker.tell("topic", topic, PARTITIONS)

    def faults(rng):
        return {
            "broker gone": (lambda: broker.tell("down"), broker.heal),
            "broker stopped (SIGSTOP)": (broker.freeze, broker.thaw),
            "broker slow": (lambda: broker.tell("slow", 2000), broker.heal),
            "broker refuses": (
                lambda: broker.tell("error", PRODUCE, *[rng.choice(REFUSALS)] * 200),
                broker.heal,
            ),
        }

    with closing(broker):
        yield broker.address, faults


@contextmanager
def apache_kafka(folder, topic):
    """Yield three nodes of Apache Kafka with a topic that takes messages while two replicas are in
    sync.
    """
    with kafka_cluster.cluster(folder / "kafka", 3) as cluster:
        cluster.topic(PARTITIONS, 3, topic, min_insync_replicas="2")
        yield cluster
