"""Boost and free flight against scipy's integrator (DOP853): other equations, other steps, other
code for the Earth.

The boost is integrated from the formulas of `class_profiles.json`; the free flight from the aimed
burnout state, down to the aim point, with places by pyproj.
"""

import json
import math
from pathlib import Path

import numpy as np
import pyproj
import pytest
from scipy.integrate import solve_ivp

import opir_core
from opir_core.flight.aiming import aim
from opir_core.flight.boost import ascent, boost_path, boost_profiles, launch_site
from opir_core.geometry import Geodetic

TABLE = json.loads(
    (Path(opir_core.__file__).parent / "data" / "class_profiles.json").read_text(encoding="utf-8")
)
PROFILES = boost_profiles()
MU = 3.986004418e14
WHIRL = 7.292115e-5
GEOD = pyproj.Geod(ellps="WGS84")
TO_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
TO_GEODETIC = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


def integrated_course(row, radius_m, elapsed_s):
    """Return height, m, and swept angle, rad, at times after ignition, from the table's
    formulas.
    """
    burn, start, k, n = (
        row[key] for key in ("burn_time_s", "pitch_start_s", "speed_shape", "pitch_exponent")
    )
    burnout_angle = math.radians(row["burnout_flight_path_angle_deg"])

    def rates(t, state):
        speed = row["burnout_speed_m_s"] * math.expm1(k * t / burn) / math.expm1(k)
        u = min(max((t - start) / (burn - start), 0.0), 1.0)
        gamma = math.pi / 2 + (burnout_angle - math.pi / 2) * math.sin(math.pi / 2 * u**n)
        return [speed * math.sin(gamma), speed * math.cos(gamma) / (radius_m + state[0])]

    options = {"method": "DOP853", "rtol": 1e-12, "atol": [1e-6, 1e-13], "dense_output": True}
    rise = solve_ivp(rates, (0.0, start), [0.0, 0.0], **options)
    turn = solve_ivp(rates, (start, burn), rise.y[:, -1], **options)
    return np.array([(rise if t < start else turn).sol(t) for t in elapsed_s]).T


LATITUDE = 0.55
LONGITUDE = 2.9
HEIGHT_M = 700.0
AZIMUTH = 4.4


def radius_of_curvature_m():
    """Return the radius of curvature of WGS 84 along the azimuth, at the height of the site."""
    flattening = 1 / 298.257223563
    e2 = flattening * (2 - flattening)
    root = 1 - e2 * math.sin(LATITUDE) ** 2
    normal = 6378137.0 / math.sqrt(root) + HEIGHT_M
    meridian = 6378137.0 * (1 - e2) / root**1.5 + HEIGHT_M
    return 1 / (math.cos(AZIMUTH) ** 2 / meridian + math.sin(AZIMUTH) ** 2 / normal)


def places_over_site(radius, height, swept):
    """Return ECEF places (n, 3) over a sphere that osculates at the site, by pyproj."""
    degrees = math.degrees(LONGITUDE), math.degrees(LATITUDE)
    launch, above = (np.array(TO_ECEF.transform(*degrees, HEIGHT_M + h)) for h in (0.0, 1e6))
    up = (above - launch) / 1e6
    east = np.cross([0.0, 0.0, 1.0], up) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], up))
    heading = math.sin(AZIMUTH) * east + math.cos(AZIMUTH) * np.cross(up, east)
    outward = np.cos(swept)[:, None] * up + np.sin(swept)[:, None] * heading
    return launch - radius * up + (radius + height)[:, None] * outward


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_boost_follows_the_formulas_of_the_profile(name):
    profile = PROFILES[name]
    burn_s = np.linspace(0.0, 1.0, 60) * profile.burn_time_s
    elapsed = np.append(burn_s, profile.pitch_start_s + np.logspace(-6, 1, 30))
    radius = radius_of_curvature_m()
    height, swept = integrated_course(TABLE["profiles"][name], radius, elapsed)
    course = ascent([profile], [profile.burnout_flight_path_angle_rad])
    site = launch_site(np.array([LATITUDE]), LONGITUDE, HEIGHT_M)
    path = boost_path(site, 0.0, np.array([AZIMUTH]), np.array([profile.burnout_speed_m_s]), course)
    position, _ = path.state(np.zeros(len(elapsed), dtype=int), elapsed)
    np.testing.assert_allclose(position, places_over_site(radius, height, swept), atol=1e-5)


def pull(_time, state):
    x, y, z, vx, vy, vz = state
    factor = -MU / (x * x + y * y + z * z) ** 1.5
    return [vx, vy, vz, factor * x, factor * y, factor * z]


def place_at(x, y, z, elapsed_s):
    """Return longitude and latitude, deg, and height, m, of an inertial point over the Earth as it
    has turned.
    """
    cosine = math.cos(WHIRL * elapsed_s)
    sine = math.sin(WHIRL * elapsed_s)
    return TO_GEODETIC.transform(cosine * x + sine * y, cosine * y - sine * x, z)


def aimed_cases():
    rng = np.random.default_rng(21)
    for name, profile in sorted(PROFILES.items()):
        for share in (0.01, 0.3, 0.6, 0.99):
            range_m = profile.minimum_range_m + share * (
                profile.maximum_range_m - profile.minimum_range_m
            )
            start = (rng.uniform(-180, 180), math.degrees(math.asin(rng.uniform(-1, 1))))
            yield pytest.param(profile, start, rng.uniform(0, 360), range_m, id=f"{name}-{share}")


@pytest.mark.parametrize(("profile", "start", "bearing_deg", "range_m"), list(aimed_cases()))
def test_free_flight_comes_down_within_a_metre_of_the_aim_point(
    profile, start, bearing_deg, range_m
):
    """The first descent to the aim point's height is found by scipy's event location."""
    launch_height = 120.0
    aim_height = 850.0
    ignition_s = 4321.0
    aim_lon, aim_lat, _ = GEOD.fwd(*start, bearing_deg, range_m)
    launch = Geodetic(np.radians([start[1]]), np.radians([start[0]]), launch_height)
    flight = aim(
        launch,
        Geodetic(np.radians([aim_lat]), np.radians([aim_lon]), aim_height),
        ignition_s,
        [profile],
    )
    assert flight.burnout_s[0] == ignition_s + profile.burn_time_s

    def height(elapsed_s, state):
        return place_at(*state[:3], elapsed_s)[2] - aim_height

    height.terminal = True
    height.direction = -1
    burnout = np.concatenate([flight.burnout_position_eci_m[0], flight.burnout_velocity_eci_m_s[0]])
    arc = solve_ivp(
        pull, (0.0, 6000.0), burnout, method="DOP853", rtol=1e-12, atol=1e-6, events=height
    )
    (elapsed_s,), (state,) = arc.t_events[0], arc.y_events[0]
    lon, lat, _ = place_at(*state[:3], flight.burnout_s[0] + elapsed_s)
    assert GEOD.inv(lon, lat, aim_lon, aim_lat)[2] < 0.05
    assert flight.burnout_s[0] + elapsed_s == pytest.approx(flight.impact_s[0], abs=1e-4)
