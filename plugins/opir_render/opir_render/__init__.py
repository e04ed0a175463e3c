"""The compiled renderer of lines: the same bytes as the reference in `opir_core.output.events.rendering`, faster."""

from collections.abc import Sequence

from opir_core.output import Column, reference
from opir_render import compiled

__all__ = ["render"]


def render(count: int, columns: Sequence[Column]) -> bytes:
    """Return `count` lines, each joined from its columns."""
    plain = [column if isinstance(column, bytes) else column.plain() for column in columns]
    lines = compiled.render(count, plain)
    return reference(count, columns) if lines is None else lines
