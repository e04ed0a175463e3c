"""Checks of every request before it is processed: host, token, rate, size and content type."""

import asyncio
import hmac
import re
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from functools import partial
from typing import Any

from opir_http.log import RequestLog
from opir_http.problems import PROBLEM_TYPE, ProblemError, problem_body
from opir_http.settings import (
    BODY_S,
    CONFIGURATION_SHARE,
    LOOPBACK,
    MAXIMUM_BODY_BYTES,
    HttpSettings,
)

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

#: Paths without a token: the page, which has no data, and health checks.
OPEN_PATHS = frozenset({"/", "/health/live", "/health/ready", "/openapi.json"})
OPEN_PREFIX = "/page/"

_HEALTH = frozenset({"/health/live", "/health/ready"})

_WRITES = frozenset({"POST", "PUT", "PATCH", "DELETE"})
#: Requests with a body.
_TAKE_BODIES = re.compile(r"POST /trigger|PUT /config|PATCH /config|PUT /sensors/[^/]+/task")
_OF_BROWSERS = (b"origin", b"referer", b"sec-fetch-site", b"sec-fetch-mode", b"sec-fetch-dest")
_CLIENTS = 1024
#: Wrong bearer tokens of one client that are answered by 401; more wait (429).
_WRONG_TOKENS_PER_S = 5.0
#: A `Host` header (RFC 9110, section 7.2): an IPv6 address in brackets or a name, and a port.
_HOST = re.compile(r"(?:\[(?P<address>[0-9a-f:.]+)\]|(?P<name>[^\[\]:]+))(?::[0-9]*)?")
_STREAM = b"text/event-stream; charset=utf-8"

_HEADERS = [
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), geolocation=(), microphone=()"),
    (
        b"content-security-policy",
        (
            b"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self';"
            b" base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        ),
    ),
]


class Rates:
    """Token buckets, one per client, for a bounded number of clients."""

    def __init__(self) -> None:
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait_s(self, client: str, per_s: float) -> float:
        """Take a token and return 0, or the time to wait for one, s. A bucket holds the tokens of 2
        s, at least one.
        """
        time_s = time.monotonic()
        capacity = max(1.0, 2.0 * per_s)
        tokens, taken_s = self._buckets.pop(client, (capacity, time_s))
        tokens = min(capacity, tokens + (time_s - taken_s) * per_s)
        wait_s = 0.0 if tokens >= 1.0 else (1.0 - tokens) / per_s
        self._buckets[client] = (tokens - (wait_s == 0.0), time_s)
        while len(self._buckets) > _CLIENTS:
            self._buckets.popitem(last=False)
        return wait_s


class Gate:
    """The application behind its checks; also adds the security headers of answers."""

    def __init__(
        self,
        app: App,
        settings: Callable[[], HttpSettings],
        token: str | None,
        log: RequestLog | None = None,
        configuration_bytes: Callable[[], int] = lambda: 0,
    ) -> None:
        self._app = app
        self._configuration_bytes = configuration_bytes
        self._log = log or RequestLog()
        self._settings = settings
        self._token = token.encode() if token else None
        self._rates = Rates()
        self._wrong_tokens = Rates()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Reject a request or pass it to the application."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        scope = in_origin_form(scope)
        guarded = self._log.watched(scope, _with_headers(send, is_open=_is_open(scope["path"])))
        try:
            body = await self._admitted(scope, receive)
        except ProblemError as problem:
            await _answer(problem, guarded)
            return
        if scope["method"] == "HEAD":
            await self._head(scope, _replayed(body, receive), guarded)
        else:
            await self._app(scope, _replayed(body, receive), guarded)

    async def _head(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer HEAD as GET without the body, which the server leaves out; a stream is not
        begun.
        """
        if scope["path"] == "/stream":
            await send(
                {
                    "type": "http.response.start",
                    "status": 200,
                    "headers": [(b"content-type", _STREAM)],
                }
            )
            await send({"type": "http.response.body", "body": b""})
        else:
            await self._app({**scope, "method": "GET"}, receive, send)

    async def _admitted(self, scope: Scope, receive: Receive) -> bytes:
        """Return the body of an accepted request; raises `ProblemError`."""
        headers = dict(scope["headers"])
        client = (scope.get("client") or ("",))[0]
        if b"content-length" in headers and b"transfer-encoding" in headers:
            words = (
                "a body has Content-Length or Transfer-Encoding, not both (RFC 9112, section 6.3)"
            )
            raise ProblemError(400, words, headers={"Connection": "close"})
        self._check_host(headers.get(b"host", b""))
        if not _is_open(scope["path"]):
            self._check_token(headers.get(b"authorization", b""), client)
        if scope["method"] in _WRITES:
            self._check_site(headers)
            _require_now(self._rates.wait_s(client, self._settings().writes_per_s))
        if headers.get(b"content-encoding", b"identity").strip().lower() not in (b"", b"identity"):
            encoded = "send the body as it is, without Content-Encoding"
            raise ProblemError(415, encoded, headers={"Accept-Encoding": "identity"})
        takes_body = _TAKE_BODIES.fullmatch(f"{scope['method']} {scope['path']}")
        if takes_body and not _is_json(headers):
            raise ProblemError(
                415, "send application/json, in UTF-8 (curl: -H 'Content-Type: application/json')"
            )
        return await _body(headers, receive, partial(self._most_bytes, scope["path"]))

    def _most_bytes(self, path: str) -> int:
        """Return how many bytes a body may have."""
        if path != "/config":
            return MAXIMUM_BODY_BYTES
        return max(MAXIMUM_BODY_BYTES, CONFIGURATION_SHARE * self._configuration_bytes())

    def _check_host(self, host: bytes) -> None:
        """Reject other host names than localhost without a token: DNS rebinding."""
        if self._token is not None:
            return
        if _host_name(host) not in LOOPBACK:
            raise ProblemError(
                421, "without a token the service answers only requests to localhost"
            )

    def _check_site(self, headers: Mapping[bytes, bytes]) -> None:
        """Reject writes of pages of other sites without a token: a browser sends them without
        asking (Fetch, 3.1).
        """
        if self._token is not None:
            return
        site = headers.get(b"sec-fetch-site", b"none")
        origin = headers.get(b"origin")
        is_own = origin is None or origin.partition(b"://")[2] == headers.get(b"host", b"")
        if not is_own or site not in (b"none", b"same-origin"):
            raise ProblemError(
                403, "without a token the service takes no writes from pages of other sites"
            )

    def _check_token(self, authorization: bytes, client: str) -> None:
        """Reject a wrong token; many of a client wait. A right one never does: clients may share an
        address.
        """
        if self._token is None:
            return
        scheme, _, token = authorization.partition(b" ")
        is_right = hmac.compare_digest(token.strip(), self._token)
        if scheme.lower() != b"bearer" or not is_right:
            if authorization:
                _require_now(self._wrong_tokens.wait_s(client, _WRONG_TOKENS_PER_S))
            raise ProblemError(
                401, "send Authorization: Bearer TOKEN", headers={"WWW-Authenticate": "Bearer"}
            )


def _require_now(wait_s: float) -> None:
    """Raise `ProblemError` if there is a time to wait, s."""
    if wait_s:
        raise ProblemError(429, "too many requests", headers={"Retry-After": str(int(wait_s) + 1)})


def _host_name(host: bytes) -> str:
    """Return the name or address of a `Host` header, without port and brackets; "" for one that is
    malformed.
    """
    match = _HOST.fullmatch(host.decode("latin-1").lower())
    return "" if match is None else match["address"] or match["name"]


def in_origin_form(scope: Scope) -> Scope:
    """Return a request to `http://host/path`, as to a proxy, as one to `/path` of that host (RFC
    9112, 3.2.2).
    """
    scheme, mark, target = scope["path"].partition("://")
    if not mark or scheme.lower() not in ("http", "https"):
        return scope
    authority, slash, path = target.partition("/")
    raw = bytes(scope.get("raw_path", b"")).partition(b"://")[2].partition(b"/")[2]
    headers = [(name, value) for name, value in scope["headers"] if name != b"host"]
    host = authority.partition("?")[0].encode("latin-1", "replace")
    return {
        **scope,
        "path": f"/{path}" if slash else "/",
        "raw_path": b"/" + raw,
        "headers": [(b"host", host), *headers],
    }


def _is_open(path: str) -> bool:
    return path in OPEN_PATHS or path.startswith(OPEN_PREFIX)


def _is_json(headers: Mapping[bytes, bytes]) -> bool:
    """Return whether a body is read as JSON: by its content type, or as sent by a program such as
    `curl -d`.

    Browsers post forms of any site without a preflight request, but always with `Origin` and
    `Sec-Fetch-*` (Fetch, sections 3.1 and 3.5).
    """
    text = headers.get(b"content-type", b"").decode("latin-1").lower()
    kind, _, parameters = (word.strip() for word in text.partition(";"))
    parameters = parameters.replace('"', "")
    if kind == "application/x-www-form-urlencoded":
        return not parameters and not any(name in headers for name in _OF_BROWSERS)
    return kind in ("application/json", "application/merge-patch+json") and parameters in (
        "",
        "charset=utf-8",
    )


async def _body(
    headers: Mapping[bytes, bytes], receive: Receive, most_bytes: Callable[[], int]
) -> bytes:
    maximum = MAXIMUM_BODY_BYTES
    length = int(headers.get(b"content-length", b"0"))
    if length > maximum:
        maximum = await asyncio.to_thread(most_bytes)
    if length > maximum:
        raise _too_large(maximum)
    body = b""
    try:
        async with asyncio.timeout(BODY_S):
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise ProblemError(400, "the client has disconnected")
                body += bytes(message.get("body", b""))
                if len(body) > maximum:
                    raise _too_large(maximum)
                if not message.get("more_body", False):
                    return body
    except TimeoutError:
        raise ProblemError(
            408, f"the body did not arrive within {BODY_S:g} s", headers={"Connection": "close"}
        ) from None


def _too_large(maximum: int) -> ProblemError:
    return ProblemError(413, f"a body may have at most {maximum} bytes")


def _replayed(body: bytes, receive: Receive) -> Receive:
    """Return a `receive` that returns the body first, then the client's messages."""
    messages = [{"type": "http.request", "body": body, "more_body": False}]

    async def replay() -> Message:
        return messages.pop() if messages else await receive()

    return replay


def _with_headers(send: Send, *, is_open: bool) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = [
                (name, _with_head(value) if name.lower() == b"allow" else value)
                for name, value in _headers(message)
            ]
            if not any(name.lower() == b"cache-control" for name, _ in headers):
                headers.append((b"cache-control", b"no-cache" if is_open else b"no-store"))
            message["headers"] = [*headers, *_HEADERS]
        await send(message)

    return sending


def _headers(message: Message) -> list[tuple[bytes, bytes]]:
    return list(message.get("headers", []))


def _with_head(allowed: bytes) -> bytes:
    """Return the value of `Allow` with HEAD where there is GET."""
    methods = {method.strip() for method in allowed.split(b",")}
    return b", ".join(sorted(methods | ({b"HEAD"} if b"GET" in methods else set())))


def health_only(app: App) -> App:
    """Return an application that answers health checks as `app` does and refuses everything else;
    each closes.
    """

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        async def closing(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*_headers(message), (b"connection", b"close")]
            await send(message)

        if in_origin_form(scope)["path"] in _HEALTH:
            await app(scope, receive, closing)
        else:
            problem = ProblemError(503, "too many connections", headers={"Retry-After": "5"})
            await _answer(problem, _with_headers(closing, is_open=False))

    return answer


async def _answer(problem: ProblemError, send: Send) -> None:
    body = problem_body(problem)
    headers = [
        (b"content-type", PROBLEM_TYPE.encode()),
        (b"content-length", str(len(body)).encode()),
    ]
    headers += [(key.lower().encode(), value.encode()) for key, value in problem.headers.items()]
    await send({"type": "http.response.start", "status": problem.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
