"""The routes of the service."""

import asyncio
import re
from collections.abc import AsyncIterator, Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from litestar import HttpMethod, Litestar, Response, get, patch, post, put, route
from litestar.datastructures import ResponseHeader, State
from litestar.exceptions import HTTPException
from litestar.openapi import ResponseSpec
from litestar.params import FromPath, PathParameter
from litestar.response import Stream
from msgspec import UNSET, UnsetType

from opir_http.answers import (
    SCHEMAS,
    ActivityAnswer,
    Configured,
    DetectionsAnswer,
    LaunchedAnswer,
    Liveness,
    Readiness,
    Retried,
    Status,
    TracksAnswer,
)
from opir_http.cached import Result
from opir_http.feed import Client
from opir_http.history import Filter
from opir_http.metrics import CONTENT_TYPE
from opir_http.openapi import described, document_of
from opir_http.problems import ProblemError, answer_defect, answer_http, answer_problem
from opir_http.queries import (
    DetectionsQuery,
    Query,
    StreamQuery,
    TracksQuery,
    read_query,
    time_us,
)
from opir_http.reading import json_object
from opir_http.schemas import Config
from opir_http.served import AnyRequest, Served, encoded, json_answer, lateness, served_of
from opir_http.service import Service
from opir_http.settings import LOOPBACK, STREAMS_PER_CLIENT
from opir_http.task_routes import task, task_options, untask

_PAGE = Path(__file__).parent / "page"
#: Content types; of texts the framework adds the charset, UTF-8.
_CONTENT_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
}
_JSON = "application/json"
_SCHEMA = "application/schema+json"
_YAML = "application/yaml"
#: Time, s, in which the status must be available for readiness.
_STATUS_S = 2.0
_ENTITY_TAG = re.compile(r'"[0-9a-f]{32}"|\*')

LAUNCH_EXAMPLE = {
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
_LOCATION = ResponseHeader(
    name="Location", value="", documentation_only=True, description="path of the status"
)
_TAG = ResponseHeader(
    name="ETag", value="", documentation_only=True, description="entity tag of the configuration"
)

_IF_MATCH = {
    "name": "If-Match",
    "in": "header",
    "required": True,
    "description": "the ETag of the configuration to replace, or *",
    "schema": {"type": "string", "minLength": 1, "pattern": '^("[0-9a-f]{32}"|\\*)$'},
}

#: Links from a response to further requests (OpenAPI 3.1, link objects).
_AFTER_LAUNCH = {
    "seen": {
        "operationId": "detections",
        "parameters": {"since": "$response.body#/timestamp"},
        "description": "detections since the launch",
    },
    "tracked": {"operationId": "tracks", "description": "tracks, also of this target"},
    "state": {"operationId": "status", "description": "number of targets in the run"},
}
_AFTER_CONFIG = {
    "change": {
        "operationId": "configure",
        "parameters": {"If-Match": "$response.header.ETag"},
        "requestBody": "$response.body",
        "description": "apply a changed configuration",
    }
}
_AFTER_CHANGE = {"changed": {"operationId": "config", "description": "the present configuration"}}
_AFTER_PAGE = {
    "next": {
        "operationId": "detections",
        "parameters": {"after": "$response.body#/next"},
        "description": "the next page, if there is one",
    },
    "same_sensor": {
        "operationId": "detections",
        "parameters": {"sensor_id": "$response.body#/detections/0/sensor_id"},
        "description": "other detections of this sensor",
    },
}


@post(
    "/trigger",
    status_code=202,
    response_headers=[_LOCATION],
    **described(
        "The target is in the run",
        headers=[
            {
                "name": "Idempotency-Key",
                "in": "header",
                "description": "requests with the same key and body get the same answer and make"
                " one launch",
                "schema": {
                    "type": "string",
                    "minLength": 1,
                    "maxLength": 200,
                    "pattern": "^[!-~]+$",
                },
            }
        ],
        body={
            "schema": {"$ref": f"{SCHEMAS}Trigger"},
            "examples": {"launch": {"value": LAUNCH_EXAMPLE}},
        },
        links=_AFTER_LAUNCH,
        problems=(403, 409, 415, 422, 429),
    ),
)
async def trigger(request: AnyRequest) -> Response[LaunchedAnswer]:
    """Launch a target.

    The body has the layout of a target in a scene; `id` and `launch.time_s` are optional. The
    target's events are those of a batch run of the scene with this target.
    """
    served = served_of(request)
    service = served.service
    body = await request.body()
    key = _idempotency_key(request.headers)
    previous = service.answers.begin(key, body) if key else None
    if previous is not None:
        return json_answer(previous, 202, {"Idempotent-Replayed": "true", "Location": "/status"})
    answer = None
    try:
        answer = await asyncio.to_thread(service.launch, json_object(body))
    finally:
        served.forget()
        if key:
            service.answers.end(key, answer)
    return json_answer(answer, 202, {"Location": "/status", **lateness(service)})


def _idempotency_key(headers: Mapping[str, str]) -> str | None:
    key = headers.get("idempotency-key")
    if key is not None and not (0 < len(key) <= 200 and key.isascii() and key.isprintable()):
        raise ProblemError(400, "Idempotency-Key must have 1 to 200 printable ASCII characters")
    return key


@post(
    "/outputs/{output:str}/retry",
    status_code=202,
    response_headers=[_LOCATION],
    **described("It tries again, if it was parked", problems=(403, 404, 429)),
)
async def retry_output(
    request: AnyRequest,
    output: Annotated[
        str,
        PathParameter(
            min_length=1, description="path of the output in the status, or name of its sink"
        ),
    ],
) -> Response[Retried]:
    """Let an output try again.

    An output that its destination refuses keeps its events in its spool and tries again later and
    later; this makes it try at once.
    """
    answer = await asyncio.to_thread(served_of(request).service.retry, output)
    return json_answer(answer, 202, {"Location": "/status"})


@get("/status", **described())
async def status(request: AnyRequest) -> Response[Status]:
    """State and counts of the simulation, its sensors and its sinks."""
    return encoded(await served_of(request).status.get())


# Registered before the other routes of its path: the framework's own answer has the methods of the
# first of them.
@route("/config", http_method=HttpMethod.OPTIONS, status_code=204, include_in_schema=False)
async def config_options() -> Response[None]:
    """Methods of the configuration."""
    return Response(None, media_type="text/plain", headers={"Allow": "GET, OPTIONS, PATCH, PUT"})


@get("/config", response_headers=[_TAG], **described(links=_AFTER_CONFIG))
async def config(request: AnyRequest) -> Response[Config]:
    """The present configuration, with all settings."""
    body, tag = await served_of(request).config.get()
    if request.headers.get("if-none-match") == tag:
        return encoded(b"", 304, {"ETag": tag})
    return encoded(body, headers={"ETag": tag})


@put(
    "/config",
    response_headers=[_TAG],
    **described(
        "Applied from this cycle on",
        headers=[_IF_MATCH],
        body={"schema": {"$ref": f"{SCHEMAS}Config"}},
        links=_AFTER_CHANGE,
        problems=(403, 409, 412, 415, 422, 428, 429),
    ),
)
async def configure(request: AnyRequest) -> Response[Configured]:
    """Replace the configuration.

    Change the answer of GET /config and send it back. It is validated like a scene and applied as a
    whole or not at all, at the start of the cycle in the answer. Settings that need a restart are
    rejected, by name.
    """
    return await _configured(request, is_patch=False)


@patch(
    "/config",
    response_headers=[_TAG],
    status_code=200,
    **described(
        "Applied from this cycle on",
        headers=[_IF_MATCH],
        body={"schema": {"type": "object"}},
        links=_AFTER_CHANGE,
        problems=(403, 409, 412, 415, 422, 428, 429),
    ),
)
async def patch_config(request: AnyRequest) -> Response[Configured]:
    """Change some settings of the configuration.

    The body is a merge patch (RFC 7396) of GET /config: an object replaces the keys that it has,
    null removes a key, a list replaces the whole list. It is applied as PUT applies the result.
    """
    return await _configured(request, is_patch=True)


async def _configured(request: AnyRequest, *, is_patch: bool) -> Response[Configured]:
    served = served_of(request)
    if not served.service.settings.config_writes:
        raise ProblemError(403, "the service was started with --no-config-writes")
    settings = json_object(await request.body())
    if_match = request.headers.get("if-match")
    if if_match is None:
        raise ProblemError(428, "send the ETag of GET /config as If-Match")
    if not _ENTITY_TAG.fullmatch(if_match):
        raise ProblemError(400, "If-Match must be one ETag of GET /config, with its quotes, or *")
    try:
        cycle, tag = await asyncio.to_thread(
            served.service.configure, settings, if_match, is_patch=is_patch
        )
    finally:
        served.forget()
    return json_answer(Configured(cycle), headers={"ETag": tag})


@get("/detections", **described(query=DetectionsQuery, links=_AFTER_PAGE))
async def detections(request: AnyRequest) -> Response[DetectionsAnswer]:
    """Recent detections, newest first; `next` is the parameter `after` of the next page."""
    query: DetectionsQuery = query_of(request)
    service = served_of(request).service
    end = None if query.after is UNSET else int(query.after, 36)
    lines, following = service.feed.history.page(_filter(query, service), end, query.limit)
    cursor = (
        b"null" if following is None else b'"%s"' % np.base_repr(following, 36).lower().encode()
    )
    return encoded(b'{"detections":[' + b",".join(lines) + b'],"next":' + cursor + b"}")


def _filter(query: DetectionsQuery, service: Service) -> Filter:
    types = service.feed.reported_types
    if query.target_type is not UNSET and query.target_type not in types:
        raise ProblemError(400, f"target_type must be one of {', '.join(types)}")
    return Filter(
        sensors=_sensor_rows(query, service),
        types=None if query.target_type is UNSET else (types.index(query.target_type),),
        track=_or_none(query.track_id),
        since_us=time_us(query, "since"),
        until_us=time_us(query, "until"),
        confidence=_or_none(query.min_confidence),
    )


def _or_none(value: Result | UnsetType) -> Result | None:
    return None if value is UNSET else value


def _sensor_rows(query: DetectionsQuery, service: Service) -> tuple[int, ...] | None:
    """Return the indices of the sensors of a query, or None for all."""
    if query.sensor_id is UNSET and query.sensor_type is UNSET:
        return None
    return tuple(
        row
        for row, sensor in enumerate(service.feed.sensors)
        if query.sensor_id in (UNSET, sensor.id) and query.sensor_type in (UNSET, sensor.type)
    )


@get("/tracks", **described(query=TracksQuery))
async def tracks(request: AnyRequest) -> Response[TracksAnswer]:
    """The latest estimate of each track, newest first."""
    query: TracksQuery = query_of(request)
    documents = served_of(request).service.feed.tracks
    return json_answer({"tracks": documents.latest(query.limit, trail=query.trail == "true")})


@get("/activity", **described())
async def activity(request: AnyRequest) -> Response[ActivityAnswer]:
    """Detections per sensor and second of the last two minutes."""
    service = served_of(request).service
    scene_us = service.run.scene.epoch_us + service.run.time_ns // 1000
    return json_answer(service.feed.activity.document(scene_us))


@get(
    "/stream",
    media_type="text/event-stream",
    **described(
        "Server-sent events",
        query=StreamQuery,
        headers=[
            {
                "name": "Last-Event-ID",
                "in": "header",
                "description": "id of the last frame that arrived",
                "schema": {"type": "string"},
            }
        ],
        problems=(503,),
    ),
)
async def stream(request: AnyRequest) -> Stream:
    """Live detections, tracks and status.

    Server-sent events: `detections` (of each cycle, with their `count`; the brief view has a
    sample), `tracks`, `status` (each second), `dropped` (frames lost by a slow client, or
    detections that are no longer in the history), `end`. The schema `StreamEvent` has the data of
    each. The `id` of `detections` is the number of the last one; with `Last-Event-ID` the stream
    goes on after that one: first come the detections since, in one frame without `cycle` and
    `time_s`, as far as the history has them. With any other `Last-Event-ID` than a number that this
    run has reached, the stream begins anew.
    """
    service = served_of(request).service
    if service.feed.viewers >= service.settings.maximum_viewers:
        raise ProblemError(
            503, "the maximum number of viewers is connected", headers={"Retry-After": "5"}
        )
    address = request.client.host if request.client else ""
    if address not in LOOPBACK and service.feed.streams_of(address) >= STREAMS_PER_CLIENT:
        raise ProblemError(429, "this client has too many streams", headers={"Retry-After": "5"})
    client = Client(brief=query_of(request).view == "brief", address=address)
    number = request.headers.get("last-event-id", "")
    # Any other text is not an id of this service: the stream begins anew, as with EventSource.
    if number.isascii() and number.isdigit() and len(number) <= 18:
        service.feed.resume(client, int(number))
    else:
        service.feed.join(client)
    return Stream(_frames(service, client), media_type="text/event-stream")


async def _frames(service: Service, client: Client) -> AsyncIterator[bytes]:
    try:
        async for frame in client.frames():
            yield frame
    finally:
        service.feed.leave(client)


@get(
    "/health/live",
    security=[{}],
    **described("Yes", responses={503: ResponseSpec(Liveness, description="No")}),
)
async def live(request: AnyRequest) -> Response[Liveness]:
    """Whether the simulation is alive: it has not failed and no call is stuck."""
    run = served_of(request).service.run
    reasons = list(run.progress().stuck)
    is_alive = run.state != "failed" and not reasons
    return json_answer(Liveness(run.state, reasons), 200 if is_alive else 503)


@get(
    "/health/ready",
    security=[{}],
    **described("Yes", responses={503: ResponseSpec(Readiness, description="No")}),
)
async def ready(request: AnyRequest) -> Response[Readiness]:
    """Whether cycles end in time, no sink has failed and no backlog grows."""
    served = served_of(request)
    try:
        health = await asyncio.wait_for(served.readiness.get(), _STATUS_S)
        readiness = Readiness(health.ready, health.reasons)
    except TimeoutError:
        readiness = Readiness(False, [f"the status is not available within {_STATUS_S:g} s"])
    return json_answer(readiness, 200 if readiness.ready else 503, lateness(served.service))


@get("/schemas/{encoder:str}", **described("The schema", problems=(404,)))
async def schemas(
    request: AnyRequest,
    encoder: Annotated[str, PathParameter(min_length=1, description="name of an event encoder")],
) -> Response[bytes]:
    """The schema of an encoder's messages.

    A JSON Schema; of a binary encoder the schema in the language of its format, as text.
    """
    text = await asyncio.to_thread(served_of(request).service.schema, encoder)
    is_json_schema = '"$schema"' in text
    return Response(text.encode(), media_type=_SCHEMA if is_json_schema else "text/plain")


@get("/asyncapi.yaml", media_type=_YAML, **described("The document", problems=(404,)))
async def asyncapi(request: AnyRequest) -> Response[bytes]:
    """The AsyncAPI document of the run's topic: that of its first output which has one."""
    text = await asyncio.to_thread(served_of(request).service.asyncapi)
    return Response(text.encode(), media_type=_YAML)


@get("/metrics", media_type="text/plain", **described("Metrics"))
async def metrics(request: AnyRequest) -> Response[bytes]:
    """Metrics in Prometheus's text format."""
    return Response(await served_of(request).metrics.get(), media_type=CONTENT_TYPE)


ROUTES = [
    trigger,
    retry_output,
    task_options,
    task,
    untask,
    status,
    config_options,
    config,
    configure,
    patch_config,
    detections,
    tracks,
    activity,
    stream,
    live,
    ready,
    schemas,
    asyncapi,
    metrics,
]


def document() -> dict[str, Any]:
    """Return the OpenAPI document of the service."""
    document = document_of(
        ROUTES, "A live simulation of overhead infrared missile-warning sensors."
    )
    # Of OpenAPI 3.2 (`itemSchema`), by its registered name for 3.1: the schema of each event, its
    # data read as JSON.
    events = document["paths"]["/stream"]["get"]["responses"]["200"]["content"]
    events["text/event-stream"]["x-oai-itemSchema"] = {"$ref": f"{SCHEMAS}StreamEvent"}
    return document


def application(service: Service) -> Litestar:
    """Return the application of a service."""
    return application_of(ROUTES, document, State({"served": Served(service)}))


def application_of(
    routes: list[Any], openapi_document: Callable[[], Any], state: State
) -> Litestar:
    """Return the application of routes, with the page and the OpenAPI document."""
    return Litestar(
        route_handlers=[*page_routes(openapi_document), *routes],
        exception_handlers={
            ProblemError: answer_problem,
            HTTPException: answer_http,
            Exception: answer_defect,
        },
        before_request=_read_query,
        state=state,
        openapi_config=None,
        logging_config=None,
    )


async def _read_query(request: AnyRequest) -> None:
    """Read the query of a route that says which parameters it has."""
    scope: Any = request.scope
    kind: type[Query] | None = scope["route_handler"].opt.get("query")
    if kind is not None:
        scope["query"] = read_query(scope["query_string"], kind)


def query_of(request: AnyRequest) -> Any:
    """Return the query of a request, an instance of the route's class of queries."""
    scope: Any = request.scope
    return scope["query"]


def page_routes(openapi_document: Callable[[], Any]) -> list[Any]:
    """Return the routes of the page's files and of the OpenAPI document."""
    folders = {folder: _files(folder) for folder in (_PAGE, _PAGE / "vendor")}
    # Encoded when it is wanted: a service starts sooner.
    openapi = cache(lambda: msgspec.json.encode(openapi_document()))

    @get("/", media_type=_CONTENT_TYPES[".html"])
    async def page() -> bytes:
        return folders[_PAGE]["index.html"]

    @get("/page/{name:str}")
    async def part(name: FromPath[str]) -> Response[bytes]:
        return _file(folders[_PAGE], name)

    @get("/page/vendor/{name:str}")
    async def vendored_part(name: FromPath[str]) -> Response[bytes]:
        return _file(folders[_PAGE / "vendor"], name)

    @get("/openapi.json", media_type=_JSON)
    async def openapi_json() -> bytes:
        return await asyncio.to_thread(openapi)

    return [page, part, vendored_part, openapi_json]


def _files(folder: Path) -> dict[str, bytes]:
    return {
        path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in _CONTENT_TYPES
    }


def _file(files: Mapping[str, bytes], name: str) -> Response[bytes]:
    if name not in files:
        raise ProblemError(404, "there is no such file")
    return Response(files[name], media_type=_CONTENT_TYPES[Path(name).suffix])
