"""What the brokers say of a topic, while some of them say nothing."""

import asyncio
from types import SimpleNamespace

from aiokafka import errors
from opir_kafka.failures import words
from opir_kafka.topic import topic_fault

PARTITION = {"partition": 0, "leader": -1, "replicas": [1, 2], "isr": [2], "error_code": 5}
TOPIC = {"error_code": 0, "partitions": [PARTITION]}


class Client:
    """Two brokers: the first hangs, the second knows the topic."""

    cluster = SimpleNamespace(brokers=lambda: [SimpleNamespace(nodeId=node) for node in (1, 2)])

    async def send(self, node, _request):
        if node == 1:
            await asyncio.Event().wait()
        return SimpleNamespace(to_object=lambda: {"topics": [TOPIC]})


def test_a_broker_that_hangs_does_not_keep_the_others_from_answering():
    async def fault():
        async with asyncio.timeout(30.0):
            return await topic_fault(Client(), "events", 0.2, 0)

    text = asyncio.run(fault())
    assert text == "topic events: partition 0 has no leader; brokers away or behind: 1"


def test_brokers_that_take_no_request_do_not_answer():
    error = errors.NodeNotReadyError("Attempt to send a request to node which is not ready.")
    assert words(error, "broker:9092") == "no broker answers at broker:9092"
