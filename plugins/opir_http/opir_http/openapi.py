"""The OpenAPI 3.1 document of the service, from its settings and configuration classes."""

from typing import Any

from opir_core.plugin import REPORTED_TYPES
from opir_http import schemas
from opir_http.problems import PROBLEM_TYPE, TITLES
from opir_http.schemas import COUNT, TEXT, TIME, Schema, closed, listed
from opir_http.settings import MAXIMUM_BODY_BYTES, MAXIMUM_PAGE

LAUNCH_EXAMPLE = {
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}

_JSON = "application/json"
#: UTC times, 1970 to 2099; a day beyond its month is rejected too.
_UTC_TIME = (
    r"^(19[789][0-9]|20[0-9]{2})-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])"
    r"T([01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9](\.[0-9]{1,6})?Z$"
)
_TAG: Schema = {"ETag": {"schema": TEXT, "description": "entity tag of the configuration"}}
_RETRY: Schema = {
    "Retry-After": {"schema": {"type": "string"}, "description": "time until the next attempt, s"}
}
_ALWAYS = (400, 401, 405, 408, 413, 421, 500)

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


def document() -> dict[str, Any]:
    """Return the OpenAPI document."""
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "opir",
            "version": "1.0",
            "summary": "A live simulation of overhead infrared missile-warning sensors.",
            "description": "Unclassified and notional; for tests of systems that receive such"
            " events."
            f" Request bodies have at most {MAXIMUM_BODY_BYTES} bytes. Errors are problem details"
            f" (RFC 9457).",
        },
        "paths": {
            "/trigger": {"post": _trigger()},
            "/outputs/{output}/retry": {"post": _retry()},
            "/status": {
                "get": _get(
                    "status",
                    "State and counts of the simulation, its sensors and its sinks",
                    "Status",
                )
            },
            "/config": {"get": _config(), "put": _configure()},
            "/detections": {"get": _detections()},
            "/tracks": {"get": _tracks()},
            "/activity": {
                "get": _get(
                    "activity",
                    "Detections per sensor and second of the last two minutes",
                    "Activity",
                )
            },
            "/stream": {"get": _stream()},
            "/health/live": {
                "get": _health("live", closed({"state": TEXT, "reasons": listed(TEXT)}))
            },
            "/health/ready": {
                "get": _health(
                    "ready", closed({"ready": {"type": "boolean"}, "reasons": listed(TEXT)})
                )
            },
            "/metrics": {"get": _metrics()},
        },
        "components": {
            "schemas": _schemas(),
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
        "security": [{}, {"token": []}],
    }


def view_document() -> dict[str, Any]:
    """Return the OpenAPI document of `opir view`, which only reads a saved run."""
    whole = document()
    paths = {"/status": whole["paths"]["/status"], "/replay": {"get": _replay()}}
    components = whole["components"]
    components["schemas"] |= {"Replay": schemas.replay()}
    return whole | {
        "info": whole["info"] | {"summary": "A saved run of overhead infrared sensors."},
        "paths": paths,
    }


def _replay() -> Schema:
    time: Schema = {"type": "string", "pattern": _UTC_TIME}
    step = {"type": "number", "minimum": 0.1, "maximum": 600, "default": 1}
    parameters = [
        _parameter("since", time) | {"required": True},
        _parameter("until", time) | {"required": True},
    ]
    summary = (
        "A part of the saved run: detections (of many a sample), estimates of tracks once a step,"
        " exact counts"
    )
    return _get("replay", summary, "Replay") | {
        "parameters": [*parameters, _parameter("step_s", step)]
    }


def _schemas() -> Schema:
    return {
        "Trigger": schemas.trigger(),
        "Launched": closed(
            {"id": TEXT, "time_s": {"type": "number"}, "timestamp": TIME, "cycle": COUNT}
        ),
        "Status": schemas.status(),
        "Config": schemas.config(),
        "Configured": closed({"cycle": COUNT}),
        "Retried": closed({"output": TEXT, "was_parked": {"type": "boolean"}}),
        **schemas.detection(),
        "Detections": closed(
            {"detections": listed(_ref("Detection")), "next": schemas.or_null(TEXT)}
        ),
        "Track": schemas.track(),
        "Tracks": closed({"tracks": listed(_ref("Track"))}),
        "Activity": schemas.activity(),
        **schemas.stream(_ref),
        "Problem": schemas.problem(),
    }


def _trigger() -> Schema:
    key = _parameter(
        "Idempotency-Key",
        {"type": "string", "minLength": 1, "maxLength": 200, "pattern": "^[!-~]+$"},
    )
    key |= {
        "in": "header",
        "description": "requests with the same key and body get the same answer and make one"
        " launch",
    }
    headers = {"Location": {"schema": TEXT, "description": "path of the status"}}
    return {
        "operationId": "trigger",
        "summary": "Launch a target",
        "description": "The body has the layout of a target in a scene; `id` and `launch.time_s`"
        " are optional. The"
        " target's events are those of a batch run of the scene with this target.",
        "parameters": [key],
        "requestBody": {"required": True, "content": {_JSON: _media("Trigger", LAUNCH_EXAMPLE)}},
        "responses": {
            "202": _answer(
                "The target is in the run", "Launched", headers=headers, links=_AFTER_LAUNCH
            )
        }
        | _problems(403, 409, 415, 422, 429),
    }


def _retry() -> Schema:
    output = _parameter("output", {"type": "string", "minLength": 1})
    output |= {
        "in": "path",
        "required": True,
        "description": "path of the output in the status, or name of its sink",
    }
    headers = {"Location": {"schema": TEXT, "description": "path of the status"}}
    return {
        "operationId": "retryOutput",
        "summary": "Let an output try again",
        "description": "An output that its destination refuses keeps its events in its spool and"
        " tries again later and"
        " later; this makes it try at once.",
        "parameters": [output],
        "responses": {
            "202": _answer("It tries again, if it was parked", "Retried", headers=headers, links={})
        }
        | _problems(403, 404, 429),
    }


def _config() -> Schema:
    return _get(
        "config",
        "The present configuration, with all settings",
        "Config",
        headers=_TAG,
        links=_AFTER_CONFIG,
    )


def _configure() -> Schema:
    match = _parameter(
        "If-Match", {"type": "string", "minLength": 1, "pattern": '^("[0-9a-f]{32}"|\\*)$'}
    )
    match |= {
        "in": "header",
        "required": True,
        "description": "the ETag of the configuration to replace, or *",
    }
    return {
        "operationId": "configure",
        "summary": "Replace the configuration",
        "description": "Change the answer of GET /config and send it back. It is validated like a"
        " scene and applied as"
        " a whole or not at all, at the start of the cycle in the answer. Settings that need a"
        " restart are rejected, by"
        " name.",
        "parameters": [match],
        "requestBody": {"required": True, "content": {_JSON: _media("Config")}},
        "responses": {
            "200": _answer(
                "Applied from this cycle on", "Configured", headers=_TAG, links=_AFTER_CHANGE
            )
        }
        | _problems(403, 409, 412, 415, 422, 428, 429),
    }


def _detections() -> Schema:
    words: dict[str, Schema] = {
        "limit": {"type": "integer", "minimum": 1, "maximum": MAXIMUM_PAGE, "default": 100},
        "after": {"type": "string", "pattern": "^[0-9a-z]{1,12}$"},
        "sensor_id": TEXT,
        "sensor_type": TEXT,
        "target_type": {
            "type": "string",
            "pattern": "^[A-Za-z0-9._+-]{1,64}$",
            "examples": list(REPORTED_TYPES),
        },
        "track_id": {"type": "integer", "minimum": 0, "maximum": 10**9 - 1},
        "since": {"type": "string", "pattern": _UTC_TIME, "examples": ["2026-04-01T12:00:00Z"]},
        "until": {"type": "string", "pattern": _UTC_TIME, "examples": ["2026-04-01T12:05:00Z"]},
        "min_confidence": {"type": "number", "minimum": 0, "maximum": 1},
    }
    summary = "Recent detections, newest first; `next` is the parameter `after` of the next page"
    parameters = [_parameter(name, schema) for name, schema in words.items()]
    return _get("detections", summary, "Detections", links=_AFTER_PAGE) | {"parameters": parameters}


def _tracks() -> Schema:
    limit = _parameter(
        "limit", {"type": "integer", "minimum": 1, "maximum": MAXIMUM_PAGE, "default": 100}
    )
    trail = _parameter("trail", {"type": "string", "enum": ["true", "false"], "default": "false"})
    trail |= {"description": "whether to add the earlier positions of each track"}
    return _get("tracks", "The latest estimate of each track, newest first", "Tracks") | {
        "parameters": [limit, trail]
    }


def _stream() -> Schema:
    view = _parameter("view", {"type": "string", "enum": ["full", "brief"], "default": "full"})
    last = {
        "name": "Last-Event-ID",
        "in": "header",
        "schema": TEXT,
        "description": "id of the last frame that arrived",
    }
    # Of OpenAPI 3.2 (`itemSchema`), by its registered name for 3.1: the schema of each event, its
    # data read as JSON.
    media = {"schema": TEXT, "x-oai-itemSchema": _ref("StreamEvent")}
    responses = {
        "200": {"description": "Server-sent events", "content": {"text/event-stream": media}}
    }
    return {
        "operationId": "stream",
        "summary": "Live detections, tracks and status",
        "description": "Server-sent events: `detections` (of each cycle, with their `count`; the"
        " brief view has a"
        " sample), `tracks`, `status` (each second), `dropped` (frames lost by a slow client, or"
        " detections that are no"
        " longer in the history), `end`. The schema `StreamEvent` has the data of each. The `id` of"
        " `detections` is the"
        " number of the last one; with `Last-Event-ID` the stream goes on after that one: first"
        " come the detections"
        " since, in one frame without `cycle` and `time_s`, as far as the history has them. An `id`"
        " that this run has"
        " not reached, or what is none, begins the stream anew.",
        "parameters": [view, last],
        "responses": responses | _problems(503),
    }


def _health(name: str, schema: Schema) -> Schema:
    words = {
        "live": "Whether the simulation is alive: it has not failed and no call is stuck",
        "ready": "Whether cycles end in time, no sink has failed and no backlog grows",
    }
    content = {_JSON: {"schema": schema}}
    answers = {
        "200": {"description": "Yes", "content": content},
        "503": {"description": "No", "content": content},
    }
    return {
        "operationId": name,
        "summary": words[name],
        "security": [{}],
        "responses": answers | _problems(),
    }


def _metrics() -> Schema:
    answer = {"description": "Metrics", "content": {"text/plain": {"schema": TEXT}}}
    return {
        "operationId": "metrics",
        "summary": "Metrics in Prometheus's text format",
        "responses": {"200": answer} | _problems(),
    }


def _get(
    name: str, summary: str, schema: str, headers: Schema | None = None, links: Schema | None = None
) -> Schema:
    answer = _answer(summary, schema, headers=headers or {}, links=links or {})
    return {"operationId": name, "summary": summary, "responses": {"200": answer} | _problems()}


def _parameter(name: str, schema: Schema) -> Schema:
    return {"name": name, "in": "query", "required": False, "schema": schema}


def _answer(words: str, schema: str, headers: Schema, links: Schema) -> Schema:
    return {
        "description": words,
        "headers": headers,
        "content": {_JSON: _media(schema)},
        "links": links,
    }


def _problems(*statuses: int) -> Schema:
    content = {PROBLEM_TYPE: {"schema": _ref("Problem")}}
    problems = {
        str(status): {"description": TITLES[status], "content": content}
        for status in sorted({*_ALWAYS, *statuses})
    }
    if "429" in problems:
        problems["429"] = problems["429"] | {"headers": _RETRY}
    return problems


def _media(schema: str, example: Any = None) -> Schema:
    media: Schema = {"schema": _ref(schema)}
    return media if example is None else media | {"examples": {"launch": {"value": example}}}


def _ref(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}
