"""Functions for the workers of executors: what they import has to be a module of its own."""

import os
import signal
from pathlib import Path
from time import sleep

from opir_core.host.boundary import blamed_call


def doubled(number: int) -> int:
    return 2 * number


def doubled_or_killed(task: tuple[int, str]) -> int:
    """Return twice the number; the first worker that gets a task with a path kills itself, and
    leaves the file.
    """
    number, path = task
    if path and not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def is_beside(task: tuple[str, str, str]) -> bool:
    """Return whether another task runs at the same time; the first worker of all kills itself, and
    leaves a file.

    `task` is the file that tells of the death, this task's own file, and the other's.
    """
    death, own, other = map(Path, task)
    if not death.exists():
        death.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    own.touch()
    for _ in range(500):
        if other.exists():
            return True
        sleep(0.01)
    return False


def doubled_or_always_killed(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def threads(_task: object) -> str:
    """Return how many threads linear algebra has here."""
    return os.environ.get("OPENBLAS_NUM_THREADS", "")


def own_number(_task: int) -> int:
    return os.getpid()


def killed(_task: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def doubled_or_hung(number: int) -> int:
    if number == 3:
        blamed_call(lambda: "the tracker 'x'", "", "step", lambda: sleep(100.0))
    return 2 * number
