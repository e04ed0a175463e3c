"""The sync thread of a spool: `SyncThread.stop` ends it in any state."""

import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from opir_core.output.spool import SyncThread

WITHIN_S = 1e-4


@pytest.fixture
def _threads_change_often() -> Iterator[None]:
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval_s)


@pytest.mark.usefixtures("_threads_change_often")
def test_stop_ends_the_thread_in_any_state() -> None:
    """Stops at 3 000 times after a write, about the end of the delay before its sync."""
    ended = threading.Event()

    def stop_often() -> None:
        for after_s in np.linspace(0.0, 3.0, 3_000) * WITHIN_S:
            thread = SyncThread(lambda: None, WITHIN_S)
            thread.note_write()
            stop_at = time.perf_counter() + after_s
            while time.perf_counter() < stop_at:
                pass
            thread.stop()
        ended.set()

    threading.Thread(target=stop_often, daemon=True).start()
    assert ended.wait(30.0), "`stop` has not returned"
