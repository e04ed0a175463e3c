"""What the brokers say of a topic: why it takes no messages, and whether it keeps them all."""

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from aiokafka import errors
from aiokafka.client import AIOKafkaClient
from aiokafka.protocol.admin import DescribeConfigsRequest
from aiokafka.protocol.metadata import MetadataRequest

#: The protocol's number of a topic among the kinds of resources.
_TOPIC = 2
_SETTINGS = ("min.insync.replicas", "cleanup.policy")

#: Answers about one partition that say less than its leader and its replicas do.
_OF_REPLICAS = {5, 9}


async def topic_fault(
    client: AIOKafkaClient, topic: str, within_s: float, partition: int | None = None
) -> str:
    """Return why a partition takes no messages, by default any partition of the topic; "" if the
    brokers say nothing of it.

    The brokers are asked twice, for at most half of `within_s` each time.

    Raises what the brokers answer that is permanent, such as a missing permission, and the error of
    the last broker that was asked, if none answers.
    """
    described = await _answer(client, MetadataRequest([topic]), within_s / 2)
    metadata: Mapping[str, Any] = described.to_object()["topics"][0]
    if metadata["error_code"] == errors.UnknownTopicOrPartitionError.errno:
        return f"there is no topic {topic}; make it, or let the broker make topics"
    if metadata["error_code"] not in (0, errors.LeaderNotAvailableError.errno):
        raise errors.for_code(metadata["error_code"])(topic)
    rows = [
        row for row in metadata["partitions"] if partition is None or row["partition"] == partition
    ]
    if partition is not None and not rows:
        return f"the topic {topic} has no partition {partition} any more"
    leaderless = [row for row in rows if row["leader"] < 0]
    if leaderless:
        return f"topic {topic}: {_named(leaderless)} no leader; {_away(leaderless)}"
    minimum = int((await topic_settings(client, topic, within_s / 2)).get("min.insync.replicas", 1))
    lagging = [row for row in rows if len(row["isr"]) < minimum]
    if lagging:
        in_sync = min(len(row["isr"]) for row in lagging)
        return (
            f"topic {topic}: {_named(lagging)} {in_sync} replicas in sync,"
            f" where min.insync.replicas asks for {minimum}; {_away(lagging)}"
        )
    refused = {row["error_code"] for row in rows} - {0} - _OF_REPLICAS
    if refused:
        return f"topic {topic}: {_named(rows)} {errors.for_code(min(refused)).__name__}"
    return ""


async def topic_settings(client: AIOKafkaClient, topic: str, within_s: float) -> Mapping[str, str]:
    """Return settings of a topic as the brokers tell them; none where they do not."""
    request = DescribeConfigsRequest([(_TOPIC, topic, list(_SETTINGS))])
    try:
        resources = (await _answer(client, request, within_s)).to_object()["resources"]
    except errors.KafkaError:
        return {}
    entries = [entry for resource in resources for entry in resource["config_entries"]]
    return {entry["config_names"]: entry["config_value"] for entry in entries}


def compaction_warning(topic: str, settings: Mapping[str, str]) -> str:
    """Return what a compacted topic does to events, "" for one that is not compacted."""
    if "compact" not in settings.get("cleanup.policy", ""):
        return ""
    return (
        f"the topic {topic} is compacted: Kafka keeps only the last message of each key, which is"
        " the last event of each sensor; cleanup.policy=delete keeps all for the time that"
        " retention.ms says"
    )


async def _answer(client: AIOKafkaClient, request: Any, within_s: float) -> Any:
    """Return the answer of the first broker that gives one; each has its share of a time, s, for
    one that hangs says nothing of the others.
    """
    failure: Exception = errors.NodeNotReadyError("no broker is known")
    brokers = client.cluster.brokers()
    for broker in brokers:
        try:
            async with asyncio.timeout(within_s / len(brokers)):
                return await client.send(broker.nodeId, request)
        except (TimeoutError, errors.KafkaError) as error:
            failure = error
    raise failure


def _named(rows: Sequence[Mapping[str, Any]]) -> str:
    numbers = ", ".join(str(row["partition"]) for row in sorted(rows, key=lambda r: r["partition"]))
    return f"partition {numbers} has" if len(rows) == 1 else f"partitions {numbers} have"


def _away(rows: Sequence[Mapping[str, Any]]) -> str:
    absent = {node for row in rows for node in row["replicas"] if node not in row["isr"]}
    if not absent:
        return "the brokers choose one"
    return f"brokers away or behind: {', '.join(map(str, sorted(absent)))}"
