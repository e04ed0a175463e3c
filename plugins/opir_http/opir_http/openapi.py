"""The service described: OpenAPI 3.1, made from the same settings and configuration classes that it runs on."""

from typing import Any

from opir_core.scene.scene import REPORTED_TYPES
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
#: Moments of UTC, 1970 to 2099; a day that its month does not have is refused, too.
_MOMENT = (
    r"^(19[789][0-9]|20[0-9]{2})-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])"
    r"T([01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9](\.[0-9]{1,6})?Z$"
)
_TAG: Schema = {"ETag": {"schema": TEXT, "description": "tag of the configuration"}}
_RETRY: Schema = {"Retry-After": {"schema": {"type": "string"}, "description": "when to try again, s"}}
_ALWAYS = (400, 401, 405, 408, 413, 421, 500)

#: What an answer leads on to (OpenAPI 3.1, link objects).
_AFTER_LAUNCH = {
    "seen": {
        "operationId": "detections",
        "parameters": {"since": "$response.body#/timestamp"},
        "description": "detections from the launch on",
    },
    "tracked": {"operationId": "tracks", "description": "the tracks that come of it"},
    "state": {"operationId": "status", "description": "how many targets are in the run"},
}
_AFTER_CONFIG = {
    "change": {
        "operationId": "configure",
        "parameters": {"If-Match": "$response.header.ETag"},
        "requestBody": "$response.body",
        "description": "put it in force again, changed",
    }
}
_AFTER_CHANGE = {"changed": {"operationId": "config", "description": "the configuration in force"}}
_AFTER_PAGE = {
    "next": {
        "operationId": "detections",
        "parameters": {"after": "$response.body#/next"},
        "description": "the following page, where there is one",
    },
    "same_sensor": {
        "operationId": "detections",
        "parameters": {"sensor_id": "$response.body#/detections/0/sensor_id"},
        "description": "what else that sensor saw",
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
            "description": "Unclassified, notional, for the test of systems that receive such events."
            f" Bodies have at most {MAXIMUM_BODY_BYTES} bytes. Errors are problem details (RFC 9457).",
        },
        "paths": {
            "/trigger": {"post": _trigger()},
            "/status": {"get": _get("status", "How the simulation, its sensors and its sinks stand", "Status")},
            "/config": {"get": _config(), "put": _configure()},
            "/detections": {"get": _detections()},
            "/tracks": {"get": _tracks()},
            "/stream": {"get": _stream()},
            "/health/live": {"get": _health("live", closed({"state": TEXT}))},
            "/health/ready": {"get": _health("ready", closed({"ready": {"type": "boolean"}, "reasons": listed(TEXT)}))},
            "/metrics": {"get": _metrics()},
        },
        "components": {"schemas": _schemas(), "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}},
        "security": [{}, {"token": []}],
    }


def _schemas() -> Schema:
    return {
        "Trigger": schemas.trigger(),
        "Launched": closed({"id": TEXT, "time_s": {"type": "number"}, "timestamp": TIME, "cycle": COUNT}),
        "Status": schemas.status(),
        "Config": schemas.config(),
        "Configured": closed({"cycle": COUNT}),
        **schemas.detection(),
        "Detections": closed({"detections": listed(_ref("Detection")), "next": schemas.or_null(TEXT)}),
        "Track": schemas.track(),
        "Tracks": closed({"tracks": listed(_ref("Track"))}),
        "Problem": schemas.problem(),
    }


def _trigger() -> Schema:
    key = _parameter("Idempotency-Key", {"type": "string", "minLength": 1, "maxLength": 200, "pattern": "^[!-~]+$"})
    key |= {"in": "header", "description": "the same key with the same body gets the same answer, and one launch"}
    headers = {"Location": {"schema": TEXT, "description": "where to look"}}
    return {
        "operationId": "trigger",
        "summary": "Launch a target",
        "description": "The body is a target as a scene has it; `id` and `launch.time_s` may be left out. A launch"
        " that is let in gives the events that it gives in a batch run of the scene with it.",
        "parameters": [key],
        "requestBody": {"required": True, "content": {_JSON: _media("Trigger", LAUNCH_EXAMPLE)}},
        "responses": {"202": _answer("The launch is in the run", "Launched", headers=headers, links=_AFTER_LAUNCH)}
        | _problems(409, 415, 422, 429),
    }


def _config() -> Schema:
    return _get(
        "config", "The configuration in force, every setting written out", "Config", headers=_TAG, links=_AFTER_CONFIG
    )


def _configure() -> Schema:
    match = _parameter("If-Match", {"type": "string", "minLength": 1, "pattern": '^("[0-9a-f]{32}"|\\*)$'})
    match |= {"in": "header", "required": True, "description": "the ETag of the configuration that it replaces, or *"}
    return {
        "operationId": "configure",
        "summary": "Put a whole configuration in force",
        "description": "Take what GET /config gives, change it, send it back. It is checked as a scene is, and applied"
        " whole or not at all, at the start of the cycle that the answer names. Settings that need a restart are"
        " refused, by name.",
        "parameters": [match],
        "requestBody": {"required": True, "content": {_JSON: _media("Config")}},
        "responses": {"200": _answer("In force from this cycle on", "Configured", headers=_TAG, links=_AFTER_CHANGE)}
        | _problems(403, 409, 412, 415, 422, 428, 429),
    }


def _detections() -> Schema:
    words: dict[str, Schema] = {
        "limit": {"type": "integer", "minimum": 1, "maximum": MAXIMUM_PAGE, "default": 100},
        "after": {"type": "string", "pattern": "^[0-9a-z]{1,12}$"},
        "sensor_id": TEXT,
        "sensor_type": TEXT,
        "target_type": {"type": "string", "enum": list(REPORTED_TYPES)},
        "track_id": {"type": "integer", "minimum": 0, "maximum": 10**9 - 1},
        "since": {"type": "string", "pattern": _MOMENT, "examples": ["2026-04-01T12:00:00Z"]},
        "until": {"type": "string", "pattern": _MOMENT, "examples": ["2026-04-01T12:05:00Z"]},
        "min_confidence": {"type": "number", "minimum": 0, "maximum": 1},
    }
    summary = "Recent detections, newest first; `next` is the `after` of the following page"
    parameters = [_parameter(name, schema) for name, schema in words.items()]
    return _get("detections", summary, "Detections", links=_AFTER_PAGE) | {"parameters": parameters}


def _tracks() -> Schema:
    limit = _parameter("limit", {"type": "integer", "minimum": 1, "maximum": MAXIMUM_PAGE, "default": 100})
    return _get("tracks", "The latest estimate of each track, newest first", "Tracks") | {"parameters": [limit]}


def _stream() -> Schema:
    view = _parameter("view", {"type": "string", "enum": ["full", "brief"], "default": "full"})
    responses = {"200": {"description": "Server-sent events", "content": {"text/event-stream": {"schema": TEXT}}}}
    return {
        "operationId": "stream",
        "summary": "Detections, tracks and status as they come",
        "description": "Server-sent events: `detections` (each cycle's, with their `count`; a brief view has some of"
        " them), `tracks`, `status` (each second), `dropped` (frames this client was too slow for), `end`.",
        "parameters": [view],
        "responses": responses | _problems(503),
    }


def _health(name: str, schema: Schema) -> Schema:
    words = {"live": "Whether the simulation is alive", "ready": "Whether it does its work and no spool grows"}
    content = {_JSON: {"schema": schema}}
    answers = {
        "200": {"description": "It is", "content": content},
        "503": {"description": "It is not", "content": content},
    }
    return {"operationId": name, "summary": words[name], "security": [{}], "responses": answers | _problems()}


def _metrics() -> Schema:
    answer = {"description": "Metrics", "content": {"text/plain": {"schema": TEXT}}}
    return {
        "operationId": "metrics",
        "summary": "What the service counts, in Prometheus's text format",
        "responses": {"200": answer} | _problems(),
    }


def _get(name: str, summary: str, schema: str, headers: Schema | None = None, links: Schema | None = None) -> Schema:
    answer = _answer(summary, schema, headers=headers or {}, links=links or {})
    return {"operationId": name, "summary": summary, "responses": {"200": answer} | _problems()}


def _parameter(name: str, schema: Schema) -> Schema:
    return {"name": name, "in": "query", "required": False, "schema": schema}


def _answer(words: str, schema: str, headers: Schema, links: Schema) -> Schema:
    return {"description": words, "headers": headers, "content": {_JSON: _media(schema)}, "links": links}


def _problems(*statuses: int) -> Schema:
    content = {PROBLEM_TYPE: {"schema": _ref("Problem")}}
    found = {
        str(status): {"description": TITLES[status], "content": content} for status in sorted({*_ALWAYS, *statuses})
    }
    if "429" in found:
        found["429"] = found["429"] | {"headers": _RETRY}
    return found


def _media(schema: str, example: Any = None) -> Schema:
    media: Schema = {"schema": _ref(schema)}
    return media if example is None else media | {"examples": {"launch": {"value": example}}}


def _ref(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}
