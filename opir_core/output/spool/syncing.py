"""The thread that makes what was written last, whatever those that fill and send a spool are
waiting for.
"""

import threading
from collections.abc import Callable

from opir_core.errors import reason_of

#: Time, s, from a write into a spool to its sync. A power cut may undo so much, and what the disk
#: and a busy machine take, together at most a second.
SPOOL_SYNC_S = 0.25
#: Shortest time, s, between two syncs of a sink, after which its events are acknowledged.
SINK_SYNC_S = 0.05


class SyncThread:
    """Calls `sync` within `within_s` after a write; `fault` is why the last call failed, or ""."""

    def __init__(self, sync: Callable[[], None], within_s: float) -> None:
        self.fault = ""
        self._sync = sync
        self._within_s = within_s
        self._written = threading.Event()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name="opir sync", daemon=True)
        self._thread.start()

    def note_write(self) -> None:
        """Let what is written now be synced."""
        self._written.set()

    def stop(self) -> None:
        """End the thread; it does not sync what was written last."""
        self._stopping.set()
        self._written.set()
        self._thread.join()

    def _work(self) -> None:
        # `stop` sets both events: one that comes just before `clear` is seen by `is_set`.
        while (
            not self._stopping.is_set()
            and self._written.wait()
            and not self._stopping.wait(self._within_s)
        ):
            self._written.clear()
            try:
                self._sync()
                self.fault = ""
            except OSError as error:
                self.fault = f"its disk answers {reason_of(error)!r}"
                self._written.set()
