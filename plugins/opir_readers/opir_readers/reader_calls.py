"""Functions of readers, imported when they are first called: a scene without files pays nothing."""

from collections.abc import Callable
from typing import Any

from opir_core.plugin import ReaderContext, deferred


def reads(module: str, function: str, *settings: str) -> Callable[[Any, ReaderContext], Any]:
    """Return the `build` of a reader: it calls a function with the text and settings by name.

    `epoch_us` is that of the scene; `start_s` counts as 0 if it is not set.
    """
    read = deferred(f"opir_readers.{module}.{function}")

    def build(config: Any, context: ReaderContext) -> Any:
        values = {name: getattr(config, name, context.epoch_us) for name in settings}
        if "start_s" in values:
            values["start_s"] = values["start_s"] or 0.0
        return read(context.text, *values.values())

    return build
