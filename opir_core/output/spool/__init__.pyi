from opir_core.output.spool.batches import (
    BATCH_EVENTS as BATCH_EVENTS,
    EncodedBatcher as EncodedBatcher,
    FullError as FullError,
    MemoryBacklog as MemoryBacklog,
    WindowBatcher as WindowBatcher,
    WindowTransport as WindowTransport,
)
from opir_core.output.spool.columns import (
    CONTENT_TYPE as CONTENT_TYPE,
    VERSION as VERSION,
    Origin as Origin,
)
from opir_core.output.spool.journal import (
    Journal as Journal,
)
from opir_core.output.spool.policy import (
    Closing as Closing,
    Parking as Parking,
    Policy as Policy,
)
from opir_core.output.spool.salvage import (
    salvaged_at_start as salvaged_at_start,
)
from opir_core.output.spool.sent_batches import (
    AHEAD_BYTES as AHEAD_BYTES,
    SentBatches as SentBatches,
)
from opir_core.output.spool.store import (
    Store as Store,
)
from opir_core.output.spool.syncing import (
    SyncThread as SyncThread,
)
from opir_core.output.spool.transport_sink import (
    TransportSink as TransportSink,
)
