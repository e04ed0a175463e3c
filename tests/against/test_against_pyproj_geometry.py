"""Geometry against PROJ (pyproj): geodetic coordinates near the ground, the topocentric frame,
geodesics.
"""

import numpy as np
import pyproj
import pytest

from opir_core.geometry import (
    azimuth_elevation_range,
    ecef_to_geodetic,
    geodesic_direct,
    geodesic_inverse,
    geodetic_to_ecef,
    line_of_sight,
)

PROJ_GEOCENTRIC = pyproj.Transformer.from_pipeline("+proj=cart +ellps=WGS84")
PROJ_GEODESIC = pyproj.Geod(ellps="WGS84")


def places(count, seed, lowest_m=-1e4, highest_m=1e5):
    rng = np.random.default_rng(seed)
    latitude = np.arcsin(rng.uniform(-1.0, 1.0, count))
    longitude = rng.uniform(-np.pi, np.pi, count)
    return latitude, longitude, rng.uniform(lowest_m, highest_m, count)


def topocentric(latitude, longitude, height):
    place = f"+lon_0={np.degrees(longitude)!s} +lat_0={np.degrees(latitude)!s} +h_0={height!s}"
    return pyproj.Transformer.from_pipeline(f"+proj=topocentric +ellps=WGS84 {place}")


def test_geodetic_to_ecef():
    latitude, longitude, height = places(2000, 1, -1e6, 4e8)
    reference = np.stack(
        PROJ_GEOCENTRIC.transform(longitude, latitude, height, radians=True), axis=-1
    )
    error = np.abs(geodetic_to_ecef(latitude, longitude, height) - reference).max(axis=1)
    assert np.all(error <= 1e-9 + 6e-16 * (6.4e6 + np.abs(height)))


def test_ecef_to_geodetic_near_the_ground():
    """PROJ inverts with one step of Bowring's formula from a start on the ground: off 1e-17 rad a
    metre of height.
    """
    position = geodetic_to_ecef(*places(2000, 2, -500.0, 500.0))
    result = ecef_to_geodetic(position)
    longitude, latitude, height = PROJ_GEOCENTRIC.transform(
        *position.T, radians=True, direction="INVERSE"
    )
    assert result.longitude_rad == pytest.approx(longitude, rel=0.0, abs=5e-16)
    assert result.latitude_rad == pytest.approx(latitude, rel=0.0, abs=1e-14)
    assert result.height_m == pytest.approx(height, rel=0.0, abs=2e-7)


def test_azimuth_elevation_range_in_the_topocentric_frame():
    targets = geodetic_to_ecef(*places(300, 4, 0.0, 4e7))
    for latitude, longitude, height in zip(*places(20, 3), strict=True):
        frame = topocentric(latitude, longitude, height)
        east, north, up = frame.transform(*targets.T)
        azimuth, elevation, distance = azimuth_elevation_range(
            geodetic_to_ecef(latitude, longitude, height), targets
        )
        turn = np.abs((azimuth - np.arctan2(east, north) + np.pi) % (2.0 * np.pi) - np.pi)
        assert np.max(turn * np.cos(elevation)) < 3e-15
        assert elevation == pytest.approx(np.arctan2(up, np.hypot(east, north)), rel=0.0, abs=3e-15)
        assert distance == pytest.approx(np.sqrt(east**2 + north**2 + up**2), rel=1e-15)


def test_line_of_sight_in_the_topocentric_frame():
    rng = np.random.default_rng(5)
    for latitude, longitude, height in zip(*places(20, 6), strict=True):
        frame = topocentric(latitude, longitude, height)
        azimuth = rng.uniform(0.0, 2.0 * np.pi, 100)
        elevation = np.arcsin(rng.uniform(-1.0, 1.0, 100))
        observer = geodetic_to_ecef(latitude, longitude, height)
        east, north, up = frame.transform(
            *(observer + 1e7 * line_of_sight(observer, azimuth, elevation)).T
        )
        assert east == pytest.approx(1e7 * np.sin(azimuth) * np.cos(elevation), rel=0.0, abs=1e-8)
        assert north == pytest.approx(1e7 * np.cos(azimuth) * np.cos(elevation), rel=0.0, abs=1e-8)
        assert up == pytest.approx(1e7 * np.sin(elevation), rel=0.0, abs=1e-8)


def test_geodesics_both_ways():
    start_latitude, start_longitude, _ = places(500, 7)
    end_latitude, end_longitude, _ = places(500, 8)
    # Every tenth pair is nearly antipodal, where series of the older kind do not converge.
    end_latitude[::10] = -start_latitude[::10] + 1e-3
    end_longitude[::10] = start_longitude[::10] + np.pi - 2e-3
    distance, bearing = geodesic_inverse(
        start_latitude, start_longitude, end_latitude, end_longitude
    )
    azimuth, _, length = PROJ_GEODESIC.inv(
        start_longitude, start_latitude, end_longitude, end_latitude, radians=True
    )
    assert distance == pytest.approx(length, rel=0.0, abs=3e-8)
    assert np.cos(bearing - azimuth) == pytest.approx(1.0, rel=0.0, abs=1e-15)
    assert np.all((bearing >= 0.0) & (bearing < 2.0 * np.pi))
    latitude, longitude = geodesic_direct(start_latitude, start_longitude, bearing, distance)
    there_longitude, there_latitude, _ = PROJ_GEODESIC.fwd(
        start_longitude, start_latitude, azimuth, length, radians=True
    )
    assert latitude == pytest.approx(np.array(there_latitude), rel=0.0, abs=2e-14)
    assert np.cos(longitude - there_longitude) == pytest.approx(1.0, rel=0.0, abs=1e-15)
