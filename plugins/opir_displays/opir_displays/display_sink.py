"""A sink that sends the tracks of windows to a display, as datagrams, or into a file."""

import math
import socket
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

from attrs import evolve

from opir_core.errors import SinkError, reason_of, unwritable
from opir_core.plugin import Delivery, Sink, SinkContext, Window
from opir_displays.settings import DatagramConfig

#: Most seconds that the datagrams of a window wait for their turn: a call of a sink may last 30 s.
_LONGEST_WAIT_S = 20.0


class Messages(Protocol):
    """Tracks in the format of a display."""

    def rows(self, window: Window) -> Iterator[tuple[int, Sequence[bytes]]]:
        """Yield groups of messages, each with the number of tracks, 1 or 0, that it is of; a track
        that is not sent has no messages.
        """


class Outlet(Protocol):
    """Where messages go: `name` is for messages to the user; errors are `SinkError`."""

    name: str

    def send(self, message: bytes, give_up_s: float) -> bool:
        """Send a message; return False if its turn is after a time of the monotonic clock."""

    def close(self) -> None:
        """Release all resources."""


class Datagrams:
    """A UDP socket that sends a limited number of datagrams a second."""

    def __init__(self, config: DatagramConfig) -> None:
        self.name = f"UDP to {config.host}, port {config.port}"
        self._address = config.host, config.port
        self._interval_s = 1.0 / config.rate_per_s
        self._turn_s = 0.0
        family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
        try:
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            raise self._failure(error) from error
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, config.allow_remote)

    def send(self, message: bytes, give_up_s: float) -> bool:
        """Send a message in its turn."""
        now_s = time.monotonic()
        turn_s = max(now_s, self._turn_s)
        if turn_s > give_up_s:
            return False
        time.sleep(turn_s - now_s)
        self._turn_s = turn_s + self._interval_s
        try:
            self._socket.sendto(message, self._address)
        except OSError as error:
            raise self._failure(error) from error
        return True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _failure(self, error: OSError) -> SinkError:
        return SinkError(f"{self.name}: {reason_of(error)}; give a host that this machine reaches")


class MessageFile:
    """A file of messages, one a line; `place` is where it is written."""

    def __init__(self, path: Path, place: Path) -> None:
        self.name = str(path)
        try:
            self._stream = place.open("wb", buffering=0)
        except OSError as error:
            raise self._failure(error) from error

    def send(self, message: bytes, _give_up_s: float) -> bool:
        """Write a message."""
        try:
            rest = memoryview(message + b"\n")
            while rest:
                rest = rest[self._stream.write(rest) :]
        except OSError as error:
            raise self._failure(error) from error
        return True

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _failure(self, error: OSError) -> SinkError:
        return unwritable("events", Path(self.name), error)


class DisplaySink(Sink):
    """Sends the messages of tracks.

    A track is delivered once all its messages are sent, and dropped if one had no turn in time.
    """

    takes_quiet_windows = True

    def __init__(self, messages: Messages, outlet: Outlet) -> None:
        self._messages = messages
        self._outlet = outlet
        self._limit_s = math.inf
        self._delivery = Delivery(delivered=0)
        #: The number of messages sent.
        self.sent = 0

    def write(self, window: Window) -> None:
        """Send the window's tracks."""
        give_up_s = time.monotonic() + _LONGEST_WAIT_S
        for tracks, messages in self._messages.rows(window):
            is_sent = all(self._is_sent(message, give_up_s) for message in messages)
            fate = ("delivered" if is_sent else "dropped") if messages else "withheld"
            count = getattr(self._delivery, fate) + tracks
            self._delivery = evolve(self._delivery, **{fate: count})

    def delivery_so_far(self) -> Delivery:
        """Return the counts of tracks."""
        return self._delivery

    def close_by(self, deadline_s: float) -> None:
        """Let nothing wait beyond a time of the monotonic clock."""
        self._limit_s = deadline_s

    def close(self) -> Delivery:
        """Close the outlet; dropped tracks are a complaint."""
        self._outlet.close()
        dropped = self._delivery.dropped
        complaint = f"{self._outlet.name}: {dropped} tracks are over rate_per_s; raise it"
        return evolve(self._delivery, complaint=complaint if dropped else None)

    def _is_sent(self, message: bytes, give_up_s: float) -> bool:
        is_sent = self._outlet.send(message, min(give_up_s, self._limit_s))
        self.sent += is_sent
        return is_sent


def opened(
    config: DatagramConfig, context: SinkContext, messages: Messages, file: str | None = None
) -> DisplaySink:
    """Return a sink into a file if one is given, else to the display; `SinkError` if it has a
    spool.
    """
    if context.resumes:
        raise SinkError("a display acknowledges nothing, so its output has no spool; remove spool")
    if file is None:
        return DisplaySink(messages, Datagrams(config))
    return DisplaySink(messages, MessageFile(Path(file), context.stage(file, only_appends=True)))
