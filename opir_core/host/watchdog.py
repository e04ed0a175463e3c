"""The watchdog: a thread that notices what does not return, for commands, workers and services
alike.
"""

import math
import os
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from attrs import define, field

from opir_core.host.boundary import overdue_call, place_of_thread

#: The exit code of a process that its watchdog has ended.
STUCK = 6
#: Time, s, that a call of a component may last in a command, unless `--dead-after` says otherwise.
DEAD_AFTER_S = 600.0
#: Longest interval, s, between two checks.
CHECK_S = 0.5
#: A check that is late by more than this, s, shows that the process was paused: stopped, or its
#: machine suspended.
PAUSED_S = 2.0


@define(eq=False)
class Watchdog:
    """A thread that asks for the reason why something is stuck, and reports the first one.

    `reason` returns "" while all is well; then `on_well` is called. `on_stuck` is called with the
    reason, in the watchdog's thread, which ends; None only stops the calls of `on_well`. It watches
    its own beat first: after a pause of the process nothing is called stuck before it had
    `dead_after_s` again, except what is `final`, a failure.
    """

    reason: Callable[[], str]
    on_stuck: Callable[[str], None] | None
    dead_after_s: float = DEAD_AFTER_S
    on_well: Callable[[], None] = lambda: None
    final: Callable[[], str] = lambda: ""
    interval_s: float = CHECK_S
    pauses: int = field(default=0, init=False)
    longest_pause_s: float = field(default=0.0, init=False)
    _stopping: threading.Event = field(factory=threading.Event, init=False)

    def start(self) -> None:
        """Start the thread."""
        threading.Thread(target=self._work, name="opir-watchdog", daemon=True).start()

    def stop(self) -> None:
        """End the checks."""
        self._stopping.set()

    def _work(self) -> None:
        beat_s = time.monotonic()
        judged_from_s = -float("inf")
        while not self._stopping.wait(self.interval_s):
            now_s = time.monotonic()
            if now_s - beat_s > self.interval_s + PAUSED_S:
                judged_from_s = now_s + self.dead_after_s
                self.pauses += 1
                self.longest_pause_s = max(self.longest_pause_s, now_s - beat_s - self.interval_s)
            beat_s = now_s
            try:
                stuck_reason = self.reason()
                reason = self.final() or (stuck_reason if now_s >= judged_from_s else "")
            except BaseException as error:
                reason = f"the watchdog has failed: {type(error).__name__}: {error}"
            if not reason:
                self.on_well()
            elif self.on_stuck is not None and not self._stopping.is_set():
                self.on_stuck(reason)
                return


#: The limits that are set, s, the last in force; processes inherit them that are copied from this
#: one.
_SET: list[float] = []


def limit_in_force(otherwise_s: float = DEAD_AFTER_S) -> float:
    """Return the time, s, that a call of a component may last: as `--dead-after` says, or else
    `otherwise_s`.
    """
    return _SET[-1] if _SET else otherwise_s


@contextmanager
def ended_if_stuck(
    dead_after_s: float | None = None, on_stuck: Callable[[str], None] | None = None
) -> Iterator[None]:
    """End this process if a component that this thread calls does not return within `dead_after_s`.

    By default the limit is that in force; `on_stuck` is called with the reason instead.
    """
    thread = threading.get_ident()
    within_s = dead_after_s or limit_in_force()
    watchdog = Watchdog(lambda: overdue_call(thread, within_s), on_stuck or _end_process, within_s)
    outer_limits = _SET.copy()
    _SET.extend([dead_after_s] if dead_after_s else [])
    watchdog.start()
    try:
        yield
    finally:
        watchdog.stop()
        _SET[:] = outer_limits


def _end_process(reason: str) -> None:
    """Print the reason and end this process with `STUCK`, without waiting for its threads: one may
    never return.
    """
    sys.stderr.write(f"opir: {reason}; the watchdog ends this process with exit code {STUCK}\n")
    sys.stderr.flush()
    os._exit(STUCK)


class OverdueError(Exception):
    """A call in another thread that does not return; its text is the line that the thread
    executes.
    """


class CallThread:
    """A thread for calls that may not return; it is left behind then, and ends after its last
    call.
    """

    def __init__(self) -> None:
        self._calls = queue.SimpleQueue[
            tuple[Callable[[], Any], list[Any], threading.Event, bool]
        ]()
        self._thread = threading.Thread(target=self._work, name="opir-call", daemon=True)
        self._thread.start()

    def result(self, call: Callable[[], Any], within_s: float, *, is_last: bool = False) -> Any:
        """Return the result of a call, or re-raise its error; `OverdueError` after `within_s`."""
        answer = list[Any]()
        is_there = threading.Event()
        self._calls.put((call, answer, is_there, is_last))
        # In steps: a pause of the process counts as one, however long.
        if not any(is_there.wait(CHECK_S) for _ in range(math.ceil(within_s / CHECK_S))):
            raise OverdueError(place_of_thread(self._thread.ident))
        value, error = answer
        if error is not None:
            raise error
        return value

    def _work(self) -> None:
        is_last = False
        while not is_last:
            call, answer, is_there, is_last = self._calls.get()
            try:
                answer += (call(), None)
            except BaseException as error:
                answer += (None, error)
            is_there.set()
