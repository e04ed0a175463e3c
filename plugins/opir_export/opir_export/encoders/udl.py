"""The `udl` encoder: one MissileTrack of the Unified Data Library per detection and line.

A record has the detection and its track's estimate.
Field names, units and meanings are those of the UDL's public interface description
(unifieddatalibrary.com, MissileTrack and its vectors): lengths in km, angles in degrees, times in
ISO 8601. Unknown fields are absent. Every record is marked as simulated.
"""

from collections.abc import Sequence

import msgspec
import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import CONTAINMENT, containment_ellipse
from opir_core.geometry import ecef_to_geodetic
from opir_core.interfaces import IMPACT_METHODS, Viewpoints
from opir_core.output import (
    DEGREE_DECIMALS,
    RATIO_DECIMALS,
    Column,
    Decimal,
    Ids,
    Looked,
    event_times,
    number_texts,
    reference,
    require_valid,
    rounded,
    rounded_bearing_deg,
    rounded_degrees,
    rounded_longitude_deg,
    time_texts,
    vector_texts,
)
from opir_core.plugin import Encoder, EncoderContext, Sensor, Tracks, Window
from opir_core.scene import UNKNOWN_TYPE
from opir_export.encoders.forge_c2 import estimated_positions_ecef_m, positions_ecef_m

#: Version of the schema, in the headers of messages.
UDL_VERSION = "udl-1.0"

_PAPER = IMPACT_METHODS.index("paper")
_ID = b'{"classificationMarking":"U","dataMode":"SIMULATED","source":"opir","msgType":"OPIR","id":"'
_TIME = b'","ts":"'
_CONTAINMENT = b',"containment":%b' % msgspec.json.encode(100.0 * CONTAINMENT)
_KM_PER_M = 1e-3
#: Decimals of lengths in km: to the millimetre.
_KM_DECIMALS = 6
#: Lower limit of space (the UDL's `env`: "AIR: between sea level and the Karman line, ... 100
#: kilometers").
_SPACE_FROM_M = 100_000.0

_json = msgspec.json.Encoder().encode


class UdlEncoder(Encoder):
    """Detections as lines of JSON, a MissileTrack each."""

    content_type = "application/json"
    schema_version = UDL_VERSION

    def __init__(self, context: EncoderContext) -> None:
        self._sensors = context.sensors
        self._count = len(context.reported_types)
        self._epoch_us = context.epoch_us
        self._type_texts = [
            text for sensor in context.sensors for text in _types(sensor, context.reported_types)
        ]
        self._vector_texts = [
            b',"origSensorId":%b,"timeSource":"SCENE","epoch":"' % _json(sensor.id)
            for sensor in context.sensors
        ]
        self._render = context.render or reference

    def encode(self, window: Window) -> bytes:
        """Return the window's detections as lines; invalid values raise `ModelError`."""
        detections = window.detections
        if not len(detections):
            return b""
        require_valid(window, self._sensors, self._count)
        angles = Viewpoints.of(detections.sensor, detections.sensor_ecef_m).angles(
            detections.line_of_sight_ecef
        )
        sensor = detections.sensor.astype(np.int64)
        look, report = event_times(detections, self._epoch_us)
        return self._render(
            len(detections),
            [
                *(_ID, Ids(detections.detection_id), _TIME, report, b'",'),
                Looked(self._type_texts, sensor * self._count + detections.reported_type),
                Decimal(np.degrees(angles.elevation_rad), DEGREE_DECIMALS),
                b',"trkConf":',
                Decimal(detections.confidence, RATIO_DECIMALS),
                *_track_columns(window, self._epoch_us),
                self._vectors(window, sensor, look.pieces()),
                b"}\n",
            ],
        )

    def _vectors(self, window: Window, sensor: IntArray, times: Sequence[bytes]) -> Column:
        """Return the environment and one vector per detection.

        The vector is the track's state, or the intersection of the line of sight with the ground.
        `times` (n,) are those of the looks.
        """
        where_m = positions_ecef_m(window)
        is_known = np.isfinite(where_m[:, 0])
        place = ecef_to_geodetic(where_m)
        is_state = np.isfinite(estimated_positions_ecef_m(window)[:, 0])
        kinds = np.where(
            is_state, np.where(place.height_m > _SPACE_FROM_M, 3, 2), np.where(is_known, 1, 0)
        )
        states = iter(_states(window, np.flatnonzero(is_state), where_m))
        columns = zip(
            Looked(self._vector_texts, sensor).pieces(),
            times,
            number_texts(rounded_degrees(np.where(is_known, place.latitude_rad, 0.0))),
            number_texts(rounded_longitude_deg(np.where(is_known, place.longitude_rad, 0.0))),
            number_texts(
                rounded(np.where(is_known, place.height_m, 0.0) * _KM_PER_M, _KM_DECIMALS)
            ),
            strict=True,
        )
        return Looked(
            [
                _VECTOR[kind] % (*fields, next(states) if kind > 1 else b"") if kind else _NO_VECTOR
                for kind, fields in zip(kinds.tolist(), columns, strict=True)
            ]
        )


_NO_VECTOR = b',"env":"UNKNOWN","vectors":[]'
_PLACE = b'%b%b","vectorLat":%b,"vectorLon":%b,"vectorAlt":%b%b}]'
_VECTOR = {
    1: b',"env":"UNKNOWN","vectors":[{"type":"LOS"' + _PLACE,
    2: b',"env":"AIR","vectors":[{"type":"STATE"' + _PLACE,
    3: b',"env":"SPACE","vectors":[{"type":"STATE"' + _PLACE,
}


def _types(sensor: Sensor, reported_types: Sequence[str]) -> list[bytes]:
    """Return one text per reported type; the unknown type is absent."""
    source = b',"infoSource":%b,"angElev":' % _json(sensor.type)
    kinds = [
        b"" if code == UNKNOWN_TYPE else b',"acftSubType":"%b"' % name.encode()
        for code, name in enumerate(reported_types)
    ]
    return [b'"objType":"MISSILE"%b%b' % (kind, source) for kind in kinds]


def _states(window: Window, rows: IntArray, where_m: FloatArray) -> list[bytes]:
    """Return the cartesian fields of the vectors of `rows`, propagated to their detections."""
    velocity = window.estimates.state[window.detections.estimate[rows], 3:]
    positions = vector_texts(rounded(where_m[rows] * _KM_PER_M, _KM_DECIMALS))
    velocities = vector_texts(rounded(velocity * _KM_PER_M, _KM_DECIMALS))
    return [
        b',"referenceFrame":"ECEF","propagated":true,"pos":[%b],"vel":[%b]' % vectors
        for vectors in zip(positions, velocities, strict=True)
    ]


def _track_columns(window: Window, epoch_us: int) -> list[Column]:
    """Return track number, launch and impact; detections of one estimate share their text."""
    track = window.detections.track
    estimate = window.detections.estimate
    numbers, of_row = np.unique(track, return_inverse=True)
    names = [b"" if number < 0 else b',"trackId":"%d"' % number for number in numbers.tolist()]
    columns: list[Column] = [Looked(names, of_row)]
    rows, of_row = np.unique(estimate, return_inverse=True)
    estimates = rows[rows >= 0]
    if len(estimates):
        points = _launches_and_impacts(window.estimates.take(estimates), epoch_us)
        columns.append(Looked([*[b""] * (len(rows) - len(estimates)), *points], of_row))
    return columns


def _launches_and_impacts(estimates: Tracks, epoch_us: int) -> list[bytes]:
    """Return launch and impact of each estimate as fields, with their areas of uncertainty."""
    launch = _points(b"launch", estimates.launch, estimates.launch_covariance, epoch_us, None)
    # The sigma of the paper's law is not an area of uncertainty.
    is_paper = (estimates.impact_method == _PAPER)[:, np.newaxis, np.newaxis]
    spread = np.where(is_paper, np.nan, estimates.impact_covariance)
    impact = _points(b"impact", estimates.impact, spread, epoch_us, estimates.impact_sigmas)
    texts = map(b"".join, zip(launch, impact, strict=True))
    return [text + (_CONTAINMENT if b"AouType" in text else b"") for text in texts]


def _points(
    kind: bytes,
    place: FloatArray,
    covariance_m2: FloatArray,
    epoch_us: int,
    reported_sigmas: FloatArray | None,
) -> list[bytes]:
    """Return points (n, 3) of latitude_rad, longitude_rad, time_s as fields; b"" if unknown."""
    on_earth = np.isfinite(place[:, 1]) & (np.abs(place[:, 0]) <= 0.5 * np.pi)
    filled = np.where(on_earth[:, np.newaxis], place, 0.0)
    latitude = number_texts(rounded_degrees(filled[:, 0]))
    longitude = number_texts(rounded_longitude_deg(np.mod(filled[:, 1], 2.0 * np.pi)))
    areas = _areas(covariance_m2, reported_sigmas)
    times = (text.encode() if text else b"" for text in time_texts(filled[:, 2], epoch_us))
    texts = zip(on_earth.tolist(), latitude, longitude, times, areas, strict=True)
    return [
        b',"%bLat":%b,"%bLon":%b%b%b'
        % (
            kind,
            lat,
            kind,
            lon,
            time and b',"%bTime":"%b"' % (kind, time),
            area and area % (kind, kind),
        )
        if is_known
        else b""
        for is_known, lat, lon, time, area in texts
    ]


def _areas(covariance_m2: FloatArray, reported_sigmas: FloatArray | None) -> list[bytes]:
    """Return areas of uncertainty: the 95 % ellipse as bearing, degrees, and semi-axes, km."""
    ellipse = containment_ellipse(covariance_m2, reported_sigmas=reported_sigmas)
    has_ellipse = np.isfinite(ellipse.semi_major_m)
    axes = np.column_stack(
        [
            rounded_bearing_deg(np.where(has_ellipse, ellipse.bearing_rad, 0.0), 180.0),
            rounded(ellipse.semi_major_m * _KM_PER_M, _KM_DECIMALS),
            rounded(ellipse.semi_minor_m * _KM_PER_M, _KM_DECIMALS),
        ]
    )
    texts = vector_texts(np.where(has_ellipse[:, np.newaxis], axes, 0.0))
    return [
        b',"%%bAouType":"ELLIPSE","%%bAouData":[%b]' % text if is_known else b""
        for is_known, text in zip(has_ellipse.tolist(), texts, strict=True)
    ]
