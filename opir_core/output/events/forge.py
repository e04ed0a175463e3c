"""The encoders `forge`, `forge-bands` and `forge-tracks`: one flat JSON object per line, fields in
the schema's order.

A line has typed columns, which a renderer joins: text shared by many events (a sensor's name, a
track's launch point) is encoded once and looked up. `benchmarks/encoding.py` compares this with
other methods.
"""

from collections.abc import Sequence

import msgspec
import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import ecef_to_geodetic
from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.outputs import Encoder
from opir_core.interfaces.records import Detections, Window
from opir_core.interfaces.sensors import Sensor
from opir_core.interfaces.viewpoints import Viewpoints
from opir_core.output.events import SCHEMA_VERSION
from opir_core.output.events.encoder_input import require_valid
from opir_core.output.events.rendering import Column, Decimal, Ids, Looked, event_times, reference
from opir_core.output.events.text import (
    DEGREE_DECIMALS,
    IRRADIANCE_DIGITS,
    METRE_DECIMALS,
    SHARE_DECIMALS,
    SIGMA_DIGITS,
    SNR_DECIMALS,
    number_texts,
    propagated_positions,
    rounded,
    rounded_bearing_deg,
    rounded_longitude_deg,
    rounded_number,
    significant,
    vector_texts,
)
from opir_core.scene.scene import REPORTED_TYPES

_json = msgspec.json.Encoder().encode


class IrradianceTexts:
    """Measured irradiances as JSON: an object with a number per band name."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        self._widths = np.array([len(sensor.bands) for sensor in sensors], dtype=np.int64)
        band_count = max((len(sensor.bands) for sensor in sensors), default=0)
        self._names = [[_name(sensor, place) for sensor in sensors] for place in range(band_count)]

    def columns(self, detections: Detections, sensor: IntArray) -> list[Column]:
        """Return the columns of `,"band_irradiance_w_m2":{...}`; none if the detection model
        measures no irradiance.
        """
        measured = detections.band_irradiance_w_m2
        if not measured.shape[1]:
            return []
        columns: list[Column] = [b',"band_irradiance_w_m2":{']
        for place, names in enumerate(self._names):
            texts = _texts(measured[:, place], self._widths[sensor] > place)
            columns += [Looked(names, sensor), Looked(texts)]
        return [*columns, b"}"]


def _name(sensor: Sensor, place: int) -> bytes:
    """Return the key of a band; empty beyond the sensor's bands."""
    if place >= len(sensor.bands):
        return b""
    return (b"," if place else b"") + _json(sensor.bands[place].name) + b":"


def _texts(irradiance_w_m2: FloatArray, exists: BoolArray) -> list[bytes]:
    texts = number_texts(significant(irradiance_w_m2, IRRADIANCE_DIGITS))
    if exists.all():
        return texts
    return [
        text if is_present else b"" for text, is_present in zip(texts, exists.tolist(), strict=True)
    ]


_ID = b'{"detection_id":"'
_TIME = b'","timestamp":"'
_SENSOR = b'"sensor_id":%b,"sensor_type":%b,"orbital_slot":%b,"target_type":%b,'
_POINTS = b'"launch_point":%b,"impact_point":%b,"confidence":'
_VERSION = b',"schema_version":"%b","reported_at":"' % SCHEMA_VERSION.encode()
_TRACK = b',"track_id":%b,"azimuth_deg":'
_SIGMA = b',"line_of_sight_sigma_urad":'
_BANDS = b',"bands":%b,"snr":'
_POSITION = b',"sensor_position_ecef_m":[%b]'
_TYPES = [
    b',"type_probability":{"ICBM":',
    *(b',"%b":' % name.encode() for name in REPORTED_TYPES[1:]),
]
_NO_TRACK = _TRACK % b"null"
_NO_POSITION = b',"latitude_deg":null,"longitude_deg":null,"altitude_m":null'


class ForgeEncoder(Encoder):
    """Detections as lines of JSON, one flat object each; the bytes do not depend on the windows.

    With `has_irradiances` they have the irradiance measured in each band, if the detection model
    measures it; with `has_positions` where its track puts the object; with `has_tracks` that too,
    and the times and uncertainties of launch and impact point, the state of its track, the state at
    burnout, their covariances, the probabilities of types and hypotheses, and how it ended.
    """

    content_type = "application/json"
    schema_version = SCHEMA_VERSION

    def __init__(
        self,
        context: EncoderContext,
        *,
        has_irradiances: bool = False,
        has_positions: bool = False,
        has_tracks: bool = False,
    ) -> None:
        self._sensors = context.sensors
        self._types = len(context.reported_types)
        self._irradiances = IrradianceTexts(context.sensors) if has_irradiances else None
        self._epoch_us = context.epoch_us
        self._has_tracks = has_tracks
        self._has_positions = has_positions or has_tracks
        self._hypotheses = context.hypotheses
        self._path_texts = [b',"path":%b' % _json(path) for path in (*context.paths, None)]
        sensors = context.sensors
        self._sensor_texts = [
            text for sensor in sensors for text in _sensor_texts(sensor, context.reported_types)
        ]
        self._band_texts = [text for sensor in sensors for text in _band_texts(sensor)]
        self._look_texts = [text for sensor in sensors for text in _look_texts(sensor)]
        self._sigma_rad = np.array(
            [sensor.line_of_sight_sigma_rad for sensor in sensors], dtype=np.float64
        )
        looks = [1 << len(sensor.bands) for sensor in sensors]
        self._first_look = np.cumsum([0, *looks[:-1]], dtype=np.int64)
        self._render = context.render or reference

    def encode(self, window: Window) -> bytes:
        """Return the window's detections as lines; invalid values raise `ModelError`."""
        detections = window.detections
        if not len(detections):
            return b""
        require_valid(window, self._sensors, self._types)
        sensor = detections.sensor.astype(np.int64)
        look, report = event_times(detections, self._epoch_us)
        viewpoints = Viewpoints.of(detections.sensor, detections.sensor_ecef_m)
        angles = viewpoints.angles(detections.line_of_sight_ecef)
        return self._render(
            len(detections),
            [
                *(_ID, Ids(detections.detection_id), _TIME, look, b'",'),
                Looked(self._sensor_texts, sensor * self._types + detections.reported_type),
                _points(window, self._epoch_us, self._has_tracks),
                Decimal(detections.confidence, SHARE_DECIMALS),
                *(_VERSION, report, b'"'),
                *self._paths(detections),
                _tracks(detections.track),
                Decimal(
                    rounded_bearing_deg(angles.azimuth_rad, decimals=DEGREE_DECIMALS),
                    DEGREE_DECIMALS,
                ),
                b',"elevation_deg":',
                Decimal(np.degrees(angles.elevation_rad), DEGREE_DECIMALS),
                *self._looks(detections, sensor),
                Decimal(detections.snr, SNR_DECIMALS),
                *(self._irradiances.columns(detections, sensor) if self._irradiances else ()),
                _sensor_positions(viewpoints),
                *_type_probabilities(detections),
                *(
                    _track_fields(window, self._epoch_us, self._hypotheses)
                    if self._has_tracks
                    else ()
                ),
                *(_positions(window) if self._has_positions else ()),
                b"}\n",
            ],
        )

    def _paths(self, detections: Detections) -> list[Column]:
        """Return the ways to the ground, null without a link; nothing in scenes without links."""
        none = len(self._path_texts) - 1
        columns = detections.path.T
        return [Looked(self._path_texts, np.where(path < 0, none, path)) for path in columns]

    def _looks(self, detections: Detections, sensor: IntArray) -> list[Column]:
        """Return the line-of-sight sigma and the confirming bands; from a table if all sigmas are
        the sensors' own.
        """
        row = self._first_look[sensor] + detections.bands
        sigma_rad = detections.line_of_sight_sigma_rad
        if np.array_equal(sigma_rad, self._sigma_rad.take(sensor)):
            return [Looked(self._look_texts, row)]
        return [
            _SIGMA,
            Decimal(significant(sigma_rad * 1e6, SIGMA_DIGITS), DEGREE_DECIMALS),
            Looked(self._band_texts, row),
        ]


def _sensor_texts(sensor: Sensor, reported_types: Sequence[str]) -> list[bytes]:
    """Return one text per reported type."""
    slot = (
        None
        if sensor.orbital_slot_deg is None
        else rounded_number(sensor.orbital_slot_deg, DEGREE_DECIMALS)
    )
    constant = _json(sensor.id), _json(sensor.type), _json(slot)
    return [_SENSOR % (*constant, _json(name)) for name in reported_types]


def _look_texts(sensor: Sensor) -> list[bytes]:
    """Return one text per set of bands, with the sensor's own sigma."""
    sigma_urad = significant(np.array([sensor.line_of_sight_sigma_rad * 1e6]), SIGMA_DIGITS)
    sigma = _json(rounded_number(float(sigma_urad[0]), DEGREE_DECIMALS))
    return [_SIGMA + sigma + bands for bands in _band_texts(sensor)]


def _band_texts(sensor: Sensor) -> list[bytes]:
    """Return one text per set of bands, in the order of the bit masks."""
    names = [band.name for band in sensor.bands]
    masks = range(1 << len(names))
    return [
        _BANDS % _json([name for bit, name in enumerate(names) if mask >> bit & 1])
        for mask in masks
    ]


def _points(window: Window, epoch_us: int, has_ellipses: bool) -> Column:
    """Return the launch and impact points of the detections' estimates; their uncertainties are in
    the tracks, and would be most of an event.
    """
    estimate = window.detections.estimate
    if not (estimate >= 0).any():
        return _POINTS % (b"null", b"null")
    rows, of_detection = np.unique(estimate, return_inverse=True)
    estimate_rows = rows[rows >= 0]
    from opir_core.output.events.estimates import (
        impact_texts,
        launch_texts,
        place_texts,
    )  # of runs with tracks

    estimates = window.estimates.take(estimate_rows)
    if has_ellipses:
        launches = launch_texts(estimates, epoch_us)
        impacts = impact_texts(estimates, epoch_us)
    else:
        launches = place_texts(estimates.launch)
        impacts = place_texts(estimates.impact)
    unknown = [_POINTS % (b"null", b"null")] * (len(rows) - len(estimate_rows))
    points = [_POINTS % texts for texts in zip(launches, impacts, strict=True)]
    return Looked([*unknown, *points], of_detection)


def _tracks(track: IntArray) -> Column:
    if track.max(initial=-1) < 0:
        return _NO_TRACK
    numbers, of_detection = np.unique(track, return_inverse=True)
    return Looked(
        [_TRACK % (b"null" if number < 0 else b"%d" % number) for number in numbers.tolist()],
        of_detection,
    )


def _sensor_positions(viewpoints: Viewpoints) -> Column:
    positions = vector_texts(rounded(viewpoints.position_ecef_m, METRE_DECIMALS))
    return Looked([_POSITION % position for position in positions], viewpoints.of_row)


def _type_probabilities(detections: Detections) -> list[Column]:
    """Return the type probabilities, if the classifier has them."""
    if not detections.type_log_probability.shape[1]:
        return []
    columns: list[Column] = []
    for name, column in zip(_TYPES, detections.type_probability.T, strict=True):
        columns += [name, Decimal(column, SHARE_DECIMALS)]
    return [*columns, b"}"]


def _positions(window: Window) -> list[Column]:
    """Return the positions of the tracks, propagated to the time of the detection."""
    tracked = np.flatnonzero(window.detections.estimate >= 0)
    if not len(tracked):
        return [_NO_POSITION]
    position = ecef_to_geodetic(propagated_positions(window, tracked))
    columns = np.full((3, len(window.detections)), np.nan)
    columns[0, tracked] = np.degrees(position.latitude_rad)
    columns[1, tracked] = rounded_longitude_deg(position.longitude_rad)
    columns[2, tracked] = position.height_m
    latitude, longitude, altitude = columns
    return [
        *(b',"latitude_deg":', Decimal(latitude, DEGREE_DECIMALS)),
        *(b',"longitude_deg":', Decimal(longitude, DEGREE_DECIMALS)),
        *(b',"altitude_m":', Decimal(altitude, METRE_DECIMALS)),
    ]


def _track_fields(window: Window, epoch_us: int, hypotheses: Sequence[str]) -> tuple[Column, ...]:
    """Return the fields of the tracks that detections belong to."""
    from opir_core.output.events.estimates import track_fields

    return (track_fields(window, epoch_us, hypotheses),)
