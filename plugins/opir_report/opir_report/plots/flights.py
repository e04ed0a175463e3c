"""Flights of targets, and places and fields of view of sensors, as columns."""

from typing import Any

import numpy as np

from opir_core import Plan
from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic
from opir_core.planning import whole_flights
from opir_core.plugin import Sensor
from opir_report.figure_data import FigureData
from opir_report.maps.spheres import EARTH_RADIUS_KM

_TRACK_NAMES = (
    "target_id",
    "time_s",
    "latitude_deg",
    "longitude_deg",
    "height_km",
    "is_burning",
)
#: Longest flight that is drawn after burnout, s: an orbit has no end.
_LONGEST_S = 7200.0


def ground_tracks(plan: Plan) -> FigureData:
    """Return the true ground tracks of the launches: target_id, time_s, latitude, longitude,
    height_km, is_burning.
    """
    targets = whole_flights(plan)
    tracks = [_ground_track(targets, number) for number in range(len(targets.ids))]
    return FigureData.joined(tracks) if tracks else FigureData.of_rows(_TRACK_NAMES, ())


def _ground_track(targets: Any, number: int) -> FigureData:
    burnout_s = float(targets.burnout_s[number])
    end_s = min(float(targets.end_s[number]), burnout_s + _LONGEST_S)
    time_s = np.linspace(float(targets.ignition_s[number]), burnout_s, 41)
    if end_s > burnout_s:
        time_s = np.append(time_s, np.linspace(burnout_s, end_s, 81)[1:])
    rows = np.full(len(time_s), number, dtype=np.int32)
    place = ecef_to_geodetic(targets.position_ecef_m(rows, time_s))
    columns = (
        np.full(len(time_s), targets.ids[number]),
        time_s,
        np.degrees(place.latitude_rad),
        np.degrees(place.longitude_rad),
        1e-3 * place.height_m,
        (time_s <= burnout_s) & ~targets.is_dark(rows, time_s),
    )
    return FigureData(dict(zip(_TRACK_NAMES, columns, strict=True)))


def view_time_s(plan: Plan) -> float:
    """Return the time for which satellites are drawn: the first ignition, or the start of a scene
    without launches.
    """
    ignition_s = plan.targets.ignition_s[: len(plan.scene.targets)]
    return float(np.clip(ignition_s.min(), 0.0, plan.scene.duration_s)) if len(ignition_s) else 0.0


def fields_of_view(plan: Plan) -> FigureData:
    """Return the sensors at `view_time_s`: sensor_id, sensor_type, latitude, longitude, height_km,
    radius_deg.

    The radius is the Earth-central angle of the spherical cap on the ground that the sensor can
    see.
    """
    time_s = np.array([view_time_s(plan)])
    rows = []
    for sensor in plan.sensors:
        position = sensor.orbit.position_ecef_m(time_s)
        place = ecef_to_geodetic(position)
        radius_rad = cap_radius_rad(sensor, float(np.linalg.norm(position)))
        latitude, longitude = np.degrees([place.latitude_rad[0], place.longitude_rad[0]]).tolist()
        height_km = float(1e-3 * place.height_m[0])
        rows.append(
            (sensor.id, sensor.type, latitude, longitude, height_km, float(np.degrees(radius_rad)))
        )
    names = ("sensor_id", "sensor_type", "latitude_deg", "longitude_deg", "height_km", "radius_deg")
    return FigureData.of_rows(names, rows)


def cap_radius_rad(sensor: Sensor, distance_m: float) -> float:
    """Return the Earth-central angle of the ground that a sensor at a distance from the Earth's
    centre can see.

    On a sphere: bounded by the cone of the field of regard, the least elevation, and the horizon.
    """
    ratio = max(distance_m / (1e3 * EARTH_RADIUS_KM), 1.0)
    elevation = max(sensor.minimum_elevation_rad, 0.0)
    half_angle = sensor.field_of_regard_half_angle_rad
    radius = float(np.arccos(np.clip(np.cos(elevation) / ratio, -1.0, 1.0))) - elevation
    sine = ratio * np.sin(half_angle)
    if half_angle < 0.5 * np.pi and sine < 1.0:
        radius = min(radius, float(np.arcsin(sine)) - half_angle)
    return max(radius, 0.0)


def satellite_track(plan: Plan, sensor: Sensor) -> FloatArray:
    """Return the ground track (n, 2) of a sensor over the scene, rad; one point for a stationary
    one.
    """
    count = 1 if sensor.orbit.is_stationary else 61
    place = ecef_to_geodetic(
        sensor.orbit.position_ecef_m(np.linspace(0.0, plan.scene.duration_s, count))
    )
    return np.stack([place.latitude_rad, place.longitude_rad], axis=1)
