"""JSON Schemas of requests and responses."""

import json
from collections.abc import Callable
from typing import Any

from attrs import fields

from opir_core.builtin import BallisticConfig
from opir_core.interfaces import IMPACT_CONDITIONS, IMPACT_METHODS, TRACK_ENDS
from opir_core.output import detection_schema
from opir_core.plugin import REPORTED_TYPES, FieldInfo
from opir_core.reading import ID_RULE
from opir_core.scene import (
    BY_OBSERVATION,
    BY_REPORT,
    CLASS_TYPES,
    PAPER_TYPES,
    WorkLimits,
    core_target_classes,
    info_of,
)
from opir_http.settings import HttpSettings

Schema = dict[str, Any]

TEXT: Schema = {"type": "string"}
COUNT: Schema = {"type": "integer", "minimum": 0}
NUMBER: Schema = {"type": "number"}
TIME: Schema = {"type": "string", "format": "date-time"}

_KINDS = {float: "number", int: "integer", str: "string", bool: "boolean"}
_BOUNDS = {
    "minimum": "minimum",
    "maximum": "maximum",
    "above": "exclusiveMinimum",
    "below": "exclusiveMaximum",
}


#: The length of an array of four: generators of clients know no `items: false`.
_FOUR: Schema = {"minItems": 4, "maxItems": 4, "items": {"anyOf": [TEXT, NUMBER, {"type": "null"}]}}


def closed(properties: Schema, optional: tuple[str, ...] = ()) -> Schema:
    """Return the schema of an object with these properties and no others."""
    required = [name for name in properties if name not in optional]
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def listed(items: Schema) -> Schema:
    """Return the schema of an array."""
    return {"type": "array", "items": items}


def or_null(schema: Schema) -> Schema:
    """Return a schema that allows null too."""
    return {"anyOf": [schema, {"type": "null"}]}


def schema_of_class(config: type) -> Schema:
    """Return the schema of a configuration class, from its fields."""
    attributes = fields(config)
    optional = tuple(
        attribute.name for attribute in attributes if attribute.default is not _REQUIRED
    )
    return closed(
        {attribute.name: _schema_of_field(attribute) for attribute in attributes}, optional
    )


def trigger() -> Schema:
    """Return the schema of a launch: a target of the model `ballistic`, with optional id and
    time.
    """
    schema = schema_of_class(BallisticConfig)
    launch = schema["properties"]["launch"]
    launch["properties"]["time_s"] = or_null(launch["properties"]["time_s"]) | {
        "description": "ignition, s after the scene's epoch, not in the past; default: the earliest"
        " possible"
    }
    schema["properties"]["type"]["examples"] = list(core_target_classes())
    schema["properties"] |= {
        "id": {"type": "string", "pattern": r"^[A-Za-z0-9._:\-]{1,64}$", "description": ID_RULE},
        "model": {
            "type": "string",
            "enum": ["ballistic"],
            "description": "target model; any installed one is accepted; default: that of the"
            " target class",
        },
    }
    return schema


def config() -> Schema:
    """Return the schema of the configuration: a scene's settings; blocks of components are not
    specified.
    """
    block = {"anyOf": [{"type": "object"}, {"type": "string"}]}
    choices = ("detection", "classification", "confidence", "tracker", "atmosphere", "background")
    parts = {
        "scene": TEXT,
        "epoch": TIME,
        "duration_s": {"type": "number", "exclusiveMinimum": 0},
        "seed": COUNT,
        "light_time": {"type": "boolean"},
        "reported_types": {"type": "string", "enum": [PAPER_TYPES, CLASS_TYPES]},
        "forces": {"description": "forces in free flight"},
        "limits": schema_of_class(WorkLimits),
        "allow_implausible": {"type": "boolean"},
        "sensors": listed({"type": "object"}) | {"minItems": 1},
        **{
            name: block | {"description": f"{name} model: its name, or a block"} for name in choices
        },
        "tracking_order": {"type": "string", "enum": [BY_OBSERVATION, BY_REPORT]},
        "tracking_lag_s": or_null({"type": "number", "minimum": 0}),
        "outputs": listed(block),
        "http": schema_of_class(HttpSettings)
        | {"required": [attribute.name for attribute in fields(HttpSettings)]},
    }
    optional = (
        "light_time",
        "reported_types",
        "forces",
        "limits",
        "allow_implausible",
        "seed",
        *choices,
        "tracking_order",
        "tracking_lag_s",
        "outputs",
    )
    return closed(parts, optional)


def detection() -> Schema:
    """Return the core's schema of a detection, and of the parts that it refers to."""
    text = json.dumps(detection_schema()).replace("#/$defs/", "#/components/schemas/detection-")
    whole: Schema = json.loads(text, object_hook=_without_listed_numbers)
    parts = {f"detection-{name}": part for name, part in whole["$defs"].items()}
    return {
        "Detection": {key: value for key, value in whole.items() if not key.startswith("$")},
        **parts,
    }


def _without_listed_numbers(schema: Schema) -> Schema:
    """Return a schema with the bounds of fractions that it lists: generators of clients know no
    such `enum`.
    """
    values = schema.get("enum")
    if not isinstance(values, list) or not all(isinstance(value, float) for value in values):
        return schema
    rest = {key: value for key, value in schema.items() if key != "enum"}
    return {"type": "number", **rest, "minimum": min(values), "maximum": max(values)}


def problem() -> Schema:
    """Return the schema of problem details."""
    errors = listed(closed({"path": TEXT, "message": TEXT}))
    return closed(
        {"type": TEXT, "title": TEXT, "status": COUNT, "detail": TEXT, "errors": errors},
        ("errors",),
    )


def status() -> Schema:
    """Return the schema of the status document."""
    clock = {
        "timestamp": TIME,
        "epoch": TIME,
        "time_s": NUMBER,
        "duration_s": NUMBER,
        "speed": or_null(NUMBER),
        "lap": COUNT,
        "cycle": COUNT,
        "late_s": NUMBER,
        "latest_s": NUMBER,
        "late_cycles": COUNT,
        "cycle_age_s": NUMBER,
    }
    counts = ("looks", "detections", "targets", "targets_launched", "tracks")
    viewers = ("connected", "dropped_frames", "dropped_windows")
    return closed(
        {
            "scene": TEXT,
            "state": {
                "type": "string",
                "enum": ["starting", "running", "ended", "stopped", "failed", "saved"],
            },
            "error": or_null(TEXT),
            "health": _state_of_health(),
            "clock": closed(clock),
            "counts": closed(dict.fromkeys(counts, COUNT)),
            "sensors": listed(_sensor()),
            "sinks": listed(_sink()),
            "viewers": closed(dict.fromkeys(viewers, COUNT)),
            "replay": closed({"since": TIME, "until": TIME})
            | {"description": "time covered by a saved run"},
        },
        ("replay", "health"),
    )


def track() -> Schema:
    """Return the schema of a track."""
    ellipse = closed(
        dict.fromkeys(("semi_major_m", "semi_minor_m", "bearing_deg", "containment"), NUMBER)
    )
    ellipses = dict.fromkeys(("ellipse", "ellipse_50", "ellipse_90"), or_null(ellipse))
    place = {"lat_deg": NUMBER, "lon_deg": NUMBER, "time": or_null(TIME)}
    point = place | ellipses | {"time_sigma_s": or_null(NUMBER)}
    method: Schema = {"type": "string", "enum": list(IMPACT_METHODS)}
    impact = point | {"method": method, "containment": or_null(NUMBER), "sigma_m": or_null(NUMBER)}
    share = or_null({"type": "number", "minimum": 0, "maximum": 1})
    vectors = dict.fromkeys(("position_ecef_m", "velocity_ecef_m_s"), listed(NUMBER))
    spread = dict.fromkeys(("covariance_ecef", "ellipsoid_sigmas"), or_null(listed(NUMBER)))
    state = or_null(closed({"timestamp": or_null(TIME), **vectors, **spread}))
    return closed(
        {
            "track_id": COUNT,
            "timestamp": TIME,
            "available_at": TIME,
            "latitude_deg": or_null(NUMBER),
            "longitude_deg": or_null(NUMBER),
            "altitude_m": or_null(NUMBER),
            "launch_point": or_null(closed(point)),
            "impact_point": or_null(closed(impact)),
            "impact_regions": listed(_region()),
            "probability_burning": share,
            "probability_relights": share,
            "type_probability": closed(dict.fromkeys(REPORTED_TYPES, or_null(NUMBER))),
            "state": state,
            "burnout": state,
            "hypotheses": or_null({"type": "object", "additionalProperties": share})
            | {
                "description": "probability of each of what the object may be; null if the tracker"
                " weighs none"
            },
            **{
                f"probability_{name}": share
                for name in ("launch", "missile", "orbit", "comes_down")
            },
            "end": {
                "enum": [*TRACK_ENDS[1:], None],
                "description": "how the track ended; null for one that goes on",
            },
            "trail": listed(
                {"type": "array", "prefixItems": [TIME, NUMBER, NUMBER, or_null(NUMBER)], **_FOUR}
            )
            | {
                "description": "earlier positions: time, latitude and longitude in degrees, height"
                " in metres"
            },
        },
        ("trail",),
    )


def replay() -> Schema:
    """Return the schema of a part of a saved run; `Activity`, `Detection` and `Track` are
    components.
    """
    reference = {
        name: {"$ref": f"#/components/schemas/{name}"}
        for name in ("Detection", "Track", "Activity")
    }
    states = listed(closed({"timestamp": TIME, "sensors": listed(_sensor())}))
    return closed(
        {
            "detections": listed(reference["Detection"]),
            "tracks": listed(reference["Track"]),
            "activity": reference["Activity"],
            "sensors": states,
        }
    )


def stream(ref: Callable[[str], Schema]) -> Schema:
    """Return the schemas of the stream's events, by their names; `ref` refers to a schema of the
    document.

    The data of an event is described as the JSON that it is read as.
    """
    detections = {"cycle": or_null(COUNT), "time_s": or_null(NUMBER), "count": COUNT}
    lost = {"frames": COUNT, "detections": COUNT}
    data = {
        "Detections": closed({**detections, "detections": listed(ref("Detection"))}),
        "Tracks": ref("Tracks"),
        "Status": ref("Status"),
        "Dropped": {**closed(lost, optional=tuple(lost)), "minProperties": 1, "maxProperties": 1},
        "End": closed({}),
    }
    parts = {f"{name}Data": each for name, each in data.items() if "$ref" not in each}
    events = {}
    for name, each in data.items():
        ids = {"id": COUNT} if name == "Detections" else {}
        shown = ref(f"{name}Data") if f"{name}Data" in parts else each
        events[f"{name}Event"] = closed(
            {"event": {"type": "string", "const": name.lower()}, **ids, "data": shown}
        )
    return {**parts, **events, "StreamEvent": {"oneOf": [ref(name) for name in events]}}


def activity() -> Schema:
    """Return the schema of the counts of detections per sensor and second."""
    counts = {"type": "object", "additionalProperties": listed(COUNT)}
    return closed(
        {"first_s": COUNT | {"description": "first second, Unix time"}, "sensors": counts}
    )


def _region() -> Schema:
    """Return the schema of an impact region; its geometry is GeoJSON (RFC 7946)."""
    rings = listed(listed(listed(NUMBER) | {"minItems": 2, "maxItems": 2}) | {"minItems": 4})
    kinds = {"Polygon": rings, "MultiPolygon": listed(rings)}
    geometry = {
        "anyOf": [
            closed({"type": {"const": kind}, "coordinates": each}) for kind, each in kinds.items()
        ]
    }
    condition = {
        "type": "string",
        "enum": list(IMPACT_CONDITIONS),
        "description": "what the region presumes",
    }
    figures = {
        "containment": NUMBER,
        "area_km2": NUMBER,
        "condition": condition,
        "probability": NUMBER,
    }
    centre = or_null(listed(NUMBER) | {"minItems": 2, "maxItems": 2})
    return closed(
        {**figures, "effective_samples": or_null(NUMBER), "centre": centre, "geometry": geometry}
    )


def _sensor() -> Schema:
    return closed(
        {
            "sensor_id": TEXT,
            "sensor_type": TEXT,
            "state": {"type": "string", "enum": ["detecting", "searching"]},
            "scan_period_ms": NUMBER,
            "position_ecef_m": listed(NUMBER),
            "field_of_regard_half_angle_deg": NUMBER,
            "detections": COUNT,
            "last_detection": or_null(TIME),
            "health": or_null(_health()),
        }
    )


def _health() -> Schema:
    """Return the schema of what the tracker has found of a sensor; null where nothing is known."""
    pairs = dict.fromkeys(("bias_rad", "bias_sigma_rad"), listed(or_null(NUMBER)))
    names = (
        "clock_s",
        "clock_sigma_s",
        "noise_scale",
        "noise_scale_sigma",
        "innovations",
        "outlier_share",
    )
    return closed({**pairs, **dict.fromkeys(names, or_null(NUMBER)), "text": TEXT})


def _state_of_health() -> Schema:
    """Return the schema of the health of a service: the reasons are those of readiness, `stuck`
    those of liveness.
    """
    flags: Schema = {"ready": {"type": "boolean"}, "alive": {"type": "boolean"}}
    times = dict.fromkeys(("beat_age_s", "longest_pause_s"), NUMBER)
    return closed(
        {**flags, "reasons": listed(TEXT), "stuck": listed(TEXT), **times, "pauses": COUNT}
    )


def _sink() -> Schema:
    counts = (
        "given",
        "delivered",
        "spooled",
        "dropped",
        "withheld",
        "recovered",
        "queued_windows",
        "waits",
        "lag",
    )
    numbers = dict.fromkeys((*counts, "unbalanced", "attempts"), COUNT) | {
        "busy_s": NUMBER,
        "has_spool": {"type": "boolean"},
    }
    state = {"type": "string", "enum": ["open", "parked", "failed", "closed"]}
    return closed({"path": TEXT, "name": TEXT, "state": state, **numbers, "error": or_null(TEXT)})


def _schema_of_field(attribute: Any) -> Schema:
    info = info_of(attribute)
    kind = attribute.type
    words = f"{info.help}{f', {info.unit}' if info.unit else ''}"
    if hasattr(kind, "__attrs_attrs__"):
        return schema_of_class(kind) | {"description": words}
    plain = next(each for each in _KINDS if kind == each or kind == each | None)
    schema = {"type": _KINDS[plain], **_limits(info)}
    return (schema if kind == plain else or_null(schema)) | {"description": words}


def _limits(info: FieldInfo) -> Schema:
    limits = {
        word: getattr(info, name)
        for name, word in _BOUNDS.items()
        if getattr(info, name) is not None
    }
    return limits | ({"enum": list(info.choices)} if info.choices else {})


_REQUIRED = fields(BallisticConfig).type.default
