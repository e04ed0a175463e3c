"""Windows of the run for history, tracks and viewers; encoded once, in a thread of its own."""

import asyncio
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any, Generic, TypeVar

import msgspec

from opir_core.host import described_error
from opir_core.live import LiveWindow
from opir_core.output import ForgeEncoder, Heartbeats, unix_microseconds
from opir_core.plugin import EncoderContext, Window
from opir_http.activity import Activity
from opir_http.history import History
from opir_http.tracks import TrackDocuments

#: Maximum bytes of the windows waiting to be encoded, and of the frames waiting for one viewer; and
#: maximum number of those.
QUEUED_BYTES = 32 << 20
QUEUED_FRAMES = 64

#: Maximum number of detections in a frame of the brief stream.
BRIEF = 40

#: Maximum number of detections in a frame of those sent again: a viewer that does not read holds
#: one such frame.
SENT_AGAIN = 250

_STATUS_S = 1.0
_HEARTBEAT_S = 10.0
_json = msgspec.json.Encoder().encode


Item = TypeVar("Item")


class LossyQueue(Generic[Item]):
    """A queue between threads of items that weigh `size` together at most; a full one loses its
    oldest items, which `dropped` counts, but never the newest.
    """

    def __init__(self, size: int, weight: Callable[[Item], int] = lambda _: 1) -> None:
        self._items: deque[Item] = deque()
        self._size = size
        self._weight = weight
        self._load = 0
        self._ready = threading.Condition()
        self._is_closed = False
        self.dropped = 0

    def put(self, item: Item) -> None:
        """Append an item; never waits."""
        with self._ready:
            self._items.append(item)
            self._load += self._weight(item)
            while self._load > self._size and len(self._items) > 1:
                self._pop()
                self.dropped += 1
            self._ready.notify()

    def take(self, timeout_s: float) -> Item | None:
        """Return the oldest item; None if there is none within `timeout_s` or the queue is
        closed.
        """
        with self._ready:
            self._ready.wait_for(lambda: self._items or self._is_closed, timeout_s)
            return self._pop() if self._items else None

    def _pop(self) -> Item:
        item = self._items.popleft()
        self._load -= self._weight(item)
        return item

    @property
    def is_over(self) -> bool:
        """Whether the queue is closed and empty."""
        with self._ready:
            return self._is_closed and not self._items

    def close(self) -> None:
        """Accept no more items."""
        with self._ready:
            self._is_closed = True
            self._ready.notify_all()


class Client:
    """A viewer of the stream, on the event loop: a bounded queue of frames; a full one loses the
    oldest, counted.
    """

    def __init__(self, *, brief: bool, address: str = "") -> None:
        self.brief = brief
        self.address = address
        #: Detections up to this number were sent at the start; frames on their way with these are
        #: left out.
        self.seen = 0
        #: Frames of the detections sent at the start, each made when the one before is sent.
        self.backlog: Iterator[bytes] = iter(())
        self._frames = LossyQueue[bytes](
            QUEUED_BYTES, lambda frame: max(len(frame), QUEUED_BYTES // QUEUED_FRAMES)
        )
        self._ready = asyncio.Event()
        self.is_closed = False

    @property
    def dropped(self) -> int:
        """Number of frames lost."""
        return self._frames.dropped

    def put(self, frame: bytes) -> None:
        """Append a frame; never waits."""
        self._frames.put(frame)
        self._ready.set()

    def close(self) -> None:
        """Accept no more frames."""
        self.is_closed = True
        self._ready.set()

    async def frames(self) -> AsyncIterator[bytes]:
        """Yield frames, the number of frames lost before them, and a comment every 10 s without a
        frame.
        """
        reported = 0
        yield b": opir\n\n"
        for sent_again in self.backlog:
            yield sent_again
            # A frame that a socket takes at once would let no other request have its turn.
            await asyncio.sleep(0)
        while True:
            while (taken := self._frames.take(0.0)) is not None:
                if lost := self.dropped - reported:
                    reported += lost
                    yield frame("dropped", _json({"frames": lost}))
                yield taken
            if self.is_closed:
                yield frame("end", b"{}")
                return
            self._ready.clear()
            try:
                await asyncio.wait_for(self._ready.wait(), _HEARTBEAT_S)
            except TimeoutError:
                yield b": still here\n\n"


class Feed:
    """Encodes a run's windows without delaying it; `status` returns the document sent to viewers
    each second.

    With `heartbeat_s`, s of scene time, it sends heartbeats to viewers at this interval: which
    sensors watched.
    """

    def __init__(
        self,
        context: EncoderContext,
        history: int,
        most_tracks: int,
        status: Callable[[], Any],
        hypotheses: tuple[str, ...] = (),
        heartbeat_s: float | None = None,
    ) -> None:
        self._heartbeats = (
            None
            if heartbeat_s is None
            else Heartbeats(context.sensors, context.epoch_us, heartbeat_s)
        )
        self.history = History(history)
        self.activity = Activity([sensor.id for sensor in context.sensors])
        self.tracks = TrackDocuments(context.epoch_us, most_tracks, hypotheses)
        self.sensors = context.sensors
        self.epoch_us = context.epoch_us
        self.reported_types = context.reported_types
        self._status = status
        self._encoder = ForgeEncoder(context, has_positions=True)
        self._windows: LossyQueue[LiveWindow] = LossyQueue(QUEUED_BYTES, _bytes_of)
        self._clients: set[Client] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._work, name="opir-feed", daemon=True)
        self._dropped_before = 0
        self._status_due_s = 0.0
        #: The error of encoding the last window; viewers miss that window.
        self.error: str | None = None
        self.put = self._windows.put

    @property
    def viewers(self) -> int:
        """Number of clients."""
        return len(self._clients)

    @property
    def dropped_frames(self) -> int:
        """Number of frames lost by slow clients."""
        return self._dropped_before + sum(client.dropped for client in tuple(self._clients))

    @property
    def dropped_windows(self) -> int:
        """Number of windows that viewers lost because encoding was too slow."""
        return self._windows.dropped

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start the thread; clients get their frames on the loop."""
        self._loop = loop
        self._thread.start()

    def stop(self) -> None:
        """End the thread and the streams of the clients."""
        self._windows.close()
        for client in tuple(self._clients):
            client.close()

    def streams_of(self, address: str) -> int:
        """Return the number of clients of an address."""
        return sum(client.address == address for client in self._clients)

    def join(self, client: Client) -> None:
        """Add a client."""
        self._clients.add(client)

    def resume(self, client: Client, number: int) -> None:
        """Add a client, and send it the detections after the first `number`, as far as the history
        has them.

        `number` is the id of the last frame that it had; one that this run has not reached is of
        another run.
        """
        # Joined first: frames are sent in later turns of the loop, and those that the history has
        # already are left out.
        self.join(client)
        total = self.history.total
        if number <= total:
            client.seen = total
            client.backlog = self._backlog(number, total, brief=client.brief)

    def _backlog(self, number: int, total: int, *, brief: bool) -> Iterator[bytes]:
        """Yield the frames of the detections from one number to another, made one by one."""
        while number < total:
            lines, lost = self.history.between(number, total, None if brief else SENT_AGAIN)
            number += lost + len(lines)
            if lost:
                yield frame("dropped", _json({"detections": lost}))
            if lines:
                yield _of_lines(b"null", b"null", lines, number, brief=brief)

    def leave(self, client: Client) -> None:
        """Remove a client."""
        if client in self._clients:
            self._clients.remove(client)
            self._dropped_before += client.dropped

    def _work(self) -> None:
        while not self._windows.is_over:
            live = self._windows.take(_STATUS_S)
            try:
                frames = self._frames(live) if live is not None else []
                self.error = None if live is not None else self.error
            except BaseException as error:  # the thread must not end unnoticed
                self.error = described_error(error)
                frames = []
            if frames and self._clients and self._loop is not None and not self._loop.is_closed():
                self._loop.call_soon_threadsafe(self._fan_out, frames)

    def _frames(self, live: LiveWindow) -> list[tuple[int, bytes, bytes]]:
        """Return the frames of a window, each with its number, 0 for none, in full and in brief."""
        window = live.window
        frames = list[tuple[int, bytes, bytes]]()
        if len(window.detections):
            frames.append(self._detections(window, live.cycle))
        if len(window.tracks):
            tracks = frame("tracks", _json(self.tracks.take(window.tracks)))
            frames.append((0, tracks, tracks))
        beats = b""
        if self._heartbeats is not None:
            beats = self._heartbeats.until(window.end_s, window.commands)
        if beats:
            heartbeats = frame("heartbeats", b"[" + b",".join(beats.splitlines()) + b"]")
            frames.append((0, heartbeats, heartbeats))
        if time.monotonic() >= self._status_due_s:
            self._status_due_s = time.monotonic() + _STATUS_S
            status = frame("status", _json(self._status()))
            frames.append((0, status, status))
        return frames

    def _detections(self, window: Window, cycle: int) -> tuple[int, bytes, bytes]:
        lines = self._encoder.encode(window).splitlines()
        detections = window.detections
        time_us = unix_microseconds(detections.time_ns, self.epoch_us)
        self.history.add(detections, time_us, lines)
        self.activity.add(detections.sensor, time_us)
        full, brief = (
            _of_lines(
                b"%d" % cycle, b"%.6f" % window.end_s, lines, self.history.total, brief=is_brief
            )
            for is_brief in (False, True)
        )
        return self.history.total, full, brief

    def _fan_out(self, frames: list[tuple[int, bytes, bytes]]) -> None:
        for client in self._clients:
            for number, *views in frames:
                if not number or number > client.seen:
                    client.put(views[client.brief])


def _bytes_of(live: LiveWindow) -> int:
    """Return about the memory of a window, bytes: most are the regions of its tracks."""
    window = live.window
    return 20_000 * (1 + len(window.tracks)) + 200 * len(window.detections)


def _of_lines(
    cycle: bytes, time_s: bytes, lines: list[bytes], number: int, *, brief: bool
) -> bytes:
    """Return the frame of detections, in full or in brief; `cycle` and `time_s` are null for those
    sent again.
    """
    head = b'{"cycle":%b,"time_s":%b,"count":%d,"detections":[' % (cycle, time_s, len(lines))
    step = -(-len(lines) // BRIEF) if brief else 1
    return frame("detections", head + b",".join(lines[::step]) + b"]}", number)


def frame(event: str, data: bytes, number: int | None = None) -> bytes:
    """Return a server-sent event (WHATWG HTML, section 9.2); `data` has no line break."""
    mark = b"id: %d\n" % number if number is not None else b""
    return mark + b"event: " + event.encode() + b"\ndata: " + data + b"\n\n"
