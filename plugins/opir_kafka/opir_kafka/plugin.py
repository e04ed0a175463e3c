"""The sink `kafka`, and the command `opir spool`: aiokafka is imported when the sink is built."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from opir_core.plugin import SinkModel, deferred, hookimpl
from opir_kafka.settings import KafkaConfig

if TYPE_CHECKING:
    from opir_core.plugin import SinkContext, Transport


def _kafka(config: KafkaConfig, context: "SinkContext") -> "Transport":
    from opir_kafka.connection import connector
    from opir_kafka.registry import registry_of
    from opir_kafka.transport import KafkaTransport

    return KafkaTransport(config, connector(config), registry_of(config, context))


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    """Yield the sink `kafka`."""
    yield SinkModel(
        name="kafka",
        summary="events into a Kafka topic, keyed by sensor, acknowledged by all replicas",
        config=KafkaConfig,
        build=_kafka,
        asyncapi=deferred("opir_kafka.document.asyncapi_text"),
    )


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir spool`, for the spool of any output."""
    from opir_kafka.spool import spool, spool_arguments

    parser = commands.add_parser(
        "spool", help="check the spool of an output, or salvage a damaged one"
    )
    spool_arguments(parser)
    parser.set_defaults(run=spool, group="maintain")
