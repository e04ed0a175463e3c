"""Synthetic launches: ground points and aim points against rotations and geodesics on a sphere, and
how even they are.

The low-discrepancy points are required to be evener than 99.9 % of all samples of independent
points.
"""

from typing import Any

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from numpy.typing import NDArray
from opir_photons.classification import synthetic_looks
from opir_photons.classification.synthetic_looks import low_discrepancy_points
from scipy.spatial.transform import Rotation
from scipy.stats import kstwo, uniform

from opir_core.flight import boost_profile
from opir_core.flight.glide import GlideShape, glide_flight
from opir_core.geometry import Geodetic
from opir_core.plugin import TARGET_TYPES, EquilibriumGlide
from opir_core.scene import core_target_class

PROFILES = [profile.name for kind in TARGET_TYPES for profile in core_target_class(kind).profiles]

#: Radius of the sphere that launches are placed on, m, and of a geostationary orbit and a low one.
RADIUS_M = 6.371e6
GEOSTATIONARY_M = 4.2164e7
LOW_M = 7.4e6

#: Semi-major axis, m, and flattening of WGS 84 (NIMA TR8350.2, table 3.1).
MAJOR_AXIS_M = 6378137.0
FLATTENING = 1.0 / 298.257223563

POINTS = 1500

Array = NDArray[np.float64]


def kolmogorov_distance(values: Array) -> float:
    """Return the largest difference between the empirical distribution of values (n,) and the
    uniform one on [0, 1].
    """
    ordered = uniform.cdf(np.sort(values))
    count = len(values)
    above = np.arange(1, count + 1) / count - ordered
    below = ordered - np.arange(count) / count
    return float(max(above.max(), below.max()))


def assert_even(values: Array) -> None:
    assert kolmogorov_distance(values) < kstwo.ppf(0.001, len(values))


def on_the_sphere_m(site: Geodetic) -> Array:
    """Return the points (n, 3) of the sphere above or below sites on the ellipsoid, along the
    ellipsoid's normals.
    """
    sine = np.sin(site.latitude_rad)
    cosine = np.cos(site.latitude_rad)
    normal = np.stack(
        [cosine * np.cos(site.longitude_rad), cosine * np.sin(site.longitude_rad), sine], axis=1
    )
    squared = FLATTENING * (2.0 - FLATTENING)
    foot = (
        normal
        * (MAJOR_AXIS_M / np.sqrt(1.0 - squared * sine**2))[:, None]
        * [1.0, 1.0, 1.0 - squared]
    )
    # |foot + h normal| is the sphere's radius.
    along = np.sum(foot * normal, axis=1)
    length = np.sum(foot * foot, axis=1)
    height = -along + np.sqrt(along**2 - length + RADIUS_M**2)
    return foot + height[:, None] * normal


@pytest.fixture(scope="module", params=[GEOSTATIONARY_M, LOW_M], ids=["geostationary", "low"])
def placed(request: pytest.FixtureRequest) -> tuple[float, Array, Array, Geodetic]:
    """Return a satellite radius, the drawn points, and the satellites and ground points made of
    them.
    """
    drawn = low_discrepancy_points(POINTS, 3)
    return request.param, drawn, *synthetic_looks.sites(request.param, drawn)


def test_ground_points_are_satellites_turned_by_rotations(
    placed: tuple[float, Array, Array, Geodetic],
) -> None:
    radius_m, drawn, sensor_m, site = placed
    ground_m = on_the_sphere_m(site)
    turns = 2.0 * np.pi * drawn[:, 0]
    assert np.allclose(
        sensor_m,
        Rotation.from_euler("z", turns[:, None]).apply([radius_m, 0.0, 0.0]),
        rtol=0.0,
        atol=1e-6,
    )
    # Above longitude 0 a point moves north by a turn about -y, and then clockwise by one about -x.
    away = sensor_m - ground_m
    angle = np.arctan2(
        np.linalg.norm(np.cross(sensor_m, ground_m), axis=1), np.sum(sensor_m * ground_m, axis=1)
    )
    turned = Rotation.from_euler(
        "yxz", np.stack([-angle, -2.0 * np.pi * drawn[:, 2], turns], axis=1)
    )
    assert np.allclose(ground_m, turned.apply([RADIUS_M, 0.0, 0.0]), rtol=0.0, atol=1e-3)
    sine = np.sum(away * ground_m, axis=1) / (RADIUS_M * np.linalg.norm(away, axis=1))
    assert np.allclose(sine, 0.02 + 0.98 * drawn[:, 1], rtol=0.0, atol=1e-9)
    assert np.all(site.height_m == 0.0)


def test_sites_have_low_discrepancy(
    placed: tuple[float, Array, Array, Geodetic],
) -> None:
    _, _, sensor_m, site = placed
    ground_m = on_the_sphere_m(site)
    away = sensor_m - ground_m
    sine = np.sum(away * ground_m, axis=1) / (RADIUS_M * np.linalg.norm(away, axis=1))
    longitude = np.arctan2(sensor_m[:, 1], sensor_m[:, 0])
    east = np.remainder(np.arctan2(ground_m[:, 1], ground_m[:, 0]) - longitude, 2.0 * np.pi)
    equatorial = np.hypot(ground_m[:, 0], ground_m[:, 1])
    bearing = np.arctan2(equatorial * np.sin(east), ground_m[:, 2])
    assert_even((sine - 0.02) / 0.98)
    assert_even(np.remainder(longitude / (2.0 * np.pi), 1.0))
    assert_even(np.remainder(bearing / (2.0 * np.pi), 1.0))


def aims_of(drawn: Array) -> tuple[Geodetic, Geodetic, list[str]]:
    """Return sites at all latitudes, with the aim points of every class profile in turn."""
    rng = np.random.default_rng(21)
    count = len(drawn)
    site = Geodetic(
        np.arcsin(rng.uniform(-1.0, 1.0, count)), rng.uniform(-np.pi, np.pi, count), np.zeros(count)
    )
    names = [PROFILES[row % len(PROFILES)] for row in range(count)]
    return site, synthetic_looks._aims(site, [boost_profile(name) for name in names], drawn), names


def test_aim_points_are_geodesics_on_a_sphere() -> None:
    drawn = low_discrepancy_points(10 * len(PROFILES), 2)
    site, aim, names = aims_of(drawn)
    sphere = Geodesic(RADIUS_M, 0.0)
    for row, name in enumerate(names):
        profile = boost_profile(name)
        least = 1.01 * profile.minimum_range_m
        most = min(profile.maximum_range_m, 1.5e7) / 1.01
        range_m = np.exp(np.log(least) + drawn[row, 0] * (np.log(most) - np.log(least)))
        latitude, longitude = np.degrees([site.latitude_rad[row], site.longitude_rad[row]])
        end = sphere.Direct(latitude, longitude, 360.0 * drawn[row, 1], range_m)
        # The distance of the two end points, by the haversine of their angle.
        other = np.radians(end["lat2"]), np.radians(end["lon2"])
        north = aim.latitude_rad[row] - other[0]
        east = aim.longitude_rad[row] - other[1]
        haversine = (
            np.sin(0.5 * north) ** 2
            + np.cos(aim.latitude_rad[row]) * np.cos(other[0]) * np.sin(0.5 * east) ** 2
        )
        assert 2.0 * RADIUS_M * np.arcsin(np.sqrt(haversine)) < 1.0
    assert np.all(aim.height_m == 0.0)


def test_aim_points_have_low_discrepancy() -> None:
    site, aim, names = aims_of(low_discrepancy_points(POINTS, 2))
    profiles = [boost_profile(name) for name in names]
    turned = Rotation.from_euler("zy", np.stack([-site.longitude_rad, site.latitude_rad], axis=1))
    cosine = np.cos(aim.latitude_rad)
    toward = np.stack(
        [
            cosine * np.cos(aim.longitude_rad),
            cosine * np.sin(aim.longitude_rad),
            np.sin(aim.latitude_rad),
        ]
    )
    up, east, north = turned.apply(toward.T).T
    range_m = RADIUS_M * np.arctan2(np.hypot(east, north), up)
    least = 1.01 * np.array([profile.minimum_range_m for profile in profiles])
    most = np.minimum([profile.maximum_range_m for profile in profiles], 1.5e7) / 1.01
    assert_even(np.remainder(np.arctan2(east, north) / (2.0 * np.pi), 1.0))
    assert_even(np.log(range_m / least) / np.log(most / least))


def boosts_of(name: str, count: int) -> tuple[Geodetic, Array, Any]:
    """Return sites, draws and boosts of launches of one of the core's classes."""
    kind = core_target_class(name)
    flights, _ = synthetic_looks.flights_of([kind])
    drawn = low_discrepancy_points(count, 5)
    _, site = synthetic_looks.sites(GEOSTATIONARY_M, drawn[:, :3])
    return site, drawn, synthetic_looks.boosts(site, list(flights) * count, drawn[:, 3:5])


def test_orbital_launches_burn_out_near_their_orbit() -> None:
    _, _, path = boosts_of("SLV", 50)
    position, velocity = path.state(np.arange(50), path.burnout_s)
    radius_m = np.linalg.norm(position, axis=1)
    assert np.all(np.abs(radius_m - 6.371e6 - 200e3) < 30e3)
    assert np.all(np.abs(np.sum(position * velocity, axis=1) / radius_m) < 150.0)
    assert path.burnout_s == pytest.approx(
        np.full(50, core_target_class("SLV").profiles[0].burn_time_s)
    )


def test_gliders_have_the_speeds_that_their_glides_take() -> None:
    site, drawn, path = boosts_of("HGV", 40)
    kind = core_target_class("HGV")
    glide = kind.after_burnout
    assert isinstance(glide, EquilibriumGlide)
    range_m = synthetic_looks._ranges_m([kind.profiles[0]] * 40, drawn[:, 3])
    columns = (glide.lift_to_drag, glide.final_speed_m_s, glide.scale_height_m)
    shape = GlideShape(*(np.full(40, value) for value in columns))
    east = Geodesic.WGS84
    ends = [
        east.Direct(*np.degrees([latitude, longitude]), 90.0, distance)
        for latitude, longitude, distance in zip(
            site.latitude_rad, site.longitude_rad, range_m, strict=True
        )
    ]
    aim = Geodetic(
        *(np.radians([end[name] for end in ends]) for name in ("lat2", "lon2")), np.zeros(40)
    )
    flight = glide_flight(site, aim, np.zeros(40), [kind.profiles[0]] * 40, shape)
    flown = np.array([not words for words in flight.complaints])
    assert flown.sum() > 20
    # The range of the boost and of the fall is not that of the glide.
    assert np.all(
        np.abs(path.burnout_speed_m_s / flight.path.burnout_speed_m_s - 1.0)[flown] < 0.15
    )


def test_classes_share_flights_that_are_the_same() -> None:
    flights, numbers = synthetic_looks.flights_of(
        [core_target_class("IRBM"), core_target_class("MRBM")]
    )
    assert [flight.profile.name for flight in flights] == ["MRBM", "IRBM"]
    assert numbers == [[0, 1], [0]]
