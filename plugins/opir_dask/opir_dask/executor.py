"""Tasks on the workers of a Dask scheduler; those whose worker dies run again."""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from itertools import islice
from typing import Any

from distributed import Client, Future, LocalCluster, wait
from distributed.scheduler import KilledWorker
from opir_studies import LostTasksError

from opir_core.errors import OpirError

#: So many tasks are on their way per worker: enough to keep it busy, and few to run again if the
#: study is stopped.
_AHEAD = 4
#: Time, s, between two looks at the cluster while no task ends.
_LOOK_S = 1.0


class DaskExecutor:
    """Runs tasks on the cluster at an address, or on as many worker processes of this computer.

    Dask runs a task again if its worker dies; one that was running at several deaths is lost
    (`LostTasksError`, after the others have ended). Nothing is started before the first task.
    """

    def __init__(self, address: str, workers: int | None, timeout_s: float) -> None:
        self._address = address
        self._workers = workers
        self._timeout_s = timeout_s
        self._client: Client | None = None
        self._cluster: LocalCluster | None = None

    def results(
        self, function: Callable[[Any], Any], tasks: Sequence[Any]
    ) -> Iterator[tuple[int, Any]]:
        """Yield the index and the result of each task once, as they end."""
        if not tasks:
            return
        client = self._connected()
        lost = []
        waiting = iter(range(len(tasks)))
        number: dict[Future, int] = {}

        def submit(count: int) -> None:
            for index in islice(waiting, count):
                # Not pure: the same task of two studies is not the same result to Dask.
                future = client.submit(function, tasks[index], pure=False)
                number[future] = index

        submit(_AHEAD * max(1, len(client.scheduler_info(n_workers=-1)["workers"])))
        while number:
            for future in self._ended(client, set(number)):
                outcome = self._outcome(future)
                if outcome is None:
                    break
                index = number.pop(future)
                if outcome:
                    yield index, outcome[0]
                else:
                    lost.append(index)
                submit(1)
        if lost:
            raise LostTasksError(sorted(lost))

    def _outcome(self, future: Future) -> Any:
        """Return the result of a task that has ended, alone; nothing if the task is lost, None if
        its worker died with the result, so that it runs again, or the scheduler.
        """
        try:
            error = future.exception(self._timeout_s)
            result = None if error else future.result(self._timeout_s)
        except (CancelledError, OSError):
            return None
        if future.cancelled():
            return None
        if error and not isinstance(error, KilledWorker):
            raise error
        return () if error else (result,)

    def _ended(self, client: Client, running: set[Future]) -> set[Future]:
        """Return tasks that have ended, at least one; raises `OpirError` if the scheduler ends, or
        has no worker for `timeout_s`.
        """
        seen_s = time.monotonic()
        while True:
            try:
                ended: set[Future] = wait(running, _LOOK_S, "FIRST_COMPLETED").done
            except TimeoutError:
                is_alive = (
                    client.status == "running" and client.scheduler_info(n_workers=-1)["workers"]
                )
                seen_s = time.monotonic() if is_alive else seen_s
                if time.monotonic() - seen_s > self._timeout_s:
                    raise self._failure(client) from None
            except (CancelledError, OSError) as error:
                raise self._failure(client) from error
            else:
                if any(future.cancelled() for future in ended):
                    raise self._failure(client)
                return ended

    def _failure(self, client: Client) -> OpirError:
        place = self._address or "on this computer"
        words = f"the Dask scheduler {place} has ended or been restarted"
        if client.status == "running" and not client.scheduler_info(n_workers=-1)["workers"]:
            words = f"the Dask scheduler {place} has had no worker for {self._timeout_s:g} s"
        way = "start it and its workers, and run the study again: it goes on where it stopped"
        return OpirError(f"{words}; {way}")

    def close(self) -> None:
        """Leave the cluster, or end the workers of this computer; allowed several times."""
        connections = (self._client, self._cluster)
        self._client = None
        self._cluster = None
        for connection in filter(None, connections):
            with suppress(OSError, TimeoutError):
                connection.close()

    def _connected(self) -> Client:
        if self._client is None:
            self._client = (
                Client(self._place(), timeout=self._timeout_s)
                if not self._address
                else self._at_address()
            )
        return self._client

    def _place(self) -> LocalCluster:
        # Runs are Python: threads of one process would wait for each other. Nothing listens to the
        # outside.
        self._cluster = LocalCluster(
            n_workers=self._workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            host="127.0.0.1",
        )
        return self._cluster

    def _at_address(self) -> Client:
        try:
            return Client(self._address, timeout=self._timeout_s)
        except (OSError, TimeoutError, ValueError) as error:
            words = (
                f"no Dask scheduler answers at {self._address} within {self._timeout_s:g} s:"
                f" {error}"
            )
            raise OpirError(
                f"{words}; start one with `dask scheduler`, or give its address"
            ) from error
