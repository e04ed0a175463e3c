"""Coverage of launch places against numpy scripts of their own, closed forms and published
constellations.

Nothing here calls `opir_coverage`'s own tests of visibility: lines of sight are cut with the
ellipsoid as quadratic equations, nadir and elevation are angles between vectors, gaps follow from
the motion on circles.
"""

import math

import numpy as np
import pytest
from opir_coverage import CoverageSettings, computed_coverage, dilution_m, stereo_angles_rad
from opir_coverage.grid import PlaceGrid, SeenPoints
from opir_coverage.visibility import Fleet, SightMap, day_s

from opir_core import compile_plan, scene_from_mapping

A_M = 6378137.0
F = 1.0 / 298.257223563
B_M = A_M * (1.0 - F)
MU = 3.986004418e14
SPIN = 7.292115e-5


def scene(sensors, **more):
    return scene_from_mapping(
        {
            "scene": "globe",
            "epoch": "2026-06-21T00:00:00Z",
            "duration_s": 100.0,
            "seed": 1,
            "sensors": sensors,
            "targets": [],
            **more,
        }
    )


def walker(total, planes, phasing, altitude_km, inclination_deg, **more):
    """Return blocks of scanners with a whole hemisphere in their fields."""
    pattern = {"total": total, "planes": planes, "phasing": phasing, "altitude_km": altitude_km}
    orbit = {**pattern, "inclination_deg": inclination_deg, "raan_deg": 0.0}
    block = {
        "model": "generic-scanner",
        "field_of_regard_half_angle_deg": 90.0,
        "solar_exclusion_deg": 0.0,
        **more,
    }
    return [
        {**block, "id": f"W{k}", "orbit": {"walker": {**orbit, "satellite": k}}}
        for k in range(1, total + 1)
    ]


def places(step_deg, height_m):
    """Return positions and verticals (n, 3) of the centres of cells, row by row."""
    latitude = np.radians(np.arange(-90.0 + step_deg / 2, 90.0, step_deg))[:, None]
    longitude = np.radians(np.arange(-180.0 + step_deg / 2, 180.0, step_deg))[None, :]
    up = np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ),
        axis=-1,
    )
    radius = A_M / np.sqrt(1.0 - F * (2.0 - F) * np.sin(latitude) ** 2)
    stretched = up * np.array([1.0, 1.0, (1.0 - F) ** 2]) * radius[..., None]
    return (stretched + height_m * up).reshape(-1, 3), up.reshape(-1, 3)


def is_seen(sensor_m, half_rad, least_rad, point_m, up):
    """Return who is seen: the roots of the line of sight and the ellipsoid, and angles by
    arccos.
    """
    way = sensor_m - point_m
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    elevation = np.arcsin(np.sum(unit * up, axis=1))
    nadir = np.arccos(np.sum(-unit * -sensor_m / np.linalg.norm(sensor_m), axis=1))
    axes = np.array([A_M, A_M, B_M])
    p = point_m / axes
    d = way / axes
    a = np.sum(d * d, axis=1)
    b = np.sum(p * d, axis=1)
    c = np.sum(p * p, axis=1) - 1.0
    inside = b * b - a * c
    distance = (-b - np.sqrt(np.maximum(inside, 0.0))) / a
    is_hit = (inside > 0.0) & (distance > 0.0) & (distance < 1.0)
    clear = np.where(elevation > 0.0, True, ~is_hit & (c > 1e-12))
    return clear & (nadir < half_rad) & (elevation > least_rad)


@pytest.mark.parametrize("height_km", [0.0, 10.0, 100.0, 900.0])
def test_every_cell_is_seen_as_by_a_script(height_km):
    heo = [
        {"model": "HEO", "id": f"H{k}", "orbit": {"molniya": {"apogee_lon_deg": k * 120.0}}}
        for k in range(2)
    ]
    fleet = [{"model": "DSP", "id": "D", "orbital_slot_deg": -75.0}, *heo]
    fleet += walker(
        6, 3, 1, 1200.0, 60.0, field_of_regard_half_angle_deg=55.0, minimum_elevation_deg=5.0
    )
    plan = compile_plan(scene(fleet))
    time_s = day_s(12)
    result = SightMap.of(
        Fleet.of(plan, time_s), SeenPoints.above(PlaceGrid.of(2.0), 1e3 * height_km)
    )
    point_m, up = places(2.0, 1e3 * height_km)
    for number, sensor in enumerate(plan.sensors):
        orbit_m = sensor.orbit.position_ecef_m(time_s)
        for step in range(len(time_s)):
            least = sensor.minimum_elevation_rad, sensor.solar_exclusion_rad
            expected = is_seen(
                orbit_m[step], sensor.field_of_regard_half_angle_rad, least[0], point_m, up
            )
            position = result.at(step)[number]
            # A sensor that avoids the Sun may see less.
            assert np.array_equal(position, expected) or (
                least[1] > 0.0 and not np.any(position & ~expected)
            )


def test_a_geostationary_satellite_sees_the_cap_of_the_closed_form():
    """Half of 1 - cos 81.30°, 42.44 % of a sphere."""
    plan = compile_plan(scene([{"model": "generic-scanner", "id": "G", "orbital_slot_deg": 0.0}]))
    grid = PlaceGrid.of(1.0)
    visible = SightMap.of(Fleet.of(plan, np.zeros(1)), SeenPoints.above(grid, 0.0)).at(0)[0]
    radius_m = (MU / SPIN**2) ** (1.0 / 3.0)
    assert 100.0 * grid.weights()[visible].sum() == pytest.approx(
        50.0 * (1.0 - 6371008.8 / radius_m), abs=0.15
    )


@pytest.mark.parametrize(
    ("pattern", "inclination_deg", "reach_deg"),
    [
        ((5, 5, 1), 43.66, 69.15),
        ((6, 6, 4), 53.13, 66.42),
        ((7, 7, 5), 55.69, 60.26),
        ((9, 9, 7), 70.54, 54.81),
    ],
)
def test_rosettes_cover_the_globe_just_from_the_published_height(
    pattern, inclination_deg, reach_deg
):
    """A. H. Ballard, Rosette Constellations of Earth Satellites, IEEE Trans. AES-16 (1980) 656,
    table of best rosettes.

    Its figures are as recalled, for the paper was not at hand; what holds them is that they are met
    between two bounds. With the central angle that is needed between satellites and the farthest
    place every place is always in view; with a degree and a half less some are not, at times.
    """
    gaps = {}
    for off_deg in (0.4, -1.5):
        altitude_km = 6378.137 / math.cos(math.radians(reach_deg + off_deg)) - 6378.137
        settings = CoverageSettings(
            target_class=None, heights_km=(0.0,), grid_deg=5.0, steps=240, assets=(1,)
        )
        result = computed_coverage(scene(walker(*pattern, altitude_km, inclination_deg)), settings)
        gaps[off_deg] = float(np.asarray(result["gaps"].values).sum())
    assert gaps[0.4] == 0.0
    assert gaps[-1.5] > 0.0


@pytest.mark.parametrize("total", [1, 4])
def test_gaps_under_an_equatorial_ring_are_those_of_the_closed_form(total):
    """The satellites pass every 2π/(n - ω)/N, and are in view for 2 acos(R/r)/(n - ω)."""
    altitude_m = 1.2e6
    steps = 2880
    rate = math.sqrt(MU / (A_M + altitude_m) ** 3) - SPIN
    passes_s = 2.0 * math.pi / rate / total
    view_s = 2.0 * math.acos(A_M / (A_M + altitude_m)) / rate
    settings = CoverageSettings(
        target_class=None, heights_km=(0.0,), grid_deg=0.5, steps=steps, assets=(1,)
    )
    plan = compile_plan(scene(walker(total, total, 0, altitude_m * 1e-3, 0.0)))
    time_s = day_s(steps)
    grid = PlaceGrid.of(0.5)
    points = SeenPoints.above(grid, 0.0)
    row = len(grid.latitude_deg) // 2 * grid.shape[1]
    equator = SeenPoints.of(points.position_m[row : row + 60])
    covered = SightMap.of(Fleet.of(plan, time_s), equator).in_view() > 0
    from opir_coverage import ages_of_data_s, response_times_s, runs, time_average_gap_s

    step_s = 86400.0 / settings.steps
    access = runs(covered, step_s)
    gap = runs(~covered, step_s)
    gap_s = passes_s - view_s
    # Gaps and accesses at the ends of the day are cut; those between are as long as the closed
    # form, to a step.
    assert np.max(np.abs(gap.most_s - gap_s)) <= step_s
    assert np.max(np.abs(access.most_s - view_s)) <= step_s
    assert np.max(np.abs(access.number - 86400.0 / passes_s)) <= 1.5
    assert np.mean(time_average_gap_s(gap, 86400.0)) == pytest.approx(gap_s**2 / passes_s, rel=0.05)
    assert np.mean(response_times_s(covered, step_s)) == pytest.approx(
        0.5 * gap_s**2 / passes_s, rel=0.05
    )
    assert np.nanmean(ages_of_data_s(covered, step_s)) == pytest.approx(
        0.5 * gap_s**2 / passes_s, rel=0.05
    )


@pytest.mark.parametrize("angle_deg", [10.0, 60.0, 90.0, 150.0])
def test_two_lines_of_sight_have_the_dilution_of_the_closed_form(angle_deg):
    """Eigenvalues of the information are 2, 1 - cos β and 1 + cos β over r²: √(1/2 + 2/sin² β)
    r.
    """
    angle = math.radians(angle_deg)
    range_m = 3.7e7
    line = np.array([0.6, 0.0, 0.8])
    second = math.cos(angle) * line + math.sin(angle) * np.array([0.0, 1.0, 0.0])
    direction = np.stack([line, second])[:, None, :]
    visible = np.ones((2, 1), dtype=np.bool_)
    expected = range_m * math.sqrt(0.5 + 2.0 / math.sin(angle) ** 2)
    assert dilution_m(direction, np.full((2, 1), range_m), visible)[0] == pytest.approx(
        expected, rel=1e-12
    )
    assert math.degrees(stereo_angles_rad(direction, visible)[0]) == pytest.approx(
        min(angle_deg, 180.0 - angle_deg)
    )
    alone = visible & np.array([[True], [False]])
    assert np.isnan(dilution_m(direction, np.full((2, 1), range_m), alone)[0])


def test_dilution_is_the_spread_of_triangulated_points():
    """Least squares over 4 000 draws of noisy lines of sight."""
    rng = np.random.default_rng(5)
    sensors = rng.normal(size=(4, 3))
    sensors *= (4e7 / np.linalg.norm(sensors, axis=1))[:, None]
    point = np.array([6.4e6, 0.0, 0.0])
    sigma = 1e-5
    way = sensors - point
    range_m = np.linalg.norm(way, axis=1)
    unit = way / range_m[:, None]
    draws = []
    for _ in range(4000):
        noise = rng.normal(scale=sigma, size=unit.shape)
        noisy = unit + noise - unit * np.sum(noise * unit, axis=1, keepdims=True)
        noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
        across = (np.eye(3) - noisy[:, :, None] * noisy[:, None, :]) / range_m[:, None, None] ** 2
        draws.append(
            np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, sensors)) - point
        )
    spread = math.sqrt(np.mean(np.sum(np.square(draws), axis=1)))
    result = dilution_m(unit[:, None, :], range_m[:, None], np.ones((4, 1)))[0]
    assert sigma * result == pytest.approx(spread, rel=0.03)
