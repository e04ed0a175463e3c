"""Progress on a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from opir_core.interfaces.records import Window
    from opir_core.scene.scene import Scene


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


@contextmanager
def run_progress(runs: int, *, is_shown: bool) -> "Iterator[Callable[[str, int], None]]":
    """Show a bar of runs for each tracker on standard error, if wanted; give the function to call after each run."""
    if not is_shown:
        yield lambda _tracker, _number: None
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID

    tasks: dict[str, TaskID] = {}
    with Progress(console=Console(stderr=True), transient=True) as bar:

        def on_run(tracker: str, number: int) -> None:
            if tracker not in tasks:
                tasks[tracker] = bar.add_task(tracker, total=runs)
            bar.update(tasks[tracker], completed=number)

        yield on_run
