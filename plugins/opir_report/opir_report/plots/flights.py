"""Where targets fly, satellites stand and sensors see, as columns."""

import numpy as np

from opir_core import Plan
from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic
from opir_core.planning import whole_flights
from opir_core.plugin import Sensor
from opir_report.figure_data import FigureData
from opir_report.maps.spheres import EARTH_RADIUS_KM

#: Points of a burn and of the flight after it.
_BURN_POINTS = 41
_FLIGHT_POINTS = 81
#: Longest flight that is drawn after burnout, s: an orbit has no end.
_LONGEST_S = 7200.0
#: Times of a satellite's ground track.
_ORBIT_POINTS = 61


def ground_tracks(plan: Plan) -> FigureData:
    """Return the true ground tracks of the launches: target_id, time_s, latitude, longitude,
    height_km, is_burning.
    """
    targets = whole_flights(plan)
    columns: dict[str, list[object]] = {
        name: []
        for name in (
            "target_id",
            "time_s",
            "latitude_deg",
            "longitude_deg",
            "height_km",
            "is_burning",
        )
    }
    for row, name in enumerate(targets.ids):
        start_s = float(targets.ignition_s[row])
        burnout_s = float(targets.burnout_s[row])
        end_s = min(float(targets.end_s[row]), burnout_s + _LONGEST_S)
        time_s = np.linspace(start_s, burnout_s, _BURN_POINTS)
        if end_s > burnout_s:
            time_s = np.append(time_s, np.linspace(burnout_s, end_s, _FLIGHT_POINTS)[1:])
        own = np.full(len(time_s), row, dtype=np.int32)
        place = ecef_to_geodetic(targets.position_ecef_m(own, time_s))
        columns["target_id"] += [name] * len(time_s)
        columns["time_s"] += time_s.tolist()
        columns["latitude_deg"] += np.degrees(place.latitude_rad).tolist()
        columns["longitude_deg"] += np.degrees(place.longitude_rad).tolist()
        columns["height_km"] += (1e-3 * place.height_m).tolist()
        columns["is_burning"] += ((time_s <= burnout_s) & ~targets.is_dark(own, time_s)).tolist()
    return FigureData({name: np.asarray(column) for name, column in columns.items()})


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
    seen = float(np.arccos(np.clip(np.cos(elevation) / ratio, -1.0, 1.0))) - elevation
    sine = ratio * np.sin(sensor.field_of_regard_half_angle_rad)
    if sensor.field_of_regard_half_angle_rad < 0.5 * np.pi and sine < 1.0:
        seen = min(seen, float(np.arcsin(sine)) - sensor.field_of_regard_half_angle_rad)
    return max(seen, 0.0)


def satellite_track(plan: Plan, sensor: Sensor) -> FloatArray:
    """Return the ground track (n, 2) of a sensor over the scene, rad; one point for a stationary
    one.
    """
    count = 1 if sensor.orbit.is_stationary else _ORBIT_POINTS
    place = ecef_to_geodetic(
        sensor.orbit.position_ecef_m(np.linspace(0.0, plan.scene.duration_s, count))
    )
    return np.stack([place.latitude_rad, place.longitude_rad], axis=1)
