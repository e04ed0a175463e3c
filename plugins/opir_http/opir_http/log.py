"""The log of requests: each write, and refused requests at a limited rate."""

import json
import time
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

_WRITES = frozenset({"POST", "PUT", "PATCH", "DELETE"})

#: Shortest time, s, between two lines about refused requests; the next line counts those in between.
REFUSED_EVERY_S = 10.0

Message = MutableMapping[str, Any]
Send = Callable[[Message], Awaitable[None]]


class RequestLog:
    """Writes one line for each accepted write, and at most one per `REFUSED_EVERY_S` for refused requests.

    `token` is the name of the bearer token, never the token. Paths and tags are quoted: a client cannot add lines.
    """

    def __init__(self, write: Callable[[str], Any] = lambda line: None, token: str | None = None) -> None:
        self._write, self._token = write, token
        self._refused, self._due_s = 0, float("-inf")

    def watched(self, scope: MutableMapping[str, Any], send: Send) -> Send:
        """Return a `send` that logs the status of the answer."""

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._answered(scope, int(message["status"]), dict(message.get("headers", ())))
            await send(message)

        return sending

    def _answered(self, scope: MutableMapping[str, Any], status: int, answer: dict[bytes, bytes]) -> None:
        client, request = (scope.get("client") or ("-",))[0], f"{scope['method']} {json.dumps(scope['path'][:200])}"
        if status < 400 and scope["method"] in _WRITES:
            before = _quoted(dict(scope["headers"]).get(b"if-match"))
            after = _quoted(next((value for name, value in answer.items() if name.lower() == b"etag"), None))
            self._write(
                f"opir: write: {client}, token {self._token or '-'}: {request} {status}, ETag {before} {after}\n"
            )
        elif 400 <= status < 500:
            self._refused += 1
            now_s = time.monotonic()
            if now_s >= self._due_s:
                self._write(f"opir: refused: {client}: {request} {status} ({self._refused} since the last line)\n")
                self._refused, self._due_s = 0, now_s + REFUSED_EVERY_S


def _quoted(tag: bytes | None) -> str:
    return "-" if tag is None else json.dumps(tag.decode("latin-1")[:80])
