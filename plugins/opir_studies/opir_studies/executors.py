"""The executors `serial` and `processes`: where the runs of a study are made.

Workers are new processes (spawned, not forked: other threads, such as a progress bar's, may hold
locks), so a script that uses them needs `if __name__ == "__main__":`.
"""

import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait as wait_for_objects
from threading import Thread
from typing import Any

from attrs import define, field

from opir_core.cli import THREADS
from opir_core.errors import OpirError
from opir_core.host import DEAD_AFTER_S, STUCK, ended_if_stuck
from opir_core.plugin import ExecutorContext, NoConfig
from opir_studies.configs import ProcessesConfig

#: Deaths of its worker, while no other task was running, after which a task is given up.
DEATHS_ALONE = 3
#: Deaths of any worker while it was running, after which a task is run alone.
DEATHS_BESIDE_OTHERS = 2


class LostTasksError(OpirError):
    """Tasks whose worker died again and again; raised after all other tasks have given their
    results.

    `tasks` are their indices, `reasons` why their workers were ended, as far as that is known. An
    executor of a plugin raises it too.
    """

    exit_code = 4

    def __init__(self, tasks: Sequence[int], reasons: Mapping[int, str] | None = None) -> None:
        self.tasks = tuple(tasks)
        self.reasons = dict(reasons or {})
        died = len(self.tasks) - len(self.reasons)
        words = f"the worker of {died} tasks ended {DEATHS_ALONE} times, possibly out of memory"
        super().__init__("\n".join([*([words] if died else []), *self.reasons.values()]))


class SerialExecutor:
    """Runs tasks one after another in this process."""

    def results(
        self, function: Callable[[Any], Any], tasks: Sequence[Any]
    ) -> Iterator[tuple[int, Any]]:
        """Yield the index and the result of each task, in order."""
        for index, task in enumerate(tasks):
            yield index, function(task)

    def close(self) -> None:
        """Do nothing: there are no workers."""


def serial_executor(_config: NoConfig, _context: ExecutorContext) -> SerialExecutor:
    """Return the executor `serial`."""
    return SerialExecutor()


def processes_executor(config: ProcessesConfig, context: ExecutorContext) -> "ProcessesExecutor":
    """Return the executor `processes`."""
    return ProcessesExecutor(context.workers or config.workers or _cores(), context.dead_after_s)


def _cores() -> int:
    count: int | None = getattr(os, "process_cpu_count", os.cpu_count)()
    return count or 1


@define
class _Progress:
    """The tasks that are left, and how often the workers of each died: while others ran, and
    alone.
    """

    waiting: deque[int]
    deaths: dict[int, int]
    deaths_alone: dict[int, int]
    suspects: deque[int]
    lost: list[int]
    #: Why the workers of tasks were ended that did not return.
    stuck: dict[int, str] = field(factory=dict)


class ProcessesExecutor:
    """Runs tasks in worker processes of this computer.

    If a worker dies, the pool is rebuilt and unfinished tasks run again. A task that was running at
    several deaths runs alone; if its worker dies three times then, the task is lost
    (`LostTasksError`, after the others have ended). So is a task in which one call of a component
    lasts `dead_after_s`: its worker reports it and ends.
    """

    def __init__(self, workers: int, dead_after_s: float = DEAD_AFTER_S) -> None:
        if workers < 1:  # would wait for ever
            raise ValueError(f"{workers} is not a number of workers; give 1 or more")
        self.workers = workers
        self.dead_after_s = dead_after_s
        self._pool: ProcessPoolExecutor | None = None
        self._context = get_context("spawn")
        #: Tasks that did not return, with the reasons.
        self._stuck = self._context.SimpleQueue()

    def results(
        self, function: Callable[[Any], Any], tasks: Sequence[Any]
    ) -> Iterator[tuple[int, Any]]:
        """Yield the index and the result of each task once, as they end."""
        progress = _Progress(deque(range(len(tasks))), {}, {}, deque(), [])
        running: dict[Future[Any], int] = {}
        while progress.waiting or progress.suspects or running:
            dead = self._filled(running, progress, function, tasks)
            done = wait(running, return_when=FIRST_COMPLETED).done if running else set()
            for future in done:
                if isinstance(future.exception(), BrokenProcessPool):
                    dead = True
                else:
                    yield running.pop(future), future.result()
            if dead:
                yield from self._rebuilt(running, progress)
        if progress.lost or progress.stuck:
            raise LostTasksError(sorted([*progress.lost, *progress.stuck]), progress.stuck)

    def close(self) -> None:
        """End the workers, also those that are in the middle of a task."""
        pool = self._pool
        self._pool = None
        if pool is None:
            return
        if sys.version_info >= (3, 14):
            pool.terminate_workers()
        else:  # no public way
            workers = list((pool._processes or {}).values())
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.terminate()

    def _filled(
        self,
        running: dict[Future[Any], int],
        progress: _Progress,
        function: Callable[[Any], Any],
        tasks: Sequence[Any],
    ) -> bool:
        """Submit tasks until the workers have enough to do; return whether a worker had died
        already.
        """
        # Few are on their way at a time, so that a death puts few under suspicion.
        while progress.waiting and len(running) < 2 * self.workers:
            if not self._submitted(progress.waiting, running, function, tasks):
                return True
        if progress.suspects and not progress.waiting and not running:
            return not self._submitted(progress.suspects, running, function, tasks)
        return False

    def _submitted(
        self,
        queue: deque[int],
        running: dict[Future[Any], int],
        function: Callable[[Any], Any],
        tasks: Sequence[Any],
    ) -> bool:
        if self._pool is None:
            arguments = self._stuck, self.dead_after_s
            self._pool = ProcessPoolExecutor(self.workers, self._context, start_worker, arguments)
        try:
            with one_thread_each():
                running[self._pool.submit(_done, function, queue[0], tasks[queue[0]])] = queue[0]
        except BrokenProcessPool:
            return False
        queue.popleft()
        return True

    def _rebuilt(
        self, running: dict[Future[Any], int], progress: _Progress
    ) -> Iterator[tuple[int, Any]]:
        """Yield what had ended before a worker died, and put the rest back into the queues."""
        wait(running)
        ended = {future: index for future, index in running.items() if future.exception() is None}
        unfinished = sorted(index for future, index in running.items() if future not in ended)
        running.clear()
        self.close()
        while not self._stuck.empty():
            index, reason = self._stuck.get()
            if index in unfinished:
                unfinished.remove(index)
                progress.stuck[index] = reason
        is_alone = len(unfinished) == 1 and unfinished[0] in progress.deaths_alone
        for index in reversed(unfinished):
            _put_back(index, progress, is_alone=is_alone)
        yield from ((index, future.result()) for future, index in ended.items())


def _put_back(index: int, progress: _Progress, *, is_alone: bool) -> None:
    if is_alone:
        progress.deaths_alone[index] += 1
        (
            progress.lost if progress.deaths_alone[index] >= DEATHS_ALONE else progress.suspects
        ).append(index)
        return
    progress.deaths[index] = progress.deaths.get(index, 0) + 1
    if progress.deaths[index] < DEATHS_BESIDE_OTHERS:
        progress.waiting.appendleft(index)
    else:
        progress.deaths_alone[index] = 0
        progress.suspects.append(index)


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Have workers that are started now use one thread each for linear algebra, unless the
    environment says otherwise.

    Each worker has a core; more threads than cores wait for each other.
    """
    missing = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(missing, "1"))
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]


#: What lasts as long as a worker: unreferenced, its watchdog would end.
_WATCHED = ExitStack()
#: The index of the task that this worker is given.
_TASK = [-1]


def _done(function: Callable[[Any], Any], index: int, task: Any) -> Any:
    """Return the result of a task, in a worker."""
    _TASK[0] = index
    return function(task)


def start_worker(stuck: Any, dead_after_s: float) -> None:
    """Prepare a worker: an interrupt from the keyboard is for its parent, and it ends when its
    parent does.

    It also ends, with the reason in the queue `stuck`, if one call of a component lasts
    `dead_after_s`.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end(reason: str) -> None:
        stuck.put((_TASK[0], reason))
        os._exit(STUCK)

    _WATCHED.enter_context(ended_if_stuck(dead_after_s, end))
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait_for_objects([sentinel])
    os._exit(1)
