"""Waits with a deadline, for another thread or process."""

import threading
import time
from concurrent.futures import Future
from typing import TypeVar

Result = TypeVar("Result")


def until(is_so, within_s=60.0):
    """Wait until a condition is met; fail at the deadline."""
    give_up_at = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < give_up_at, "the condition is not met in time"
        time.sleep(0.005)


def within(seconds, call):
    """Return what a call that may block for ever returns, or raise what it raises; `TimeoutError`
    at the deadline.
    """
    answer = Future()

    def run():
        try:
            answer.set_result(call())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return answer.result(seconds)
