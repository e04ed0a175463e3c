"""The thread that makes the log of a spool last, whatever those that fill and send the spool are waiting for."""

import threading
from pathlib import Path

from opir_core.errors import reason_of
from opir_core.output.temporary_files import sync_path

#: Time, s, from a write to its sync: with what the disk takes, the longest time for which a power cut may undo it.
SYNC_S = 0.5


class LogSync:
    """Syncs a log after writes; `fault` is why the last sync failed, or ""."""

    def __init__(self, log: Path) -> None:
        self.fault = ""
        self._log = log
        self._written, self._stopping = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"opir sync {log.name}", daemon=True)
        self._thread.start()

    def note_write(self) -> None:
        """Let what is in the log now be synced within `SYNC_S`."""
        self._written.set()

    def stop(self) -> None:
        """End the thread."""
        self._stopping.set()
        self._written.set()
        self._thread.join()

    def _work(self) -> None:
        while self._written.wait() and not self._stopping.wait(SYNC_S):
            self._written.clear()
            try:
                sync_path(self._log)  # a log has no locks, which closing a descriptor would give up
                self.fault = ""
            except OSError as error:
                self.fault = f"its disk answers {reason_of(error)!r}"
                self._written.set()
