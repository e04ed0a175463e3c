"""The Kafka transport: a thread with an event loop that keeps a connection open and sends batches
over it.
"""

import asyncio
import itertools
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any

from aiokafka import AIOKafkaProducer
from aiokafka.errors import UnknownTopicOrPartitionError
from aiokafka.partitioner import DefaultPartitioner
from aiokafka.structs import TopicPartition

from opir_core.errors import SinkError
from opir_core.plugin import Batch, Transport
from opir_kafka.connection import OURS, Connector, close_producer, probe
from opir_kafka.failures import TOO_LARGE, SmallerBatchesError, TopicError, is_fatal, words
from opir_kafka.lanes import Frame, Lane, Shipment
from opir_kafka.settings import KafkaConfig
from opir_kafka.topic import compaction_warning, topic_fault, topic_settings

if TYPE_CHECKING:
    from opir_kafka.registry import SchemaRegistry

_log = logging.getLogger(__name__)

#: Time, s, without an acknowledgement before the first look for the reason, and the longest between
#: two looks.
_PATIENCE_S = 1.0
_LONGEST_PATIENCE_S = 8.0


class KafkaTransport(Transport):
    """Sends batches to a topic: each sensor's events in order; a batch is acknowledged when all
    replicas have it.

    Transient errors are retried for ever, on a new connection if the state of the old one is
    unknown; a permanent error fails every batch, those to come too, until `retry`. A batch that is
    too large for the topic is sent in halves, down to single messages. All state except `trouble`
    belongs to the loop's thread.
    """

    def __init__(
        self, config: KafkaConfig, connect: Connector, registry: "SchemaRegistry | None" = None
    ) -> None:
        self._config = config
        self._connect = connect
        self._registry = registry
        self._frame: Frame | None = None
        self.trouble: str | None = f"no connection to {config.bootstrap_servers} yet"
        self.acknowledged: int = 0
        self.attempts: int = 0
        self._shipments: dict[Shipment, None] = {}
        self._lanes: dict[int, Lane] = {}
        self._partition_of: Callable[[bytes], int] | None = None
        self._fatal: SinkError | None = None
        #: Why partitions take no messages, as their topic's metadata say.
        self._faults: dict[int, str] = {}
        self._is_topic_examined = False
        self._is_to_retry = asyncio.Event()
        self._pauses_s = self._pauses()
        self._most_messages = sys.maxsize
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(_to_log)
        self._main: asyncio.Task[None] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=OURS, daemon=True)
        self._thread.start()

    def send(self, batch: Batch) -> "Future[None]":
        """Send a batch; the future is done when all events are acknowledged, or has the permanent
        error.
        """
        future: Future[None] = Future()
        self._loop.call_soon_threadsafe(self._accept, batch, future)
        return future

    def retry(self) -> None:
        """Connect again after a permanent error; batches that follow are sent."""
        self._loop.call_soon_threadsafe(self._reopen)

    def close(self, wait_s: float) -> None:
        """Disconnect within `wait_s`; the futures of unacknowledged batches are cancelled."""
        self._closing.set()
        try:
            self._loop.call_soon_threadsafe(self._stop)
        except RuntimeError:  # the loop is closed
            return
        self._thread.join(wait_s)

    def _run(self) -> None:
        try:
            self._main = self._loop.create_task(self._serve(), name=OURS)
            self._loop.run_until_complete(self._main)
        except asyncio.CancelledError:
            # Named as ours, for the closing of a producer cancels every other task.
            self._loop.run_until_complete(self._loop.create_task(_finish_tasks(), name=OURS))
        finally:
            for shipment in self._shipments:
                shipment.give_up()
            self._loop.close()

    def _stop(self) -> None:
        if self._main is not None and not self._main.done():
            self._main.cancel()
        else:
            self._loop.stop()

    def _accept(self, batch: Batch, future: "Future[None]") -> None:
        if self._fatal is not None:
            future.set_exception(self._fatal)
            return
        shipment = Shipment(batch, future)
        self._shipments[shipment] = None
        if self._partition_of is not None:
            self._distribute(shipment)

    def _distribute(self, shipment: Shipment) -> None:
        assert self._partition_of is not None
        for partition, rows in shipment.rows_by_partition(self._partition_of).items():
            self._lanes[partition].add(shipment, rows)

    async def _serve(self) -> None:
        """Connect again after each transient error, and after a permanent one on request, until
        closed.
        """
        while True:
            try:
                await self._one_connection()
            except Exception as error:
                trouble = words(error, self._config.bootstrap_servers)
                self.attempts += 1
                if is_fatal(error):
                    self._fail(SinkError(trouble))
                    await self._is_to_retry.wait()  # without a deadline: only the sink knows when
                    continue
                self._note(self._fault() or trouble)
            await asyncio.sleep(next(self._pauses_s))

    def _fault(self) -> str | None:
        return next(iter(self._faults.values()), None)

    def _note(self, trouble: str) -> None:
        if trouble != self.trouble:
            _log.warning("%s; trying again", trouble)
        self.trouble = trouble

    def _reopen(self) -> None:
        self._fatal = None
        self._most_messages = sys.maxsize
        self._is_to_retry.set()

    def _fail(self, error: SinkError) -> None:
        self._is_to_retry.clear()
        self._fatal = error
        self.trouble = str(error)
        for shipment in self._shipments:
            shipment.future.set_exception(error)
        self._shipments.clear()

    async def _one_connection(self) -> None:
        """Connect, send all unacknowledged and new messages; raise the error that ends the
        connection.
        """
        if self._registry is not None:
            self._frame = await self._registry.frame()
        producer = await self._connect()
        tasks: list[asyncio.Task[None]] = []
        examining: list[asyncio.Task[None]] = []
        try:
            self._open_lanes(await self._partitioning(producer))
            self.trouble = self._fault()
            tasks = [
                asyncio.create_task(self._send(producer, number, lane), name=f"{OURS} {number}")
                for number, lane in self._lanes.items()
            ]
            examining = [asyncio.create_task(self._examine(producer), name=f"{OURS} topic")]
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
            for task in done:
                task.result()
        finally:
            self._partition_of = None
            for task in (*tasks, *examining):
                task.cancel()
            await asyncio.gather(*tasks, *examining, return_exceptions=True)
            await close_producer(producer)

    async def _partitioning(
        self, producer: AIOKafkaProducer
    ) -> tuple[list[int], Callable[[bytes], int]]:
        """Return the topic's partitions, and the partition of a key by Kafka's default rule."""
        try:
            async with asyncio.timeout(self._config.connect_timeout_s):
                partitions = sorted(await producer.partitions_for(self._config.topic))
        except (TimeoutError, UnknownTopicOrPartitionError):
            if fault := await self._topic_fault(producer):
                raise TopicError(fault) from None
            raise
        choose = DefaultPartitioner()
        return partitions, cache(lambda key: int(choose(key, partitions, partitions)))

    async def _examine(self, producer: AIOKafkaProducer) -> None:
        """Log once if the topic does not keep all messages; a broker need not say."""
        if self._is_topic_examined:
            return
        with suppress(Exception):
            within_s = self._config.request_timeout_s
            async with asyncio.timeout(within_s):
                settings = await topic_settings(producer.client, self._config.topic, within_s)
            self._is_topic_examined = True
            if warning := compaction_warning(self._config.topic, settings):
                _log.warning("%s", warning)

    def _open_lanes(self, partitioning: tuple[list[int], Callable[[bytes], int]]) -> None:
        partitions, self._partition_of = partitioning
        self._lanes = {partition: Lane(self._frame) for partition in partitions}
        for shipment in self._shipments:
            self._distribute(shipment)

    async def _send(self, producer: AIOKafkaProducer, partition: int, lane: Lane) -> None:
        """Send the messages of a lane, one batch at a time; the next is made after the
        acknowledgement.
        """
        timeout_s = self._config.acknowledgement_timeout_s
        while True:
            await lane.has_messages.wait()  # the only wait without a deadline
            batch = producer.create_batch()
            sent = lane.fill(batch, self._most_messages)
            batch.close()
            try:
                async with asyncio.timeout(timeout_s):
                    sending = await producer.send_batch(
                        batch, self._config.topic, partition=partition
                    )
                    await self._explained(producer, partition, sending)
            except TOO_LARGE:
                count = sum(len(rows) for _, rows in sent)
                if count == 1:
                    raise
                # Lanes fail at once: a smaller maximum of another one stands.
                self._most_messages = min(self._most_messages, count // 2)
                raise SmallerBatchesError from None
            self._pauses_s = self._pauses()
            self._faults.pop(partition, None)
            self.trouble = self._fault()
            self.attempts = 0
            for shipment, rows in sent:
                self.acknowledged += len(rows)
                if shipment.acknowledge(rows):
                    del self._shipments[shipment]

    async def _explained(
        self, producer: AIOKafkaProducer, partition: int, sending: "asyncio.Future[Any]"
    ) -> None:
        """Wait for an acknowledgement; while there is none, look now and then for the reason.

        aiokafka only logs that a broker is gone or refuses a login, and tries ten times a second.
        """
        pause_s = _PATIENCE_S
        while not (await asyncio.wait([sending], timeout=pause_s))[0]:
            await self._probe(producer, partition)
            pause_s = min(2.0 * pause_s, _LONGEST_PATIENCE_S)
        await sending

    async def _probe(self, producer: AIOKafkaProducer, partition: int) -> None:
        """Note why no connection can be made, or why the partition takes no messages; raise what is
        permanent.
        """
        try:
            await probe(self._config)
            fault = await self._topic_fault(producer, partition)
            if fault := fault or await self._leader_fault(producer, partition):
                self._faults[partition] = fault
                self._note(fault)
            elif self._faults.pop(partition, None):
                self.trouble = self._fault()
        except Exception as error:
            self.attempts += 1
            if is_fatal(error):
                raise
            self._note(words(error, self._config.bootstrap_servers))

    async def _topic_fault(self, producer: AIOKafkaProducer, partition: int | None = None) -> str:
        within_s = self._config.request_timeout_s
        async with asyncio.timeout(within_s):
            return await topic_fault(producer.client, self._config.topic, within_s, partition)

    async def _leader_fault(self, producer: AIOKafkaProducer, partition: int) -> str:
        """Return that a partition's leader is away, which the other brokers do not miss yet; raise
        what is permanent.
        """
        cluster = producer.client.cluster
        leader = cluster.leader_for_partition(TopicPartition(self._config.topic, partition))
        if leader is None or leader < 0:
            return ""
        text = f"the leader of partition {partition}, broker {leader}, is away"
        broker = cluster.broker_metadata(leader)
        if broker is None:
            return text
        address = f"{broker.host}:{broker.port}"
        try:
            await probe(self._config, address)
        except Exception as error:
            if is_fatal(error):
                raise
            return f"{text}: {words(error, address)}"
        return ""

    def _pauses(self) -> Iterator[float]:
        pauses_s = self._config.pauses_s()
        return itertools.chain(pauses_s, itertools.repeat(pauses_s[-1]))


async def _finish_tasks() -> None:
    """Wait for the remaining tasks of the loop, above all for the closing of a producer."""
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    if tasks:
        _, pending = await asyncio.wait(tasks, timeout=1.5)
        for task in pending:
            task.cancel()


def _to_log(_loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log errors of a closed producer's tasks: its batches are sent again by the next producer."""
    _log.debug("%s", context.get("message"))
