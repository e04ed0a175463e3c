"""Throughput of the Kafka sink: events per second, beside Kafka's Java producer, confluent-kafka
and bare aiokafka.

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

import asyncio
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import confluent_kafka
from aiokafka import AIOKafkaProducer
from aiokafka.partitioner import DefaultPartitioner
from opir_kafka.connection import connector
from opir_kafka.settings import KafkaConfig
from opir_kafka.transport import KafkaTransport
from pages import markdown_table, options_of

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
#: How many times the events the Java producer sends.
JAVA_TIMES = 5
REPORT = re.compile(r"(\d+) records sent, ([\d.]+) records/sec")
JAVA = "Java producer, warm"
COLD = "Java producer, with its first 5 s"

PAGE = """# Throughput of the Kafka sink

How many events per second does the Kafka sink deliver, and how many Kafka's own producer? {plain}
uncompressed, {zstd} with zstd; with a spool on disk {spooled} and {spooled_zstd}.

{table}

{events} events of {size} bytes, {partitions} partitions; `acks=all`, idempotent, 128 KiB batches;
broker: {broker}. Producers and broker share two cores with other work, so that processor times
are steadier than rates. Times end at the last acknowledgement; the sink's include encoding
({renderer} renderer), keys and headers, the Java producer's do not; its processor time includes
the start of the JVM. Medians of {repeats} repetitions: `python benchmarks/kafka.py`.

What limits the sink is Python's lock: one thread encodes, another hands message after message to
aiokafka, and both run in turn. Each event costs {sink_us} µs of one core, of which the bare
producer (`aiokafka, batches`) has {bare_us}. The Java producer spreads over both cores.
"""

Messages = list[tuple[bytes, bytes]]
#: Wall and processor time of a way, s.
Times = tuple[float, float]
Way = Callable[[KafkaConfig], Mapping[str, float]]


def main():
    """Measure and print; write the page where asked."""
    options = options_of(__doc__, events=200_000, partitions=6, repeats=5)
    with tempfile.TemporaryDirectory() as scratch, broker_of(Path(scratch)) as (broker, name):
        times = {
            compression: turns(broker, options, compression, Path(scratch))
            for compression in ("none", "zstd")
        }
    text = page(times, options, name)
    print(text)
    if options.write:
        (options.write / "kafka.md").write_text(text, encoding="utf-8")


def has_java():
    """Whether there is an Apache Kafka to start, and no broker is named."""
    return not kafka_broker.BOOTSTRAP and not kafka_cluster.why_absent()


@contextmanager
def broker_of(scratch):
    """Yield a broker and its name."""
    if has_java():
        with kafka_cluster.cluster(scratch / "cluster") as cluster:
            yield cluster, "Apache Kafka 4.1, one node on the same machine"
    else:
        with kafka_broker.broker() as broker:
            yield broker, kafka_broker.BOOTSTRAP or "librdkafka's mock cluster, own process"


def turns(broker, options, compression, scratch):
    """Return each way's times, turn by turn; the first turn is left out."""
    windows = [window(WINDOW_EVENTS, first) for first in range(0, options.events, WINDOW_EVENTS)]
    lines = [line for batch in windows for line in ENCODER.encode(batch).splitlines()]
    messages = [(KEYS[number % len(KEYS)], line) for number, line in enumerate(lines)]
    file = scratch / "events.jsonl"
    file.write_bytes(b"\n".join(lines[:50_000]))

    def spooled(config):
        return through_the_sink(config, windows, tempfile.mkdtemp(dir=scratch))

    ways = [partial(java_producer, file=file, events=len(lines))] if has_java() else []
    ways += [
        lambda config: {"confluent-kafka": by_confluent_kafka(config, messages)},
        lambda config: {"aiokafka, batches": asyncio.run(in_batches(config, messages))},
        lambda config: {"kafka": through_the_sink(config, windows, None)},
        lambda config: {"kafka, spooled": spooled(config)},
    ]
    times = {}
    for turn in range(options.repeats + 1):
        for way in ways:
            config = KafkaConfig(
                bootstrap_servers=broker.address,
                topic=broker.topic(options.partitions),
                compression=compression,
            )
            start_s = sum(os.times()[:4])
            walls = way(config)
            used_s = (sum(os.times()[:4]) - start_s) / (JAVA_TIMES if JAVA in walls else 1)
            for name, wall_s in walls.items():
                times.setdefault(name, []).extend([(wall_s, used_s)] if turn else [])
    return times


def java_producer(config, file, events):
    """Return the times of Kafka's own producer for so many events, with and without its first
    report.
    """
    producer = {
        "bootstrap.servers": config.bootstrap_servers,
        "acks": "all",
        "enable.idempotence": "true",
        "batch.size": config.batch_bytes,
        "compression.type": config.compression,
    }
    command = ["java", "-Xmx512m", "-cp", kafka_cluster.classpath()]
    command += ["org.apache.kafka.tools.ProducerPerformance", "--topic", config.topic]
    command += ["--num-records", str(JAVA_TIMES * events), "--throughput", "-1"]
    command += ["--payload-file", str(file), "--producer-props"]
    command += [f"{key}={value}" for key, value in producer.items()]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    *reports, (sent, rate) = [(int(sent), float(rate)) for sent, rate in REPORT.findall(output)]
    compiling = reports[0][0] if reports else 0
    compiling_s = compiling / reports[0][1] if reports else 0.0
    warm_rate = (sent - compiling) / (sent / rate - compiling_s)
    return {JAVA: events / warm_rate, COLD: events / rate}


def by_confluent_kafka(config, messages):
    """Return the time of confluent-kafka, s."""
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
    start_s = time.perf_counter()
    for key, value in messages:
        producer.produce(config.topic, value, key, headers=HEADERS)
    producer.flush()
    return time.perf_counter() - start_s


async def in_batches(config, messages):
    """Return the time of bare aiokafka with the settings of the sink, s."""
    producer = AIOKafkaProducer(
        bootstrap_servers=list(config.servers),
        acks="all",
        enable_idempotence=True,
        compression_type=None if config.compression == "none" else config.compression,
        max_batch_size=config.batch_bytes,
        request_timeout_ms=round(config.request_timeout_s * 1000),
    )
    await producer.start()
    partitions = sorted(await producer.partitions_for(config.topic))
    partitioner = DefaultPartitioner()
    partition_of = {key: partitioner(key, partitions, partitions) for key in KEYS}
    start_s = time.perf_counter()
    queues = {partition: [] for partition in partitions}
    for key, value in messages:
        queues[partition_of[key]].append((key, value))

    async def send(partition):
        queue = queues[partition][::-1]
        while queue:
            batch = producer.create_batch()
            while queue:
                key, value = queue[-1]
                if batch.append(timestamp=None, key=key, value=value, headers=HEADERS) is None:
                    break
                queue.pop()
            await (await producer.send_batch(batch, config.topic, partition=partition))

    await asyncio.gather(*(send(partition) for partition in partitions))
    taken_s = time.perf_counter() - start_s
    await producer.stop()
    return taken_s


def through_the_sink(config, windows, folder):
    """Return the time of the sink, s, with a spool in a folder, if given."""
    backlog = MemoryBacklog(1 << 30) if folder is None else Journal(f"{folder}/spool", 1 << 30)
    carrier = KafkaTransport(config, connector(config))
    while carrier.trouble is not None:
        time.sleep(0.001)
    sink = TransportSink("kafka", carrier, backlog, EncodedBatcher(ENCODER, SENSORS), Policy())
    events = sum(len(batch.detections) for batch in windows)
    start_s = time.perf_counter()
    for batch in windows:
        sink.write(batch)
    while sink.delivery_so_far().delivered < events:
        time.sleep(0.001)
    taken_s = time.perf_counter() - start_s
    sink.close()
    return taken_s


def page(times, options, broker):
    """Return the page."""
    reference = JAVA if has_java() else "confluent-kafka"
    lines = {}
    for compression, ways in times.items():
        for name, turns in ways.items():
            walls_s, used_s = zip(*turns, strict=True)
            rate = f"{options.events / statistics.median(walls_s):,.0f}".replace(",", " ")
            pairs = zip(ways[reference], walls_s, strict=True)
            ratio = statistics.median(reference_s / wall_s for (reference_s, _), wall_s in pairs)
            used_us = 1e6 * statistics.median(used_s) / options.events
            lines[compression, name] = (compression, name, rate, f"{ratio:.2f}", f"{used_us:.1f}")
    head = ("compression", "method", "events/s", f"ratio to {reference}")
    return PAGE.format(
        plain=lines["none", "kafka"][2],
        zstd=lines["zstd", "kafka"][2],
        spooled=lines["none", "kafka, spooled"][2],
        spooled_zstd=lines["zstd", "kafka, spooled"][2],
        table=markdown_table((*head, "processor time, µs an event"), lines.values()),
        events=f"{options.events:,}".replace(",", " "),
        size=len(ENCODER.encode(window(WINDOW_EVENTS))) // WINDOW_EVENTS,
        partitions=options.partitions,
        broker=broker,
        renderer=RENDERER,
        repeats=options.repeats,
        sink_us=lines["none", "kafka"][4],
        bare_us=lines["none", "aiokafka, batches"][4],
    )


if __name__ == "__main__":
    main()
