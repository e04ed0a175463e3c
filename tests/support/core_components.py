"""Components of the core, built as a host offers them."""

from typing import Any

from opir_core import Host

HOST = Host.of()


def built(hook: Any, name: str, context: Any, **settings: Any) -> Any:
    """Return the part that a component builds from settings."""
    component = HOST.component(hook, name)
    return component.build(component.config(**settings), context)
