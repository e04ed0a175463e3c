"""Making the sink of an output that carries, or that has a spool."""

from collections.abc import Callable, Sequence
from typing import Any

from opir_core.interfaces.protocols import Encoder, Sensor, Sink, Transport
from opir_core.output.spool.batches import Backlog, MemoryBacklog, Packer, Packing
from opir_core.output.spool.dispatch import Dispatch, Policy
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.windows import WindowCarrier, WindowPacker
from opir_core.scene.scene import Choice

#: Bytes of messages that wait in memory where an output has no spool.
MEMORY_BYTES = 64 << 20
#: How long closing waits without an acknowledgement where nothing is lost by leaving.
SPOOLED_STALL_S = 3.0


def dispatched(
    choice: Choice, made: Sink | Transport, make_encoder: Callable[[], Encoder], sensors: Sequence[Sensor]
) -> Dispatch:
    """Return the sink of an output that carries, or of any output with a spool; on failure what was made is closed."""
    carrier, packing = _ends(made, make_encoder, sensors)
    try:
        backlog, policy = _backlog(choice.spool)
    except BaseException:
        carrier.close(0.0)
        raise
    return Dispatch(choice.name, carrier, backlog, packing, policy)


def _ends(
    made: Sink | Transport, make_encoder: Callable[[], Encoder], sensors: Sequence[Sensor]
) -> tuple[Transport, Packing]:
    if isinstance(made, Transport):
        return made, Packer(make_encoder(), sensors)
    return WindowCarrier(made), WindowPacker()


def _backlog(spool: Any) -> tuple[Backlog, Policy]:
    if spool is None:
        return MemoryBacklog(MEMORY_BYTES), Policy()
    journal = Journal(spool.path, spool.max_bytes, survives_power_cut=spool.survives_power_cut)
    return journal, Policy(when_full=spool.when_full, wait_s=spool.wait_s, stall_s=SPOOLED_STALL_S)
