"""opir's detections as a Stone Soup detection reader: of a run, windows, or a file of events."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from attrs import frozen
from ordered_set import OrderedSet
from stonesoup.base import Property
from stonesoup.buffered_generator import BufferedGenerator
from stonesoup.reader.base import DetectionReader
from stonesoup.types.angle import Bearing, Elevation
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection

from opir_core import Run
from opir_core.arrays import FloatArray
from opir_core.errors import Problem, SceneError
from opir_core.plugin import REPORTED_TYPES, Detections, Sensor, Window
from opir_core.scene import file_bytes
from opir_stonesoup.models import SightModel, sensor_axes

_UNIX = datetime(1970, 1, 1)
_STEPS = timedelta(microseconds=1)


@frozen
class SensorSight:
    """One line of sight in ECEF, with its time in microseconds of UTC since 1970."""

    time_us: int
    sensor_id: str
    sensor_ecef_m: FloatArray
    direction_ecef: FloatArray
    sigma_rad: float
    metadata: Mapping[str, Any]


class OpirDetectionReader(DetectionReader):  # type: ignore[misc]
    """Detections as elevation and bearing in the axes of their sensor, with a `SightModel` each.

    One step is one sensor at one instant, to the microsecond (Stone Soup's resolution). The
    metadata are `sensor_id`, `detection_id`, `reported_type` and `confidence`, without truth.
    """

    sights: Any = Property(
        doc="`SensorSight`s in order, iterated once for each iteration of the reader"
    )
    ndim_state: int = Property(
        default=9, doc="size of the states that the measurement models are to read"
    )
    light_time: bool = Property(default=True, doc="whether light takes its time")

    @classmethod
    def of_run(cls, run: Run, **settings: Any) -> "OpirDetectionReader":
        """Return the reader of a finished run's detections, in order of observation."""
        epoch_us = _epoch_us(run.manifest["scene"]["epoch"])
        ids = [sensor.id for sensor in run.sensors]
        settings.setdefault("light_time", run.manifest["scene"].get("light_time", True))
        detections = run.detections.take(np.argsort(run.detections.time_ns, kind="stable"))
        return cls(
            sights=list(sights_of(detections, ids, epoch_us, run.reported_types)), **settings
        )

    @classmethod
    def of_windows(
        cls,
        windows: Iterable[Window],
        sensors: Sequence[Sensor],
        epoch_us: int,
        *,
        reported_types: Sequence[str] = REPORTED_TYPES,
        **settings: Any,
    ) -> "OpirDetectionReader":
        """Return the reader of windows in their order, for one iteration.

        Windows are in order of report. `reported_types` are a plan's.
        """
        ids = [sensor.id for sensor in sensors]
        sights = (
            sight
            for window in windows
            for sight in sights_of(window.detections, ids, epoch_us, reported_types)
        )
        return cls(sights=sights, **settings)

    @classmethod
    def of_events(cls, path: str | Path, **settings: Any) -> "OpirDetectionReader":
        """Return the reader of a file of events in the encoding `forge`, one per line.

        Raises `SceneError` with the file and line that is invalid.
        """
        return cls(
            sights=sorted(_events(Path(path)), key=lambda sight: (sight.time_us, sight.sensor_id)),
            **settings,
        )

    @BufferedGenerator.generator_method  # type: ignore[untyped-decorator]
    def detections_gen(self) -> Iterator[tuple[datetime, "OrderedSet[Detection]"]]:
        """Yield the time and the detections of each sensor's instants."""
        step: list[SensorSight] = []
        for sight in self.sights:
            if step and (sight.time_us, sight.sensor_id) != (step[0].time_us, step[0].sensor_id):
                yield self._step(step)
                step = []
            step.append(sight)
        if step:
            yield self._step(step)

    def _step(self, sights: Sequence[SensorSight]) -> tuple[datetime, "OrderedSet[Detection]"]:
        detections = [detection_of(sight, self.ndim_state, self.light_time) for sight in sights]
        return detections[0].timestamp, OrderedSet(detections)


def detection_of(sight: SensorSight, ndim_state: int, light_time: bool) -> Detection:
    """Return a line of sight as a detection with its measurement model.

    The error across the line is isotropic, so that of the bearing is proportional to 1 /
    cos(elevation).
    """
    axes = sensor_axes(sight.sensor_ecef_m)
    x, y, z = axes @ sight.direction_ecef
    elevation = np.arctan2(z, np.hypot(x, y))
    bearing = np.arctan2(y, x)
    sigma = sight.sigma_rad
    model = SightModel(
        ndim_state=ndim_state,
        mapping=(0, 1, 2),
        noise_covar=np.diag([sigma**2, (sigma / np.cos(elevation)) ** 2]),
        translation_offset=StateVector(sight.sensor_ecef_m),
        axes=axes,
        light_time=light_time,
    )
    return Detection(
        StateVector([Elevation(elevation), Bearing(bearing)]),
        timestamp=_UNIX + sight.time_us * _STEPS,
        measurement_model=model,
        metadata=dict(sight.metadata),
    )


def sights_of(
    detections: Detections,
    sensor_ids: Sequence[str],
    epoch_us: int,
    reported_types: Sequence[str] = REPORTED_TYPES,
) -> Iterator[SensorSight]:
    """Yield detections as lines of sight."""
    time_us = epoch_us + np.round(detections.time_ns * 1e-3).astype(np.int64)
    for row in range(len(detections)):
        high, low = (int(half) for half in detections.detection_id[row])
        sensor_id = sensor_ids[detections.sensor[row]]
        yield SensorSight(
            time_us=int(time_us[row]),
            sensor_id=sensor_id,
            sensor_ecef_m=detections.sensor_ecef_m[row],
            direction_ecef=detections.line_of_sight_ecef[row],
            sigma_rad=float(detections.line_of_sight_sigma_rad[row]),
            metadata={
                "sensor_id": sensor_id,
                "detection_id": _uuid(high, low),
                "reported_type": reported_types[detections.reported_type[row]],
                "confidence": float(detections.confidence[row]),
            },
        )


class _JsonEvent(msgspec.Struct):
    detection_id: str
    timestamp: str
    sensor_id: str
    target_type: str
    confidence: float
    azimuth_deg: float
    elevation_deg: float
    line_of_sight_sigma_urad: float
    sensor_position_ecef_m: tuple[float, float, float]


def _events(path: Path) -> Iterator[SensorSight]:
    decoder = msgspec.json.Decoder(_JsonEvent)
    try:
        lines = file_bytes(path).splitlines()
    except OSError as error:
        raise SceneError(
            [Problem("", f"cannot be read: {error.strerror or error}")], source=str(path)
        ) from error
    for number, line in enumerate(lines, start=1):
        try:
            event = decoder.decode(line)
            _require_sense(event)
            time_us = _epoch_us(event.timestamp)
        except (msgspec.DecodeError, ValueError) as error:
            raise SceneError(
                [Problem(f"line {number}", f"is no event of the encoder forge: {error}")],
                source=str(path),
            ) from error
        yield _sight(event, time_us)


def _require_sense(event: _JsonEvent) -> None:
    """Raise `ValueError` where an event's numbers give no line of sight."""
    if not event.line_of_sight_sigma_urad > 0.0:
        raise ValueError(
            f"line_of_sight_sigma_urad is {event.line_of_sight_sigma_urad}, not above 0"
        )
    if not any(event.sensor_position_ecef_m):
        raise ValueError("sensor_position_ecef_m is the centre of the Earth")
    if not event.timestamp.endswith("Z"):
        raise ValueError(f"timestamp {event.timestamp!r} is not UTC with a Z")


def _sight(event: _JsonEvent, time_us: int) -> SensorSight:
    from opir_core.geometry import local_axes

    place = np.array(event.sensor_position_ecef_m)
    azimuth, elevation = np.radians([event.azimuth_deg, event.elevation_deg])
    level = np.cos(elevation)
    local = np.array([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)])
    return SensorSight(
        time_us=time_us,
        sensor_id=event.sensor_id,
        sensor_ecef_m=place,
        direction_ecef=local @ local_axes(place),
        sigma_rad=event.line_of_sight_sigma_urad * 1e-6,
        metadata={
            "sensor_id": event.sensor_id,
            "detection_id": event.detection_id,
            "reported_type": event.target_type,
            "confidence": event.confidence,
        },
    )


def _epoch_us(text: str) -> int:
    return int(np.datetime64(text.removesuffix("Z"), "us").astype(np.int64))


def _uuid(high: int, low: int) -> str:
    digits = f"{high:016x}{low:016x}"
    return "-".join([digits[:8], digits[8:12], digits[12:16], digits[16:20], digits[20:]])
