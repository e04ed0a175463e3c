"""Rows of detections of another program to the columns of a run, as the sensors of a scene had made
them.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID

import numpy as np
from attrs import frozen

from opir_core import Detections, DetectionTruth, Plan
from opir_core.arrays import FloatArray, IndexArray, IntArray, WordArray
from opir_core.errors import nearest_names
from opir_core.geometry import line_of_sight
from opir_core.plugin import BadFileError, Sensor
from opir_core.random_streams import id_key, uuid8_words
from opir_readers.detections.numbers import finite, number_of_row, place_of, shown, vector_of_row
from opir_readers.detections.times import unix_ns
from opir_readers.detections.truth import truth_of
from opir_readers.frames import frame_of, to_ecef

Row = Mapping[str, Any]

_NS = 1_000_000_000
_URAD = 1e-6

#: The confidence of a detection whose file says nothing of it.
UNKNOWN_CONFIDENCE = 0.5

#: How a row may give its direction: by the keys of each way, the first that it has counts.
_DIRECTIONS: tuple[tuple[str, ...], ...] = (
    ("line_of_sight_ecef",),
    ("azimuth_deg", "elevation_deg"),
    ("right_ascension_deg", "declination_deg"),
    ("line_of_sight_eme2000",),
)


@frozen(eq=False)
class RunColumns:
    """Detections in the order of observation, their truth as far as it is known, and what a user
    should know.
    """

    detections: Detections
    truth: DetectionTruth
    rows: Sequence[Row]


def times_ns(rows: Sequence[Row], epoch_us: int, key: str = "timestamp") -> IntArray:
    """Return the scene times (n,) of rows, ns: of dates, or of seconds of the scene (`time_s`)."""
    return np.array([_time_ns(row, epoch_us, key) for row in rows], dtype=np.int64)


def _time_ns(row: Row, epoch_us: int, key: str) -> int:
    if key in row:
        since_ns = unix_ns(row[key], f"{place_of(row)}{key}") - epoch_us * 1000
    else:
        since_ns = round(min(max(number_of_row(row, "time_s"), -1e10), 1e10) * _NS)
    return min(max(since_ns, -(2**62)), 2**62)


def columns_of(rows: Sequence[Row], plan: Plan, names: Mapping[str, str]) -> RunColumns:
    """Return the columns of rows for the sensors of a plan; `names` are the plan's ids of ids in
    the file.

    Raises `BadFileError` with the line of a row that cannot be one of a sensor's detections.
    """
    sensor = _sensors(rows, plan.sensors, names)
    when = times_ns(rows, plan.scene.epoch_us)
    order = np.lexsort((sensor, when))
    rows = [rows[place] for place in order.tolist()]
    sensor = sensor[order]
    when = when[order]
    origin = _positions(rows, sensor, when, plan.sensors)
    reported = _reported_ns(rows, when, plan.scene.epoch_us)
    detections = Detections(
        time_ns=when,
        sensor=sensor,
        scan=_scans(rows, sensor, when, plan.sensors),
        detection_id=_ids(rows, plan),
        reported_type=_types(rows, plan.reported_types),
        bands=_bands(rows, sensor, plan.sensors),
        detection_count=np.ones(len(rows), dtype=np.int32),
        confidence=_optional(rows, "confidence", UNKNOWN_CONFIDENCE, 0.0, 1.0),
        line_of_sight_ecef=_directions(
            rows, origin, when.astype(np.float64) * 1e-9, plan.scene.epoch_us
        ),
        sensor_ecef_m=origin,
        snr=_optional(rows, "snr", np.nan),
        track=np.full(len(rows), -1, dtype=np.int64),
        estimate=np.full(len(rows), -1, dtype=np.int64),
        line_of_sight_sigma_rad=_sigmas(rows, sensor, plan.sensors),
        band_irradiance_w_m2=np.empty((len(rows), 0)),
        reported_ns=when if reported is None else reported,
    )
    return RunColumns(detections.freeze(), truth_of(rows, detections, plan), rows)


def _sensors(
    rows: Sequence[Row], sensors: Sequence[Sensor], names: Mapping[str, str]
) -> IndexArray:
    number = {sensor.id: place for place, sensor in enumerate(sensors)}
    only = sensors[0].id if len(sensors) == 1 else None
    found = []
    for row in rows:
        own = row.get("sensor_id", only)
        if own is None:
            raise BadFileError(
                f"{place_of(row)}has no sensor_id, and --sensors has several: {', '.join(number)}"
            )
        own = names.get(str(own), str(own))
        if own not in number:
            near = nearest_names(own, number)
            hint = (
                f"did you mean {near[0]}?" if near else f"there are {', '.join(list(number)[:12])}."
            )
            unknown = Counter(str(each.get("sensor_id")) for each in rows)
            count = unknown[str(row.get("sensor_id"))]
            raise BadFileError(
                f"{place_of(row)}its sensor {shown(own)}, of {count} of {len(rows)} detections, is"
                f" none of --sensors; {hint} Use --rename THEIRS=OURS if the names differ"
            )
        found.append(number[own])
    return np.array(found, dtype=np.int32)


def _positions(
    rows: Sequence[Row], sensor: IndexArray, when: IntArray, sensors: Sequence[Sensor]
) -> FloatArray:
    """Return the sensors' positions (n, 3): those of the file, else of the scene's orbits."""
    position = np.empty((len(rows), 3))
    is_given = np.array([row.get("sensor_position_ecef_m") is not None for row in rows], dtype=bool)
    for place in np.flatnonzero(is_given).tolist():
        position[place] = vector_of_row(rows[place], "sensor_position_ecef_m")
    for number in np.unique(sensor[~is_given]).tolist():
        own = np.flatnonzero(~is_given & (sensor == number))
        position[own] = sensors[number].orbit.position_ecef_m(when[own] * 1e-9)
    return position


def _directions(
    rows: Sequence[Row], origin: FloatArray, time_s: FloatArray, epoch_us: int
) -> FloatArray:
    """Return unit vectors (n, 3) in ECEF."""
    ways = np.array([_way(row) for row in rows], dtype=np.int64)
    vectors = np.empty((len(rows), 3))
    for way in np.unique(ways).tolist():
        own = np.flatnonzero(ways == way)
        given = [rows[place] for place in own.tolist()]
        if len(_DIRECTIONS[way]) == 1:
            found = np.array([vector_of_row(row, _DIRECTIONS[way][0]) for row in given])
        else:
            first, second = np.radians(
                [[number_of_row(row, name) for name in _DIRECTIONS[way]] for row in given]
            ).T
            _require_angles(given, second, _DIRECTIONS[way][1])
            is_local = way == 1
            found = (
                line_of_sight(origin[own], first, second) if is_local else _vectors(first, second)
            )
        vectors[own] = _earth_fixed(given, found, epoch_us, time_s[own]) if way >= 2 else found
    with np.errstate(over="ignore"):
        length = np.sqrt((vectors * vectors).sum(axis=1))
    for place in np.flatnonzero(~((length > 0.0) & (length < np.inf))).tolist():
        raise BadFileError(f"{place_of(rows[place])}its line of sight has no direction")
    return np.asarray(vectors / length[:, None])


def _earth_fixed(
    rows: Sequence[Row], vectors: FloatArray, epoch_us: int, time_s: FloatArray
) -> FloatArray:
    """Return vectors (n, 3) in ECEF of those in the frames that rows name, J2000 where they name
    none.
    """
    names = np.array([str(row.get("reference_frame", "EME2000")) for row in rows])
    turned = np.empty_like(vectors)
    for name in np.unique(names).tolist():
        own = np.flatnonzero(names == name)
        turned[own], _ = to_ecef(
            frame_of(name), vectors[own], np.zeros((len(own), 3)), epoch_us, time_s[own]
        )
    return turned


def _way(row: Row) -> int:
    for number, names in enumerate(_DIRECTIONS):
        if any(name in row for name in names):
            return number
    known = "; ".join(" and ".join(names) for names in _DIRECTIONS)
    raise BadFileError(f"{place_of(row)}has no line of sight; give one of {known}")


def _require_angles(rows: Sequence[Row], angle_rad: FloatArray, name: str) -> None:
    for place in np.flatnonzero(np.abs(angle_rad) > 0.5 * np.pi + 1e-9).tolist():
        raise BadFileError(
            f"{place_of(rows[place])}{name} is {rows[place][name]}, beyond 90 deg; are its units"
            f" others?"
        )


def _vectors(longitude_rad: FloatArray, latitude_rad: FloatArray) -> FloatArray:
    level = np.cos(latitude_rad)
    return np.stack(
        [level * np.cos(longitude_rad), level * np.sin(longitude_rad), np.sin(latitude_rad)], axis=1
    )


def _reported_ns(rows: Sequence[Row], when: IntArray, epoch_us: int) -> IntArray | None:
    """Return the times of the reports (n,), None where none is later than its look."""
    if not any(row.get("reported_at") not in (None, row.get("timestamp")) for row in rows):
        return None
    found = [
        _time_ns(row, epoch_us, "reported_at") if row.get("reported_at") else own
        for row, own in zip(rows, when.tolist(), strict=True)
    ]
    reported = np.array(found, dtype=np.int64)
    if (reported == when).all():
        return None
    for place in np.flatnonzero(reported < when).tolist():
        raise BadFileError(f"{place_of(rows[place])}is reported before it was seen")
    return reported


def _scans(
    rows: Sequence[Row], sensor: IndexArray, when: IntArray, sensors: Sequence[Sensor]
) -> IntArray:
    """Return the numbers of the sensors' scans, by their periods."""
    period = np.array([each.scan.period_ns for each in sensors], dtype=np.int64)
    return np.asarray(when // period[sensor])


def _sigmas(rows: Sequence[Row], sensor: IndexArray, sensors: Sequence[Sensor]) -> FloatArray:
    own = np.array([each.line_of_sight_sigma_rad for each in sensors])[sensor]
    given = _optional(rows, "line_of_sight_sigma_urad", np.nan, 0.0, 1e6) * _URAD
    return np.where(np.isnan(given), own, given)


def _optional(
    rows: Sequence[Row], name: str, otherwise: float, low: float = -np.inf, high: float = np.inf
) -> FloatArray:
    """Return the numbers (n,) of a key, `otherwise` where it is missing or null."""
    values = np.full(len(rows), otherwise)
    for place, row in enumerate(rows):
        if row.get(name) is not None:
            values[place] = finite(row[name], f"{place_of(row)}{name}")
            if not low <= values[place] <= high:
                raise BadFileError(
                    f"{place_of(row)}{name} is {shown(row[name])}, outside [{low:g}, {high:g}]"
                )
    return values


def _types(rows: Sequence[Row], reported_types: Sequence[str]) -> Any:
    """Return the codes of reported types; those that the scene does not know are UNKNOWN."""
    code = {name: number for number, name in enumerate(reported_types)}
    unknown = code["UNKNOWN"]
    return np.array(
        [code.get(str(row.get("target_type")), unknown) for row in rows], dtype=np.uint8
    )


def _bands(rows: Sequence[Row], sensor: IndexArray, sensors: Sequence[Sensor]) -> Any:
    """Return the masks of bands; a row without them has the sensor's first."""
    names = [[band.name for band in each.bands] for each in sensors]
    masks = []
    for row, number in zip(rows, sensor.tolist(), strict=True):
        given = row.get("bands")
        seen = (
            given
            if isinstance(given, Sequence) and not isinstance(given, str)
            else names[number][:1]
        )
        masks.append(sum(1 << place for place, name in enumerate(names[number]) if name in seen))
    return np.array(masks, dtype=np.uint8)


def _ids(rows: Sequence[Row], plan: Plan) -> WordArray:
    """Return the ids of a file of opir's events, which are UUIDs of version 8; else ids of their
    own.
    """
    given = [_uuid8(row.get("detection_id")) for row in rows]
    if rows and all(each is not None for each in given) and len(set(given)) == len(given):
        words = [[each >> 64, each & 0xFFFFFFFFFFFFFFFF] for each in given if each is not None]
        return np.array(words, dtype=np.uint64)
    key = id_key(plan.scene.seed, plan.scene.name, plan.scene.epoch_us, "opir track")
    return uuid8_words(
        np.array([key] * len(rows), dtype=np.uint64).reshape(-1, 2), np.arange(len(rows))
    )


def _uuid8(value: Any) -> int | None:
    try:
        found = UUID(value)
    except (TypeError, ValueError, AttributeError):
        return None
    return found.int if found.version == 8 else None
