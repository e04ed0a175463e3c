"""Progress on a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from opir_core.records import Window
    from opir_core.scene import Scene


@contextmanager
def progress(scene: "Scene", *, is_shown: bool) -> "Iterator[Callable[[Window], None] | None]":
    """Show a bar of scene time on standard error, if wanted; give the function to call with each window."""
    if not is_shown:
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(scene.name, total=scene.duration_s)
        yield lambda window: bar.update(task, completed=window.end_s)
