"""What code asks of the world, and what others ask while it happens to run."""

import gc
import time

import pytest
from opir_testing.execution_monitor import outside_inputs


def many_containers() -> list[list[int]]:
    return [[number] for number in range(200_000)]


@pytest.mark.slow
def test_callbacks_of_the_collector_are_no_inputs():
    def timed(phase, info):
        time.perf_counter()

    gc.callbacks.append(timed)
    try:
        assert outside_inputs(many_containers) == []
        assert gc.isenabled()
    finally:
        gc.callbacks.remove(timed)


def test_the_clock_is_seen_however_it_was_imported():
    from time import monotonic

    (reported,) = outside_inputs(lambda: monotonic())
    assert reported.startswith(
        "the clock: time.monotonic (testing/test_execution_monitor.py, line "
    )
