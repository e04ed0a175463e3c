"""The window of batches that are sent and not yet acknowledged."""

from collections.abc import Collection
from concurrent.futures import Future

from attrs import frozen

from opir_core.interfaces.records import Batch

#: Maximum bytes of messages that are sent and not yet acknowledged.
AHEAD_BYTES = 8 << 20


@frozen(eq=False, repr=False)
class Sent:
    """A batch under way: its number in the backlog and its acknowledgement."""

    number: int
    size: int
    future: "Future[None]"

    @property
    def has_failed(self) -> bool:
        """Whether the transport has given it up."""
        return self.future.done() and (
            self.future.cancelled() or self.future.exception() is not None
        )


class SentBatches:
    """The batches under way, in the order of sending; they belong to one thread."""

    def __init__(self) -> None:
        self._sent: list[Sent] = []
        self._bytes = 0

    def __len__(self) -> int:
        """Return the number of batches under way."""
        return len(self._sent)

    @property
    def has_room(self) -> bool:
        """Whether another may be sent: not behind one that failed, which it would overtake."""
        return self._bytes < AHEAD_BYTES and not (self._sent and self._sent[-1].has_failed)

    def add(self, number: int, batch: Batch, future: "Future[None]") -> None:
        """Add a batch that was sent."""
        self._sent.append(Sent(number, len(batch.body), future))
        self._bytes += len(batch.body)

    def done(self) -> list[Sent]:
        """Return the batches that are acknowledged or have failed."""
        return [sent for sent in self._sent if sent.future.done()]

    def remove(self, done: Collection[Sent]) -> None:
        """Remove batches."""
        self._sent = [sent for sent in self._sent if sent not in done]
        self._bytes -= sum(sent.size for sent in done)
