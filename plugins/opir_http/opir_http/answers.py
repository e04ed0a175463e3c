"""The answers of the service as msgspec Structs: the OpenAPI document has their schemas."""

from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, Raw, Struct, UnsetType

from opir_core.interfaces import IMPACT_CONDITIONS, IMPACT_METHODS, TRACK_ENDS

Schema = dict[str, Any]

#: Where the schemas of the OpenAPI document are.
SCHEMAS = "#/components/schemas/"

Count = Annotated[int, Meta(ge=0)]
Time = Annotated[str, Meta(extra_json_schema={"format": "date-time"})]
Share = Annotated[float, Meta(ge=0, le=1)]


#: A detection that is encoded already.
EncodedDetection = Annotated[Raw, Meta(extra_json_schema={"$ref": f"{SCHEMAS}Detection"})]


class Closed(Struct, forbid_unknown_fields=True):
    """An object with its own properties and no others; its schema is named without `Answer`."""

    def __init_subclass__(cls) -> None:
        cls.__name__ = cls.__name__.removesuffix("Answer")
        cls.__qualname__ = cls.__name__


class Message(Closed):
    """An error in a part of a request."""

    path: str
    message: str


class ProblemAnswer(Closed, kw_only=True):
    """Problem details (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: Count
    detail: str
    errors: list[Message] | UnsetType = UNSET


class LaunchedAnswer(Closed):
    """A target that has joined the run, and the cycle in which it did."""

    id: str
    time_s: float
    timestamp: Time
    cycle: Count


class Configured(Closed):
    """The first cycle of a configuration."""

    cycle: Count


class Task(Closed):
    """What a sensor with a narrow field is to look at: a place or a track, one of both; and in which
    of its modes.
    """

    place_deg: (
        Annotated[
            tuple[Annotated[float, Meta(ge=-90, le=90)], Annotated[float, Meta(ge=-180, le=180)]],
            Meta(description="latitude and east longitude"),
        ]
        | UnsetType
    ) = UNSET
    track_id: Count | UnsetType = UNSET
    mode: str = ""


class TaskedAnswer(Closed):
    """A sensor with a task, given at `time_s`.

    It leaves its former direction at `start_s` and looks in the new one from `from_s` on, null for
    a sensor that is left to the director.
    """

    sensor_id: str
    track_id: Count | None
    time_s: float
    start_s: float | None
    from_s: float | None


class Retried(Closed):
    """An output that tries again."""

    output: str
    was_parked: bool


class Liveness(Closed):
    """The state of a run, and why it is not alive."""

    state: str
    reasons: list[str]


class Readiness(Closed):
    """Whether the service is ready, and why not."""

    ready: bool
    reasons: list[str]


class Health(Closed):
    """Health of the service: `reasons` are those of readiness, `stuck` those of liveness.

    The last cycle ended `beat_age_s` ago. A pause is a time in which the whole process did not run.
    """

    ready: bool
    alive: bool
    reasons: list[str]
    stuck: list[str]
    beat_age_s: float
    pauses: Count
    longest_pause_s: float


class Clock(Closed):
    """Scene time and pace of the run."""

    timestamp: Time
    epoch: Time
    time_s: float
    duration_s: float
    speed: float | None
    lap: Count = 0
    cycle: Count = 0
    late_s: float = 0.0
    latest_s: float = 0.0
    late_cycles: Count = 0
    cycle_age_s: float = 0.0


class CountsAnswer(Closed):
    """Counts since the start of the run."""

    looks: Count
    detections: Count
    targets: Count
    targets_launched: Count
    tracks: Count


class SensorHealthAnswer(Closed):
    """Calibration of a sensor as the tracker estimates it; null where nothing is known."""

    bias_rad: list[float | None]
    bias_sigma_rad: list[float | None]
    clock_s: float | None
    clock_sigma_s: float | None
    noise_scale: float | None
    noise_scale_sigma: float | None
    innovations: float | None
    outlier_share: float | None
    text: str


class SensorPointing(Closed):
    """Where the narrow field of a sensor is.

    `position_ecef_m` is the point that it looks at, null for nadir, and `looks_from` when it has
    turned there, null if it was there from the start. `track_id` is the track that it follows,
    `reason` the command's. `is_tasked` says whether an operator has the sensor; `refusal` why it did
    not take the last command, "" if it did.
    """

    half_angle_deg: float
    mode: str
    modes: list[str]
    position_ecef_m: list[float] | None
    looks_from: Time | None
    track_id: Count | None
    reason: str
    is_tasked: bool
    refusal: str


class SensorState(Closed):
    """Place and state of a sensor; `pointing` of its narrow field, null if it has none."""

    sensor_id: str
    sensor_type: str
    state: Literal["detecting", "searching"]
    scan_period_ms: float
    position_ecef_m: list[float]
    field_of_regard_half_angle_deg: float
    detections: Count
    last_detection: Time | None
    health: SensorHealthAnswer | None
    pointing: SensorPointing | None = None


class SinkState(Closed):
    """Event counts of a sink; `lag` are the events that are still on their way."""

    path: str
    name: str
    state: Literal["open", "parked", "failed", "closed"]
    given: Count
    delivered: Count
    spooled: Count
    dropped: Count
    withheld: Count
    recovered: Count
    queued_windows: Count
    waits: Count
    busy_s: float
    attempts: Count
    unbalanced: Count
    has_spool: bool
    error: str | None
    lag: Count


class Viewers(Closed):
    """Clients of the stream, and their losses."""

    connected: Count = 0
    dropped_frames: Count = 0
    dropped_windows: Count = 0


class Covered(Closed):
    """Time covered by a saved run."""

    since: Time
    until: Time


class Status(Closed, kw_only=True):
    """State and counts of the simulation, its sensors and its sinks."""

    version: Annotated[str, Meta(description="of opir-core")]
    scene: str
    state: Literal["starting", "running", "ended", "stopped", "failed", "saved"]
    error: str | None
    health: Health | UnsetType = UNSET
    clock: Clock
    counts: CountsAnswer
    sensors: list[SensorState]
    sinks: list[SinkState]
    viewers: Viewers
    replay: Covered | UnsetType = UNSET


class DetectionsAnswer(Closed):
    """A page of detections, newest first."""

    detections: list[EncodedDetection]
    next: str | None


class EllipseAnswer(Closed):
    """A confidence ellipse on the ground."""

    semi_major_m: float
    semi_minor_m: float
    bearing_deg: float
    containment: float


class LaunchPoint(Closed):
    """An estimate of the launch point and time."""

    lat_deg: float
    lon_deg: float
    time: Time | None
    ellipse: EllipseAnswer | None
    ellipse_50: EllipseAnswer | None
    ellipse_90: EllipseAnswer | None
    time_sigma_s: float | None


class ImpactPointAnswer(LaunchPoint):
    """A predicted impact point and time."""

    method: Annotated[str, Meta(extra_json_schema={"enum": list(IMPACT_METHODS)})]
    containment: float | None
    sigma_m: float | None


#: Longitude and latitude, deg.
Place = Annotated[list[float], Meta(min_length=2, max_length=2)]
Rings = list[Annotated[list[Place], Meta(min_length=4)]]


class Polygon(Closed, tag_field="type", tag=True):
    """A polygon (RFC 7946)."""

    coordinates: Rings


class MultiPolygon(Closed, tag_field="type", tag=True):
    """Several polygons (RFC 7946)."""

    coordinates: list[Rings]


class ImpactRegionAnswer(Closed):
    """A region that holds the impact point with the probability `containment`, on a condition."""

    containment: float
    area_km2: float
    condition: Annotated[str, Meta(extra_json_schema={"enum": list(IMPACT_CONDITIONS)})]
    probability: float
    effective_samples: float | None
    centre: Place | None
    geometry: Polygon | MultiPolygon


class State(Closed):
    """Position and velocity, with their covariance."""

    timestamp: Time | None
    position_ecef_m: list[float]
    velocity_ecef_m_s: list[float]
    covariance_ecef: list[float] | None
    ellipsoid_sigmas: list[float] | None


_POSITION = Meta(
    min_length=4,
    max_length=4,
    extra_json_schema={
        "prefixItems": [
            {"type": "string", "format": "date-time"},
            {"type": "number"},
            {"type": "number"},
            {"anyOf": [{"type": "number"}, {"type": "null"}]},
        ]
    },
)


class TypeProbability(Closed):
    """Probability of each reported type."""

    ICBM: float | None
    IRBM: float | None
    SRBM: float | None
    UNKNOWN: float | None


class Track(Closed):
    """The latest estimate of a track; `end` is how it ended, null for one that goes on."""

    track_id: Count
    timestamp: Time
    available_at: Time
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    launch_point: LaunchPoint | None
    impact_point: ImpactPointAnswer | None
    impact_regions: list[ImpactRegionAnswer]
    probability_burning: Share | None
    probability_relights: Share | None
    type_probability: TypeProbability
    state: State | None
    burnout: State | None
    hypotheses: Annotated[
        dict[str, Share | None] | None,
        Meta(description="probability of each hypothesis; null if the tracker weighs none"),
    ]
    probability_launch: Share | None
    probability_missile: Share | None
    probability_orbit: Share | None
    probability_comes_down: Share | None
    end: Annotated[str, Meta(extra_json_schema={"enum": list(TRACK_ENDS[1:])})] | None
    trail: (
        Annotated[
            list[Annotated[list[str | float | None], _POSITION]],
            Meta(
                description="earlier positions: time, latitude and longitude in degrees, height in"
                " metres"
            ),
        ]
        | UnsetType
    ) = UNSET


class TracksAnswer(Closed):
    """Estimates of tracks."""

    tracks: list[Track]


class ActivityAnswer(Closed):
    """Detections per sensor and second, from `first_s`, Unix time."""

    first_s: Count
    sensors: dict[str, list[Count]]


class SensorStatesAnswer(Closed):
    """The sensors at a time."""

    timestamp: Time
    sensors: list[SensorState]


class ReplayAnswer(Closed):
    """A part of a saved run."""

    detections: list[EncodedDetection]
    tracks: list[Track]
    activity: ActivityAnswer
    sensors: list[SensorStatesAnswer]


class DetectionsData(Closed):
    """The detections of a cycle; those sent again have neither cycle nor time."""

    cycle: Count | None
    time_s: float | None
    count: Count
    detections: list[EncodedDetection]


class DroppedData(Closed):
    """Frames that a slow client lost, or detections that are no longer in the history."""

    frames: Count | UnsetType = UNSET
    detections: Count | UnsetType = UNSET


class EndData(Closed):
    """The end of the stream has no data."""


class Event(Closed, tag_field="event"):
    """A server-sent event, its data read as JSON."""


class DetectionsEvent(Event, tag="detections"):
    """New detections; `id` is the number of the last one."""

    id: Count
    data: DetectionsData


class TracksEvent(Event, tag="tracks"):
    """Estimates of a tick."""

    data: TracksAnswer


class StatusEvent(Event, tag="status"):
    """The status, each second."""

    data: Status


class DroppedEvent(Event, tag="dropped"):
    """A loss."""

    data: Annotated[DroppedData, Meta(extra_json_schema={"minProperties": 1, "maxProperties": 1})]


class EndEvent(Event, tag="end"):
    """The end of the stream."""

    data: EndData


StreamEvent = DetectionsEvent | TracksEvent | StatusEvent | DroppedEvent | EndEvent

#: The answers of all routes: their schemas have those of their parts.
ANSWERS = (
    ActivityAnswer,
    Configured,
    DetectionsAnswer,
    LaunchedAnswer,
    Liveness,
    ProblemAnswer,
    Readiness,
    ReplayAnswer,
    Retried,
    Status,
    Task,
    TaskedAnswer,
    TracksAnswer,
    StreamEvent,
)
