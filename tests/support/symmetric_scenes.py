"""A tracked scene, and what may be done to it without a change of any detection or track but in
numbers and places.
"""

from collections.abc import Mapping
from typing import Any

import opir_core as opir

#: Two sensors see the launches of the west, the third alone that of the east.
SENSORS: Mapping[str, Mapping[str, Any]] = {
    "WEST": {"orbital_slot_deg": -135.0},
    "MIDDLE": {"orbital_slot_deg": -95.0, "scan_period_ms": 700, "line_of_sight_sigma_urad": 15.0},
    "EAST": {"orbital_slot_deg": 20.0},
}
#: It looks at the other side of the Earth.
BLIND = {"model": "generic-scanner", "id": "BLIND", "orbital_slot_deg": 130.0}


def launch(name, kind, start, aim):
    """Return a target that starts at latitude, longitude and time."""
    lat_deg, lon_deg, time_s = start
    return {
        "id": name,
        "type": kind,
        "launch": {"lat_deg": lat_deg, "lon_deg": lon_deg, "time_s": time_s},
        "aim": {"lat_deg": aim[0], "lon_deg": aim[1]},
    }


#: Latitudes of the second launch: alone, and 5 km from the first one.
ALONE_DEG = 39.0
CROWDED_DEG = 34.78


def scene(tracker, second_deg=ALONE_DEG, **changes):
    """Return a scene of four launches: two in the northwest, one whose burn soon ends, one before a
    single sensor.
    """
    return {
        "scene": "symmetric",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 40,
        "seed": 5,
        "detection": "constant",
        "sensors": [
            {"model": "generic-scanner", "id": name, **settings}
            for name, settings in SENSORS.items()
        ],
        "targets": [
            launch("T1", "ICBM", (34.73, -120.57, 3.0), (9.0, 167.7)),
            launch("T2", "IRBM", (second_deg, -120.52, 4.0), (20.0, -160.0)),
            {**launch("T3", "SRBM", (11.0, -100.0, 4.0), (12.0, -103.0)), "burn_time_s": 20.0},
            launch("T4", "SRBM", (-12.0, 31.0, 5.0), (-14.0, 34.3)),
        ],
        "tracker": tracker,
        **changes,
    }


def simulated(mapping, **settings):
    """Return the run of a scene."""
    return opir.simulate(opir.scene_from_mapping(dict(mapping)), **settings)


def turned(mapping, turn_deg):
    """Return a scene whose sensors and targets are moved east alike."""
    sensors = [
        {**sensor, "orbital_slot_deg": in_circle(sensor["orbital_slot_deg"] + turn_deg)}
        for sensor in mapping["sensors"]
    ]
    targets = []
    for target in mapping["targets"]:
        ends = {
            end: {**target[end], "lon_deg": in_circle(target[end]["lon_deg"] + turn_deg)}
            for end in ENDS
        }
        targets.append({**target, **ends})
    return {**mapping, "sensors": sensors, "targets": targets}


ENDS = ("launch", "aim")


def in_circle(degrees):
    """Return a longitude between -180 and 180 degrees."""
    return (degrees + 180.0) % 360.0 - 180.0
