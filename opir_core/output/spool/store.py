"""The events of a sink that wait: the backlog with its lock, the event counts, and the faults of
its disk.
"""

import threading
from collections.abc import Sequence

from attrs import define

from opir_core.interfaces.outputs import Delivery
from opir_core.interfaces.records import Batch
from opir_core.output.spool.batches import Backlog, DamagedError, FullError
from opir_core.output.spool.salvage import Salvage


@define(eq=False, repr=False)
class Books:
    """Counts of a sink's events, but for those that wait; as in `Delivery`."""

    recovered: int
    dropped: int
    delivered: int = 0
    withheld: int = 0


class Store:
    """A backlog that is filled at one end and sent from at the other.

    The lock `room` guards all of it, and whoever waits for room waits on it; it is never held while
    the transport works. `read_to` is the number of the last batch that was read for sending.
    """

    def __init__(self, name: str, backlog: Backlog, damage: Salvage | None) -> None:
        self.name = name
        self.backlog = backlog
        self.room = threading.Condition()
        # Events of an earlier run that were lost with a damaged spool were recovered and dropped.
        lost = 0 if damage is None else damage.state.lost_events
        self.books = Books(backlog.waiting + lost, lost)
        self.read_to = 0
        #: What of the spool is damaged, why the disk did not take the last bytes, and why it cannot
        #: be read.
        self.damage = None if damage is None else f"{name}: the spool {self._place}: {damage}"
        self._unwritten = ""
        self._unread = ""

    def delivery(self, complaint: str | None) -> Delivery:
        """Return the counts; `spooled` are the events that wait."""
        books = self.books
        waiting = self.backlog.waiting
        return Delivery(
            books.delivered, waiting, books.dropped, books.withheld, books.recovered, complaint
        )

    @property
    def fault(self) -> str | None:
        """Why the spool's disk fails, or None."""
        if unwritten := self._unwritten or self.backlog.sync_fault:
            return f"{self.name}: the spool {self._place} cannot be written: {unwritten}"
        return self._unread or None

    def full(self, trouble: str | None) -> str:
        """Return the error of a full backlog; `trouble` is the transport's."""
        why = self._unwritten or trouble
        return (
            f"{self.name}: {f'its spool {self._place}' if self._place else 'its queue'}"
            f" {'cannot be written' if self._unwritten else 'is full'}, with {self.backlog.waiting}"
            f" events that wait"
            f"{f': {why}' if why else ''}"
        )

    def put(self, batch: Batch) -> bool:
        """Add a batch; return whether there was room."""
        try:
            self.backlog.put(batch)
        except FullError as error:
            self._unwritten = str(error)
            return False
        self._unwritten = ""
        return True

    def drop_oldest(self) -> int | None:
        """Drop the oldest batch that was not read yet; return its number of events, None if that
        makes no room.
        """
        try:
            lost = self.backlog.drop_oldest(self.read_to)
        except FullError:  # the disk itself is full, and deleting needs room too
            return None
        self.books.dropped += lost or 0
        return lost

    def next(self) -> tuple[int, Batch] | None:
        """Return the next batch to send, None if there is none or it cannot be read now; skip those
        that are damaged.

        What is damaged stays in the file, until the next start sets that aside.
        """
        with self.room:
            while True:
                try:
                    numbered = self.backlog.after(self.read_to)
                except FullError as error:  # what the disk keeps is sent later
                    if not self.backlog.is_empty:
                        why = str(error) or "its disk is full"
                        self._unread = f"{self.name}: the spool {self._place} cannot be read: {why}"
                    return None
                except DamagedError as error:
                    self.damage = f"{self.name}: {error}"
                    self.read_to = error.number
                    continue
                self._unread = ""
                if numbered is not None:
                    self.read_to = numbered[0]
                return numbered

    def acknowledge(self, numbers: list[int]) -> None:
        """Remove delivered batches; raise `FullError` if the disk has no room to note it."""
        with self.room:
            former_waiting = self.backlog.waiting
            self.backlog.acknowledge(numbers)
            self.books.delivered += former_waiting - self.backlog.waiting
            self._unread = "" if self.backlog.is_empty else self._unread
            self.room.notify_all()

    def keep(self, number: int, rows: Sequence[int]) -> None:
        """Remove the events of a batch that are delivered, all but `rows`."""
        with self.room:
            former_waiting = self.backlog.waiting
            self.backlog.keep(number, rows)
            self.books.delivered += former_waiting - self.backlog.waiting

    @property
    def _place(self) -> str:
        return str(getattr(self.backlog, "path", ""))
