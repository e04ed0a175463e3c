"""Functions for the workers of executors: what they import has to be a module of its own."""

import os
import signal
from pathlib import Path
from time import sleep

from opir_core.host.boundary import blamed_call


def slept(duration_s):
    sleep(duration_s)
    return duration_s


def doubled(number):
    return 2 * number


def doubled_or_killed(task):
    """Return twice the number; the first worker that gets a task with a path kills itself, and
    leaves the file.
    """
    number, path = task
    if path and not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def is_beside(task):
    """Return whether another task runs at the same time; the first worker of all kills itself, and
    leaves a file.

    `task` is the file that tells of the death, this task's own file, and the other's.
    """
    death, here_path, peer = map(Path, task)
    if not death.exists():
        death.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    here_path.touch()
    for _ in range(500):
        if peer.exists():
            return True
        sleep(0.01)
    return False


def doubled_or_always_killed(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def threads(_task):
    """Return how many threads linear algebra has here."""
    return os.environ.get("OPENBLAS_NUM_THREADS", "")


def own_number(_task):
    return os.getpid()


def killed(_task):
    os.kill(os.getpid(), signal.SIGKILL)


def doubled_or_hung(number):
    if number == 3:
        blamed_call(lambda: "the tracker 'x'", "", "step", lambda: sleep(100.0))
    return 2 * number
