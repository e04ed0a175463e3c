"""The batches that are sent, until what became of them is noted."""

from collections import deque
from collections.abc import Collection
from concurrent.futures import Future

from attrs import frozen

from opir_core.interfaces.records import Batch

#: No further batch is sent from so many bytes of messages under way on.
AHEAD_BYTES = 8 << 20


@frozen(eq=False, repr=False)
class Sent:
    """A batch under way: its number in the backlog and its acknowledgement."""

    number: int
    size: int
    future: "Future[None]"

    @property
    def has_failed(self) -> bool:
        """Whether its future ended without an acknowledgement: refused, partly sent or cancelled."""
        return self.future.done() and (
            self.future.cancelled() or self.future.exception() is not None
        )


class SentBatches:
    """The batches under way, in the order of sending; they belong to one thread."""

    def __init__(self) -> None:
        self._sent: dict[Sent, None] = {}
        self._done: dict[Sent, None] = {}
        # Acknowledged or failed in other threads, and not yet seen by this one: a search of all
        # under way at each acknowledgement would take quadratic time.
        self._just_ended: deque[Sent] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        """Return the number of batches under way."""
        return len(self._sent)

    @property
    def has_room(self) -> bool:
        """Whether another may be sent: not right behind one that failed, which it would overtake."""
        last = next(reversed(self._sent), None)
        return self._bytes < AHEAD_BYTES and not (last and last.has_failed)

    def add(self, number: int, batch: Batch, future: "Future[None]") -> None:
        """Add a batch that was sent."""
        sent = Sent(number, len(batch.body), future)
        self._sent[sent] = None
        self._bytes += sent.size
        future.add_done_callback(lambda _done: self._just_ended.append(sent))

    def done(self) -> list[Sent]:
        """Return the batches that are acknowledged or have failed, in the order of sending."""
        while self._just_ended:
            self._done[self._just_ended.popleft()] = None
        return sorted(self._done, key=lambda sent: sent.number)

    def remove(self, done: Collection[Sent]) -> None:
        """Remove batches that `done` returned."""
        for sent in done:
            del self._sent[sent], self._done[sent]
            self._bytes -= sent.size
