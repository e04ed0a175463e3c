"""Fleets by pattern against published constellations and closed forms of continuous coverage.

The largest distance of any point of the sphere from its nearest satellite is that of a vertex of
the spherical Voronoi diagram: the angle of a facet of the convex hull of the satellites. Sources:
A. H. Ballard, Rosette Constellations of Earth Satellites, IEEE Trans. AES-16 (1980), 656-673, table
I; W. S. Adams and L. Rider, Circular Polar Constellations Providing Continuous Single or Multiple
Coverage Above a Specified Latitude, J. Astronaut. Sci. 35 (1987), 155-192.
"""

import math

import numpy as np
import pytest
from opir_coverage import CoverageSettings, computed_coverage
from scipy.spatial import ConvexHull

from opir_core import compile_plan, scene_from_mapping

MU = 3.986004418e14
EARTH_M = 6_378_137.0


def scene(*fleets, **more):
    block = {
        "model": "generic-scanner",
        "field_of_regard_half_angle_deg": 90.0,
        "solar_exclusion_deg": 0.0,
        **more,
    }
    sensors = [{**block, "fleet": fleet} for fleet in fleets]
    return scene_from_mapping(
        {
            "scene": "pattern",
            "epoch": "2016-11-21T00:00:00Z",
            "duration_s": 100,
            "sensors": sensors,
            "targets": [],
        }
    )


def walker(total, planes, phasing, inclination_deg, **more):
    pattern = {
        "total": total,
        "planes": planes,
        "phasing": phasing,
        "inclination_deg": inclination_deg,
    }
    return {
        "walker": {
            **pattern,
            **({"altitude_km": 10_000.0} | more if "period_min" not in more else more),
        }
    }


def circle_deg(fleet, instants=3601):
    """Return the largest distance of a point from its nearest satellite over an orbit, degrees."""
    sensors = compile_plan(scene(fleet)).sensors
    radius_m = float(np.linalg.norm(sensors[0].orbit.position_ecef_m(np.zeros(1))))
    time_s = np.linspace(0.0, 2.0 * math.pi * math.sqrt(radius_m**3 / MU), instants)
    unit = np.stack([sensor.orbit.position_ecef_m(time_s) for sensor in sensors]) / radius_m
    nearest = [-ConvexHull(unit[:, step]).equations[:, 3].max() for step in range(instants)]
    return math.degrees(math.acos(min(nearest)))


@pytest.mark.parametrize(
    ("satellites", "harmonic", "inclination_deg", "published_deg"),
    [
        (5, 1, 43.66, 69.15),
        (6, 4, 53.13, 66.42),
        (7, 5, 55.69, 60.26),
        (8, 6, 61.86, 56.52),
        (9, 7, 70.54, 54.81),
    ],
)
def test_rosettes_have_the_published_circle_of_coverage(
    satellites, harmonic, inclination_deg, published_deg
):
    fleet = walker(satellites, satellites, harmonic, inclination_deg)
    assert circle_deg(fleet) == pytest.approx(published_deg, abs=0.01)


@pytest.mark.parametrize(("spare_deg", "is_whole"), [(0.6, True), (-3.0, False)])
def test_five_satellites_cover_the_earth_from_the_published_height_on(spare_deg, is_whole):
    height_km = 1e-3 * EARTH_M * (1.0 / math.cos(math.radians(69.15 + spare_deg)) - 1.0)
    settings = CoverageSettings(target_class=None, heights_km=(0.0,), grid_deg=5.0, steps=96)
    result = computed_coverage(scene(walker(5, 5, 1, 43.66, altitude_km=height_km)), settings)
    assert (result["in_view"].values.min() >= 1) == is_whole


@pytest.mark.parametrize(("planes", "in_plane"), [(6, 11), (4, 7)])
def test_polar_streets_of_coverage_close_at_the_angle_of_adams_and_rider(planes, in_plane):
    """cos R = cos c cos(pi/S), and planes that move together are c + R apart, the two that do not 2
    c.
    """
    half_rad = np.linspace(0.01, 1.2, 100_001)
    circle_rad = np.arccos(np.cos(half_rad) * math.cos(math.pi / in_plane))
    own = np.argmin(np.abs((planes - 1) * (half_rad + circle_rad) + 2.0 * half_rad - math.pi))
    street_deg, radius_deg = np.degrees([half_rad[own], circle_rad[own]])
    # Satellites of the next plane are half a place ahead: P / 2 units of 360/T.
    spaced = {"kind": "star", "node_spacing_deg": street_deg + radius_deg}
    fleet = walker(planes * in_plane, planes, planes // 2, 90.0, **spaced)
    assert circle_deg(fleet, instants=721) == pytest.approx(radius_deg, abs=0.05)


def test_iridium_needs_its_published_spacing_of_31_6_degrees():
    """86.4 deg, 66/6/2, 780 km, 8.2 deg of elevation; nodes spread evenly would leave a gap at the
    seam.
    """
    settings = CoverageSettings(
        target_class=None, heights_km=(0.0,), grid_deg=3.0, hours=1.675, steps=20
    )
    covered = {}
    for spacing_deg in (31.6, 30.0):
        fleet = walker(66, 6, 2, 86.4, kind="star", node_spacing_deg=spacing_deg, altitude_km=780.0)
        result = computed_coverage(scene(fleet, minimum_elevation_deg=8.2), settings)
        covered[spacing_deg] = result["in_view_min"].values.min()
    assert covered == {31.6: 1, 30.0: 0}


def test_galileo_is_the_published_24_3_1():
    """The Galileo reference constellation, 14 h 4 min 42 s, slot by slot from its formula and its
    slot A1.
    """
    fleet = walker(
        24, 3, 1, 56.0, period_min=844.7, raan_deg=317.632, arg_latitude_deg=180.153, prefix="GAL"
    )
    orbits = [sensor.model.config.orbit.circular for sensor in scene(fleet).sensors]
    assert orbits[0].altitude_km + 6378.137 == pytest.approx(29_600.318, abs=0.5)
    for number, orbit in enumerate(orbits):
        plane, slot = divmod(number, 8)
        assert orbit.raan_deg == pytest.approx((317.632 + 120.0 * plane) % 360.0)
        assert orbit.arg_latitude_deg == pytest.approx(
            (180.153 + 45.0 * slot + 15.0 * plane) % 360.0
        )


@pytest.mark.parametrize(
    ("period_min", "axis_km"),
    [(0.5 * 86_164.0905 / 60.0, 26_559.7), (86_164.0905 * 8.0 / 17.0 / 60.0, 25_508.2)],
    ids=["GPS: half a sidereal day", "GLONASS: 17 orbits in 8 sidereal days"],
)
def test_heights_of_published_periods(period_min, axis_km):
    (orbit,) = [
        sensor.model.config.orbit.circular
        for sensor in scene(walker(1, 1, 0, 55.0, period_min=period_min)).sensors
    ]
    assert orbit.altitude_km + 6378.137 == pytest.approx(axis_km, abs=3.0)


@pytest.mark.parametrize("kind", ["delta", "star"])
def test_satellites_fly_as_those_of_the_orbit_of_a_single_walker_satellite(kind):
    pattern = {
        "total": 12,
        "planes": 4,
        "phasing": 3,
        "altitude_km": 1200.0,
        "inclination_deg": 60.0,
        "kind": kind,
    }
    angles = {"raan_deg": 200.0, "arg_latitude_deg": 300.0}
    blocks = [
        {
            "model": "generic-scanner",
            "id": f"S{number}",
            "orbit": {"walker": {**pattern, **angles, "satellite": number}},
        }
        for number in range(1, 13)
    ]
    mapping = {
        "scene": "x",
        "epoch": "2016-11-21T00:00:00Z",
        "duration_s": 100,
        "sensors": blocks,
        "targets": [],
    }
    singles = compile_plan(scene_from_mapping(mapping)).sensors
    time_s = np.array([0.0, 3000.0])
    for sensor, single in zip(
        compile_plan(scene({"walker": {**pattern, **angles}})).sensors, singles, strict=True
    ):
        apart_m = sensor.orbit.position_ecef_m(time_s) - single.orbit.position_ecef_m(time_s)
        assert np.abs(apart_m).max() < 0.01


@pytest.mark.parametrize("phasing", [1, 5, 9])
def test_a_phasing_of_as_many_more_as_there_are_planes_is_the_same_pattern(phasing):
    time_s = np.array([500.0])
    result = [
        np.concatenate(
            [sensor.orbit.position_ecef_m(time_s) for sensor in compile_plan(scene(fleet)).sensors]
        )
        for fleet in (walker(12, 4, 1, 60.0), walker(12, 4, phasing, 60.0))
    ]
    one, other = (np.round(each[np.lexsort(np.round(each, 0).T)], 1) for each in result)
    np.testing.assert_allclose(one, other, atol=0.2)


def test_a_ring_of_slots_is_evenly_spread():
    plan = compile_plan(scene({"slots": {"count": 3, "first_deg": 100.0}}))
    place_m = np.concatenate([sensor.orbit.position_ecef_m(np.zeros(1)) for sensor in plan.sensors])
    np.testing.assert_allclose(
        np.degrees(np.arctan2(place_m[:, 1], place_m[:, 0])), [100.0, -140.0, -20.0]
    )
    assert all(sensor.orbit.is_stationary for sensor in plan.sensors)
