"""The array wrappers against GeographicLib itself, called point by point."""

import subprocess
import sys

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from opir_core.geometry import geodesic_direct, geodesic_inverse
from opir_core.scene import QuadrangleConfig


def test_every_element_is_the_library_s():
    rng = np.random.default_rng(1)
    latitude_1, latitude_2 = rng.uniform(-np.pi / 2, np.pi / 2, (2, 40))
    longitude_1, longitude_2 = rng.uniform(-np.pi, np.pi, (2, 40))
    distance, bearing = geodesic_inverse(latitude_1, longitude_1, latitude_2, longitude_2)
    latitude, longitude = geodesic_direct(latitude_1, longitude_1, bearing, distance)
    for index in range(40):
        points = np.degrees(
            [latitude_1[index], longitude_1[index], latitude_2[index], longitude_2[index]]
        )
        line = Geodesic.WGS84.Inverse(*points)
        assert distance[index] == line["s12"]
        assert np.degrees(bearing[index]) == pytest.approx(line["azi1"] % 360.0, rel=1e-15)
        end = Geodesic.WGS84.Direct(points[0], points[1], line["azi1"], line["s12"])
        assert np.degrees(latitude[index]) == pytest.approx(end["lat2"], rel=0.0, abs=1e-12)
        assert np.degrees(longitude[index]) == pytest.approx(end["lon2"], rel=0.0, abs=1e-12)


def test_shapes_broadcast():
    distance, bearing = geodesic_inverse(
        0.0, 0.0, np.array([[0.1], [0.2], [0.3]]), np.array([0.1, 0.2])
    )
    assert distance.shape == bearing.shape == (3, 2)
    assert geodesic_inverse(0.0, 0.0, 0.1, 0.1).distance_m == pytest.approx(897_000.0, rel=0.01)
    assert geodesic_direct(np.zeros((0,)), 0.0, 0.0, 1.0).latitude_rad.shape == (0,)


def test_what_has_no_answer_is_nan():
    distance, bearing = geodesic_inverse([0.3, 1.6, np.nan, 0.3], 0.2, [0.3, 0.0, 0.0, np.inf], 0.2)
    assert distance[0] == 0.0
    assert np.all(np.isnan(distance[1:]))
    assert np.all(np.isnan(bearing))
    latitude, longitude = geodesic_direct(
        [1.6, 0.0, 0.0, 0.0], 0.0, [0.0, np.nan, 0.0, 0.0], [1.0, 1.0, np.inf, np.nan]
    )
    assert np.all(np.isnan(latitude))
    assert np.all(np.isnan(longitude))


def test_poles_and_date_line_are_places_like_others():
    pole = np.pi / 2
    assert geodesic_inverse(pole, 0.0, -pole, 0.0).distance_m == pytest.approx(
        20003931.4586, rel=0.0, abs=1e-4
    )
    across = geodesic_inverse(0.0, np.radians(179.5), 0.0, np.radians(-179.5))
    assert across.distance_m == pytest.approx(np.radians(1.0) * 6378137.0, rel=1e-14)
    assert across.bearing_rad == pytest.approx(np.pi / 2)
    assert (
        abs(geodesic_direct(0.0, np.radians(179.5), np.pi / 2, across.distance_m).longitude_rad)
        < np.pi
    )


def test_geographiclib_is_imported_when_called_and_not_before():
    script = (
        "import sys, opir_core.geometry as g\n"
        "assert not [m for m in sys.modules if m.split('.')[0] in ('geographiclib', 'scipy',"
        " 'pyproj', 'astropy')]\n"
        "g.geodesic_inverse(0, 0, 1, 1)\n"
        "assert 'geographiclib' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


@pytest.mark.parametrize("south_deg", [-90, -45, 0, 30, 89])
def test_surface_of_a_quadrangle_is_that_of_the_ellipsoid(south_deg):
    """A polygon of geodesics with vertices 0.01 degrees apart along the parallels."""
    quadrangle = QuadrangleConfig(
        south_deg=south_deg, north_deg=south_deg + 1, west_deg=175, east_deg=-175
    )
    outline = Geodesic.WGS84.Polygon()
    steps = np.arange(1001) / 100
    for step in steps:
        outline.AddPoint(south_deg, 175 + step)
    for step in steps[::-1]:
        outline.AddPoint(south_deg + 1, 175 + step)
    surface_m2 = outline.Compute()[2]
    assert quadrangle.surface_m2 == pytest.approx(surface_m2, rel=0.009)


def test_surface_of_the_whole_earth():
    """The area of the WGS 84 ellipsoid, as GeographicLib's documentation gives it."""
    whole = QuadrangleConfig(south_deg=-90, north_deg=90, west_deg=-180, east_deg=180)
    assert whole.surface_m2 == pytest.approx(510_065_621_724_088.0, rel=1e-9)
