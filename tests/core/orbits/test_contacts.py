"""Contacts of satellites with stations and with each other, against closed forms."""

import numpy as np
import pytest

from opir_core.geometry import geodetic_to_ecef
from opir_core.orbits import contact_intervals, crosslink_intervals
from opir_core.orbits.orbit_models import GeostationaryOrbit

RATE_RAD_S = 1e-3
RADIUS_M = 8e6
POLAR_RADIUS_M = 6_356_752.314245179


class Circle:
    """A satellite on a circle in the equator's plane, fixed in ECEF, or over the poles."""

    is_stationary = False

    def __init__(self, radius_m: float, phase_rad: float = 0.0, *, is_polar: bool = False) -> None:
        self.radius_m = radius_m
        self.phase_rad = phase_rad
        self.is_polar = is_polar

    def position_ecef_m(self, time_s: np.ndarray) -> np.ndarray:
        angle = self.phase_rad + RATE_RAD_S * time_s
        along, across = self.radius_m * np.cos(angle), self.radius_m * np.sin(angle)
        level = np.zeros(len(angle))
        rows = (along, level, across) if self.is_polar else (along, across, level)
        return np.stack(rows, axis=1)


@pytest.mark.parametrize("mask_deg", [0.0, 5.0, 40.0])
def test_passes_over_the_pole_follow_the_triangle(mask_deg: float) -> None:
    station_m = geodetic_to_ecef(0.5 * np.pi, 0.0, 0.0)
    mask = np.radians(mask_deg)
    # At the mask the triangle of centre, station and satellite has 90 deg + mask at the station.
    from_pole = 0.5 * np.pi - mask - np.arcsin(POLAR_RADIUS_M / RADIUS_M * np.cos(mask))
    middle_s = 0.5 * np.pi / RATE_RAD_S
    turn_s = 2.0 * np.pi / RATE_RAD_S
    spans = contact_intervals(
        Circle(RADIUS_M, is_polar=True), station_m, mask_rad=mask, start_s=0.0, stop_s=2.0 * turn_s
    )
    half_s = from_pole / RATE_RAD_S
    edges_s = [[middle_s - half_s, middle_s + half_s]]
    np.testing.assert_allclose(spans, [*edges_s, np.add(edges_s, turn_s)[0]], atol=2e-3)


def test_a_geostationary_satellite_is_in_contact_throughout_or_never() -> None:
    station_m = geodetic_to_ecef(0.3, 0.1, 0.0)
    settings = {"mask_rad": 0.1, "start_s": 0.0, "stop_s": 5000.0}
    spans = contact_intervals(GeostationaryOrbit(0.0), station_m, **settings)
    assert spans.tolist() == [[0.0, 5000.0]]
    assert contact_intervals(GeostationaryOrbit(180.0), station_m, **settings).shape == (0, 2)


@pytest.mark.parametrize("clearance_m", [0.0, 1e5, 1e6])
def test_two_satellites_see_each_other_past_the_limb(clearance_m: float) -> None:
    fixed = GeostationaryOrbit(0.0)
    far_m = float(np.abs(fixed.position_ecef_m(np.zeros(1))).max())
    low_m = 6_378_137.0 + clearance_m
    angle_rad = np.arccos(low_m / RADIUS_M) + np.arccos(low_m / far_m)
    half_s = angle_rad / RATE_RAD_S
    turn_s = 2.0 * np.pi / RATE_RAD_S
    spans = crosslink_intervals(
        Circle(RADIUS_M), fixed, clearance_m=clearance_m, start_s=0.0, stop_s=turn_s
    )
    np.testing.assert_allclose(spans, [[0.0, half_s], [turn_s - half_s, turn_s]], atol=2e-3)
