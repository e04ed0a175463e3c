"""The sink `kafka`: aiokafka is imported when the sink is built."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.plugin import SinkModel, hookimpl
from opir_kafka.settings import KafkaConfig

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import SinkContext
    from opir_core.interfaces.outputs import Transport


def _kafka(config: KafkaConfig, _context: "SinkContext") -> "Transport":
    from opir_kafka.connection import connector
    from opir_kafka.transport import KafkaTransport

    return KafkaTransport(config, connector(config))


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    """Yield the sink `kafka`."""
    yield SinkModel(
        name="kafka",
        summary="events into a Kafka topic, keyed by sensor, acknowledged by all replicas",
        config=KafkaConfig,
        build=_kafka,
    )
