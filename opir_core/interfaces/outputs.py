"""The contracts of outputs: sinks, transports and event encoders.

Each is one base class: the abstract methods, and the properties that say so, are required; the
others have defaults. A part that has the methods and another base class works too
(`PluginPart.adopt`).
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

from attrs import frozen

from opir_core.arrays import BoolArray
from opir_core.interfaces.contract import PluginPart, optional, required
from opir_core.interfaces.records import Batch, Window

if TYPE_CHECKING:
    from concurrent.futures import Future


@frozen
class Delivery:
    """Delivery counts of a sink: delivered + spooled + dropped + withheld = events written +
    recovered.

    `spooled` wait in a spool; `withheld` have no message in the encoder; `recovered` are events of
    an earlier run that were still in the spool. `complaint` is the reason of a failed delivery.
    """

    delivered: int
    spooled: int = 0
    dropped: int = 0
    withheld: int = 0
    recovered: int = 0
    complaint: str | None = None


class Sink(PluginPart):
    """A destination of events. A sink that fails raises `SinkError`; the other sinks continue.

    A sink's `build` may return a `Transport` instead; the core makes a sink of it.

    >>> class Census(Sink):
    ...     written = 0
    ...
    ...     def write(self, window):
    ...         self.written += len(window.detections)
    ...
    ...     def close(self):
    ...         return Delivery(delivered=self.written)
    >>> Census().close()
    Delivery(delivered=0, spooled=0, dropped=0, withheld=0, recovered=0, complaint=None)
    """

    @abstractmethod
    def write(self, window: Window) -> None:
        """Accept a window's events."""

    @abstractmethod
    def close(self) -> Delivery:
        """Release all resources and return the delivery counts; called once, also after a
        failure.
        """

    def sync(self) -> None:
        """Make what was written outlast a power cut: then its events leave a spool; callable from
        any thread.
        """
        return

    def delivery_so_far(self) -> Delivery | None:
        """Return the counts of an open sink, None to count what is written as delivered; callable
        from any thread.

        `spooled` are all events that are not delivered yet.
        """
        return None

    def close_by(self, deadline_s: float) -> None:
        """Be closed by `deadline_s` of the monotonic clock, delivered or not; callable from any
        thread.
        """
        return

    @optional
    def takes_quiet_windows(self) -> bool:
        """Whether a live run passes the sink windows without events too: it tells of silence."""
        return False

    @optional
    def waits(self) -> int:
        """How often `write` has waited for room in the sink's own buffer."""
        return 0

    @optional
    def outlives_the_process(self) -> bool | None:
        """Whether the next run finds the events left in the sink's buffer at closing; None for a
        sink without a buffer.
        """
        return None

    @optional
    def parked(self) -> str | None:
        """Why the destination refuses the events that the sink keeps for it, or None; callable from
        any thread.
        """
        return None

    @optional
    def trouble(self) -> str | None:
        """Why nothing gets through at the moment; None while all is well; callable from any
        thread.
        """
        return None

    @optional
    def attempts(self) -> int:
        """Number of failed attempts since the last success; callable from any thread."""
        return 0

    def retry(self) -> bool:
        """Try again at once; return whether the sink was parked; callable from any thread."""
        return False


class PartlySentError(Exception):
    """In the future of a batch at closing: `rows`, in order, are not acknowledged, and the others
    are.
    """

    def __init__(self, rows: Sequence[int]) -> None:
        super().__init__(f"{len(rows)} events are not acknowledged")
        self.rows = rows


class Transport(PluginPart):
    """Sends encoded events and acknowledges them later: a sink's `build` may return one.

    The core makes a sink of it: it encodes, queues in memory or in a spool, and calls the transport
    from a thread of its own, a few megabytes ahead of the acknowledgements. A transport retries by
    itself while it is open.

    >>> from concurrent.futures import Future
    >>> class Mailbox(Transport):
    ...     letters = []
    ...
    ...     def send(self, batch):
    ...         self.letters += batch.messages()
    ...         acknowledged = Future()
    ...         acknowledged.set_result(None)
    ...         return acknowledged
    ...
    ...     def close(self, wait_s):
    ...         pass
    >>> batch = Batch(
    ...     body=b"{}\\n", keys=("S-1",), key_of=[0], content_type="application/json", schema_version="1"
    ... )
    >>> Mailbox().send(batch).done(), Mailbox.letters
    (True, [b'{}'])
    """

    @abstractmethod
    def send(self, batch: Batch) -> "Future[None]":
        """Send events without blocking; those of one key arrive in the order in which they were
        given.

        The future is done once every event is acknowledged. A `SinkError` in it is final: a sink
        without a spool has failed; one with a spool is parked, and sends the batch again later (see
        `retry`).
        """

    @abstractmethod
    def close(self, wait_s: float) -> None:
        """Release all resources within `wait_s` seconds; futures that are not done by then are
        cancelled.

        The future of a batch that is acknowledged in part may have a `PartlySentError`: only its
        rest is sent again.
        """

    @optional
    def trouble(self) -> str | None:
        """The reason why nothing gets through at the moment; None while all is well."""
        return None

    @optional
    def attempts(self) -> int:
        """Number of failed attempts since the last success."""
        return 0

    @optional
    def acknowledged(self) -> int:
        """The number of events that were acknowledged so far, in batches that are not whole too:
        the progress.
        """
        return 0

    def retry(self) -> None:
        """Forget a final error: the batches that follow are sent as if there had been none."""
        return


class Container(Protocol):
    """A form of files of binary messages: a head, then blocks.

    >>> class Counted(Container):
    ...     head = b"C"
    ...
    ...     def block(self, body):
    ...         return len(body).to_bytes(4, "big") + body
    ...
    ...     def whole(self, file):
    ...         return len(file.read())
    >>> Counted().block(b"two")
    b'\\x00\\x00\\x00\\x03two'
    """

    head: bytes

    def block(self, body: bytes) -> bytes:
        """Return the block of the messages of a body, as `binary_body` returns them."""

    def whole(self, file: BinaryIO) -> int:
        """Return how many bytes of a file its head and its whole blocks are, 0 without a whole head.

        Raises `SinkError` for a file with another head.
        """


class Encoder(PluginPart):
    """Detections to message bytes; tracks to message bytes if it `encodes_tracks`.

    >>> from opir_testing.doubles import stub_window
    >>> class Times(Encoder):
    ...     content_type = "application/json"
    ...     schema_version = "times-1"
    ...
    ...     def encode(self, window):
    ...         return b"".join(b"%.1f\\n" % time_s for time_s in window.detections.time_s)
    >>> Times().encode(stub_window(2)).count(b"\\n")
    2
    """

    @required
    def content_type(self) -> str:
        """The media type of a message; required."""

    @required
    def schema_version(self) -> str:
        """The version of the schema that the messages follow; required."""

    @abstractmethod
    def encode(self, window: Window) -> bytes:
        """Return the window's detections, or tracks, as messages, each ended by a newline and none
        containing one; binary ones as `opir_core.output.binary_body` returns them.
        """

    @optional
    def encodes_tracks(self) -> bool:
        """Whether messages are the rows of `window.tracks`, and the event counts of outputs are of
        tracks.

        Outputs pass such an encoder every window with tracks, with detections or without.
        """
        return False

    @optional
    def container(self) -> Container | None:
        """The form of files and pipes of messages; None for messages one after the other."""
        return None

    def encodable(self, window: Window) -> BoolArray | None:
        """Return which detections (n,) have a message; None if all have."""
        return None


def sink_or_transport(product: Any, owner: Callable[[], str] | None = None) -> Sink | Transport:
    """Return the product of a sink's `build` as a sink or a transport; raises `ModelError` for
    neither.
    """
    if isinstance(product, Transport) or (hasattr(product, "send") and hasattr(product, "trouble")):
        return Transport.adopt(product, owner)
    return Sink.adopt(product, owner)
