"""Sources that move against closed forms, another integrator and published statistics: turns, climbs
and courses of aircraft, falls through the air, orbits, intervals, strokes and durations of lightning.
"""

import numpy as np
import pytest
from infrared_sources import HERE, context
from opir_photons.movers.aircraft import aircraft_sources
from opir_photons.movers.configs import (
    AircraftConfig,
    GrazerConfig,
    LegConfig,
    ReentryConfig,
    SatelliteConfig,
    ShipConfig,
    StormConfig,
)
from opir_photons.movers.courses import ship_sources
from opir_photons.movers.falls import grazer_sources, reentry_sources
from opir_photons.movers.storms import storm_sources
from opir_photons.movers.sunlit import satellite_sources
from opir_photons.radiometry import band_radiance
from pyproj import Geod, Transformer
from scipy.integrate import solve_ivp

GEOD = Geod(ellps="WGS84")
TO_GEODETIC = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
EARTH_RATE = 7.292115e-5


def track(sources, times_s, row=0):
    """Return longitudes, latitudes, deg, and heights, m, of one emitter."""
    rows = np.full(len(times_s), row, np.int32)
    positions = sources.trajectories.position_ecef_m(rows, np.asarray(times_s, float))
    return np.array(TO_GEODETIC.transform(*positions.T))


def jet(*legs, **changes):
    place = {**HERE[0], "heading_deg": 30.0, "height_m": 5000.0, "speed_m_s": 200.0}
    config = AircraftConfig(at=(place,), legs=tuple(LegConfig(**leg) for leg in legs), **changes)
    return aircraft_sources(config, context(duration_s=1000.0))


@pytest.mark.parametrize("bank_deg", [15.0, 45.0, -70.0])
def test_a_turn_has_the_radius_and_the_period_of_its_bank(bank_deg):
    radius_m = 200.0**2 / (9.80665 * np.tan(np.radians(abs(bank_deg))))
    period_s = 2.0 * np.pi * radius_m / 200.0
    sources = jet({"for_s": 2.0 * period_s, "bank_deg": bank_deg})
    times_s = np.linspace(0.0, period_s, 49)
    east, north, _ = track(sources, times_s)
    side = np.sign(bank_deg)
    centre = GEOD.fwd(20.0, 10.0, 30.0 + side * 90.0, radius_m)[:2]
    count = len(times_s)
    distances = GEOD.inv([centre[0]] * count, [centre[1]] * count, east, north)[2]
    assert distances == pytest.approx(radius_m, rel=3e-5)
    assert GEOD.inv(east[0], north[0], east[-1], north[-1])[2] < 2.0
    quarter = GEOD.inv(20.0, 10.0, east[12], north[12])[2]
    assert quarter == pytest.approx(radius_m * np.sqrt(2.0), rel=1e-4)
    bearing = GEOD.inv(20.0, 10.0, east[12], north[12])[0]
    assert bearing == pytest.approx(30.0 + side * 45.0, abs=0.05)


def test_a_straight_course_is_a_geodesic_at_constant_speed_and_height():
    times_s = np.array([0.0, 100.0, 500.0, 1000.0])
    east, north, height = track(jet(), times_s)
    expected = np.array([GEOD.fwd(20.0, 10.0, 30.0, 200.0 * time)[:2] for time in times_s])
    assert np.column_stack([east, north]) == pytest.approx(expected, abs=1e-6)
    assert height == pytest.approx(5000.0, abs=0.05)


def test_a_course_goes_on_where_a_turn_ends():
    radius_m = 200.0**2 / (9.80665 * np.tan(np.radians(30.0)))
    quarter_s = 0.5 * np.pi * radius_m / 200.0
    east, north, _ = track(
        jet({"for_s": 100.0}, {"for_s": quarter_s, "bank_deg": 30.0}),
        100.0 + quarter_s + np.array([0.0, 300.0]),
    )
    course, _, distance_m = GEOD.inv(east[0], north[0], east[1], north[1])
    assert course == pytest.approx(120.0, abs=0.1)
    assert distance_m == pytest.approx(60_000.0, rel=1e-6)


def test_speed_and_climb_follow_constant_accelerations():
    sources = jet(
        {"for_s": 20.0, "acceleration_m_s2": 4.0},
        {"for_s": 60.0, "climb_m_s": 100.0},
        pull_m_s2=5.0,
    )
    east, north, height = track(sources, [20.0, 40.0, 80.0, 120.0, 130.0])
    assert GEOD.inv(20.0, 10.0, east[0], north[0])[2] == pytest.approx(4800.0, abs=0.05)
    # 280 m/s; up with 5 m/s² to 100 m/s in 20 s, 40 s on, and back to level in 20 s.
    steps = GEOD.inv(east[:-1], north[:-1], east[1:], north[1:])[2]
    assert steps == pytest.approx([5600.0, 11_200.0, 11_200.0, 2800.0], rel=1e-5)
    assert height == pytest.approx([5000.0, 6000.0, 10_000.0, 11_000.0, 11_000.0], abs=0.1)


def test_afterburners_burn_on_their_legs_only():
    sources = jet({"for_s": 10.0}, {"for_s": 20.0, "afterburner": True}, {"for_s": 10.0})
    row = np.zeros(1, np.int32)
    nose_on = np.zeros(1)

    def light(since_s, aspect_rad=nose_on):
        return float(
            sources.signatures.intensity_w_sr(0, row, np.array([since_s]), nose_on, aspect_rad)[0]
        )

    assert [light(time) for time in (5.0, 35.0, 100.0)] == [0.0, 0.0, 0.0]
    flame = 1.5 * float(band_radiance(2000.0, 2.5, 3.0))
    assert light(15.0) == pytest.approx(flame, rel=1e-12)
    behind = np.full(1, np.pi)
    tailpipe = 0.9 * 0.6 * float(band_radiance(850.0, 2.5, 3.0))
    assert light(5.0, behind) == pytest.approx(tailpipe, rel=1e-12)
    assert sources.signatures.time_breakpoints_s.tolist() == [[10.0, 30.0, 40.0]]


def test_ships_go_as_far_as_their_speed_says_where_they_head_at_random():
    config = ShipConfig(at=HERE * 400, speed_m_s=10.0)
    sources = ship_sources(config, context(duration_s=100.0))
    headings = np.array([row["heading_deg"] for row in sources.trajectories.truth()])
    east, north, _ = np.array([track(sources, [90.0], row)[:, 0] for row in range(20)]).T
    bearing, _, distance = GEOD.inv([20.0] * 20, [10.0] * 20, east, north)
    assert distance == pytest.approx(900.0, abs=0.1)
    assert np.mod(bearing, 360.0) == pytest.approx(headings[:20], abs=0.01)
    quarters = np.bincount((headings // 90.0).astype(int), minlength=4)
    assert np.sum((quarters - 100.0) ** 2 / 100.0) < 16.3  # χ² of 3, once in a thousand


def density(height_m):
    """The U.S. Standard Atmosphere, 1976, below 86 km, kg/m³, from its own definition."""
    layers = [
        (0.0, 288.15, -6.5e-3, 101_325.0),
        (11e3, 216.65, 0.0, 22_632.06),
        (20e3, 216.65, 1e-3, 5_474.889),
        (32e3, 228.65, 2.8e-3, 868.0187),
        (47e3, 270.65, 0.0, 110.9063),
        (51e3, 270.65, -2.8e-3, 66.93887),
        (71e3, 214.65, -2e-3, 3.956420),
    ]
    geopotential = 6_356_766.0 * height_m / (6_356_766.0 + height_m)
    base, temperature, lapse, pressure = [row for row in layers if row[0] <= geopotential][-1]
    rise = geopotential - base
    exponent = 9.80665 * 0.0289644 / 8.31432
    if lapse == 0.0:
        factor = np.exp(-exponent * rise / temperature)
    else:
        factor = (1.0 + lapse * rise / temperature) ** (-exponent / lapse)
    return pressure * factor * 0.0289644 / (8.31432 * (temperature + lapse * rise))


def test_a_body_falls_as_another_integrator_says():
    place = {**HERE[0], "heading_deg": 70.0, "height_m": 80e3, "speed_m_s": 7000.0}
    config = ReentryConfig(at=(place,), descent_deg=3.0, ballistic_coefficient_kg_m2=300.0)
    sources = reentry_sources(config, context(duration_s=400.0))
    times_s = np.array([0.0, 30.0, 60.0, 90.0])
    rows = np.zeros(len(times_s), np.int32)
    positions = sources.trajectories.position_ecef_m(rows, times_s)
    spin = np.array([0.0, 0.0, EARTH_RATE])

    def rates(_time, state):
        position, velocity = state[:3], state[3:]
        radius = np.linalg.norm(position)
        height = TO_GEODETIC.transform(*position)[2]
        z2 = (position[2] / radius) ** 2
        shape = 1.5 * 1.08263e-3 * (6_378_137.0 / radius) ** 2
        factors = 1.0 + shape * np.array([1.0 - 5.0 * z2, 1.0 - 5.0 * z2, 3.0 - 5.0 * z2])
        gravity = -3.986004418e14 / radius**3 * position * factors
        drag = -0.5 * density(height) * np.linalg.norm(velocity) * velocity / 300.0
        turning = -2.0 * np.cross(spin, velocity) - np.cross(spin, np.cross(spin, position))
        return np.concatenate([velocity, gravity + drag + turning])

    start = positions[0]
    velocity = (sources.trajectories.position_ecef_m(rows[:1], np.array([0.01]))[0] - start) / 0.01
    assert np.linalg.norm(velocity) == pytest.approx(7000.0, rel=1e-4)
    flown = solve_ivp(
        rates, (0.0, 90.0), [*start, *velocity], t_eval=times_s, rtol=1e-10, atol=1e-6
    )
    misses = np.linalg.norm(flown.y[:3].T - positions, axis=1)
    assert misses.max() < 20.0
    # It slows down by over 2 km/s on the way: drag is what is compared.
    assert np.linalg.norm(flown.y[3:, -1]) < 5000.0


def test_a_spent_stage_climbs_to_the_height_of_its_energy_before_it_falls():
    place = {**HERE[0], "heading_deg": 0.0, "height_m": 80e3, "speed_m_s": 1500.0}
    config = ReentryConfig(at=(place,), descent_deg=-50.0, ballistic_coefficient_kg_m2=1e5)
    sources = reentry_sources(config, context(duration_s=500.0))
    times_s = np.linspace(0.0, float(sources.trajectories.burnout_s[0]) - 0.01, 2000)
    height = track(sources, times_s)[2]
    # Up to the sphere's second order: v² sin² / 2 of the pull of gravity less that of the curve.
    radius = 6_378_137.0 + 80e3
    across = 1500.0 * np.cos(np.radians(50.0))
    pull = 3.986004418e14 / radius**2 - across**2 / radius
    rise = (1500.0 * np.sin(np.radians(50.0))) ** 2 / (2.0 * pull)
    assert height.max() - 80e3 == pytest.approx(rise, rel=0.02)
    assert height[-1] == pytest.approx(15e3, abs=100.0)


def test_a_falling_body_is_as_hot_as_the_air_makes_it():
    config = ReentryConfig(at=({**HERE[0], "heading_deg": 90.0},))
    sources = reentry_sources(config, context(duration_s=900.0))
    row = np.zeros(1, np.int32)
    trajectories = sources.trajectories
    times_s = np.linspace(0.0, float(trajectories.burnout_s[0]), 400)
    time_s = np.interp([-70e3], -track(sources, times_s)[2], times_s)
    step = trajectories.position_ecef_m(np.zeros(2, np.int32), time_s + np.array([-0.05, 0.05]))
    speed = np.linalg.norm(step[1] - step[0]) / 0.1
    height = track(sources, time_s)[2]
    # Sutton and Graves, and Stefan and Boltzmann with the wall's share of the enthalpy.
    flux = 1.7415e-4 * np.sqrt(density(float(height[0])) / 0.5) * speed**3
    temperature = 1000.0
    for _ in range(200):
        wall = 1.0 - 1100.0 * temperature / (1100.0 * 220.0 + 0.5 * speed**2)
        temperature = (300.0**4 + flux * wall / (0.8 * 5.670374e-8)) ** 0.25
    expected = 0.8 * 2.0 * float(band_radiance(temperature, 2.5, 3.0))
    light = sources.signatures.intensity_w_sr(0, row, time_s, height, np.zeros(1))
    assert temperature > 1200.0
    assert float(light[0]) == pytest.approx(expected, rel=0.01)


def test_a_grazer_is_lowest_and_brightest_at_its_perigee_and_leaves():
    place = {**HERE[0], "heading_deg": 10.0}
    sources = grazer_sources(GrazerConfig(at=(place,), shining_s=100.0), context())
    times_s = np.linspace(0.0, 100.0, 101)
    east, north, height = track(sources, times_s)
    assert height.argmin() == 50
    assert height[50] == pytest.approx(57e3, abs=1.0)
    assert (east[50], north[50]) == pytest.approx((20.0, 10.0), abs=1e-5)
    # A hyperbola leaves the circle of its perigee with v²/r - g, over the rotating Earth.
    radius = 6_378_137.0 + 57e3
    rise = 0.5 * 25.0**2 * (15_000.0**2 / radius - 9.6)
    assert height[75] - 57e3 == pytest.approx(rise, rel=0.05)
    rows = np.zeros(len(times_s), np.int32)
    light = sources.signatures.intensity_w_sr(0, rows, times_s, height, np.zeros(len(rows)))
    assert light.argmax() == 50
    assert light[50] == pytest.approx(30.0 * float(band_radiance(4500.0, 2.5, 3.0)), rel=1e-3)
    assert light[0] < 0.2 * light[50]


def test_a_satellite_goes_round_as_kepler_says_and_into_the_shadow():
    place = {"lat_deg": 0.0, "lon_deg": 20.0, "heading_deg": 90.0, "height_m": 600e3}
    sources = satellite_sources(SatelliteConfig(at=(place,)), context(duration_s=5800.0))
    radius_m = 6_378_137.0 + 600e3
    period_s = 2.0 * np.pi * np.sqrt(radius_m**3 / 3.986004418e14)
    times_s = np.linspace(0.0, 0.98 * period_s, 50)
    rows = np.zeros(len(times_s), np.int32)
    positions = sources.trajectories.position_ecef_m(rows, times_s)
    radii_m = np.linalg.norm(positions, axis=1)
    # At the equator J2 pulls 0.13 % more: the orbit dips by two parts in a thousand and a half.
    assert radii_m == pytest.approx(radius_m, rel=3e-3)
    assert positions[:, 2] == pytest.approx(0.0, abs=1.0)
    turned = np.unwrap(np.arctan2(positions[:, 1], positions[:, 0])) - np.radians(20.0)
    expected = (2.0 * np.pi / period_s - EARTH_RATE) * times_s
    assert turned == pytest.approx(expected, abs=0.03)
    to_sensor = positions / radii_m[:, None]
    aspect = sources.signatures.aspect_rad(rows, times_s, to_sensor)
    columns = (rows, times_s, np.full(len(rows), 600e3), aspect)
    light = sources.signatures.intensity_w_sr(0, *columns)
    own = 0.8 * 10.0 * float(band_radiance(300.0, 2.5, 3.0))
    dark = light < 1.0001 * own
    # The Earth hides the Sun for twice the arcsine of R/r of a turn, within the plane's tilt.
    share = np.arcsin(6_378_137.0 / radius_m) / np.pi
    assert dark.mean() == pytest.approx(share, abs=0.05)
    assert light[~dark].max() > 100.0 * own


@pytest.fixture(scope="module")
def flashes():
    """Return the flashes of a hundred storms in an hour, as columns."""
    config = StormConfig(at=HERE * 100)
    truth = storm_sources(config, context(seed=23, duration_s=3590.0)).trajectories.truth()
    return {name: np.array([row[name] for row in truth]) for name in truth[0] if name != "type"}


def test_storms_flash_three_times_a_minute_at_log_normal_intervals(flashes):
    assert len(flashes["start_s"]) == pytest.approx(100 * 180.0, rel=0.03)
    intervals = np.concatenate(
        [np.diff(flashes["start_s"][flashes["storm"] == storm]) for storm in range(1, 101)]
    )
    # Dennis (1970): log-normal, with a standard deviation of about 1.
    assert np.std(np.log(intervals)) == pytest.approx(1.0, abs=0.03)
    halves = np.array([flashes["start_s"] < 1800.0, flashes["start_s"] >= 1800.0]).mean(axis=1)
    assert halves == pytest.approx([0.5, 0.5], abs=0.01)


def test_strokes_and_durations_are_as_observed(flashes):
    strokes = flashes["strokes"]
    # Poelman et al. (2021): 3.67 strokes; a third of one; several last 371 ms.
    assert strokes.mean() == pytest.approx(3.67, rel=0.02)
    assert np.mean(strokes == 1.0) == pytest.approx(1.0 / 3.0, abs=0.07)
    spans_s = flashes["end_s"] - flashes["start_s"] - 0.04
    assert spans_s[strokes > 1.0].mean() == pytest.approx(0.371, rel=0.03)
    # Zhu et al. (2015): a geometric mean of 62 ms between strokes.
    pairs = spans_s[strokes == 2.0]
    assert np.exp(np.log(pairs).mean()) == pytest.approx(0.062, rel=0.05)


def test_energies_are_as_observed(flashes):
    by_stroke = flashes["energy_j"] / flashes["strokes"]
    assert np.median(by_stroke) == pytest.approx(450e3, rel=0.04)
    # Turman (1977): two flashes in a thousand over a hundred times the typical.
    assert np.mean(by_stroke > 45e6) == pytest.approx(2e-3, rel=0.4)


def test_flashes_are_even_over_the_disc_and_the_heights_of_a_storm(flashes):
    distance = GEOD.inv(
        np.full(len(flashes["lon_deg"]), 20.0),
        np.full(len(flashes["lon_deg"]), 10.0),
        flashes["lon_deg"],
        flashes["lat_deg"],
    )[2]
    assert distance.max() <= 8000.0
    assert np.mean(distance < 4000.0) == pytest.approx(0.25, abs=0.01)
    assert flashes["height_m"].min() >= 6000.0
    assert np.median(flashes["height_m"]) == pytest.approx(10_000.0, rel=0.01)


def test_a_flash_has_its_energy_in_the_band_that_was_measured():
    config = StormConfig(at=HERE, flashes_per_minute=60.0, energy_log_sigma=0.0)
    sources = storm_sources(config, context(duration_s=60.0))
    truth = sources.trajectories.truth()[0]
    light = sources.signatures.intensity_w_sr(
        0, np.zeros(1, np.int32), np.zeros(1), np.zeros(1), np.zeros(1)
    )
    seconds = truth["end_s"] - truth["start_s"]
    share = float(band_radiance(10_000.0, 2.5, 3.0) / band_radiance(10_000.0, 0.4, 1.1))
    expected = truth["strokes"] * 450e3 / seconds / (4.0 * np.pi) * share
    assert float(light[0]) == pytest.approx(expected, rel=1e-12)
