"""The columns of the tables `targets` and `sensors`."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.plugin import Sensor
from opir_export.tabular.columns import TableColumn, counts, plain_numbers, texts

_PLACES = ("launch", "aim", "burnout", "impact")
_ANGLES = (
    ("lat_deg", "geodetic latitude"),
    ("lon_deg", "longitude"),
    ("height_m", "height"),
)


def target_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `targets` of a run: truth, and statistics of detections."""
    yield from _true_targets(run.plan.targets)
    yield from _detected_targets(run.summary, run.plan.targets.ids)


def _true_targets(targets: Any) -> Iterator[TableColumn]:
    truths = targets.truth()
    yield TableColumn("target_id", texts(targets.ids), "the target")
    yield TableColumn(
        "target_type", texts(targets.class_names), "target class, or type of another hot source"
    )
    yield TableColumn(
        "profile", texts([_word(row.get("profile")) for row in truths]), "boost profile"
    )
    yield TableColumn("ignition_s", targets.ignition_s, "scene time of ignition")
    yield TableColumn("burnout_s", targets.burnout_s, "scene time of burnout")
    for place in _PLACES:
        for key, quantity in _ANGLES:
            values = plain_numbers([_inner(row, place, key) for row in truths])
            yield TableColumn(f"{place}_{key}", values, f"{quantity} of the {place}")
    yield TableColumn(
        "impact_s", plain_numbers([_inner(row, "impact", "time_s") for row in truths]), "of impact"
    )


def _detected_targets(summary: Mapping[str, Any], ids: Sequence[str]) -> Iterator[TableColumn]:
    statistics = {row["source_id"]: row for row in summary["sources"]} | {
        row["target_id"]: row for row in summary["targets"]
    }
    rows = [statistics[name] for name in ids]
    yield TableColumn(
        "detections", counts([row["detections"] for row in rows]), "number of detections"
    )
    sensor_ids = texts([row["first_sensor_id"] for row in rows])
    yield TableColumn("first_sensor_id", sensor_ids, "the sensor that detected it first")
    for key, meaning in (
        ("first_detection_s", "scene time of the first detection"),
        ("latency_s", "from ignition to the first detection"),
        ("last_detection_s", "scene time of the last detection"),
    ):
        yield TableColumn(key, plain_numbers([row.get(key) for row in rows]), meaning)
    reported_types = texts([row["reported_type"] for row in rows])
    yield TableColumn("reported_type", reported_types, "type reported most often")


def sensor_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `sensors` of a run."""
    sensors: Sequence[Sensor] = run.sensors
    yield TableColumn("sensor_id", texts([sensor.id for sensor in sensors]), "the sensor")
    models = texts([sensor.type for sensor in sensors])
    yield TableColumn("sensor_type", models, "its sensor model")
    slots = plain_numbers([sensor.orbital_slot_deg for sensor in sensors])
    yield TableColumn("orbital_slot_deg", slots, "longitude of a geostationary slot")
    start_m = [sensor.orbit.position_ecef_m(np.zeros(1))[0] for sensor in sensors]
    position_m = np.array(start_m).reshape(-1, 3)
    for axis, letter in enumerate("xyz"):
        yield TableColumn(f"{letter}_m", position_m[:, axis], "position at the scene's start, ECEF")
    bands = texts(["+".join(band.name for band in sensor.bands) for sensor in sensors])
    yield TableColumn("bands", bands, "joined by +")
    yield from _observation_limits(sensors)


def _observation_limits(sensors: Sequence[Sensor]) -> Iterator[TableColumn]:
    period_s = plain_numbers([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    yield TableColumn("scan_period_s", period_s, "time between two looks at a target")
    for name, attribute, meaning in (
        (
            "field_of_regard_half_angle",
            "field_of_regard_half_angle_rad",
            "from the direction to the Earth's centre",
        ),
        ("minimum_elevation", "minimum_elevation_rad", "of the sensor above the target's horizon"),
    ):
        angles = np.degrees([getattr(sensor, attribute) for sensor in sensors])
        yield TableColumn(f"{name}_deg", plain_numbers(angles.tolist()), meaning)
    sigma_urad = plain_numbers([sensor.line_of_sight_sigma_rad * 1e6 for sensor in sensors])
    yield TableColumn("line_of_sight_sigma_urad", sigma_urad, "standard deviation per axis")


def _inner(row: Mapping[str, Any], place: str, key: str) -> float | None:
    value = (row.get(place) or {}).get(key)
    return None if value is None else float(value)


def _word(value: Any) -> str | None:
    return None if value is None else str(value)
