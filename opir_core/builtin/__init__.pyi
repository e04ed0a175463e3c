from opir_core.builtin.configs import (
    BallisticConfig as BallisticConfig,
)
from opir_core.builtin.no_tracker import (
    NoTracker as NoTracker,
)
