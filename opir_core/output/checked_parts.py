"""Sinks and encoders of plugins behind the boundary: what they raise or return wrongly fails only the output."""

from collections.abc import Callable
from typing import Any

from opir_core.arrays import BoolArray
from opir_core.errors import OpirError, SinkError, kind_of
from opir_core.host.boundary import blamed_call
from opir_core.interfaces.optional import BufferingSink, DeadlineSink, MonitoredSink, PartialEncoder, TrackEncoder
from opir_core.interfaces.protocols import Delivery, Encoder, Sink
from opir_core.interfaces.records import Window


class CheckedPart:
    """A part of a plugin; `owner()` returns the beginning of messages, `hint` is their end."""

    def __init__(self, part: Any, owner: Callable[[], str], hint: str) -> None:
        self._part, self._owner, self._hint = part, owner, hint

    def _called(self, method: str, *given: Any) -> Any:
        try:
            return blamed_call(self._owner, self._hint, method, lambda: getattr(self._part, method)(*given))
        except SinkError:
            raise
        except OpirError as error:
            raise SinkError(str(error)) from error

    def _wrong(self, words: str) -> SinkError:
        return SinkError(f"{self._owner()}: {words}; {self._hint}")


class CheckedSink(CheckedPart):
    """A sink of which every error is a `SinkError`: the other sinks continue."""

    def write(self, window: Window) -> None:
        """Write a window."""
        self._called("write", window)

    def close(self) -> Delivery:
        """Close the sink and return its counts."""
        delivery = self._called("close")
        if not isinstance(delivery, Delivery):
            raise self._wrong(f"close returned {kind_of(delivery)}, no opir_core.plugin.Delivery")
        return delivery


class _Monitored(CheckedPart):
    def delivery_so_far(self) -> Any:
        """Return the counts so far."""
        return self._called("delivery_so_far")


class _Deadline(CheckedPart):
    def close_by(self, deadline_s: float) -> None:
        """Pass on the deadline."""
        self._called("close_by", deadline_s)


class _Buffering(CheckedPart):
    @property
    def waits(self) -> Any:
        """How often `write` has waited."""
        return self._part.waits

    @property
    def outlives_the_process(self) -> Any:
        """Whether the buffer outlives the process."""
        return self._part.outlives_the_process


class CheckedEncoder(CheckedPart):
    """An encoder with checked messages: bytes, one line per event."""

    @property
    def content_type(self) -> str:
        """The media type of a message."""
        return str(self._part.content_type)

    @property
    def schema_version(self) -> str:
        """The version of the schema."""
        return str(self._part.schema_version)

    def encode(self, window: Window) -> bytes:
        """Return the messages of a window's events."""
        messages = self._called("encode", window)
        events = len(window.tracks) if isinstance(self, TrackEncoder) else len(window.detections)
        if not isinstance(messages, bytes):
            raise self._wrong(f"encode returned {kind_of(messages)}; bytes are required")
        lines = messages.count(b"\n")
        if lines != events or (messages and not messages.endswith(b"\n")):
            raise self._wrong(f"encode returned {lines} lines for {events} events; each message ends with a newline")
        return messages


class _Partial(CheckedPart):
    def encodable(self, window: Window) -> BoolArray:
        """Return which detections have a message."""
        mask: BoolArray = self._called("encodable", window)
        if getattr(mask, "shape", None) != (len(window.detections),) or mask.dtype.kind != "b":
            raise self._wrong(f"encodable returned {kind_of(mask)}; truth values of each detection are required")
        return mask


class _OfTracks(CheckedPart):
    encodes_tracks = True


_SINK_ABILITIES = ((MonitoredSink, _Monitored), (DeadlineSink, _Deadline), (BufferingSink, _Buffering))
_ENCODER_ABILITIES = ((PartialEncoder, _Partial), (TrackEncoder, _OfTracks))


def checked_sink(sink: Sink, owner: Callable[[], str], hint: str) -> Sink:
    """Return a sink behind the boundary, with its optional abilities."""
    return _composed(CheckedSink, _SINK_ABILITIES, sink)(sink, owner, hint)


def checked_encoder(encoder: Encoder, owner: Callable[[], str], hint: str) -> Encoder:
    """Return an encoder behind the boundary, with its optional abilities."""
    return _composed(CheckedEncoder, _ENCODER_ABILITIES, encoder)(encoder, owner, hint)


def is_of_core(component: Any) -> bool:
    """Return whether a component's parts are the core's own, which need no boundary."""
    build = getattr(component.build, "func", component.build)
    return str(getattr(build, "__module__", "")).partition(".")[0] == "opir_core"


def _composed(base: type, abilities: Any, part: Any) -> Any:
    """Return the class that has the abilities of a part."""
    return type(base.__name__, (base, *(mixin for protocol, mixin in abilities if isinstance(part, protocol))), {})
