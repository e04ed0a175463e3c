"""Throughput of the Kafka sink: events per second, compared with a bare aiokafka producer of the same bytes.

    python benchmarks/kafka.py [--events 40000] [--partitions 6] [--repeats 7] [--write docs/benchmarks]

The broker is librdkafka's mock cluster, in a process of its own, or the one that KAFKA_BOOTSTRAP names. Each way sends
the same events into a topic of its own, connected beforehand, and is timed until the last is acknowledged:

- `aiokafka, send()`: the messages are ready; `send()` each, then wait for all. Settings as the sink has them;
- `aiokafka, batches`: the messages are ready; `create_batch()` and `send_batch()`, a task for each partition;
- `kafka`: the sink, from columns: encoding, queue and acknowledgement included;
- `kafka, spooled`: the same with a spool on disk, written before sending and cleared after acknowledgement.

The methods alternate; figures are medians, ratios medians of the ratios within each repetition.
"""

import argparse
import asyncio
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from aiokafka import AIOKafkaProducer
from aiokafka.partitioner import DefaultPartitioner
from opir_kafka.connection import connector
from opir_kafka.settings import KafkaConfig
from opir_kafka.transport import KafkaTransport

from opir_core.output.spool.batches import EncodedBatcher, MemoryBacklog
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.transport_sink import Policy, TransportSink

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
import kafka_broker
from spool_transports import ENCODER, SENSORS, window

WINDOW_EVENTS = 2000
HEADERS = [("content-type", b"application/json"), ("schema-version", b"1.0")]
#: Sensors enough that no partition is left out, whatever their hashes.
KEYS = [sensor.id.encode() for sensor in SENSORS]

PAGE = """# Throughput of the Kafka sink

How many events per second does the Kafka sink deliver? {plain} uncompressed, {zstd} with zstd; with a spool on disk
{spooled} and {spooled_zstd}.

| compression | method | events/s | ratio to `send()` |
|---|---|---|---|
{rows}

{events} events of {size} bytes, {partitions} partitions, two shared cores; `acks=all`, idempotent, 128 KiB batches;
broker: {broker}. Times end at the last acknowledgement; the sink's include encoding. Medians of {repeats} repetitions.
"""

Messages = list[tuple[bytes, bytes]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--events", type=int, default=40_000)
    parser.add_argument("--partitions", type=int, default=6)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the table to FOLDER/kafka.md")
    options = parser.parse_args()
    with kafka_broker.broker() as broker:
        took = {compression: turns(broker, options, compression) for compression in ("none", "zstd")}
    page = table(took, options)
    print(page)
    if options.write:
        (options.write / "kafka.md").write_text(page, encoding="utf-8")


def turns(broker: Any, options: argparse.Namespace, compression: str) -> dict[str, list[float]]:
    """Return each way's times, s, turn by turn; the first turn is left out."""
    windows = [window(WINDOW_EVENTS, first) for first in range(0, options.events, WINDOW_EVENTS)]
    lines = [line for each in windows for line in ENCODER.encode(each).splitlines()]
    messages = [(KEYS[number % len(KEYS)], line) for number, line in enumerate(lines)]
    ways: Mapping[str, Callable[[KafkaConfig], float]] = {
        "aiokafka, send()": lambda given: asyncio.run(one_by_one(given, messages)),
        "aiokafka, batches": lambda given: asyncio.run(in_batches(given, messages)),
        "kafka": lambda given: through_the_sink(given, windows, None),
        "kafka, spooled": lambda given: through_the_sink(given, windows, tempfile.mkdtemp()),
    }
    took: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(options.repeats + 1):
        for name, way in ways.items():
            place = {"bootstrap_servers": broker.address, "topic": broker.topic(options.partitions)}
            took[name].append(way(KafkaConfig(**place, compression=compression)))
    return {name: times[1:] for name, times in took.items()}


def producer_like_the_sink_s(config: KafkaConfig) -> AIOKafkaProducer:
    return AIOKafkaProducer(
        bootstrap_servers=list(config.servers),
        acks="all",
        enable_idempotence=True,
        compression_type=None if config.compression == "none" else config.compression,
        max_batch_size=config.batch_bytes,
        request_timeout_ms=round(config.request_timeout_s * 1000),
    )


async def one_by_one(config: KafkaConfig, messages: Messages) -> float:
    producer = producer_like_the_sink_s(config)
    await producer.start()
    await producer.partitions_for(config.topic)
    began = time.perf_counter()
    sent = [await producer.send(config.topic, value, key, headers=HEADERS) for key, value in messages]
    await asyncio.gather(*sent)
    took = time.perf_counter() - began
    await producer.stop()
    return took


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
        queue, at = queues[partition], 0
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


def table(took: Mapping[str, Mapping[str, list[float]]], options: argparse.Namespace) -> str:
    """Return the page."""
    rows, rate = [], {}
    for compression, ways in took.items():
        bare = ways["aiokafka, send()"]
        for name, times in ways.items():
            ratios = [one / other for one, other in zip(bare, times, strict=True)]
            rate[compression, name] = spaced(options.events / statistics.median(times))
            cells = (compression, name, rate[compression, name], f"{statistics.median(ratios):.2f}")
            rows.append(f"| {' | '.join(cells)} |")
    return PAGE.format(
        plain=rate["none", "kafka"],
        zstd=rate["zstd", "kafka"],
        spooled=rate["none", "kafka, spooled"],
        spooled_zstd=rate["zstd", "kafka, spooled"],
        events=options.events,
        size=len(ENCODER.encode(window(WINDOW_EVENTS))) // WINDOW_EVENTS,
        partitions=options.partitions,
        broker=kafka_broker.BOOTSTRAP or "librdkafka's mock cluster, own process",
        repeats=options.repeats,
        rows="\n".join(rows),
    )


def spaced(rate: float) -> str:
    """Return a rate as text, with spaces between the thousands."""
    return f"{rate:,.0f}".replace(",", " ")


if __name__ == "__main__":
    main()
