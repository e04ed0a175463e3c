"""The renderer `compiled`: the bytes of the reference, faster."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from opir_core.errors import install_command
from opir_core.plugin import NoConfig, RendererModel, hookimpl

if TYPE_CHECKING:
    from opir_core.plugin import Renderer, RendererContext


@hookimpl
def opir_renderers() -> Iterable[RendererModel]:
    """Yield `compiled`."""
    yield RendererModel(
        name="compiled",
        summary="lines joined in C, with the interpreter's lock released",
        build=renderer,
    )


def renderer(_config: NoConfig, context: "RendererContext") -> "Renderer":
    """Return the compiled renderer; raises ImportError where it was installed without a C
    compiler.
    """
    try:
        from opir_render.compiled import render
    except ImportError as error:
        words = f"{error}; where a C compiler is, {install_command('opir-render')}"
        raise ImportError(words) from error
    return partial(_rendered, render, context.reference)


def _rendered(
    render: Callable[[int, list[Any]], bytes | None],
    reference: "Renderer",
    count: int,
    columns: Sequence[Any],
) -> bytes:
    """Return `count` lines, each joined from its columns; by the reference where the compiled
    module returns None.
    """
    plain = [column if isinstance(column, bytes) else column.plain() for column in columns]
    lines = render(count, plain)
    return reference(count, columns) if lines is None else lines
