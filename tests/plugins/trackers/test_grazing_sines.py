"""At what angles lines of sight meet the ground."""

import numpy as np
import pytest
from opir_trackers.initiation import _sines

from opir_core.geometry import geodetic_to_ecef


@pytest.mark.parametrize("latitude_deg", [-80.0, -45.0, 0.0, 30.0, 45.0, 89.0])
def test_the_sine_is_that_of_the_angle_to_the_plane_of_the_ellipsoid(latitude_deg: float) -> None:
    latitude = np.radians(latitude_deg)
    longitude = 0.7
    grazing = np.radians([1.0, 5.0, 30.0, 90.0])
    up = [
        np.cos(latitude) * np.cos(longitude),
        np.cos(latitude) * np.sin(longitude),
        np.sin(latitude),
    ]
    north = [
        -np.sin(latitude) * np.cos(longitude),
        -np.sin(latitude) * np.sin(longitude),
        np.cos(latitude),
    ]
    lines = np.outer(np.cos(grazing), north) - np.outer(np.sin(grazing), up)
    ground_m = np.tile(geodetic_to_ecef(latitude, longitude, 0.0), (len(grazing), 1))
    assert _sines(lines, ground_m) == pytest.approx(np.sin(grazing), abs=1e-14)
