"""The sink of a scene's output with a transport or a spool: its transport, backlog, and policy."""

from collections.abc import Callable
from typing import Any

from opir_core.interfaces.outputs import Encoder, Sink, Transport
from opir_core.output.events.encoder_input import configured_heartbeats
from opir_core.output.sink_thread import MEMORY_BYTES
from opir_core.output.spool.batches import (
    Backlog,
    Batcher,
    EncodedBatcher,
    MemoryBacklog,
    WindowBatcher,
    WindowTransport,
)
from opir_core.output.spool.columns import Origin
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.policy import Policy
from opir_core.output.spool.salvage import Salvage, salvaged_at_start
from opir_core.output.spool.transport_sink import TransportSink
from opir_core.scene.scene import Choice

#: Time, s, after which closing stops waiting for an acknowledgement, for an output with a spool: of
#: a destination that is slow, and of one that says why nothing gets through.
SPOOLED_STALL_S = 30.0
TROUBLE_S = 3.0


def transport_sink(
    choice: Choice, product: Sink | Transport, make_encoder: Callable[[], Encoder], origin: Origin
) -> TransportSink:
    """Return the sink of an output with a transport or a spool; if the spool cannot be opened,
    `product` is closed.
    """
    batcher: Batcher
    transport = product if isinstance(product, Transport) else WindowTransport(product, origin)
    try:
        if transport is product:
            encoder = make_encoder()
            beats = configured_heartbeats(choice.name, choice.config, encoder, origin)
            batcher = EncodedBatcher(encoder, origin.sensors, beats)
        else:
            batcher = WindowBatcher(make_encoder(), origin)
        backlog, policy, damage = _backlog(choice.spool)
    except BaseException:
        transport.close(0.0)
        raise
    return TransportSink(choice.name, transport, backlog, batcher, policy, damage)


def _backlog(spool: Any) -> tuple[Backlog, Policy, Salvage | None]:
    if spool is None:
        return MemoryBacklog(MEMORY_BYTES), Policy(), None
    damage = salvaged_at_start(spool.path)
    journal = Journal(spool.path, spool.max_bytes, survives_power_cut=spool.survives_power_cut)
    limits = {"stall_s": SPOOLED_STALL_S, "trouble_s": TROUBLE_S}
    return journal, Policy(when_full=spool.when_full, wait_s=spool.wait_s, **limits), damage
