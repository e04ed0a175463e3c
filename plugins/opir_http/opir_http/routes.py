"""The routes of the service."""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec
from litestar import HttpMethod, Litestar, Request, Response, get, post, route
from litestar.exceptions import HTTPException
from litestar.response import Stream

from opir_http.feed import Client
from opir_http.history import Filter
from opir_http.metrics import CONTENT_TYPE, metrics_text
from opir_http.openapi import document
from opir_http.problems import ProblemError, answer_defect, answer_http, answer_problem
from opir_http.reading import instant_us, json_object, query, unit_number, whole_number
from opir_http.service import Service, etag_of
from opir_http.settings import LOOPBACK, MAXIMUM_PAGE, STREAMS_PER_CLIENT

_PAGE = Path(__file__).parent / "page"
#: Content types; of texts the framework adds the charset, UTF-8.
_KINDS = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
}
_JSON = "application/json"
#: Maximum age of cached documents, s.
_CACHED_S = 0.05
#: Time, s, in which the status must be available for readiness.
_STATUS_S = 2.0
_KEY_LENGTH = 200
#: The most digits of the id of a frame.
_ID_LENGTH = 18
_ENTITY_TAG = re.compile(r'"[0-9a-f]{32}"|\*')
_FILTERS = (
    "after",
    "limit",
    "min_confidence",
    "sensor_id",
    "sensor_type",
    "since",
    "target_type",
    "track_id",
    "until",
)

AnyRequest = Request[Any, Any, Any]
Made = TypeVar("Made")


def application(service: Service) -> Litestar:
    """Return the application of a service."""
    documents = Documents(service)
    return Litestar(
        route_handlers=[
            *page_routes(document()),
            *_health_routes(service),
            *_reading_routes(service, documents),
            _trigger_route(service, documents),
            _retry_route(service),
            _config_route(service, documents),
            _stream_route(service),
        ],
        exception_handlers={
            ProblemError: answer_problem,
            HTTPException: answer_http,
            Exception: answer_defect,
        },
        openapi_config=None,
        logging_config=None,
    )


def page_routes(openapi_document: Mapping[str, Any]) -> list[Any]:
    """Return the routes of the page's files and of the OpenAPI document."""
    files = {path.name: path.read_bytes() for path in _PAGE.iterdir() if path.suffix in _KINDS}
    vendored = {
        path.name: path.read_bytes()
        for path in (_PAGE / "vendor").iterdir()
        if path.suffix in _KINDS
    }
    openapi = msgspec.json.encode(openapi_document)

    @get("/", media_type=_KINDS[".html"])
    async def page() -> bytes:
        return files["index.html"]

    @get("/page/{name:str}")
    async def part(request: AnyRequest) -> Response[bytes]:
        name = str(request.path_params["name"])
        if name not in files:
            raise ProblemError(404, "there is no such file")
        return Response(files[name], media_type=_KINDS[Path(name).suffix])

    @get("/page/vendor/{name:str}")
    async def vendored_part(request: AnyRequest) -> Response[bytes]:
        name = str(request.path_params["name"])
        if name not in vendored:
            raise ProblemError(404, "there is no such file")
        return Response(vendored[name], media_type=_KINDS[Path(name).suffix])

    @get("/openapi.json", media_type=_JSON)
    async def described() -> bytes:
        return openapi

    return [page, part, vendored_part, described]


def _health_routes(service: Service) -> list[Any]:
    readiness = Cached(service.health, _CACHED_S)
    counted = Cached(lambda: metrics_text(service).encode(), _CACHED_S)

    @get("/health/live")
    async def live(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        # Never waits: it answers while the engine, a sink or its counts are stuck.
        state = service.run.state
        reasons = service.run.progress().stuck
        return _json(
            {"state": state, "reasons": reasons}, 503 if state == "failed" or reasons else 200
        )

    @get("/health/ready")
    async def ready(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        try:
            found = await asyncio.wait_for(readiness.get(), _STATUS_S)
            is_ready = found.ready
            reasons = list(found.reasons)
        except TimeoutError:
            is_ready = False
            reasons = [f"the status is not available within {_STATUS_S:g} s"]
        return _json(
            {"ready": is_ready, "reasons": reasons},
            200 if is_ready else 503,
            headers=_lateness(service),
        )

    @get("/metrics")
    async def metrics(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        return Response(await counted.get(), media_type=CONTENT_TYPE)

    return [live, ready, metrics]


class Cached(Generic[Made]):
    """The result of `make`, called in a thread when the last one is older than `for_s`; for one
    event loop.
    """

    def __init__(self, make: Callable[[], Made], for_s: float) -> None:
        self._make = make
        self._for_s = for_s
        self._made: tuple[float, Made] | None = None
        self._making: asyncio.Task[Made] | None = None

    async def get(self) -> Made:
        """Return the result; waits for a new one if it is too old."""
        if self._made is not None and time.monotonic() - self._made[0] < self._for_s:
            return self._made[1]
        if self._making is None:
            self._making = asyncio.create_task(asyncio.to_thread(self._make))
            self._making.add_done_callback(self._keep)
        return await asyncio.shield(self._making)

    def forget(self) -> None:
        """Make a new result for the next request; the one in progress is for earlier requests."""
        self._made = None
        self._making = None

    def _keep(self, making: "asyncio.Task[Made]") -> None:
        if making is self._making:
            self._making = None
            if not making.cancelled() and making.exception() is None:
                self._made = time.monotonic(), making.result()


class Documents:
    """Status and configuration, encoded and cached."""

    def __init__(self, service: Service) -> None:
        self.status = Cached(lambda: msgspec.json.encode(service.status()), _CACHED_S)
        self.config = Cached(lambda: _tagged(service.config()), _CACHED_S)

    def forget(self) -> None:
        """Make both again for the next request, after a change."""
        self.status.forget()
        self.config.forget()


def _tagged(config: Mapping[str, Any]) -> tuple[bytes, str]:
    return msgspec.json.encode(config), etag_of(config)


def _reading_routes(service: Service, documents: Documents) -> list[Any]:
    @get("/status")
    async def status(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        return Response(await documents.status.get(), media_type=_JSON)

    @get("/detections")
    async def detections(request: AnyRequest) -> Response[bytes]:
        given = query(request.scope["query_string"], _FILTERS)
        limit = whole_number(given, "limit", 100, MAXIMUM_PAGE)
        before = int(given["after"], 36) if _is_cursor(given) else None
        lines, following = service.feed.history.page(_filter(given, service), before, limit)
        cursor = b"null" if following is None else b'"%s"' % _base36(following).encode()
        body = b'{"detections":[' + b",".join(lines) + b'],"next":' + cursor + b"}"
        return Response(body, media_type=_JSON)

    @get("/tracks")
    async def tracks(request: AnyRequest) -> Response[bytes]:
        given = query(request.scope["query_string"], ("limit", "trail"))
        if given.get("trail", "false") not in ("true", "false"):
            raise ProblemError(400, "trail must be true or false")
        limit = whole_number(given, "limit", 100, MAXIMUM_PAGE)
        return _json(
            {"tracks": service.feed.tracks.latest(limit, trail=given.get("trail") == "true")}
        )

    @get("/activity")
    async def activity(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        now_us = service.run.scene.epoch_us + service.run.time_ns // 1000
        return _json(service.feed.activity.document(now_us))

    return [status, detections, tracks, activity]


def _trigger_route(service: Service, documents: Documents) -> Any:
    @post("/trigger", status_code=202)
    async def trigger(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        body = await request.body()
        key = _idempotency_key(request.headers)
        previous = service.answers.begin(key, body) if key else None
        if previous is not None:
            return _json(
                previous, 202, headers={"Idempotent-Replayed": "true", "Location": "/status"}
            )
        answer = None
        try:
            answer = await asyncio.to_thread(service.launch, json_object(body))
        finally:
            documents.forget()
            if key:
                service.answers.end(key, answer)
        return _json(answer, 202, headers={"Location": "/status", **_lateness(service)})

    return trigger


def _lateness(service: Service) -> dict[str, str]:
    """Return the header that states how late the last cycle was, s."""
    return {"Opir-Late": f"{service.run.late_s:.3f}"}


def _retry_route(service: Service) -> Any:
    @post("/outputs/{output:str}/retry", status_code=202)
    async def retry(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        output = str(request.path_params["output"])
        return _json(
            await asyncio.to_thread(service.retry, output), 202, headers={"Location": "/status"}
        )

    return retry


def _config_route(service: Service, documents: Documents) -> Any:
    # One handler: the framework's answer to OPTIONS has only the methods of one.
    @route("/config", http_method=[HttpMethod.GET, HttpMethod.PUT], status_code=200)
    async def config(request: AnyRequest) -> Response[bytes]:
        query(request.scope["query_string"], ())
        if request.method == HttpMethod.PUT:
            return await _configured(service, documents, request)
        body, tag = await documents.config.get()
        if request.headers.get("if-none-match") == tag:
            return Response(b"", status_code=304, headers={"ETag": tag})
        return Response(body, media_type=_JSON, headers={"ETag": tag})

    return config


async def _configured(
    service: Service, documents: Documents, request: AnyRequest
) -> Response[bytes]:
    if not service.settings.config_writes:
        raise ProblemError(403, "the service was started with --no-config-writes")
    wanted = json_object(await request.body())
    if_match = request.headers.get("if-match")
    if if_match is None:
        raise ProblemError(428, "send the ETag of GET /config as If-Match")
    if not _ENTITY_TAG.fullmatch(if_match):
        raise ProblemError(400, "If-Match must be one ETag of GET /config, with its quotes, or *")
    try:
        cycle, tag = await asyncio.to_thread(service.configure, wanted, if_match)
    finally:
        documents.forget()
    return _json({"cycle": cycle}, headers={"ETag": tag})


def _stream_route(service: Service) -> Any:
    @get("/stream")
    async def stream(request: AnyRequest) -> Stream:
        given = query(request.scope["query_string"], ("view",))
        if given.get("view", "full") not in ("full", "brief"):
            raise ProblemError(400, "view must be full or brief")
        if service.feed.viewers >= service.settings.maximum_viewers:
            raise ProblemError(
                503, "the maximum number of viewers is connected", headers={"Retry-After": "5"}
            )
        address = request.client.host if request.client else ""
        if address not in LOOPBACK and service.feed.streams_of(address) >= STREAMS_PER_CLIENT:
            raise ProblemError(
                429, "this client has too many streams", headers={"Retry-After": "5"}
            )
        client = Client(brief=given.get("view") == "brief", address=address)
        last = request.headers.get("last-event-id", "")
        # Anything else that a client sends is no id of this service: it starts anew, as EventSource
        # does.
        if last.isascii() and last.isdigit() and len(last) <= _ID_LENGTH:
            service.feed.resume(client, int(last))
        else:
            service.feed.join(client)
        return Stream(_frames(service, client), media_type="text/event-stream")

    return stream


async def _frames(service: Service, client: Client) -> AsyncIterator[bytes]:
    try:
        async for frame in client.frames():
            yield frame
    finally:
        service.feed.leave(client)


def _filter(given: Mapping[str, str], service: Service) -> Filter:
    sensors = None
    if "sensor_id" in given or "sensor_type" in given:
        sensors = tuple(
            row
            for row, sensor in enumerate(service.feed.sensors)
            if given.get("sensor_id", sensor.id) == sensor.id
            and given.get("sensor_type", sensor.type) == sensor.type
        )
    kind = given.get("target_type")
    types = service.feed.reported_types
    if kind is not None and kind not in types:
        raise ProblemError(400, f"target_type must be one of {', '.join(types)}")
    return Filter(
        sensors=sensors,
        types=None if kind is None else (types.index(kind),),
        track=None
        if "track_id" not in given
        else whole_number(given, "track_id", 0, 10**9 - 1, least=0),
        since_us=instant_us(given, "since"),
        until_us=instant_us(given, "until"),
        confidence=unit_number(given, "min_confidence"),
    )


def _is_cursor(given: Mapping[str, str]) -> bool:
    word = given.get("after")
    if word is not None and not (
        0 < len(word) <= 12 and word.isascii() and word.isalnum() and word == word.lower()
    ):
        raise ProblemError(400, "after must be the `next` of a page")
    return word is not None


def _base36(number: int) -> str:
    digits = ""
    while number or not digits:
        number, digit = divmod(number, 36)
        digits = "0123456789abcdefghijklmnopqrstuvwxyz"[digit] + digits
    return digits


def _idempotency_key(headers: Mapping[str, str]) -> str | None:
    key = headers.get("idempotency-key")
    if key is not None and not (
        0 < len(key) <= _KEY_LENGTH and key.isascii() and key.isprintable()
    ):
        raise ProblemError(
            400, f"Idempotency-Key must have 1 to {_KEY_LENGTH} printable ASCII characters"
        )
    return key


def _json(
    value: Any, status: int = 200, headers: Mapping[str, str] | None = None
) -> Response[bytes]:
    return Response(
        msgspec.json.encode(value),
        status_code=status,
        media_type=_JSON,
        headers=dict(headers or {}),
    )
