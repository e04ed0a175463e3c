from opir_core.host.boundary import (
    InvalidOutput as InvalidOutput,
    owner_text as owner_text,
)
from opir_core.host.components import (
    plural as plural,
)
from opir_core.host.discovery import (
    core_sources as core_sources,
    installed_sources as installed_sources,
)
from opir_core.host.error_messages import (
    PACKAGES as PACKAGES,
    Search as Search,
    contested as contested,
    described_error as described_error,
)
from opir_core.host.registry import (
    warn as warn,
)
from opir_core.host.watchdog import (
    CHECK_S as CHECK_S,
    DEAD_AFTER_S as DEAD_AFTER_S,
    STUCK as STUCK,
    Watchdog as Watchdog,
    ended_if_stuck as ended_if_stuck,
)
