"""The columns of a run: numpy arrays of one length, one row per look, detection or track.

Arrays are read-only in records that leave the engine.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from attrs import Factory, evolve, field, frozen
from numpy.typing import NDArray

from opir_core.arrays import (
    BoolArray,
    ByteArray,
    FloatArray,
    IndexArray,
    IntArray,
    ObjectArray,
    WordArray,
)
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.sensor_health import SensorHealth
from opir_core.notebook import html_view

if TYPE_CHECKING:
    from opir_core.interfaces.viewpoints import AzimuthElevation


def _computed(column: Callable[[Any], Any]) -> Any:
    """Return the default of a column, computed from the record."""
    return Factory(column, takes_self=True)


def _unknown(*shape: int) -> Any:
    """Return the default of a column of tracks: nan (n, *shape)."""

    def nothing(tracks: Any) -> FloatArray:
        column = np.empty((len(tracks.tick_s), *shape))
        column.fill(np.nan)
        return column

    return _computed(nothing)


def _no_regions(tracks: "Tracks") -> ObjectArray:
    nothing = np.empty(len(tracks.tick_s), dtype=np.object_)
    nothing.fill(())
    return nothing


@frozen(eq=False, repr=False)
class Exposures(Columns):
    """Looks at radiating, visible targets: the input of detection models; one row per look.

    `sensor` and `target` are indices into the plan's sensors and targets. Geometry columns are
    empty for models without `needs_geometry`: `range_m` from sensor to target, `elevation_sine` of
    the sensor above the target's horizon, `target_ecef_m` the target at the time of emission,
    `sensor_ecef_m` the sensor at the time of the look.
    """

    time_s: FloatArray
    emission_time_s: FloatArray
    scan: IntArray
    sensor: IndexArray
    target: IndexArray
    range_m: FloatArray
    elevation_sine: FloatArray
    target_ecef_m: FloatArray
    sensor_ecef_m: FloatArray

    @property
    def elevation_rad(self) -> FloatArray:
        """Return the sensor's elevation above the target's horizon, (n,) rad."""
        return np.arcsin(self.elevation_sine)


@frozen(eq=False, repr=False)
class ClassifierInputs(Columns):
    """Looks that detected: the input of classifiers and confidence models; one row per detection.

    `sensor` and `target` are indices into the plan's sensors and targets; `elevation_sine` is of
    the sensor's elevation above the target's horizon; `band_count` of `band_total` bands confirm;
    `detection_count` is the number of detections of this target by this sensor so far, this one
    included; `snr` is nan if the detection model has none; `band_irradiance_w_m2` (n, B) is as in
    `Detections`, and `band_noise_w_m2` its standard deviation, undefined beyond the sensor's own
    bands, (n, 0) if the detection model has none or the classifier goes by pairs.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = {
        "band_irradiance_w_m2": (0,),
        "band_noise_w_m2": (0,),
    }

    time_s: FloatArray
    sensor: IndexArray
    target: IndexArray
    range_m: FloatArray
    elevation_sine: FloatArray
    bands: ByteArray
    band_count: IntArray
    band_total: IntArray
    detection_count: IndexArray
    snr: FloatArray
    band_irradiance_w_m2: FloatArray
    band_noise_w_m2: FloatArray = field(
        default=_computed(lambda rows: np.empty((len(rows.time_s), 0)))
    )

    @property
    def elevation_rad(self) -> FloatArray:
        """Return the sensor's elevation above the target's horizon, (n,) rad."""
        return np.arcsin(self.elevation_sine)


@frozen(eq=False, repr=False)
class Detections(Columns):
    """Reports of sensors; one row per detection, sorted by report, then time, sensor and look. They
    contain no truth.

    `time_ns` is the scene time of the look, `reported_ns` that of its report, both exact; they are
    the same array if no sensor has a reporting latency. `sensor` is an index into the run's
    sensors; `scan` counts the sensor's scans from the scene's epoch; `detection_id` (n, 2) holds
    the two 64-bit halves of a UUID; `reported_type` is a code into `REPORTED_TYPES`; `bands` a bit
    mask over the sensor's bands; `detection_count` the number of detections of this object by this
    sensor so far; `line_of_sight_ecef` (n, 3) the measured unit vector from sensor to object;
    `sensor_ecef_m` (n, 3) the sensor's position; `snr` is nan if the model has none; `track` is the
    track's number or -1; `estimate` the row of the window's `estimates` that holds the track's
    state at the last tick before the detection, or -1. If the scene tracks in the order of report,
    it is the last tick available before the report.

    `path` (n, 1) is the number of the report's way to the ground among those of the plan's links,
    -1 for a sensor without a link; (n, 0) if the scene has no links.

    `line_of_sight_sigma_rad` (n,) is the standard deviation of this line of sight along each axis
    across it, without the bias common to all lines of sight of a sensor. `band_irradiance_w_m2` (n,
    B) is measured at the aperture, nan beyond the sensor's own bands; B is the largest number of
    bands of the run's sensors, or 0 if the detection model measures no irradiance or there are no
    rows. `type_log_probability` (n, 4) is over `REPORTED_TYPES`, (n, 0) if the classifier has no
    probabilities; `hypothesis_log_probability` (n, H) is over the scene's hypotheses, (n, 0) if it
    has none of them.

    `time_s`, `azimuth_rad` and `elevation_rad` are computed at each access; for both angles call
    `angles()` once. `reported_type`, `confidence` and the probabilities of a classifier that has
    such are computed together at the first access to one of them, unless a tracker reads them.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = {
        "detection_id": (2,),
        "line_of_sight_ecef": (3,),
        "sensor_ecef_m": (3,),
        "band_irradiance_w_m2": (0,),
        "type_log_probability": (0,),
        "hypothesis_log_probability": (0,),
        "path": (0,),
    }

    time_ns: IntArray
    sensor: IndexArray
    scan: IntArray
    detection_id: WordArray
    reported_type: ByteArray
    bands: ByteArray
    detection_count: IndexArray
    confidence: FloatArray
    line_of_sight_ecef: FloatArray
    sensor_ecef_m: FloatArray
    snr: FloatArray
    track: IntArray
    estimate: IntArray
    line_of_sight_sigma_rad: FloatArray
    band_irradiance_w_m2: FloatArray
    type_log_probability: FloatArray = field(
        default=_computed(lambda rows: np.empty((len(rows.time_ns), 0)))
    )
    reported_ns: IntArray = field(default=_computed(lambda rows: rows.time_ns))
    hypothesis_log_probability: FloatArray = field(
        default=_computed(lambda rows: np.empty((len(rows.time_ns), 0)))
    )
    path: IntArray = field(
        default=_computed(lambda rows: np.empty((len(rows.time_ns), 0), dtype=np.int64))
    )

    @property
    def is_delayed(self) -> bool:
        """Whether there are detections, and a column of its own has the times of their reports."""
        return self.reported_ns is not self.time_ns and len(self.time_ns) > 0

    @property
    def type_probability(self) -> FloatArray:
        """Return the probabilities (n, 4) over `REPORTED_TYPES`, or (n, 0); computed at each
        call.
        """
        return np.exp(self.type_log_probability)

    @property
    def time_s(self) -> FloatArray:
        """Return the scene times of the looks, (n,) s; computed at each call."""
        return self.time_ns.astype(np.float64) * 1e-9

    @property
    def azimuth_rad(self) -> FloatArray:
        """Return the azimuths of `angles()`, (n,) rad; both angles are computed at each call."""
        return self.angles().azimuth_rad

    @property
    def elevation_rad(self) -> FloatArray:
        """Return the elevations of `angles()`, (n,) rad; both angles are computed at each call."""
        return self.angles().elevation_rad

    def angles(self) -> "AzimuthElevation":
        """Return the measured lines of sight as azimuth in [0, 2 pi) and elevation, (n,) rad;
        computed at each call.

        Azimuth is clockwise from true north, elevation above the geodetic horizontal, both at the
        sensor; nan if the direction or the sensor's position is.
        """
        from opir_core.interfaces.viewpoints import Viewpoints

        return Viewpoints.of(self.sensor, self.sensor_ecef_m).angles(self.line_of_sight_ecef)


@frozen(eq=False, repr=False)
class DetectionTruth(Columns):
    """The truth of `Detections`, row by row: kept separate, and never encoded into an event.

    `target` is an index into the run's targets, or -1 for a false alarm; `emission_time_s` the
    emission time of the light; `range_m` the true distance; `target_elevation_sine` the sine of the
    sensor's elevation above the target's horizon; `probability` P_d of the look. For false alarms
    these are nan.
    """

    target: IndexArray
    emission_time_s: FloatArray
    range_m: FloatArray
    target_elevation_sine: FloatArray
    probability: FloatArray

    @property
    def target_elevation_rad(self) -> FloatArray:
        """Return the sensor's elevation above the target's horizon, (n,) rad."""
        return np.arcsin(self.target_elevation_sine)


#: Probabilities of the containment ellipsoids and ellipses of states and impacts in tracks.
TRACK_CONTAINMENTS = (0.5, 0.9, 0.95)

#: How an impact was predicted: from the posterior of the track, or by the paper's empirical law,
#: whose sigma contains the impact with no stated probability.
IMPACT_METHODS = ("posterior", "paper")

#: How a track ended, in its last row: not yet; its target came down; it stays in orbit, and nothing
#: new can come; it was lost; its light, which was no launch, went out after moments; or before its
#: lines could tell.
TRACK_ENDS = ("", "impact", "orbit", "lost", "flash", "unresolved")


@frozen(eq=False, repr=False)
class Tracks(Columns):
    """Estimates of a tracker, one row per track and tick, sorted by tick, then track.

    `tick_s` is the time for which an estimate is valid, `available_s` the time at which it became
    available: the same unless reports are late. Unknown quantities are nan. `launch` and `impact`
    (n, 3) are latitude_rad, longitude_rad and time_s; `launch_covariance` and `impact_covariance`
    (n, 3, 3) are over east, north (m) and time (s); `state` (n, 6) is ECEF position and velocity at
    the tick, `state_covariance` (n, 6, 6) its covariance; `burnout` (n, 7) is ECEF position and
    velocity at the end of the burn and its time_s, with `burnout_covariance` (n, 7, 7);
    `type_probability` (n, 4) is over `REPORTED_TYPES`. `impact_sigmas` (n, 3) are the radii of the
    ellipses that contain the impact with the probabilities `TRACK_CONTAINMENTS`, in standard
    deviations of its covariance, and `state_sigmas` (n, 3) those of the ellipsoids that contain the
    state; nan for those of a normal distribution.

    `impact_regions` (n,) are tuples of `ImpactRegion`: for each condition, the most probable first,
    one for each probability of `TRACK_CONTAINMENTS`; empty where unknown; rows may share a tuple.
    `probability_burning` (n,) is that of a burn at the tick, `probability_relights` (n,) that of no
    burn now and another one later. `impact_method` (n,) are codes into `IMPACT_METHODS`.

    `hypothesis_probability` (n, H) is over the scene's hypotheses, (n, 0) if the tracker weighs
    none. Sums over some of them are `probability_missile` (n,), of what comes down ballistically,
    and `probability_orbit`, of what stays in orbit. `probability_launch` is that of anything that
    was launched: of the target classes, and of what none of these is but was launched. `end` (n,)
    are codes into `TRACK_ENDS`.

    `seen_s` (n,) is the time from the first to the last detection. `is_brief` (n,) are tracks whose
    source went out before its detections could tell a launch from a light that stands still: they
    have no launch and no impact.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = {
        "state": (6,),
        "state_covariance": (6, 6),
        "state_sigmas": (3,),
        "launch": (3,),
        "launch_covariance": (3, 3),
        "impact": (3,),
        "impact_covariance": (3, 3),
        "impact_sigmas": (3,),
        "burnout": (7,),
        "burnout_covariance": (7, 7),
        "type_probability": (4,),
        "hypothesis_probability": (0,),
    }

    tick_s: FloatArray
    track: IntArray
    state: FloatArray
    state_covariance: FloatArray
    launch: FloatArray
    launch_covariance: FloatArray
    impact: FloatArray
    impact_covariance: FloatArray
    type_probability: FloatArray
    burnout: FloatArray = field(default=_unknown(7))
    burnout_covariance: FloatArray = field(default=_unknown(7, 7))
    impact_sigmas: FloatArray = field(default=_unknown(3))
    state_sigmas: FloatArray = field(default=_unknown(3))
    available_s: FloatArray = field(default=_computed(lambda rows: rows.tick_s))
    impact_regions: ObjectArray = field(default=_computed(_no_regions))
    probability_burning: FloatArray = field(default=_unknown())
    probability_relights: FloatArray = field(default=_unknown())
    impact_method: ByteArray = field(
        default=_computed(lambda rows: np.zeros(len(rows.track), dtype=np.uint8))
    )
    hypothesis_probability: FloatArray = field(default=_unknown(0))
    probability_launch: FloatArray = field(default=_unknown())
    probability_missile: FloatArray = field(default=_unknown())
    probability_orbit: FloatArray = field(default=_unknown())
    end: ByteArray = field(
        default=_computed(lambda rows: np.zeros(len(rows.track), dtype=np.uint8))
    )
    seen_s: FloatArray = field(default=_unknown())
    is_brief: BoolArray = field(default=_computed(lambda rows: np.full(len(rows.track), False)))


#: The reason of commands that are an operator's tasks.
OPERATOR = "operator"


class CommandRecord(NamedTuple):
    """What became of a command that was given at `time_s`.

    The sensor leaves its former direction at `start_s` and looks in the new one from `from_s` on.
    `refusal` is why it did not take the command, "" if it did; then both times are nan. `mode` is
    the mode that the command names, "" for none. `position_ecef_m` is the point in the axis of the
    field at `from_s`, the Earth's centre at nadir; None for a command without effect.
    """

    time_s: float
    sensor: str
    track: int
    reason: str
    start_s: float
    from_s: float
    refusal: str = ""
    mode: str = ""
    position_ecef_m: tuple[float, ...] | None = None


@frozen(eq=False, repr=False)
class Window:
    """The results of a slice of scene time [start_s, end_s).

    `detections` are those reported in the window, `truth` has their rows; `tracks` are the rows of
    the ticks in the window; `estimates` those to which `detections.estimate` refers. `health` is
    what the tracker has found of the sensors, if it says so. `commands` are those of its director.
    `lost` (sensors,) are the reports that do not arrive, None without links.
    """

    start_s: float
    end_s: float
    looks: int
    detections: Detections
    truth: DetectionTruth
    tracks: Tracks
    estimates: Tracks
    health: SensorHealth | None = None
    commands: tuple[CommandRecord, ...] = ()
    lost: IntArray | None = None

    def __repr__(self) -> str:
        """Return the window in one line."""
        of = (
            f"{self.looks} looks, {len(self.detections)} detections, {len(self.tracks)} rows of"
            f" tracks"
        )
        return f"<Window from {self.start_s:g} to {self.end_s:g} s: {of}>"

    def _repr_html_(self) -> str:
        """Return the first detections for a notebook."""
        return f"<div>{html_view(self, (), [])}{self.detections._repr_html_()}</div>"


#: Bytes of the length before a binary message; the first is 0, with which no line of text begins.
LENGTH_BYTES = 4


def binary_body(messages: Iterable[bytes]) -> bytes:
    """Return binary messages, none of them empty, each after its length: four bytes, big endian.

    A message of 16 MiB or more raises `OverflowError`.
    """
    return b"".join(
        b"\0" + len(message).to_bytes(LENGTH_BYTES - 1, "big") + message for message in messages
    )


def framed_messages(body: bytes) -> list[bytes]:
    """Return the messages of a body, each with its newline or its length; an incomplete last one is
    left out.
    """
    if not body.startswith(b"\0"):
        return [line + b"\n" for line in body.split(b"\n")[:-1]]
    messages = []
    start = 0
    while size := int.from_bytes(body[start : start + LENGTH_BYTES], "big"):
        end = start + LENGTH_BYTES + size
        if end > len(body):
            break
        messages.append(body[start:end])
        start = end
    return messages


@frozen(eq=False, kw_only=True)
class Batch:
    """Encoded events in the order of their times.

    `body` holds the messages, each ended by a newline, or binary ones as `binary_body` returns
    them; `keys` the sensors' ids, or of track messages the tracks' numbers, and `key_of` (n,) the
    index of each message's key. `content_type` and `schema_version` are the encoder's. The
    messages of a version that begins with `heartbeat` are no events.
    """

    body: bytes
    keys: tuple[str, ...]
    key_of: NDArray[np.uint16]
    content_type: str
    schema_version: str

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.key_of)

    @property
    def events(self) -> int:
        """The number of events: none in heartbeats."""
        return 0 if self.schema_version.startswith("heartbeat") else len(self)

    def messages(self) -> list[bytes]:
        """Return the messages, without their newlines or lengths."""
        if self.body.startswith(b"\0"):
            return [message[LENGTH_BYTES:] for message in framed_messages(self.body)]
        return self.body.split(b"\n")[:-1]

    def take(self, rows: Sequence[int]) -> "Batch":
        """Return some of the messages."""
        messages = framed_messages(self.body)
        return evolve(
            self,
            body=b"".join(messages[row] for row in rows),
            key_of=self.key_of[list(rows)],
        )
