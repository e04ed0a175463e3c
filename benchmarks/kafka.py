"""Throughput of the Kafka sink: events per second, beside Kafka's Java producer, confluent-kafka
and bare aiokafka.

    python benchmarks/kafka.py [--events 200000] [--partitions 6] [--repeats 5] [--write
    docs/benchmarks]

The broker is Apache Kafka, one node, where Java and Maven are; else librdkafka's mock cluster,
without the Java producer; or the one that KAFKA_BOOTSTRAP names. Each way sends the same events
into a topic of its own, with the same acks, idempotence, compression and size of batches, and is
timed until the last is acknowledged:

- `Java producer`: Kafka's `ProducerPerformance`. It takes lines of a file at random, without keys
  and headers, and sends five times as many as the others; its first report, of 5 s in which the JVM
  compiles, is left out (`warm`) or not;
- `confluent-kafka`: the messages are ready; `produce()` each, then `flush()`;
- `aiokafka, batches`: the messages are ready; `create_batch()` and `send_batch()`, a task for each
  partition;
- `kafka`: the sink, from columns: encoding, queue and acknowledgement included;
- `kafka, spooled`: the same with a spool on disk, written before sending and cleared after
  acknowledgement.

The methods alternate; figures are medians, ratios medians of the ratios within each repetition.
"""

import argparse
import asyncio
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import confluent_kafka
from aiokafka import AIOKafkaProducer
from aiokafka.partitioner import DefaultPartitioner
from opir_kafka.connection import connector
from opir_kafka.settings import KafkaConfig
from opir_kafka.transport import KafkaTransport

from opir_core import Host
from opir_core.output import ForgeEncoder
from opir_core.output.events.rendering import chosen_renderer
from opir_core.output.spool.batches import EncodedBatcher, MemoryBacklog
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.transport_sink import Policy, TransportSink
from opir_core.plugin import EncoderContext

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
import kafka_broker
import kafka_cluster
from spool_transports import SENSORS, window

WINDOW_EVENTS = 2000
HEADERS = [("content-type", b"application/json"), ("schema-version", b"1.0")]
#: Sensors enough that no partition is left out, whatever their hashes.
KEYS = [sensor.id.encode() for sensor in SENSORS]
RENDERER, RENDER = chosen_renderer(Host.discover())
#: The encoder as a run has it.
ENCODER = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=0, render=RENDER))
#: How many times the events the Java producer sends, and how many of them its file has at most.
JAVA_TIMES = 5
JAVA_LINES = 50_000
REPORT = re.compile(r"(\d+) records sent, ([\d.]+) records/sec")
JAVA = "Java producer, warm"
COLD = "Java producer, with its first 5 s"

PAGE = """# Throughput of the Kafka sink

How many events per second does the Kafka sink deliver, and how many Kafka's own producer? {plain} uncompressed, {zstd}
with zstd; with a spool on disk {spooled} and {spooled_zstd}.

| compression | method | events/s | ratio to {reference} | processor time, µs an event |
|---|---|---|---|---|
{rows}

{events} events of {size} bytes, {partitions} partitions; `acks=all`, idempotent, 128 KiB batches; broker: {broker}.
Producers and broker share two cores with other work, so that processor times are steadier than rates. Times end at the
last acknowledgement; the sink's include encoding ({renderer} renderer), keys and headers, the Java producer's do not;
its processor time includes the start of the JVM. Medians of {repeats} repetitions: `python benchmarks/kafka.py`.

What limits the sink is Python's lock: one thread encodes, another hands message after message to aiokafka, and both run
in turn. Each event costs {sink_us} µs of one core, of which the bare producer (`aiokafka, batches`) has {bare_us}.
The Java producer spreads over both cores.
"""

Messages = list[tuple[bytes, bytes]]
#: How long a way took, and the processor time that it took, s.
Times = tuple[float, float]
Way = Callable[[KafkaConfig], Mapping[str, float]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--events", type=int, default=200_000)
    parser.add_argument("--partitions", type=int, default=6)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--write", type=Path, metavar="FOLDER", help="write the table to FOLDER/kafka.md"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch, broker_of(Path(scratch)) as (broker, name):
        took = {
            compression: turns(broker, options, compression, Path(scratch))
            for compression in ("none", "zstd")
        }
    page = table(took, options, name)
    print(page)
    if options.write:
        (options.write / "kafka.md").write_text(page, encoding="utf-8")


def has_java() -> bool:
    """Return whether there is an Apache Kafka to start, and none that is named."""
    return not kafka_broker.BOOTSTRAP and not kafka_cluster.why_absent()


@contextmanager
def broker_of(scratch: Path) -> Iterator[tuple[Any, str]]:
    """Yield a broker and its name."""
    if has_java():
        with kafka_cluster.cluster(scratch / "cluster") as cluster:
            yield cluster, "Apache Kafka 4.1, one node on the same machine"
    else:
        with kafka_broker.broker() as broker:
            yield broker, kafka_broker.BOOTSTRAP or "librdkafka's mock cluster, own process"


def processor_s() -> float:
    """Return the processor time of this process and of those that it has waited for, s."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def turns(
    broker: Any, options: argparse.Namespace, compression: str, scratch: Path
) -> dict[str, list[Times]]:
    """Return each way's time and processor time, s, turn by turn; the first turn is left out."""
    windows = [window(WINDOW_EVENTS, first) for first in range(0, options.events, WINDOW_EVENTS)]
    lines = [line for each in windows for line in ENCODER.encode(each).splitlines()]
    messages = [(KEYS[number % len(KEYS)], line) for number, line in enumerate(lines)]
    file = scratch / "events.jsonl"
    file.write_bytes(b"\n".join(lines[:JAVA_LINES]))
    ways: list[Way] = [partial(java_producer, file=file, events=len(lines))] if has_java() else []
    ways += [
        lambda given: {"confluent-kafka": by_confluent_kafka(given, messages)},
        lambda given: {"aiokafka, batches": asyncio.run(in_batches(given, messages))},
        lambda given: {"kafka": through_the_sink(given, windows, None)},
        lambda given: {
            "kafka, spooled": through_the_sink(given, windows, tempfile.mkdtemp(dir=scratch))
        },
    ]
    took: dict[str, list[Times]] = {}
    for turn in range(options.repeats + 1):
        for way in ways:
            place = {"bootstrap_servers": broker.address, "topic": broker.topic(options.partitions)}
            config = KafkaConfig(**place, compression=compression)
            before_s = processor_s()
            found = way(config)
            used_s = (processor_s() - before_s) / (JAVA_TIMES if JAVA in found else 1)
            for name, time_s in found.items():
                took.setdefault(name, []).extend([(time_s, used_s)] if turn else [])
    return took


def java_producer(config: KafkaConfig, file: Path, events: int) -> dict[str, float]:
    """Return the times that Kafka's own producer takes for so many events, with and without its
    first report.
    """
    producer = {
        "bootstrap.servers": config.bootstrap_servers,
        "acks": "all",
        "enable.idempotence": "true",
        "batch.size": config.batch_bytes,
        "compression.type": config.compression,
    }
    count = JAVA_TIMES * events
    words = [
        "--topic",
        config.topic,
        "--num-records",
        str(count),
        "--throughput",
        "-1",
        "--payload-file",
        str(file),
    ]
    words += ["--producer-props", *(f"{key}={value}" for key, value in producer.items())]
    main_class = "org.apache.kafka.tools.ProducerPerformance"
    command = ["java", "-Xmx512m", "-cp", kafka_cluster.classpath(), main_class, *words]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    *first, (sent, rate) = [(int(sent), float(rate)) for sent, rate in REPORT.findall(printed)]
    compiling, compiling_s = (first[0][0], first[0][0] / first[0][1]) if first else (0, 0.0)
    warm_rate = (sent - compiling) / (sent / rate - compiling_s)
    return {JAVA: events / warm_rate, COLD: events / rate}


def by_confluent_kafka(config: KafkaConfig, messages: Messages) -> float:
    settings = {
        "bootstrap.servers": config.bootstrap_servers,
        "acks": "all",
        "enable.idempotence": True,
        "batch.size": config.batch_bytes,
        "compression.type": config.compression,
        "queue.buffering.max.messages": len(messages) + 1,
        "queue.buffering.max.kbytes": 1 << 20,
    }
    producer = confluent_kafka.Producer(settings)
    producer.list_topics(config.topic)
    began = time.perf_counter()
    for key, value in messages:
        producer.produce(config.topic, value, key, headers=HEADERS)
    producer.flush()
    return time.perf_counter() - began


def producer_like_the_sink_s(config: KafkaConfig) -> AIOKafkaProducer:
    return AIOKafkaProducer(
        bootstrap_servers=list(config.servers),
        acks="all",
        enable_idempotence=True,
        compression_type=None if config.compression == "none" else config.compression,
        max_batch_size=config.batch_bytes,
        request_timeout_ms=round(config.request_timeout_s * 1000),
    )


async def in_batches(config: KafkaConfig, messages: Messages) -> float:
    producer = producer_like_the_sink_s(config)
    await producer.start()
    partitions = sorted(await producer.partitions_for(config.topic))
    choose = DefaultPartitioner()
    of_key = {key: choose(key, partitions, partitions) for key in KEYS}
    began = time.perf_counter()
    queues: dict[int, Messages] = {partition: [] for partition in partitions}
    for key, value in messages:
        queues[of_key[key]].append((key, value))

    async def send(partition: int) -> None:
        queue = queues[partition]
        at = 0
        while at < len(queue):
            batch = producer.create_batch()
            while at < len(queue):
                key, value = queue[at]
                if batch.append(timestamp=None, key=key, value=value, headers=HEADERS) is None:
                    break
                at += 1
            await (await producer.send_batch(batch, config.topic, partition=partition))

    await asyncio.gather(*(send(partition) for partition in partitions))
    took = time.perf_counter() - began
    await producer.stop()
    return took


def through_the_sink(config: KafkaConfig, windows: list[Any], folder: str | None) -> float:
    backlog = MemoryBacklog(1 << 30) if folder is None else Journal(f"{folder}/spool", 1 << 30)
    carrier = KafkaTransport(config, connector(config))
    while carrier.trouble is not None:
        time.sleep(0.001)
    sink = TransportSink("kafka", carrier, backlog, EncodedBatcher(ENCODER, SENSORS), Policy())
    events = sum(len(each.detections) for each in windows)
    began = time.perf_counter()
    for each in windows:
        sink.write(each)
    while sink.delivery_so_far().delivered < events:
        time.sleep(0.001)
    took = time.perf_counter() - began
    sink.close()
    return took


def table(
    took: Mapping[str, Mapping[str, list[Times]]], options: argparse.Namespace, broker: str
) -> str:
    """Return the page."""
    reference = JAVA if has_java() else "confluent-kafka"
    rows = []
    rate = dict[tuple[str, str], str]()
    used = dict[tuple[str, str], str]()
    for compression, ways in took.items():
        for name, times in ways.items():
            ratios = [
                one / other for (one, _), (other, _) in zip(ways[reference], times, strict=True)
            ]
            rate[compression, name] = spaced(
                options.events / statistics.median(time_s for time_s, _ in times)
            )
            used_us = statistics.median(used_s for _, used_s in times) / options.events * 1e6
            used[compression, name] = f"{used_us:.1f}"
            ratio = f"{statistics.median(ratios):.2f}"
            cells = (compression, name, rate[compression, name], ratio, used[compression, name])
            rows.append(f"| {' | '.join(cells)} |")
    return PAGE.format(
        plain=rate["none", "kafka"],
        zstd=rate["zstd", "kafka"],
        spooled=rate["none", "kafka, spooled"],
        spooled_zstd=rate["zstd", "kafka, spooled"],
        reference=reference,
        events=spaced(options.events),
        size=len(ENCODER.encode(window(WINDOW_EVENTS))) // WINDOW_EVENTS,
        partitions=options.partitions,
        broker=broker,
        renderer=RENDERER,
        repeats=options.repeats,
        rows="\n".join(rows),
        sink_us=used["none", "kafka"],
        bare_us=used["none", "aiokafka, batches"],
    )


def spaced(rate: float) -> str:
    """Return a rate as text, with spaces between the thousands."""
    return f"{rate:,.0f}".replace(",", " ")


if __name__ == "__main__":
    main()
