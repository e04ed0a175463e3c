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
    described_error as described_error,
)
from opir_core.host.registry import (
    warn as warn,
)
