"""The watchdog of commands: it names the call that does not return; and calls in a thread that may
not.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from opir_testing.bench import bench_scene
from waiting import until

import opir_core as opir
from opir_core.host import DEAD_AFTER_S, ended_if_stuck
from opir_core.host.boundary import PluginErrors, blamed_call, overdue_call
from opir_core.host.watchdog import CallThread, OverdueError, limit_in_force

ME = threading.get_ident()


@pytest.fixture
def over() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


def begun(name: str, call: Callable[[], object]) -> int:
    """Begin a call of a component in a thread of its own; return the thread."""
    thread = threading.Thread(
        target=lambda: blamed_call(lambda: name, "hint", "step", call), daemon=True
    )
    thread.start()
    assert thread.ident is not None
    return thread.ident


def test_a_call_that_does_not_return_is_named_with_its_line(over: threading.Event) -> None:
    thread = begun("the tracker 'x'", over.wait)
    until(lambda: overdue_call(thread, 0.2))
    assert overdue_call(thread, 0.2).startswith("the tracker 'x': step has not returned for 0.")
    assert "test_overdue_calls.py, line " in overdue_call(thread, 0.2)
    assert overdue_call(thread, 60.0) == ""
    over.set()
    until(lambda: not overdue_call(thread, 0.0))


def test_the_innermost_call_is_named(
    over: threading.Event,
) -> None:
    inner = threading.Event()

    def outer() -> None:
        blamed_call(lambda: "inner", "hint", "build", inner.wait)
        over.wait()

    thread = begun("outer", outer)
    until(lambda: overdue_call(thread, 0.3))
    assert overdue_call(thread, 0.3).startswith("inner: build")
    inner.set()
    until(lambda: not overdue_call(thread, 0.3))
    until(lambda: overdue_call(thread, 0.3))
    assert overdue_call(thread, 0.3).startswith("outer: step")


def test_a_call_may_return_while_it_is_looked_at(
    over: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    thread = begun("short", over.wait)
    until(lambda: overdue_call(thread, 0.0))
    ended = next(
        call_thread for call_thread in threading.enumerate() if call_thread.ident == thread
    )
    clock = time.monotonic

    def late() -> float:
        if threading.get_ident() == ME and ended.is_alive():
            over.set()
            ended.join()
        return clock()

    monkeypatch.setattr("opir_core.host.boundary.time.monotonic", late)
    assert overdue_call(thread, 0.0).startswith("short: step has not returned for ")
    assert overdue_call(thread, 0.0) == ""


def test_each_block_of_looks_is_a_sign_of_life() -> None:
    """A window of millions of looks may take longer than one call of a component."""
    plan = opir.compile_plan(opir.scene_from_mapping(bench_scene()))
    zero = np.zeros(1, dtype=np.int64)
    with PluginErrors(plan.host, plan.scene):
        until(lambda: overdue_call(ME, 0.3))
        plan.look_geometry().exposures(zero, zero)
        assert overdue_call(ME, 0.3) == ""


def test_only_calls_of_the_thread_that_is_watched_end_it(over: threading.Event) -> None:
    reasons: list[str] = []
    begun("another", over.wait)
    with ended_if_stuck(0.1, reasons.append):
        time.sleep(1.2)  # no call of a component: a long pause between two is no reason
        assert reasons == []
        blamed_call(lambda: "mine", "hint", "step", lambda: until(lambda: reasons))
    assert reasons[0].startswith("mine: step has not returned for ")


def test_a_call_in_a_thread_returns_raises_or_is_given_up(over: threading.Event) -> None:
    calls = CallThread()
    assert calls.result(lambda: 7, 60.0) == 7
    with pytest.raises(ZeroDivisionError):
        calls.result(lambda: 1 // 0, 60.0)
    with pytest.raises(OverdueError, match=r"test_overdue_calls\.py, line"):
        calls.result(lambda: over.wait(60.0), 0.1)


def test_a_thread_for_calls_ends_after_the_last_call() -> None:
    calls = CallThread()
    assert calls.result(threading.get_ident, 60.0) == calls.result(
        threading.get_ident, 60.0, is_last=True
    )
    until(lambda: not calls._thread.is_alive())


def test_a_pause_of_the_process_is_not_the_time_of_a_call(over: threading.Event) -> None:
    """A process that sleeps in a signal handler for longer than the limit, as one that was stopped,
    gets its answer.
    """
    calls = CallThread()
    main = signal.getsignal(signal.SIGALRM)
    signal.signal(signal.SIGALRM, lambda *_: (time.sleep(2.5), over.set()))
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        assert calls.result(lambda: over.wait(60.0), 2.0)
    finally:
        signal.signal(signal.SIGALRM, main)


def test_a_limit_that_is_set_is_in_force() -> None:
    assert (limit_in_force(), limit_in_force(30.0)) == (DEAD_AFTER_S, 30.0)
    with ended_if_stuck(), ended_if_stuck(7.0):
        with ended_if_stuck():
            assert (limit_in_force(), limit_in_force(30.0)) == (7.0, 7.0)
        with ended_if_stuck(50.0):
            assert limit_in_force(30.0) == 50.0
        assert limit_in_force(30.0) == 7.0
    assert limit_in_force(30.0) == 30.0
