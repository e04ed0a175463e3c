"""The `forge-c2` encoder: flat JSON records of a command-and-control consumer, one per line.

Its consumers replace a missing number by 0, so every event has a position: the track's estimate,
propagated to the time of the detection, or the intersection of the line of sight with the Earth. A
detection with neither has no message.
"""

import msgspec
import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.geometry import ecef_to_geodetic, intersection_with_ellipsoid
from opir_core.interfaces import Viewpoints
from opir_core.output import (
    DEGREE_DECIMALS,
    METRE_DECIMALS,
    RATIO_DECIMALS,
    Column,
    Decimal,
    Ids,
    Looked,
    event_times,
    number_texts,
    only_encodable,
    propagated_positions,
    reference,
    require_valid,
    rounded_bearing_deg,
    rounded_longitude_deg,
    rounded_number,
)
from opir_core.plugin import Detections, Encoder, EncoderContext, Sensor, Window

#: Version of the schema, in the headers of messages.
FORGE_C2_VERSION = "forge-c2-1.0"

_ID = b'{"event_id":"'
_TIME = b'","timestamp":"'
_SENSOR = b'"sensor_id":%b,"sensor_type":"OPIR","latitude":'
_M_PER_UM = 1e-6
#: Range of the largest component of a plausible estimated position, m.
_NEAREST_M = 1e6
_FARTHEST_M = 1e9
_SIGNAL = b',"signal_type":"IR","intensity":'

_json = msgspec.json.Encoder().encode


class ForgeC2Encoder(Encoder):
    """Detections as lines of JSON, one flat object each, all with a position."""

    content_type = "application/json"
    schema_version = FORGE_C2_VERSION

    def __init__(self, context: EncoderContext) -> None:
        self._sensors = context.sensors
        self._types = len(context.reported_types)
        self._epoch_us = context.epoch_us
        self._sensor_texts = [_SENSOR % _json(sensor.id) for sensor in context.sensors]
        self._frequency_texts = [
            text for sensor in context.sensors for text in _frequencies(sensor)
        ]
        masks = [1 << len(sensor.bands) for sensor in context.sensors]
        self._first_mask = np.cumsum([0, *masks[:-1]], dtype=np.int64)
        self._render = context.render or reference

    def encodable(self, window: Window) -> BoolArray:
        """Return which detections (n,) have a position; invalid values raise `ModelError`."""
        require_valid(window, self._sensors, self._types)
        return np.isfinite(positions_ecef_m(window)[:, 0])

    def encode(self, window: Window) -> bytes:
        """Return the detections with a position as lines; invalid values raise `ModelError`."""
        window = only_encodable(window, self)
        detections = window.detections
        if not len(detections):
            return b""
        look, report = event_times(detections, self._epoch_us)
        sensor = detections.sensor.astype(np.int64)
        return self._render(
            len(detections),
            [
                *(_ID, Ids(detections.detection_id), _TIME, look, b'",'),
                Looked(self._sensor_texts, sensor),
                *_geometry(window),
                _SIGNAL,
                Looked(number_texts(_irradiance_w_m2(detections))),
                Looked(self._frequency_texts, self._first_mask[sensor] + detections.bands),
                Decimal(detections.snr, RATIO_DECIMALS),
                b',"confidence":',
                Decimal(detections.confidence, RATIO_DECIMALS),
                *(b',"reported_at":"', report, b'"}\n'),
            ],
        )


def _geometry(window: Window) -> list[Column]:
    """Return the position of each detection and the direction of its line of sight."""
    detections = window.detections
    position = ecef_to_geodetic(positions_ecef_m(window))
    angles = Viewpoints.of(detections.sensor, detections.sensor_ecef_m).angles(
        detections.line_of_sight_ecef
    )
    return [
        Decimal(np.degrees(position.latitude_rad), DEGREE_DECIMALS),
        b',"longitude":',
        Decimal(rounded_longitude_deg(position.longitude_rad), DEGREE_DECIMALS),
        b',"altitude":',
        Decimal(position.height_m, METRE_DECIMALS),
        b',"azimuth":',
        Decimal(rounded_bearing_deg(angles.azimuth_rad), DEGREE_DECIMALS),
        b',"elevation":',
        Decimal(np.degrees(angles.elevation_rad), DEGREE_DECIMALS),
    ]


def positions_ecef_m(window: Window) -> FloatArray:
    """Return positions (n, 3) of detections, ECEF, m: the track's, or on the ground, or nan."""
    positions = estimated_positions_ecef_m(window)
    untracked_rows = np.flatnonzero(np.isnan(positions[:, 0]))
    if len(untracked_rows):
        untracked = window.detections.take(untracked_rows)
        positions[untracked_rows] = intersection_with_ellipsoid(
            untracked.sensor_ecef_m, untracked.line_of_sight_ecef
        )
    return positions


def estimated_positions_ecef_m(window: Window) -> FloatArray:
    """Return the tracks' positions (n, 3) at the detections, ECEF, m; nan where unknown."""
    positions = np.full((len(window.detections), 3), np.nan)
    tracked = np.flatnonzero(window.detections.estimate >= 0)
    if len(tracked):
        propagated = propagated_positions(window, tracked)
        extent_m = np.abs(propagated).max(axis=1)
        is_plausible = (extent_m >= _NEAREST_M) & (extent_m <= _FARTHEST_M)  # false for nan
        positions[tracked] = np.where(is_plausible[:, np.newaxis], propagated, np.nan)
    return positions


def _irradiance_w_m2(detections: Detections) -> FloatArray:
    """Return the irradiance (n,) at the aperture, W/m², over the measured bands; nan without."""
    measured = detections.band_irradiance_w_m2
    if not measured.shape[1]:
        return np.full(len(detections), np.nan)
    return np.where(np.isnan(measured).all(axis=1), np.nan, np.nansum(measured, axis=1))


def _frequencies(sensor: Sensor) -> list[bytes]:
    """Return one text per set of bands: the centre frequency of the first confirming band, Hz."""
    centres_um = [0.5 * (band.lower_um + band.upper_um) for band in sensor.bands]
    confirming_um = [
        next((um for bit, um in enumerate(centres_um) if mask >> bit & 1), None)
        for mask in range(1 << len(centres_um))
    ]
    frequencies_hz = [
        None if um is None else rounded_number(SPEED_OF_LIGHT_M_S / (um * _M_PER_UM), 0)
        for um in confirming_um
    ]
    return [b',"frequency":%b,"snr":' % _json(frequency) for frequency in frequencies_hz]
