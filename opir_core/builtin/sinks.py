"""The sinks `memory` and `null`, which write nothing, and `jsonl`: lines of a file or of standard
output, at once.
"""

import json
import os
import select
import stat
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from errno import EINVAL
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from opir_core.builtin.configs import JsonlConfig, MemoryConfig
from opir_core.errors import SinkError, reason_of, way_to_write
from opir_core.host.components import NoConfig
from opir_core.interfaces.contexts import SinkContext
from opir_core.interfaces.outputs import Container, Delivery, Encoder, Sink
from opir_core.interfaces.records import LENGTH_BYTES, Window, framed_messages
from opir_core.output.events.encoder_input import (
    configured_heartbeats,
    detection_count,
    encoder_blocks,
    event_counter,
    only_encodable,
)
from opir_core.output.temporary_files import GrowingFile, sync_path

if TYPE_CHECKING:
    from opir_core.output.heartbeats import Heartbeats


class MemorySink(Sink):
    """Keeps windows; encodes them on request."""

    def __init__(
        self, make_encoder: Callable[[], Encoder], count: Callable[[Window], int] = detection_count
    ) -> None:
        self._make_encoder = make_encoder
        self._count = count
        #: The windows in order; available after closing.
        self.windows: list[Window] = []

    def __len__(self) -> int:
        """Return the number of events kept."""
        return sum(map(self._count, self.windows))

    def write(self, window: Window) -> None:
        """Keep the window."""
        self.windows.append(window)

    def lines(self) -> bytes:
        """Return all events as the encoder writes them."""
        encoder = self._make_encoder()
        return b"".join(map(encoder.encode, self.windows))

    def events(self) -> list[dict[str, Any]]:
        """Return all events, read back from the encoder's JSON."""
        return [json.loads(line) for line in self.lines().splitlines()]

    def close(self) -> Delivery:
        """Return all events as delivered."""
        return Delivery(delivered=len(self))


class NullSink(Sink):
    """Counts events and discards them."""

    def __init__(self) -> None:
        self._taken = 0

    def write(self, window: Window) -> None:
        """Count the window's events."""
        self._taken += len(window.detections)

    def close(self) -> Delivery:
        """Return all events as delivered."""
        return Delivery(delivered=self._taken)


def memory_sink(_config: MemoryConfig, context: SinkContext) -> MemorySink:
    """Return the sink `memory`."""
    return MemorySink(context.make_encoder, context.count)


def null_sink(_config: NoConfig, _context: SinkContext) -> NullSink:
    """Return the sink `null`."""
    return NullSink()


#: Encoded lines.
Lines = bytes | memoryview

#: The path of standard output.
STANDARD_OUTPUT = "-"
#: Bytes at a file's end that a power cut may have spoilt: more than the lines that wait for a sync.
_UNSYNCED = 1 << 26


class LineFile(Sink):
    """An open file of events, or standard output; an existing file is overwritten.

    With `appends` the file keeps its lines, except an incomplete last line of a killed run.
    `written_at` is the temporary file in which a batch run writes the lines. `heartbeats` are lines
    between those of events, and count as none.

    Nothing is buffered: `write` returns after the system has accepted all bytes, so a killed run
    leaves complete lines, except possibly the last. When the disk is full, the file is truncated to
    its last complete line.
    """

    def __init__(
        self,
        path: str,
        encoder: Encoder,
        *,
        appends: bool = False,
        written_at: Path | None = None,
        heartbeats: "Heartbeats | None" = None,
    ) -> None:
        self._heartbeats = heartbeats
        self._name = "standard output" if path == STANDARD_OUTPUT else path
        self._encoder = encoder
        self._container = encoder.container
        self._count = event_counter(encoder)
        self._taken = 0
        self._delivered = 0
        self._withheld = 0
        #: Bytes of an incomplete line at the end of the file, which an error left there.
        self._incomplete = 0
        place = path if written_at is None else str(written_at)
        self._descriptor = (
            _standard_output()
            if path == STANDARD_OUTPUT
            else _opened(place, self._container, appends=appends)
        )
        self._growing = GrowingFile(self._descriptor)
        if self._container is not None and not os.fstat(self._descriptor).st_size:
            self._write_lines(self._container.head, 0)

    @property
    def takes_quiet_windows(self) -> bool:
        """Whether heartbeats follow windows without events."""
        return self._heartbeats is not None

    def write(self, window: Window) -> None:
        """Encode the window's events and write them."""
        self.write_encoded(window, self.encoded(window))

    def encoded(self, window: Window) -> Iterator[tuple[bytes, int, int]]:
        """Yield the lines of a window's events in blocks, each with its numbers of events and of
        withheld ones.
        """
        for block in encoder_blocks(window, self._encoder):
            encodable = only_encodable(block, self._encoder)
            withheld = len(block.detections) - len(encodable.detections)
            lines = self._encoder.encode(encodable)
            if lines and self._container is not None:
                lines = self._container.block(lines)
            yield lines, self._count(encodable), withheld

    def write_encoded(self, window: Window, blocks: Iterable[tuple[Lines, int, int]]) -> None:
        """Write a window's lines, as `encoded` yields them."""
        self._taken += self._count(window)
        for lines, events, withheld in blocks:
            self._withheld += withheld
            self._write_lines(lines, events)
        if self._heartbeats is not None:
            self._write_lines(self._heartbeats.until(window.end_s, window.commands), 0)

    def sync(self) -> None:
        """Make the lines that were written outlast a power cut; a pipe has none to keep."""
        try:
            os.fsync(self._descriptor)
        except OSError as error:
            if error.errno != EINVAL:
                raise self._failure(error) from error
        self._require_whole()

    def delivery_so_far(self) -> Delivery:
        """Return the events whose lines the system has accepted."""
        return Delivery(self._delivered, withheld=self._withheld)

    def close(self) -> Delivery:
        """Close the file; events without a complete line count as dropped, all of them if the file
        is gone.
        """
        try:
            fault = self._growing.fault()
            if self._heartbeats is not None:
                self._write_lines(self._heartbeats.rest(), 0)
            os.close(self._descriptor)
        except OSError as error:
            raise self._failure(error) from error
        missing = self._taken - self._withheld - self._delivered
        kept = 0 if fault else self._delivered
        dropped = missing + self._delivered - kept
        complaint = f"jsonl: {self._name}: {fault}" if fault else None
        return Delivery(kept, dropped=dropped, withheld=self._withheld, complaint=complaint)

    def _write_lines(self, lines: Lines, events: int) -> None:
        """Write the lines of some events, one each."""
        self._require_whole()
        written = 0
        try:
            self._remove_incomplete()
            while written < len(lines):
                count = _written(self._descriptor, memoryview(lines)[written:])
                self._growing.size += count
                written += count
        except OSError as error:
            # A part of a container's block is of no use.
            complete = [] if self._container else framed_messages(bytes(lines[:written]))
            self._incomplete += written - sum(map(len, complete))
            with suppress(OSError):  # else before the next line
                self._remove_incomplete()
            self._delivered += len(complete)
            raise self._failure(error) from error
        self._delivered += events

    def _remove_incomplete(self) -> None:
        """Remove an incomplete line from the end of the file; has no effect on a pipe."""
        if self._incomplete and stat.S_ISREG(os.fstat(self._descriptor).st_mode):
            self._growing.size -= self._incomplete
            os.ftruncate(
                self._descriptor, os.lseek(self._descriptor, 0, os.SEEK_END) - self._incomplete
            )
            os.lseek(self._descriptor, 0, os.SEEK_END)
        self._incomplete = 0

    def _require_whole(self) -> None:
        """Raise `SinkError` if the file is removed or cut off: its events are not delivered."""
        if fault := self._growing.fault():
            raise SinkError(f"jsonl: {self._name}: {fault}, after {self._delivered} events")

    def _failure(self, error: OSError) -> SinkError:
        return SinkError(
            f"jsonl: {self._name}: {reason_of(error)}, after {self._delivered} events were"
            f" delivered; {_way_out(error)}"
        )


def _opened(path: str, container: Container | None, *, appends: bool) -> int:
    if not path:
        raise SinkError(
            "jsonl: the path is empty; give the path of a file, or - for standard output"
        )
    # Always at the end: what another process cuts off shows, as nothing fills the hole.
    opening = os.O_APPEND | (0 if appends else os.O_TRUNC)
    try:
        descriptor = os.open(
            path, os.O_WRONLY | os.O_CREAT | opening | getattr(os, "O_BINARY", 0), 0o666
        )
        if appends:
            _remove_damaged_lines(path, descriptor, container)
            with suppress(OSError):  # the name of a new file
                sync_path(Path(path).absolute().parent)
    except OSError as error:
        reason = f"{reason_of(error)}; {way_to_write(error, Path(path))}"
        raise SinkError(f"jsonl: {path}: cannot be opened: {reason}") from error
    except ValueError as error:  # a NUL, or half a surrogate pair
        raise SinkError(
            f"jsonl: {path!r} is no path ({error}); give one that the system can name"
        ) from error
    return descriptor


def _remove_damaged_lines(path: str, descriptor: int, container: Container | None) -> None:
    """Remove what a killed run or a power cut left damaged at the end of a file; the spool still
    has those events.

    A kill leaves an incomplete line; a power cut zeros, where bytes were lost that had not been
    synced.
    """
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        return
    with Path(path).open("rb") as lines:
        if container is not None:
            os.ftruncate(descriptor, container.whole(lines))
            return
        if lines.read(1) == b"\0":
            os.ftruncate(descriptor, _end_of_binary(lines, status.st_size))
            return
        lines.seek(max(0, status.st_size - _UNSYNCED))
        end = lines.read()
    complete = end.find(b"\0") if b"\0" in end else len(end)
    complete = end.rfind(b"\n", 0, complete) + 1
    if end[complete : complete + 1] in (b"{", b"\0"):
        os.ftruncate(descriptor, status.st_size - len(end) + complete)


def _end_of_binary(messages: BinaryIO, size: int) -> int:
    """Return where the complete messages of a file of binary ones end; zeros are none."""
    end = messages.seek(0)
    while length := int.from_bytes(messages.read(LENGTH_BYTES), "big"):
        if end + LENGTH_BYTES + length > size:
            break
        end = messages.seek(end + LENGTH_BYTES + length)
    return end


def _standard_output() -> int:
    try:
        sys.stdout.flush()
        return os.dup(sys.stdout.fileno())
    except (OSError, ValueError, AttributeError) as error:
        raise SinkError(
            f"jsonl: standard output is not open for bytes ({error}); give the path of a file"
        ) from error


def _written(descriptor: int, lines: memoryview) -> int:
    """Write some of the lines and return the number of bytes; waits for a slow reader."""
    try:
        return os.write(descriptor, lines)
    except BlockingIOError:
        select.select([], [descriptor], [])
        return 0


def _way_out(error: OSError) -> str:
    if isinstance(error, BrokenPipeError):
        return "its reader stopped reading"
    return "make room, or give a path on another disk"


def line_file(config: JsonlConfig, context: SinkContext) -> LineFile:
    """Return the sink `jsonl`, open."""
    encoder = context.make_encoder()
    beats = configured_heartbeats("jsonl", config, encoder, context.origin)
    is_in_place = context.resumes or config.path in ("", STANDARD_OUTPUT)
    place = None if is_in_place else context.stage(config.path, only_appends=True)
    return LineFile(
        config.path, encoder, appends=context.resumes, written_at=place, heartbeats=beats
    )
