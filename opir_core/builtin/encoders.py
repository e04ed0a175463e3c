"""Core's own event encoders; nothing heavy is imported before one is built."""

from typing import TYPE_CHECKING, Any

from opir_core.plugin.components import EventEncoder

if TYPE_CHECKING:
    from opir_core.protocols import Encoder, EncoderContext


def _forge(_config: Any, context: "EncoderContext") -> "Encoder":
    from opir_core.events.forge import ForgeEncoder

    return ForgeEncoder(context)


ENCODERS = (
    EventEncoder(name="forge", summary="one flat JSON object an event, for the FORGE fusion pipeline", build=_forge),
)
