"""Faults of a soak test: of the broker, of the reader of a pipe, and of the disk; and what arrives
in spite of them.
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
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
import kafka_cluster
from kafka_broker import MockBroker

#: The mock broker keeps 5 MiB of each partition, which the consumer must have read by then: batches
#: are compressed, for two sensors see most of it, and a fault of 12 s at full speed fills their
#: partitions otherwise.
PARTITIONS = 12
#: Kafka's number of the API that takes messages, and codes it may answer with: the first park the
#: output.
PRODUCE = 0
CODES = (29, 6, 7, 19, 2)
#: Ids that are remembered, to notice what comes twice.
_REMEMBERED = 200_000

READER = """
import json, sys, time
lines = repeated = 0
recent, reported_s = {}, time.monotonic()
for line in open(sys.argv[1], "rb"):
    lines += 1
    name = json.loads(line)["detection_id"]
    repeated += name in recent
    recent[name] = None
    if len(recent) > 200_000:
        for old in list(recent)[:100_000]:
            del recent[old]
    if time.monotonic() - reported_s > 0.2:
        reported_s = time.monotonic()
        print(lines, repeated, flush=True)
print(lines, repeated, flush=True)
"""


class PipeReader:
    """A process that reads lines from a pipe; `lines` and `repeated` are its counts."""

    def __init__(self, path: Path) -> None:
        self.lines = 0
        self.repeated = 0
        command = [sys.executable, "-c", READER, str(path)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.thread = threading.Thread(target=self._follow, daemon=True)
        self.thread.start()

    def _follow(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines, self.repeated = map(int, line.split())

    def stop(self) -> None:
        """Let the process not run, as an operator or a debugger does."""
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        self._process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()


class TopicReader:
    """A thread that consumes a topic from its beginning; `messages` are counted once, `repeated`
    those that came again.

    `disordered` are messages that came for the first time after a later one of their sensor. A
    consumer that is too late for the broker's memory fails: `error` says so.
    """

    def __init__(self, address: str, topic: str) -> None:
        from confluent_kafka import OFFSET_BEGINNING, Consumer, TopicPartition

        self.messages = 0
        self.repeated = 0
        self.disordered = 0
        self.error: str | None = None
        settings = {
            "bootstrap.servers": address,
            "group.id": "soak",
            "enable.auto.commit": False,
            "auto.offset.reset": "error",
            "log_level": 0,
            "reconnect.backoff.max.ms": 500,
        }
        self._consumer = Consumer(settings)
        self._consumer.assign(
            [TopicPartition(topic, number, OFFSET_BEGINNING) for number in range(PARTITIONS)]
        )
        self._is_over = threading.Event()
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self) -> None:
        recent: dict[str, None] = {}
        latest: dict[str, str] = {}
        while not self._is_over.is_set():
            for message in self._consumer.consume(2000, 0.2):
                if message.error() is not None:
                    if "offset" in str(message.error()).lower():
                        self.error = str(message.error())
                    continue
                event = json.loads(message.value())
                name = event["detection_id"]
                sensor = event["sensor_id"]
                timestamp = event["timestamp"]
                if name in recent:
                    self.repeated += 1
                    continue
                self.messages += 1
                self.disordered += timestamp < latest.get(sensor, "")
                latest[sensor] = timestamp
                recent[name] = None
                if len(recent) > _REMEMBERED:
                    for old in list(recent)[: _REMEMBERED // 2]:
                        del recent[old]

    def close(self) -> None:
        self._is_over.set()
        self.thread.join(10.0)
        self._consumer.close()


#: How each kind of fault begins and ends, by its name.
FaultKinds = dict[str, tuple[Callable[[], Any], Callable[[], Any]]]
#: Returns those of a broker, which may draw.
BrokerFaults = Callable[[random.Random], FaultKinds]


class Faults:
    """Faults of random kind and duration, one at a time, each followed by a time without."""

    def __init__(
        self, seed: int, process: int, broker_faults: BrokerFaults, reader: PipeReader
    ) -> None:
        self._rng = random.Random(seed)
        self._process = process
        self._reader = reader
        self._kinds = {**broker_faults(self._rng), **self._own_kinds()}
        self.counts: dict[str, int] = dict.fromkeys(self._kinds, 0)
        self.now: str | None = None
        self._end: Callable[[], None] = lambda: None
        self._next_s = time.monotonic() + 20.0

    def _own_kinds(self) -> FaultKinds:
        return {
            "reader stopped (SIGSTOP)": (self._reader.stop, self._reader.go_on),
            "disk takes nothing (EFBIG)": (
                lambda: self._limit(4096),
                lambda: self._limit(resource.RLIM_INFINITY),
            ),
        }

    def _limit(self, size: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            resource.prlimit(self._process, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

    def step(self) -> None:
        """Begin or end a fault, if it is time."""
        if time.monotonic() < self._next_s:
            return
        if self.now is not None:
            self.end()
            self._next_s = time.monotonic() + self._rng.uniform(10.0, 25.0)
            return
        self.now = self._rng.choice(list(self.counts))
        begin, self._end = self._kinds[self.now]
        begin()
        self.counts[self.now] += 1
        self._next_s = time.monotonic() + self._rng.uniform(2.0, 12.0)

    def end(self) -> None:
        """End the present fault."""
        if self.now is not None:
            self._end()
            self.now = None


@contextmanager
def mock_kafka(_folder: Path, topic: str) -> Iterator[tuple[str, BrokerFaults]]:
    """Yield the address and the faults of librdkafka's mock broker, in a process of its own, with a
    topic.
    """
    broker = MockBroker()
    broker.tell("topic", topic, PARTITIONS)

    def faults(rng: random.Random) -> FaultKinds:
        return {
            "broker gone": (lambda: broker.tell("down"), broker.heal),
            "broker stopped (SIGSTOP)": (broker.freeze, broker.thaw),
            "broker slow": (lambda: broker.tell("slow", 2000), broker.heal),
            "broker refuses": (
                lambda: broker.tell("error", PRODUCE, *[rng.choice(CODES)] * 200),
                broker.heal,
            ),
        }

    with closing(broker):
        yield broker.address, faults


@contextmanager
def apache_kafka(folder: Path, topic: str) -> Iterator[tuple[str, BrokerFaults]]:
    """Yield the address and the faults of Apache Kafka, one node, with a topic."""
    with kafka_cluster.cluster(folder / "kafka") as cluster:
        cluster.topic(PARTITIONS, name=topic)
        (node,) = cluster.nodes
        kinds: FaultKinds = {
            "broker killed (SIGKILL)": (lambda: node.stop(signal.SIGKILL), node.start),
            "broker ended (SIGTERM)": (node.stop, node.start),
            "broker stopped (SIGSTOP)": (
                lambda: node.send(signal.SIGSTOP),
                lambda: node.send(signal.SIGCONT),
            ),
        }
        yield cluster.address, lambda _rng: kinds


def descriptors(process: int) -> int:
    return len(list(Path(f"/proc/{process}/fd").iterdir()))


def rss_mib(process: int) -> float:
    memory = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    return (
        next(int(line.split()[1]) for line in memory.splitlines() if line.startswith("VmRSS"))
        / 1024
    )


def file_mib(path: Path) -> float:
    """Return the size of a spool with its log, MiB."""
    files = [Path(f"{path}{end}") for end in ("", "-wal", "-shm")]
    return sum(file.stat().st_size for file in files if file.exists()) / 2**20
