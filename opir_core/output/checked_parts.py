"""Sinks and encoders of plugins behind the boundary: what they raise or return wrongly fails only
the output.

So does a call of a sink that does not return, in a batch run.
"""

from collections.abc import Callable
from typing import Any

from opir_core.arrays import BoolArray
from opir_core.errors import OpirError, SinkError, kind_of
from opir_core.host.boundary import blamed_call
from opir_core.host.watchdog import CallThread, OverdueError
from opir_core.interfaces.outputs import Delivery, Encoder, Sink
from opir_core.interfaces.records import Window, framed_messages


class CheckedPart:
    """A part of a plugin; `owner()` returns the beginning of messages, `hint` is their end."""

    def __init__(self, component: Any, owner: Callable[[], str], hint: str) -> None:
        self._part = component
        self._owner = owner
        self._hint = hint

    def _called(self, method: str, *arguments: Any) -> Any:
        try:
            return blamed_call(
                self._owner, self._hint, method, lambda: getattr(self._part, method)(*arguments)
            )
        except SinkError:
            raise
        except OpirError as error:
            raise SinkError(str(error)) from error

    def _wrong(self, words: str) -> SinkError:
        return SinkError(f"{self._owner()}: {words}; {self._hint}")


def _of_part(name: str, words: str) -> Any:
    """Return a property that is the part's own."""
    return property(lambda checked: getattr(checked._part, name), doc=words)


class CheckedSink(CheckedPart, Sink):
    """A sink of which every error is a `SinkError`: the other sinks continue.

    `within_s` is how long `write` or `close` may last, each called in a thread of the sink; None if
    they have no limit.
    """

    def __init__(
        self, component: Any, owner: Callable[[], str], hint: str, within_s: float | None = None
    ) -> None:
        super().__init__(component, owner, hint)
        self._within_s = within_s
        self._thread = CallThread() if within_s else None
        self._stuck = ""

    def write(self, window: Window) -> None:
        """Write a window."""
        self._limited("write", window)

    def close(self) -> Delivery:
        """Close the sink and return its counts."""
        delivery = self._limited("close")
        if not isinstance(delivery, Delivery):
            raise self._wrong(f"close returned {kind_of(delivery)}, no opir_core.plugin.Delivery")
        return delivery

    def delivery_so_far(self) -> Any:
        """Return the counts so far."""
        return self._called("delivery_so_far")

    def close_by(self, deadline_s: float) -> None:
        """Pass on the deadline."""
        self._called("close_by", deadline_s)

    def _limited(self, method: str, *arguments: Any) -> Any:
        """Return the result of a call; `SinkError` if it does not return in time, and at once for
        every later call.
        """
        if self._thread is None or self._within_s is None:
            return self._called(method, *arguments)
        if self._stuck:
            raise SinkError(self._stuck)
        is_last = method == "close"
        try:
            return self._thread.result(
                lambda: self._called(method, *arguments), self._within_s, is_last=is_last
            )
        except OverdueError as place:
            self._stuck = (
                f"{self._owner()}: {method} has not returned for {self._within_s:g} s: in {place}"
            )
            raise SinkError(self._stuck) from None

    takes_quiet_windows = _of_part(
        "takes_quiet_windows", "Whether it takes windows without events."
    )
    waits = _of_part("waits", "How often `write` has waited.")
    outlives_the_process = _of_part(
        "outlives_the_process", "Whether the buffer outlives the process."
    )
    parked = _of_part("parked", "Why the destination refuses events.")
    trouble = _of_part("trouble", "Why nothing gets through.")
    attempts = _of_part("attempts", "Number of failed attempts.")

    def retry(self) -> Any:
        """Let the sink try again."""
        return self._called("retry")


class CheckedEncoder(CheckedPart, Encoder):
    """An encoder with checked messages: bytes, one line or binary message per event."""

    @property
    def encodes_tracks(self) -> bool:
        """Whether messages are tracks."""
        return bool(self._part.encodes_tracks)

    @property
    def content_type(self) -> str:
        """The media type of a message."""
        return str(self._part.content_type)

    @property
    def schema_version(self) -> str:
        """The version of the schema."""
        return str(self._part.schema_version)

    @property
    def container(self) -> Any:
        """The form of files."""
        return self._part.container

    def encode(self, window: Window) -> bytes:
        """Return the messages of a window's events."""
        messages = self._called("encode", window)
        events = len(window.tracks) if self.encodes_tracks else len(window.detections)
        if not isinstance(messages, bytes):
            raise self._wrong(f"encode returned {kind_of(messages)}; bytes are required")
        if messages.startswith(b"\0"):
            whole = framed_messages(messages)
            count = len(whole)
            is_whole = sum(map(len, whole)) == len(messages)
        else:
            count = messages.count(b"\n")
            is_whole = not messages or messages.endswith(b"\n")
        if count != events or not is_whole:
            raise self._wrong(
                f"encode returned {count} lines for {events} events; each message ends with a"
                f" newline, or follows its length if it is binary"
            )
        return messages

    def encodable(self, window: Window) -> BoolArray | None:
        """Return which detections have a message."""
        mask: BoolArray | None = self._called("encodable", window)
        if mask is None:
            return None
        if getattr(mask, "shape", None) != (len(window.detections),) or mask.dtype.kind != "b":
            raise self._wrong(
                f"encodable returned {kind_of(mask)}; truth values of each detection are required"
            )
        return mask
