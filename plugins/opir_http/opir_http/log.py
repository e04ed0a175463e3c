"""The log of requests: each write, and refused requests at a limited rate."""

import json
import time
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from typing import Any

from opir_http.json_log import json_line

_WRITES = frozenset({"POST", "PUT", "PATCH", "DELETE"})

#: Shortest time, s, between two lines about refused requests; the next line counts those in
#: between.
REFUSED_EVERY_S = 10.0

Message = MutableMapping[str, Any]
Send = Callable[[Message], Awaitable[None]]


class RequestLog:
    """Writes one line for each accepted write, and at most one per `REFUSED_EVERY_S` for refused
    requests.

    `token` is the name of the bearer token, never the token. Paths and tags are quoted: a client
    cannot add lines. With `is_json` the lines are JSON.
    """

    def __init__(
        self,
        write: Callable[[str], Any] = lambda line: None,
        token: str | None = None,
        *,
        is_json: bool = False,
    ) -> None:
        self._write = write
        self._token = token
        self._is_json = is_json
        self._refused = 0
        self._due_s = float("-inf")

    def watched(self, scope: MutableMapping[str, Any], send: Send) -> Send:
        """Return a `send` that logs the status of the answer."""

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._answered(scope, int(message["status"]), dict(message.get("headers", ())))
            await send(message)

        return sending

    def _answered(
        self, scope: MutableMapping[str, Any], status: int, answer: dict[bytes, bytes]
    ) -> None:
        client = (scope.get("client") or ("-",))[0]
        path = scope["path"][:200]
        request = f"{scope['method']} {json.dumps(path)}"
        fields = {"client": client, "method": scope["method"], "path": path, "status": status}
        if status < 400 and scope["method"] in _WRITES:
            old_tag = _text(dict(scope["headers"]).get(b"if-match"))
            new_tag = _text(
                next((value for name, value in answer.items() if name.lower() == b"etag"), None)
            )
            tags = f"{_quoted(old_tag)} {_quoted(new_tag)}"
            text = f"write: {client}, token {self._token or '-'}: {request} {status}, ETag {tags}"
            self._tell(
                "info",
                text,
                {**fields, "token": self._token, "etag_before": old_tag, "etag_after": new_tag},
            )
        elif 400 <= status < 500:
            self._refused += 1
            now_s = time.monotonic()
            if now_s >= self._due_s:
                text = (
                    f"refused: {client}: {request} {status} ({self._refused} since the last line)"
                )
                self._tell("warning", text, {**fields, "refused": self._refused})
                self._refused = 0
                self._due_s = now_s + REFUSED_EVERY_S

    def _tell(self, level: str, text: str, fields: Mapping[str, Any]) -> None:
        self._write(
            json_line(level, "opir_http.requests", text, fields)
            if self._is_json
            else f"opir: {text}\n"
        )


def _text(tag: bytes | None) -> str | None:
    return None if tag is None else tag.decode("latin-1")[:80]


def _quoted(tag: str | None) -> str:
    return "-" if tag is None else json.dumps(tag)
