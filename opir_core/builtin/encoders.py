"""Core's own event encoders; nothing heavy is imported before one is built."""

from typing import TYPE_CHECKING, Any

from opir_core.plugin.components import EventEncoder

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import EncoderContext
    from opir_core.interfaces.protocols import Encoder


def _forge(_config: Any, context: "EncoderContext") -> "Encoder":
    from opir_core.output.events.forge import ForgeEncoder

    return ForgeEncoder(context)


def _forge_bands(_config: Any, context: "EncoderContext") -> "Encoder":
    from opir_core.output.events.forge import ForgeEncoder

    return ForgeEncoder(context, has_irradiances=True)


def _forge_tracks(_config: Any, context: "EncoderContext") -> "Encoder":
    from opir_core.output.events.forge import ForgeEncoder

    return ForgeEncoder(context, has_tracks=True)


def _forge_c2(_config: Any, context: "EncoderContext") -> "Encoder":
    from opir_core.output.events.forge_c2 import ForgeC2Encoder

    return ForgeC2Encoder(context)


def _udl(_config: Any, context: "EncoderContext") -> "Encoder":
    from opir_core.output.events.udl import UdlEncoder

    return UdlEncoder(context)


ENCODERS = (
    EventEncoder(name="forge", summary="one flat JSON object an event, for the FORGE fusion pipeline", build=_forge),
    EventEncoder(
        name="forge-bands",
        summary="the event of forge, with the irradiance that each band measured",
        build=_forge_bands,
    ),
    EventEncoder(
        name="forge-c2",
        summary="a flat record with a place, or none, for command-and-control consumers",
        build=_forge_c2,
    ),
    EventEncoder(
        name="forge-tracks",
        summary="the event of forge, with the state, burnout, covariances and type of its track",
        build=_forge_tracks,
    ),
    EventEncoder(name="udl", summary="a MissileTrack of the Unified Data Library, simulated", build=_udl),
)
