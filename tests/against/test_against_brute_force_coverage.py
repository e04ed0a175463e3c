"""What the default fleets see, against a count that shares nothing with them.

Satellites are moved by skyfield's two-body propagation from their elements; whether the Earth hides
a place is asked of 500 points along the line of sight, and the field of regard of an angle between
vectors.
"""

import importlib
import math
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from repository import ROOT
from skyfield.keplerlib import propagate

from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.geometry import geodetic_to_ecef
from opir_core.host.host import Host
from opir_core.interfaces.contexts import SensorContext
from opir_core.orbits import highly_elliptical_elements, walker_pattern
from opir_core.orbits.orbit_models import TwoBodyMotion
from opir_core.planning.visibility import visible_now
from opir_core.reading import scene_from_mapping

for package in ("opir_heo", "opir_leo"):
    # Where the plugins are not installed, their sources are tested.
    if find_spec(package) is None:
        sys.path.append(str(ROOT / "plugins" / package))

A_M = 6378137.0
B_M = 6356752.314245
TIMES_S = np.arange(0.0, 86400.0, 5417.0)


def elements_of(name):
    """Return the orbits that the fleets' readme gives, written down here once more."""
    day_s = 86164.1
    if name == "HEO-MOLNIYA":
        return [
            highly_elliptical_elements(2.0, 0.74, math.radians(-90.0), k * day_s / 6.0)
            for k in range(3)
        ]
    if name == "HEO-TUNDRA":
        return [
            highly_elliptical_elements(1.0, 0.27, math.radians(-90.0), k * day_s / 2.0)
            for k in range(2)
        ]
    total, planes = {"LEO-WIDE": (24, 6), "LEO-MEDIUM": (12, 3)}[name]
    return walker_pattern(total, planes, 1, 1.2e6, math.radians(60.0))


def skyfield_positions(elements):
    """Return positions (times, 3) in ECEF, m."""
    position, velocity = TwoBodyMotion(elements).state_eci(np.zeros(1))
    days = TIMES_S / 86400.0
    mu_km3_d2 = EARTH_MU_M3_S2 * 1e-9 * 86400.0**2
    moved, _ = propagate(position[0] * 1e-3, velocity[0] * 86.4, 0.0, days, mu_km3_d2)
    x, y, z = moved * 1e3
    turn = EARTH_ROTATION_RAD_S * TIMES_S
    return np.stack(
        [np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x, z], axis=1
    )


def places():
    """Return targets (n, 3) in ECEF, m, 50 km up, all over the globe."""
    latitude, longitude = np.meshgrid(
        np.radians(np.linspace(-88.0, 88.0, 12)), np.radians(np.arange(0.0, 360.0, 36.0))
    )
    return geodetic_to_ecef(latitude.ravel(), longitude.ravel(), np.full(latitude.size, 50e3))


def clear_by_points(sensor_m, target_m):
    """Return which lines of sight keep out of the ellipsoid: 500 points of each are tried."""
    share = np.linspace(0.0, 1.0, 500)[:, None, None]
    points = target_m * (1.0 - share) + sensor_m * share
    inside = (points[..., 0] ** 2 + points[..., 1] ** 2) / A_M**2 + points[
        ..., 2
    ] ** 2 / B_M**2 < 1.0
    return ~inside.any(axis=0)


def sensor_of(fleet, number):
    host = Host.discover(["heo", "leo"])
    mapping = {
        "scene": "coverage",
        "epoch": "2026-04-01T00:00:00Z",
        "duration_s": 1.0,
        "seed": 1,
        "sensors": [{"constellation": fleet}],
        "targets": [],
    }
    selected = scene_from_mapping(mapping).sensors[number]
    model = host.component("opir_sensor_models", selected.model.name, "")
    return model.build(selected.model.config, SensorContext(id=selected.id, epoch_us=0))


@pytest.mark.parametrize("fleet", ["HEO-MOLNIYA", "HEO-TUNDRA", "LEO-WIDE", "LEO-MEDIUM"])
def test_positions_and_coverage_of_a_fleet(fleet):
    importlib.import_module("opir_heo.plugin")
    targets = places()
    for number, elements in list(enumerate(elements_of(fleet)))[::5]:
        sensor = sensor_of(fleet, number)
        reference = skyfield_positions(elements)
        result = sensor.orbit.position_ecef_m(TIMES_S)
        # Skyfield bisects for the universal anomaly; 7e-5 m apart here at most.
        assert np.abs(result - reference).max() < 1e-3
        for position in reference:
            down = -position / np.linalg.norm(position)
            offset = targets - position
            nadir = np.arccos(offset @ down / np.linalg.norm(offset, axis=1))
            expected = clear_by_points(position, targets) & (
                nadir < sensor.field_of_regard_half_angle_rad
            )
            result = visible_now(sensor, np.broadcast_to(position, targets.shape), targets)
            # 500 points step over grazes of a few kilometres.
            assert np.count_nonzero(result != expected) <= 1
