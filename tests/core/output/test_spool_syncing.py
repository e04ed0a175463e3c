"""The thread that syncs a spool: it ends when it is told, whatever it does at that moment."""

import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from opir_core.output.spool.syncing import SyncThread

WITHIN_S = 1e-4


@pytest.fixture
def _threads_change_often() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("_threads_change_often")
def test_it_ends_whenever_it_is_told() -> None:
    """Stops around the moment at which its wait ends: one that falls between two of its steps is not missed."""
    ended = threading.Event()

    def stop_often() -> None:
        for after_s in np.linspace(0.0, 3.0, 3_000) * WITHIN_S:
            thread = SyncThread(lambda: None, WITHIN_S)
            thread.note_write()
            told_at = time.perf_counter() + after_s
            while time.perf_counter() < told_at:
                pass
            thread.stop()
        ended.set()

    threading.Thread(target=stop_often, daemon=True).start()
    assert ended.wait(30.0), "a thread that was told to stop still waits"
