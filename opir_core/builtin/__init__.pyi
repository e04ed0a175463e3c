from opir_core.builtin.configs import (
    BallisticConfig as BallisticConfig,
)
from opir_core.builtin.null_models import (
    NoTracker as NoTracker,
)
