"""Components of the core, built as a host offers them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from opir_core import Host
from opir_core.plugin import TARGET_TYPES, ModelContext, Sensor

HOST = Host.of()


def built(hook: Any, name: str, context: Any, **settings: Any) -> Any:
    """Return the part that a component builds from settings."""
    component = HOST.component(hook, name)
    return component.build(component.config(**settings), context)


def context_of(sensors: Iterable[Sensor], types: Sequence[str] = TARGET_TYPES) -> ModelContext:
    """Return the context of models with sensors and a target of each type."""
    codes = np.array([TARGET_TYPES.index(name) for name in types], dtype=np.uint8)
    return ModelContext(sensors=tuple(sensors), target_type_code=codes)
