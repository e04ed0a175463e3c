"""The `forge-c2` encoder: the flat record of a command-and-control consumer, one JSON object a line.

Its consumers fill a number that is missing with 0, so every event has a place: the track's estimate, carried to the
time of the detection, or where the line of sight meets the Earth. A detection with neither has no message.
"""

import msgspec
import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.geometry import ecef_to_geodetic, intersection_with_ellipsoid
from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import Detections, Window
from opir_core.interfaces.viewpoints import Viewpoints
from opir_core.output.events import FORGE_C2_VERSION
from opir_core.output.events.blocks import only_encodable
from opir_core.output.events.text import (
    METRE_DECIMALS,
    RATIO_DECIMALS,
    carried_positions,
    joined_lines,
    number_texts,
    openings,
    piece_table,
    rounded,
    rounded_bearing_deg,
    rounded_degrees,
    rounded_longitude_deg,
    rounded_number,
    taken,
)
from opir_core.output.events.validation import refuse_unlawful

_OPENING = b'{"event_id":"', b'","timestamp":"'
_SENSOR = b'"sensor_id":%b,"sensor_type":"OPIR","latitude":'
_M_PER_UM = 1e-6
#: What a track's estimate must lie between to be a place: the largest component of its position, m.
_NEAREST_M, _FARTHEST_M = 1e6, 1e9
_SIGNAL = b',"signal_type":"IR","intensity":'

_json = msgspec.json.Encoder().encode


class ForgeC2Encoder:
    """Detections to lines of JSON, one flat object each, none without a place."""

    content_type = "application/json"
    schema_version = FORGE_C2_VERSION

    def __init__(self, context: EncoderContext) -> None:
        self._sensors = context.sensors
        self._epoch_us = context.epoch_us
        self._sensor_pieces = piece_table(_SENSOR % _json(sensor.id) for sensor in context.sensors)
        self._frequency_pieces = piece_table(piece for sensor in context.sensors for piece in _frequencies(sensor))
        masks = [1 << len(sensor.bands) for sensor in context.sensors]
        self._first_mask = np.cumsum([0, *masks[:-1]], dtype=np.int64)

    def encodable(self, window: Window) -> BoolArray:
        """Return which detections (n,) have a place; what no event can carry raises `ModelError`."""
        refuse_unlawful(window, self._sensors)
        has_place: BoolArray = np.isfinite(places_ecef_m(window)[:, 0])
        return has_place

    def encode(self, window: Window) -> bytes:
        """Return the detections that have a place as lines; what no event can carry raises `ModelError`."""
        window = only_encodable(window, self)
        detections = window.detections
        if not len(detections):
            return b""
        place = ecef_to_geodetic(places_ecef_m(window))
        angles = Viewpoints.of(detections.sensor, detections.sensor_ecef_m).angles(detections.line_of_sight_ecef)
        sensor = detections.sensor.astype(np.int64)
        return joined_lines(
            len(detections),
            [
                openings(detections, self._epoch_us, *_OPENING),
                taken(self._sensor_pieces, sensor),
                number_texts(rounded_degrees(place.latitude_rad)),
                b',"longitude":',
                number_texts(rounded_longitude_deg(place.longitude_rad)),
                b',"altitude":',
                number_texts(rounded(place.height_m, METRE_DECIMALS)),
                b',"azimuth":',
                number_texts(rounded_bearing_deg(angles.azimuth_rad)),
                b',"elevation":',
                number_texts(rounded_degrees(angles.elevation_rad)),
                _SIGNAL,
                number_texts(_irradiance_w_m2(detections)),
                taken(self._frequency_pieces, self._first_mask[sensor] + detections.bands),
                number_texts(rounded(detections.snr, RATIO_DECIMALS)),
                b',"confidence":',
                number_texts(rounded(detections.confidence, RATIO_DECIMALS)),
                b"}\n",
            ],
        )


def places_ecef_m(window: Window) -> FloatArray:
    """Return where detections (n,) put their objects, ECEF (n, 3), m: estimated, or on the ground; nan for nowhere."""
    places = estimated_places_ecef_m(window)
    rest = np.flatnonzero(np.isnan(places[:, 0]))
    if len(rest):
        seen = window.detections.take(rest)
        places[rest] = intersection_with_ellipsoid(seen.sensor_ecef_m, seen.line_of_sight_ecef)
    return places


def estimated_places_ecef_m(window: Window) -> FloatArray:
    """Return where the tracks put the objects of detections (n,) at their times, ECEF (n, 3), m; nan where unknown."""
    places = np.full((len(window.detections), 3), np.nan)
    tracked = np.flatnonzero(window.detections.estimate >= 0)
    if len(tracked):
        carried = carried_positions(window, tracked)
        extent_m = np.abs(carried).max(axis=1)
        is_place = (extent_m >= _NEAREST_M) & (extent_m <= _FARTHEST_M)  # false for nan
        places[tracked] = np.where(is_place[:, np.newaxis], carried, np.nan)
    return places


def _irradiance_w_m2(detections: Detections) -> FloatArray:
    """Return the irradiance at the aperture, (n,), all measured bands together; nan where none is measured."""
    measured = detections.band_irradiance_w_m2
    if not measured.shape[1]:
        return np.full(len(detections), np.nan)
    total: FloatArray = np.where(np.isnan(measured).all(axis=1), np.nan, np.nansum(measured, axis=1))
    return total


def _frequencies(sensor: Sensor) -> list[bytes]:
    """Return a piece for each set of bands: the frequency at the centre of the first that confirms, Hz."""
    centres_um = [0.5 * (band.lower_um + band.upper_um) for band in sensor.bands]
    first = [
        next((um for bit, um in enumerate(centres_um) if mask >> bit & 1), None) for mask in range(1 << len(centres_um))
    ]
    found = [None if um is None else rounded_number(SPEED_OF_LIGHT_M_S / (um * _M_PER_UM), 0) for um in first]
    return [b',"frequency":%b,"snr":' % _json(frequency) for frequency in found]
