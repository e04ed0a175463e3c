"""The tracker `kepler-arc`: its arcs against closed forms and SciPy, and the paper's law of its
sigma.
"""

import numpy as np
import pytest
from opir_estimation import LinesOfSight
from opir_testing.doubles import stub_sensor
from opir_trackers.arc import fit as arc_fit
from opir_trackers.arc.ends import impacts, latency_s, launches, states_at, trajectory_parameters
from opir_trackers.arc.fit import ArcFits, AssumedHeights
from opir_trackers.arc.range_types import type_probabilities
from opir_trackers.sensors import SensorSchedule
from scipy.optimize import least_squares

from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.flight import propagate_kepler
from opir_core.flight.conic_impact import kepler_impact
from opir_core.geometry import ecef_to_eci, ecef_to_geodetic, eci_to_ecef, geodetic_to_ecef
from opir_core.geometry.occlusion import intersection_with_ellipsoid
from opir_core.geometry.sphere import great_circle_m

SLOTS_DEG = np.array([-150.0, -90.0])
SIGMA_RAD = 2e-5
#: A state 100 km over 35° N 120° W, inertial at scene time 30 s: up and to the west, 5.6 km/s.
START_S = 30.0


def start_state():
    place = ecef_to_eci(geodetic_to_ecef(np.radians(35.0), np.radians(-120.0), 100e3), START_S)
    up = place / np.linalg.norm(place)
    west = -np.cross([0.0, 0.0, 1.0], up) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], up))
    return np.concatenate([place, 3000.0 * up + 4700.0 * west])


def true_position(time_s):
    state = start_state()
    return eci_to_ecef(propagate_kepler(state[:3], state[3:], time_s - START_S)[0], time_s)


def rays_at(time_s, sensor, noise=None, light_time=True):
    """Return rays of sensors (n,) at times (n,) at the arc, free of noise unless stated
    otherwise.
    """
    longitude = np.radians(SLOTS_DEG)[sensor]
    origin = 4.2164e7 * np.stack([np.cos(longitude), np.sin(longitude), 0.0 * longitude], axis=1)
    left_s = time_s
    for _ in range(4 if light_time else 0):
        left_s = (
            time_s - np.linalg.norm(true_position(left_s) - origin, axis=1) / SPEED_OF_LIGHT_M_S
        )
    line = true_position(left_s) - origin
    unit = line / np.linalg.norm(line, axis=1)[:, None]
    if noise is not None:
        unit = unit + SIGMA_RAD * noise.normal(size=unit.shape)
        unit /= np.linalg.norm(unit, axis=1)[:, None]
    scan = np.arange(len(time_s), dtype=np.int64)
    return LinesOfSight(
        time_s, sensor.astype(np.int32), scan, origin, unit, np.full(len(time_s), SIGMA_RAD)
    )


def both(times):
    """Return the times of two sensors' looks, a tenth of a second apart, and which sensor's they
    are.
    """
    return np.stack([times, times + 0.1], axis=1).ravel(), np.tile([0, 1], len(times))


def begun(rays, climb_m_s2=15.0, light_time=True, launch_s=0.0):
    owner = np.zeros(len(rays), dtype=np.int64)
    arcs = ArcFits.unfitted(np.zeros(1, dtype=np.int64), 2)
    heights = AssumedHeights(np.full(1, launch_s), climb_m_s2)
    return arc_fit.initialised(arcs, rays, owner, heights, light_time)


def followed(arcs, rays):
    """Return one arc after more rays."""
    owner = np.zeros(len(rays), dtype=np.int64)
    return arc_fit.updated(arcs, rays, owner, AssumedHeights(np.zeros(1), 15.0), True)


def true_impact():
    state = start_state()
    flight_s, point = kepler_impact(state[:3], state[3:])
    place = ecef_to_geodetic(eci_to_ecef(point, START_S + flight_s))
    return np.array([place.latitude_rad, place.longitude_rad, START_S + flight_s])


def assert_hits(arcs):
    """The impact is the true one to 1e-6 of the 3700 km flown and of the 700 s of flight."""
    found = impacts(arcs)[0]
    true = true_impact()
    range_m = float(
        great_circle_m(np.array([[np.radians(35.0), np.radians(-120.0), 0.0]]), true[None])[0]
    )
    assert range_m > 3e6
    assert great_circle_m(found[None], true[None])[0] < 1e-6 * range_m
    assert abs(found[2] - true[2]) < 1e-6 * (true[2] - START_S)


@pytest.mark.parametrize("light_time", [True, False])
def test_noise_free_detections_of_an_arc_give_its_impact(light_time):
    time_s, sensor = both(np.arange(31.0, 91.0, 1.0))
    assert_hits(begun(rays_at(time_s, sensor, light_time=light_time), light_time=light_time))


def test_three_detections_are_enough():
    arcs = begun(rays_at(np.array([31.0, 51.0, 71.0, 71.0]), np.array([0, 1, 0, 1])))
    assert_hits(arcs)
    assert_hits(begun(rays_at(np.array([31.0, 61.0, 91.0]), np.array([0, 1, 0]))))


def test_two_detections_make_no_arc():
    assert not begun(rays_at(np.array([31.0, 31.5]), np.array([0, 1]))).is_fitted.any()


def test_looks_of_one_instant_make_no_arc():
    assert not begun(rays_at(np.full(4, 31.0), np.array([0, 1, 0, 1]))).is_fitted.any()


def test_an_arc_that_is_followed_is_the_arc_of_all_its_rays():
    time_s, sensor = both(np.arange(31.0, 91.0, 1.0))
    rays = rays_at(time_s, sensor, np.random.default_rng(3))
    whole = begun(rays)
    arcs = begun(rays.take(slice(0, 20)))
    for first in range(20, len(rays), 10):
        part = rays.take(slice(first, first + 10))
        arcs = followed(arcs, part)
    at = np.array([91.0])
    apart = states_at(arcs, at)[0] - states_at(whole, at)[0]
    sigma = np.sqrt(np.diagonal(states_at(whole, at)[1], axis1=1, axis2=2))
    # Each ray is linearised once, where the arc then stood: that costs less than a hundredth of a
    # sigma.
    assert np.abs(apart / sigma).max() < 0.01
    assert arcs.looks[0] == len(rays)


@pytest.mark.slow
def test_errors_of_an_arc_are_as_its_covariance_says():
    time_s, sensor = both(np.arange(31.0, 91.0, 1.0))
    rng = np.random.default_rng(5)
    at = np.array([60.0])
    truth = true_position(at)[0]
    count = 200
    sight = rays_at(time_s, sensor)
    rays = LinesOfSight.concatenate([rays_at(time_s, sensor, rng) for _ in range(count)])
    owner = np.repeat(np.arange(count), len(sight))
    heights = AssumedHeights(np.zeros(count), 15.0)
    unfitted = ArcFits.unfitted(np.arange(count), 2)
    arcs = arc_fit.initialised(unfitted, rays, owner, heights, True)
    state, covariance = states_at(arcs, np.repeat(at, count))
    error = state[:, :3] - truth
    squares = np.sum(
        error * np.linalg.solve(covariance[:, :3, :3], error[:, :, None])[:, :, 0], axis=1
    )
    # χ² of 600 degrees, 99.9 %: 494 to 721. The covariance grows with a misfit above 1, so it errs
    # on the large side.
    assert 494.0 / 200 * 0.9 < np.mean(squares) < 721.0 / 200


def test_one_sensors_arc_is_the_least_squares_arc_through_the_heights_assumed():
    time_s = np.arange(31.0, 91.0, 1.0)
    rays = rays_at(time_s, np.zeros(60, dtype=np.int64), light_time=False)
    arcs = begun(rays, climb_m_s2=20.0, light_time=False)
    points = intersection_with_ellipsoid(rays.origin_ecef_m, rays.direction_ecef, 10.0 * time_s**2)
    points = ecef_to_eci(points, time_s)
    distance_m = np.linalg.norm(points - ecef_to_eci(rays.origin_ecef_m, time_s), axis=1)

    def residuals(x):
        path = propagate_kepler(x[:3] * 1e6, x[3:] * 1e3, time_s - time_s[0])[0]
        return ((path - points) / distance_m[:, None]).ravel()

    guess = np.concatenate([points[0] / 1e6, (points[1] - points[0]) / 1e3])
    best = least_squares(residuals, guess, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac").x
    # The weights hold the distance along the ray to the arc here, to the point there: parts in ten
    # thousand.
    assert arcs.state[0, :3] == pytest.approx(best[:3] * 1e6, abs=20.0)
    assert arcs.state[0, 3:] == pytest.approx(best[3:] * 1e3, abs=1.0)


def test_a_second_sensor_ends_the_assumption_of_heights():
    time_s = np.arange(31.0, 91.0, 1.0)
    alone = begun(rays_at(time_s, np.zeros(60, dtype=np.int64)))
    later, sensor = both(np.arange(91.0, 121.0, 1.0))
    rays = rays_at(later, sensor)
    arcs = alone
    for _ in range(3):
        arcs = followed(arcs, rays)
    # What was linearised about the assumed heights stays so: no longer to the metre, but the
    # heights are gone.
    before, after = (
        great_circle_m(impacts(each)[:1], true_impact()[None])[0] for each in (alone, arcs)
    )
    assert after < 1e-3 * before


def test_a_short_memory_follows_what_is_recent():
    time_s, sensor = both(np.arange(31.0, 91.0, 1.0))
    arcs = begun(rays_at(time_s, sensor))
    faded = arcs.discounted(0.5)
    state = states_at(arcs, np.array([60.0]))[1]
    half = states_at(faded, np.array([60.0]))[1]
    assert half == pytest.approx(2.0 * state, rel=1e-6)
    assert arcs.discounted(1.0) is arcs


def test_launches_are_where_first_rays_meet_the_ground():
    places = geodetic_to_ecef(np.radians([35.0, -10.0]), np.radians([-120.0, -100.0]), 0.0)
    longitude = np.radians(SLOTS_DEG)
    origins = 4.2164e7 * np.stack([np.cos(longitude), np.sin(longitude), 0.0 * longitude], axis=1)
    sensors = (
        stub_sensor("A", -150.0, detection_probability={"ICBM": 0.5, "IRBM": 0.5, "SRBM": 0.5}),
        stub_sensor("B", -90.0, detection_probability={"ICBM": 0.8, "IRBM": 0.8, "SRBM": 0.8}),
    )
    watch = SensorSchedule.of(sensors, least=0.01, most=1.0)
    owner = np.array([0, 0, 1, 1])
    sensor = np.array([0, 1, 0, 1])
    line = places[owner] - origins[sensor]
    distance = np.linalg.norm(line, axis=1)
    rays = LinesOfSight(
        np.array([10.0, 10.1, 20.0, 20.1]) + distance / SPEED_OF_LIGHT_M_S,
        sensor.astype(np.int32),
        np.arange(4),
        origins[sensor],
        line / distance[:, None],
        np.full(4, SIGMA_RAD),
    )
    found = launches(rays, owner, 2, watch, True, 100.0)
    assert np.degrees(found.place[:, :2]) == pytest.approx(
        np.array([[35.0, -120.0], [-10.0, -100.0]]), abs=1e-9
    )
    period_s = sensors[0].scan.period_ns * 1e-9
    # The paper's mean latency: T/P, 2 periods at 0.5.
    assert found.place[:, 2] == pytest.approx(np.array([10.0, 20.0]) - 2.0 * period_s, abs=1e-6)
    spread = period_s * np.sqrt(0.5 / 0.25 + 1.0 / 12.0)
    assert np.sqrt(found.covariance[:, 2, 2]) == pytest.approx(np.full(2, spread), rel=1e-6)


def test_launches_err_as_their_covariance_says():
    rng = np.random.default_rng(7)
    count = 2000
    site_m = 800.0
    place = geodetic_to_ecef(np.radians(50.0), np.radians(-120.0), site_m * rng.normal(size=count))
    longitude = np.radians(SLOTS_DEG)
    origins = 4.2164e7 * np.stack([np.cos(longitude), np.sin(longitude), 0.0 * longitude], axis=1)
    line = (place[:, None] - origins).reshape(-1, 3)
    unit = line / np.linalg.norm(line, axis=1)[:, None]
    noisy = unit + SIGMA_RAD * rng.normal(size=(2 * count, 3))
    noisy /= np.linalg.norm(noisy, axis=1)[:, None]
    sensor = np.tile([0, 1], count).astype(np.int32)
    watch = SensorSchedule.of(
        (stub_sensor("A", -150.0), stub_sensor("B", -90.0)), least=0.01, most=1.0
    )
    rays = LinesOfSight(
        np.full(2 * count, 5.0),
        sensor,
        np.arange(2 * count),
        origins[sensor],
        noisy,
        np.full(2 * count, SIGMA_RAD),
    )
    found = launches(rays, np.repeat(np.arange(count), 2), count, watch, True, site_m)
    north = 6.378e6 * (found.place[:, 0] - np.radians(50.0))
    east = 6.378e6 * np.cos(np.radians(50.0)) * (found.place[:, 1] - np.radians(-120.0))
    error = np.stack([east, north], axis=1)
    plane = found.covariance[:, :2, :2]
    squares = np.sum(error * np.linalg.solve(plane, error[:, :, None])[:, :, 0], axis=1)
    # χ² of 4000 degrees over 2000, 99.9 %: 1.855 to 2.151; the sphere taken for the ellipsoid is
    # good to 1 %.
    assert 1.83 < squares.mean() < 2.18


def test_parameters_of_a_shot_are_those_it_was_made_of():
    from opir_core.geometry import local_axes

    place = geodetic_to_ecef(np.radians(20.0), np.radians(70.0), 50e3)
    azimuth = np.radians(300.0)
    angle = np.radians(25.0)
    speed = 6500.0
    local = speed * np.array(
        [np.sin(azimuth) * np.cos(angle), np.cos(azimuth) * np.cos(angle), np.sin(angle)]
    )
    state = np.concatenate([place, local @ local_axes(place)])
    found = trajectory_parameters(state[None])
    assert [float(part[0]) for part in found] == pytest.approx([azimuth, angle, speed], rel=1e-9)


def test_types_follow_from_the_range():
    range_m = np.array([200e3, 3000e3, 9000e3])
    sure = type_probabilities(range_m, np.full(3, 1.0))
    assert sure == pytest.approx(np.eye(4)[[2, 1, 0]])
    # On the edge between two classes each is as likely; an error of the range of 1000 km reaches
    # the next class.
    edge = type_probabilities(np.array([5500e3, 4500e3]), np.array([100e3, 1000e3]))
    assert edge[0] == pytest.approx([0.5, 0.5, 0.0, 0.0], abs=1e-9)
    assert edge[1] == pytest.approx([0.15866, 0.84111, 0.00023, 0.0], abs=1e-5)
    assert type_probabilities(np.array([np.nan]), np.ones(1))[0].tolist() == [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("chance", [0.1, 0.5, 0.9, 1.0])
def test_the_latency_is_of_a_geometric_number_of_scans_at_an_unknown_phase(chance):
    rng = np.random.default_rng(20261202)
    drawn_s = 2.5 * (rng.geometric(chance, 200_000) - rng.uniform(0.0, 1.0, 200_000))
    mean_s, sigma_s = latency_s(SensorSchedule(np.array([2.5]), np.array([[chance, chance]])))
    assert sigma_s == pytest.approx([drawn_s.std()], rel=0.02)
    # The mean is the paper's T/P, half a period above that of an unknown phase.
    assert mean_s == pytest.approx([drawn_s.mean() + 1.25], rel=0.02)
