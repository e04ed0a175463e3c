"""The server: uvicorn with a deadline for headers, a limit of connections, and an orderly stop."""

import asyncio
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from opir_core.cli import ending_signals
from opir_http.gate import health_only
from opir_http.settings import (
    CONNECTIONS_PER_CLIENT,
    HEADERS_S,
    LOOPBACK,
    MAXIMUM_CONNECTIONS,
    RESERVED_CONNECTIONS,
    RESERVED_S,
    WRITE_S,
)

_CHECK_S = 2.0
_BACKLOG = 512

#: Time, s, that clients have at the end to receive the last frames: uvicorn cancels requests after
#: 2 s, which prints tracebacks.
_CUT_S = 0.8


class Connection(H11Protocol):
    """A connection that is closed if no complete request arrives for `HEADERS_S`, or the client
    reads nothing.

    A connection above the limits is served health checks only, and briefly.
    """

    _waiting_s: float | None = None
    _deadline_s = HEADERS_S
    _is_reserved = False
    #: Bytes that wait for the client, and since when none of them has been taken.
    _unread = 0
    _unread_since_s = 0.0
    _check: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Open the connection, for health checks only if there are too many; close it if there are
        far too many.
        """
        super().connection_made(transport)
        self._deadline_s = HEADERS_S
        if (
            len(self.connections) > MAXIMUM_CONNECTIONS
            or self._of_client() > CONNECTIONS_PER_CLIENT
        ):
            reserved = sum(getattr(peer, "_is_reserved", False) for peer in self.connections)
            if reserved >= RESERVED_CONNECTIONS:
                transport.close()
                return
            self._is_reserved = True
            self._deadline_s = RESERVED_S
            self.app = health_only(self.app)
        self._look()

    def _of_client(self) -> int:
        """Return the number of connections of this client; 0 on this machine."""
        address = self.client[0] if self.client else ""
        if address in LOOPBACK:
            return 0
        clients = (getattr(peer, "client", None) for peer in self.connections)
        return sum(client is not None and client[0] == address for client in clients)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the check."""
        if self._check is not None:
            self._check.cancel()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Restart the time for the next request."""
        self._waiting_s = None
        super().on_response_complete()

    def _look(self) -> None:
        now_s = self.loop.time()
        if self._reads_nothing(now_s):
            self.transport.abort()
            return
        if self.transport.is_closing():
            # Closing lasts until the client has read what waits for it.
            if self.transport.get_write_buffer_size():
                self._check = self.loop.call_later(_CHECK_S, self._look)
            return
        cycle: Any = self.cycle
        is_waiting = cycle is None or cycle.response_complete
        if not is_waiting:
            self._waiting_s = None
        elif self._waiting_s is None:
            self._waiting_s = now_s
        elif now_s - self._waiting_s > self._deadline_s:
            self.transport.close()
            return
        self._check = self.loop.call_later(_CHECK_S, self._look)

    def _reads_nothing(self, now_s: float) -> bool:
        """Return whether bytes have waited for the client for `WRITE_S` and it has taken none."""
        unread = self.transport.get_write_buffer_size()
        if self._unread == 0 or unread < self._unread:
            self._unread_since_s = now_s
        self._unread = unread
        return unread > 0 and now_s - self._unread_since_s > WRITE_S


class Server(uvicorn.Server):
    """A server that a signal stops without ending the process.

    `on_start` is called once signals are handled and requests accepted, `on_stop` at the beginning
    of the stop.
    """

    def __init__(
        self, app: Any, on_stop: Callable[[], None], on_start: Callable[[], None] = lambda: None
    ) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                http=Connection,
                ws="none",
                lifespan="off",
                log_config=None,
                access_log=False,
                server_header=False,
                h11_max_incomplete_event_size=16 * 1024,
                timeout_keep_alive=15,
                timeout_graceful_shutdown=2,
                backlog=_BACKLOG,
            )
        )
        self._on_stop = on_stop
        self._on_start = on_start
        #: Time of the first stop signal, monotonic clock, s.
        self.asked_at_s: float | None = None

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Handle the signals that end the server, that of a closed terminal too."""
        is_main = threading.current_thread() is threading.main_thread()
        numbers = ending_signals() if is_main else []
        with super().capture_signals():
            former = {number: signal.signal(number, self.handle_exit) for number in numbers}
            try:
                yield
            finally:
                for number, handler in former.items():
                    signal.signal(number, handler)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop the server; the signal does not end the process."""
        self.should_exit = True
        self.asked_at_s = self.asked_at_s or time.monotonic()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then call `on_start`."""
        await super().startup(sockets)
        self._on_start()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Call `on_stop`, then stop; connections that are open after `_CUT_S` are aborted."""
        self._on_stop()
        cut = asyncio.get_running_loop().call_later(_CUT_S, self._cut_off)
        await super().shutdown(sockets)
        cut.cancel()

    def _cut_off(self) -> None:
        for connection in tuple(self.server_state.connections):
            if connection.transport is not None:
                connection.transport.abort()


def bound(host: str, port: int) -> socket.socket:
    """Return a listening socket; raises `OSError`."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # With the protocol TCP, asyncio sets TCP_NODELAY; without it each answer would wait 40 ms for
    # the client's ACK.
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(_BACKLOG)
    except BaseException:
        listening.close()
        raise
    return listening
