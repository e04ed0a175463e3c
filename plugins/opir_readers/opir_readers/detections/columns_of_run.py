"""Rows of detections of another program to the columns of a run, as the sensors of a scene had made
them.
"""

from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID

import numpy as np
from attrs import fields_dict, frozen

from opir_core import Detections, DetectionTruth, Plan
from opir_core.arrays import ByteArray, FloatArray, IndexArray, IntArray, WordArray
from opir_core.errors import nearest_names
from opir_core.geometry import line_of_sight, unit_vectors
from opir_core.plugin import BadFileError, FieldInfo, ScanningSensorConfig
from opir_core.random_streams import id_key, uuid8_words
from opir_core.scene import info_of
from opir_readers.detections.numbers import (
    Row,
    Rows,
    finite,
    number_of_row,
    place_of,
    shown,
    vector_of_row,
)
from opir_readers.detections.times import NS_PER_S, unix_ns
from opir_readers.detections.truth import truth_of
from opir_readers.frames import frame_of, lengths, to_ecef

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
    """Detections in the order of observation, their truth as far as it is known, and their rows."""

    detections: Detections
    truth: DetectionTruth
    rows: Rows


@frozen(eq=False)
class _Sights:
    """Rows in the order of observation, with the number of the sensor of each in a plan (n,), and
    its scene time, ns.
    """

    rows: Rows
    sensor: IndexArray
    time_ns: IntArray
    plan: Plan

    def numbers(
        self, name: str, default: float, low: float = -np.inf, high: float = np.inf
    ) -> FloatArray:
        """Return the numbers (n,) of a key, the default where it is missing or null."""
        values = np.full(len(self.rows), default)
        for place, row in enumerate(self.rows):
            if row.get(name) is not None:
                values[place] = finite(row[name], f"{place_of(row)}{name}")
                if not low <= values[place] <= high:
                    raise BadFileError(
                        f"{place_of(row)}{name} is {shown(row[name])}, outside [{low:g}, {high:g}]"
                    )
        return values


def times_ns(rows: Rows, epoch_us: int, key: str = "timestamp") -> IntArray:
    """Return the scene times (n,) of rows, ns: of dates, or of seconds of the scene (`time_s`)."""
    return np.array([_time_ns(row, epoch_us, key) for row in rows], dtype=np.int64)


def _time_ns(row: Row, epoch_us: int, key: str) -> int:
    if key in row:
        since_ns = unix_ns(row[key], f"{place_of(row)}{key}") - epoch_us * 1000
    else:
        since_ns = round(min(max(number_of_row(row, "time_s"), -1e10), 1e10) * NS_PER_S)
    return min(max(since_ns, -(2**62)), 2**62)


def columns_of(rows: Rows, plan: Plan, names: Mapping[str, str]) -> RunColumns:
    """Return the columns of rows for the sensors of a plan; `names` are the plan's ids of ids in
    the file.

    Raises `BadFileError` with the line of a row that cannot be one of a sensor's detections.
    """
    ids = [sensor.id for sensor in plan.sensors]
    number = {name: place for place, name in enumerate(ids)}
    sensor = np.array([number[name] for name in sensor_ids(rows, ids, names)], dtype=np.int32)
    time_ns = times_ns(rows, plan.scene.epoch_us)
    order = np.lexsort((sensor, time_ns))
    rows = [rows[place] for place in order.tolist()]
    sights = _Sights(rows, sensor[order], time_ns[order], plan)
    origin = _positions(sights)
    count = len(rows)
    # Lines do not say the mode: no scan of any may have two of them.
    in_modes = [(each, *each.modes.values()) for each in plan.sensors]
    periods_ns = np.array([min(each.scan.period_ns for each in modes) for modes in in_modes])
    detections = Detections(
        time_ns=sights.time_ns,
        sensor=sights.sensor,
        reported_ns=_reported_ns(sights),
        scan=np.asarray(sights.time_ns // periods_ns[sights.sensor]),
        detection_id=_ids(rows, plan),
        reported_type=_types(rows, plan.reported_types),
        bands=_bands(sights),
        detection_count=np.ones(count, dtype=np.int32),
        confidence=sights.numbers("confidence", UNKNOWN_CONFIDENCE, 0.0, 1.0),
        line_of_sight_ecef=_directions(sights, origin),
        sensor_ecef_m=origin,
        snr=sights.numbers("snr", np.nan),
        track=np.full(count, -1, dtype=np.int64),
        estimate=np.full(count, -1, dtype=np.int64),
        line_of_sight_sigma_rad=_sigmas_rad(sights),
        band_irradiance_w_m2=np.empty((count, 0)),
    )
    return RunColumns(detections.freeze(), truth_of(rows, detections, plan), rows)


def sensor_ids(rows: Rows, ids: Sequence[str], names: Mapping[str, str]) -> list[str]:
    """Return the ids (n,) of the rows' sensors, of those of a scene; `names` are the scene's of
    ids in the file.

    Raises `BadFileError` with the line of another.
    """
    only = ids[0] if len(ids) == 1 else None
    allowed = set(ids)
    of_rows = []
    for row in rows:
        name = row.get("sensor_id", only)
        if name is None:
            raise BadFileError(
                f"{place_of(row)}has no sensor_id, and --sensors has several: {', '.join(ids)}"
            )
        name = names.get(str(name), str(name))
        if name not in allowed:
            raise _unknown_sensor(name, row, rows, ids)
        of_rows.append(name)
    return of_rows


def _unknown_sensor(name: str, row: Row, rows: Rows, known: Sequence[str]) -> BadFileError:
    nearest = nearest_names(name, known)
    hint = f"did you mean {nearest[0]}?" if nearest else f"there are {', '.join(known[:12])}."
    sensor_id = str(row.get("sensor_id"))
    count = sum(str(other_row.get("sensor_id")) == sensor_id for other_row in rows)
    return BadFileError(
        f"{place_of(row)}its sensor {shown(name)}, of {count} of {len(rows)} detections, is none of"
        f" --sensors; {hint} Use --rename THEIRS=OURS if the names differ"
    )


def _positions(sights: _Sights) -> FloatArray:
    """Return the sensors' positions (n, 3): those of the file, else of the scene's orbits."""
    position = np.empty((len(sights.rows), 3))
    is_missing = np.ones(len(sights.rows), dtype=bool)
    for place, row in enumerate(sights.rows):
        if row.get("sensor_position_ecef_m") is not None:
            position[place] = vector_of_row(row, "sensor_position_ecef_m")
            is_missing[place] = False
    for number in np.unique(sights.sensor[is_missing]).tolist():
        rows = np.flatnonzero(is_missing & (sights.sensor == number))
        orbit = sights.plan.sensors[number].orbit
        position[rows] = orbit.position_ecef_m(sights.time_ns[rows] * 1e-9)
    return position


def _directions(sights: _Sights, origin: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) in ECEF of rows seen from origins (n, 3)."""
    ways = np.array([_way(row) for row in sights.rows], dtype=np.int64)
    vectors = np.empty((len(sights.rows), 3))
    for way in np.unique(ways).tolist():
        places = np.flatnonzero(ways == way)
        rows = [sights.rows[place] for place in places.tolist()]
        names = _DIRECTIONS[way]
        if len(names) == 1:
            vectors[places] = [vector_of_row(row, names[0]) for row in rows]
        else:
            angles = np.radians([[number_of_row(row, name) for name in names] for row in rows])
            _require_angles(rows, angles[:, 1], names[1])
            is_local = names[0] == "azimuth_deg"
            vectors[places] = (
                line_of_sight(origin[places], *angles.T)
                if is_local
                else unit_vectors(angles[:, ::-1])
            )
        if way >= 2:
            time_s = sights.time_ns[places].astype(np.float64) * 1e-9
            vectors[places] = _earth_fixed(
                rows, vectors[places], sights.plan.scene.epoch_us, time_s
            )
    with np.errstate(over="ignore"):
        length = lengths(vectors)
    for place in np.flatnonzero(~((length > 0.0) & (length < np.inf))).tolist():
        raise BadFileError(f"{place_of(sights.rows[place])}its line of sight has no direction")
    return vectors / length[:, None]


def _earth_fixed(rows: Rows, vectors: FloatArray, epoch_us: int, time_s: FloatArray) -> FloatArray:
    """Return vectors (n, 3) in ECEF of those in the frames that rows name, J2000 where they name
    none.
    """
    names = np.array([str(row.get("reference_frame", "EME2000")) for row in rows])
    turned = np.empty_like(vectors)
    for name in np.unique(names).tolist():
        places = np.flatnonzero(names == name)
        still = np.zeros((len(places), 3))
        turned[places], _ = to_ecef(
            frame_of(name), vectors[places], still, epoch_us, time_s[places]
        )
    return turned


def _way(row: Row) -> int:
    """Return how a row gives its direction, a number of `_DIRECTIONS`."""
    for number, names in enumerate(_DIRECTIONS):
        if any(name in row for name in names):
            return number
    known = "; ".join(" and ".join(names) for names in _DIRECTIONS)
    raise BadFileError(f"{place_of(row)}has no line of sight; give one of {known}")


def _require_angles(rows: Rows, angle_rad: FloatArray, name: str) -> None:
    for place in np.flatnonzero(np.abs(angle_rad) > 0.5 * np.pi + 1e-9).tolist():
        raise BadFileError(
            f"{place_of(rows[place])}{name} is {rows[place][name]}, beyond 90 deg; name the columns"
            " of zenith angles, other units or exchanged angles with --columns"
        )


def _reported_ns(sights: _Sights) -> IntArray:
    """Return the times of the reports (n,): the same array as those of the looks where none is
    later.
    """
    rows = sights.rows
    if all(row.get("reported_at") in (None, row.get("timestamp")) for row in rows):
        return sights.time_ns
    reported = sights.time_ns.copy()
    for place, row in enumerate(rows):
        if row.get("reported_at"):
            reported[place] = _time_ns(row, sights.plan.scene.epoch_us, "reported_at")
    for place in np.flatnonzero(reported < sights.time_ns).tolist():
        raise BadFileError(f"{place_of(rows[place])}is reported before it was seen")
    return reported if (reported > sights.time_ns).any() else sights.time_ns


def sigma_setting() -> FieldInfo:
    """Return the setting of a sensor whose ranges standard deviations of lines of sight have."""
    return info_of(fields_dict(ScanningSensorConfig)["line_of_sight_sigma_urad"])


def _sigmas_rad(sights: _Sights) -> FloatArray:
    """Return standard deviations (n,), rad, those of the sensors where they are missing."""
    defaults = np.array([sensor.line_of_sight_sigma_rad for sensor in sights.plan.sensors])
    setting = sigma_setting()
    limits = setting.minimum or 0.0, setting.maximum or np.inf
    sigma = sights.numbers("line_of_sight_sigma_urad", np.nan, *limits) * 1e-6
    return np.where(np.isnan(sigma), defaults[sights.sensor], sigma)


def _types(rows: Rows, reported_types: Sequence[str]) -> ByteArray:
    """Return the codes of reported types; those that the scene does not know are UNKNOWN."""
    code = {name: number for number, name in enumerate(reported_types)}
    names = (str(row.get("target_type")) for row in rows)
    return np.array([code.get(name, code["UNKNOWN"]) for name in names], dtype=np.uint8)


def _bands(sights: _Sights) -> ByteArray:
    """Return the masks of bands; a row without them has the sensor's first."""
    names = [[band.name for band in sensor.bands] for sensor in sights.plan.sensors]
    masks = []
    for row, number in zip(sights.rows, sights.sensor.tolist(), strict=True):
        bands = row.get("bands")
        if not isinstance(bands, Sequence) or isinstance(bands, str):
            bands = names[number][:1]
        masks.append(sum(1 << place for place, name in enumerate(names[number]) if name in bands))
    return np.array(masks, dtype=np.uint8)


def _ids(rows: Rows, plan: Plan) -> WordArray:
    """Return the ids of a file of opir's events, which are UUIDs of version 8; else new ids."""
    ids = [_uuid8(row.get("detection_id")) for row in rows]
    if rows and all(ids) and len(set(ids)) == len(ids):
        words = [divmod(number, 2**64) for number in ids if number]
        return np.array(words, dtype=np.uint64)
    key = id_key(plan.scene.seed, plan.scene.name, plan.scene.epoch_us, "opir track")
    keys = np.array([key] * len(rows), dtype=np.uint64).reshape(-1, 2)
    return uuid8_words(keys, np.arange(len(rows)))


def _uuid8(value: Any) -> int | None:
    try:
        uuid = UUID(value)
    except (TypeError, ValueError, AttributeError):
        return None
    return uuid.int if uuid.version == 8 else None
