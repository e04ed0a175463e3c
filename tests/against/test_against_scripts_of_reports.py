"""Times to reports and bounds at burnout against enumeration, simulation and a script of their
own.
"""

import itertools
import math

import numpy as np
import pytest
from opir_coverage.bounds import BiasInformation, LaunchInformation, LaunchSlopes, burnout_bounds
from opir_coverage.grid import PlaceGrid
from opir_coverage.launches import LaunchPlaces
from opir_coverage.reports import ReportChain, Reports, ScanSteps
from scipy.special import ndtri

from opir_core import compile_plan, scene_from_mapping
from opir_core.geometry import geodetic_to_ecef
from opir_core.scene import core_target_class


@pytest.mark.parametrize(("needed", "scans"), [(1, 1), (2, 2), (2, 3), (3, 4)])
def test_reports_are_those_of_all_sequences_of_looks(needed, scans):
    """Every sequence of nine looks, with its probability; a look is reported that is the M-th hit
    among N.
    """
    chances = np.random.default_rng(2).uniform(0.05, 0.9, 9)
    expected = np.zeros(4)
    for hits in itertools.product((0, 1), repeat=9):
        likely = math.prod(p if hit else 1.0 - p for hit, p in zip(hits, chances, strict=True))
        reports = sum(
            hits[k] and sum(hits[max(0, k - scans + 1) : k + 1]) >= needed for k in range(9)
        )
        if reports < 4:
            expected[reports] += likely
    chain = ReportChain(2, 1, (needed, scans), 4)
    for chance in chances:
        chain.look(np.full(len(chain.active), chance))
    assert np.allclose(chain.total[:, 0], expected, atol=1e-12)


def test_phases_of_slow_scans_are_averaged():
    """A look every 10 s from a random start, P_d 0.6: the chance of a report by t is a mean of
    geometric ones.
    """
    steps = ScanSteps.of(10.0, 60.0)
    assert (steps.phases, steps.step_s, steps.steps) == (5, 2.0, 30)
    reports = Reports(np.linspace(0.0, 70.0, 141), 1, 1)
    nodes = np.full((7, 1), ndtri(0.6))
    reports.add(np.arange(1), ReportChain(1, 5, (1, 1), 1), nodes, steps, 3.0)
    rng = np.random.default_rng(3)
    first_s = rng.uniform(0.0, 10.0, 200_000) + 10.0 * (rng.geometric(0.6, 200_000) - 1)
    first_s = np.where(first_s < 60.0, first_s, np.inf) + 3.0
    for time_s in (5.0, 11.0, 20.0, 40.0):
        result = 1.0 - reports.chance[np.searchsorted(reports.time_s, time_s), 0, 0]
        assert result == pytest.approx(np.mean(first_s <= time_s), abs=0.01)
    assert reports.times_s(1, 0.9)[0] == pytest.approx(np.quantile(first_s, 0.9), abs=0.3)


def path_m(profile, latitude, longitude, azimuth, speed, angle, since_s):
    """Return the position of a launch by stepping through speed and flight path angle, on a sphere
    that osculates.
    """
    sine = math.sin(latitude)
    e2 = 0.00669437999014
    normal = 6378137.0 / math.sqrt(1.0 - e2 * sine * sine)
    meridian = normal * (1.0 - e2) / (1.0 - e2 * sine * sine)
    radius = 1.0 / (math.cos(azimuth) ** 2 / meridian + math.sin(azimuth) ** 2 / normal)
    t = np.linspace(0.0, since_s, 4001)
    u = np.clip(
        (t - profile.pitch_start_s) / (profile.burn_time_s - profile.pitch_start_s), 0.0, None
    )
    k = profile.speed_shape
    v = speed * np.expm1(k * t / profile.burn_time_s) / math.expm1(k)
    gamma = 0.5 * math.pi + (angle - 0.5 * math.pi) * np.sin(
        0.5 * math.pi * u**profile.pitch_exponent
    )
    climb = np.concatenate(
        [
            [0.0],
            np.cumsum(
                0.5 * (v * np.sin(gamma))[1:] * np.diff(t)
                + 0.5 * (v * np.sin(gamma))[:-1] * np.diff(t)
            ),
        ]
    )
    rate = v * np.cos(gamma) / (radius + climb)
    swept = np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))
    up = np.array(
        [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), sine]
    )
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    heading = math.sin(azimuth) * east + math.cos(azimuth) * np.cross(up, east)
    launch = np.asarray(geodetic_to_ecef(latitude, longitude, 0.0))
    return (
        launch
        + (radius + climb[-1]) * (math.cos(swept) * up + math.sin(swept) * heading)
        - radius * up
    )


def test_bounds_are_those_of_a_script_with_numeric_derivatives():
    """Positions are integrated in steps, their derivatives taken by differences, angles measured
    along two axes.
    """
    profile = core_target_class("ICBM").profiles[0]
    latitude = math.radians(41.0)
    longitude = math.radians(-105.0)
    azimuth = 0.4
    sigma = 2e-5
    bias = 1e-5
    sensors = [
        np.array([4.2164e7 * math.cos(a), 4.2164e7 * math.sin(a), 0.0])
        for a in np.radians([-135.0, -70.0])
    ]
    times_s = np.linspace(15.0, profile.burn_time_s, 12)
    base = np.zeros(6)
    speed = profile.burnout_speed_m_s
    angle = profile.burnout_flight_path_angle_rad
    steps = np.array([1e-5, 1e-5, 1e-2, 1e-4, 1.0, 1e-4])

    def position(off, time_s):
        slope_rows = (
            latitude + off[0],
            longitude + off[1],
            azimuth + off[3],
            speed + off[4],
            angle + off[5],
        )
        return path_m(profile, *slope_rows, min(time_s - off[2], profile.burn_time_s))

    information = np.zeros((6 + 4, 6 + 4))
    for number, sensor in enumerate(sensors):
        for time_s in times_s - 0.5:
            way = position(base, time_s) - sensor
            range_m = np.linalg.norm(way)
            side = np.cross(way, [0.0, 0.0, 1.0])
            side /= np.linalg.norm(side)
            other = np.cross(way / range_m, side)
            slopes = np.array(
                [
                    (position(s * e, time_s) - position(-s * e, time_s)) / (2 * s)
                    for s, e in zip(steps, np.eye(6), strict=True)
                ]
            )
            rows = np.zeros((2, 10))
            rows[:, :6] = np.stack([slopes @ side, slopes @ other]) / range_m
            rows[0, 6 + 2 * number] = 1.0
            rows[1, 7 + 2 * number] = 1.0
            information += rows.T @ rows / sigma**2
    information[range(6, 10), range(6, 10)] += 1.0 / bias**2
    covariance = np.linalg.inv(information)
    e2 = 0.00669437999014
    sine = math.sin(latitude)
    normal = 6378137.0 / math.sqrt(1.0 - e2 * sine * sine)
    meridian = normal * (1.0 - e2) / (1.0 - e2 * sine * sine)
    launch_m = math.sqrt(
        covariance[0, 0] * meridian**2 + covariance[1, 1] * (normal * math.cos(latitude)) ** 2
    )

    kind = core_target_class("ICBM")
    places = LaunchPlaces(np.array([latitude]), np.array([longitude]), kind, profile, azimuth)
    slopes = LaunchSlopes.of(places)
    slope_rows = [slopes.at(time_s) for time_s in times_s - 0.5]
    known = LaunchInformation(slope_rows)
    for sensor in sensors:
        pointing = BiasInformation(1)
        for step, time_s in enumerate(times_s - 0.5):
            way = sensor - position(base, time_s)
            range_m = np.linalg.norm(way)
            measured = (way / range_m)[None], np.array([range_m]), np.array([1.0 / sigma**2])
            known.add(step, np.arange(1), *measured)
            pointing.add(np.arange(1), slope_rows[step], *measured)
        known.lose(pointing, bias)
    bounds = burnout_bounds(slopes.at_burnout(), known.covariance(), comes_down=True)
    assert bounds.launch_m[0] == pytest.approx(launch_m, rel=0.01)

    def velocity(off):
        slope_rows = (
            latitude + off[0],
            longitude + off[1],
            azimuth + off[3],
            speed + off[4],
            angle + off[5],
        )
        end = profile.burn_time_s
        return (path_m(profile, *slope_rows, end) - path_m(profile, *slope_rows, end - 0.01)) / 0.01

    turned = np.array(
        [
            (velocity(s * e) - velocity(-s * e)) / (2 * s)
            for s, e in zip(steps, np.eye(6), strict=True)
        ]
    )
    turned[2] = 0.0
    spread = math.sqrt(np.trace(turned.T @ covariance[:6, :6] @ turned))
    assert bounds.velocity_m_s[0] == pytest.approx(spread, rel=0.02)
    assert bounds.impact_m[0] > bounds.launch_m[0]


def test_the_profile_of_a_class_is_flown_from_every_cell():
    plan = compile_plan(
        scene_from_mapping(
            {
                "scene": "one",
                "epoch": "2026-06-21T00:00:00Z",
                "duration_s": 100.0,
                "seed": 1,
                "sensors": [{"model": "generic-scanner", "id": "G", "orbital_slot_deg": 0.0}],
                "targets": [],
            }
        )
    )
    assert plan.sensors
    kind = core_target_class("SRBM")
    places = LaunchPlaces.of(PlaceGrid.of(30.0), kind, 0.0)
    path = places.path(0.0)
    result = path.state(np.zeros(1, dtype=np.int32), np.array([kind.profiles[0].burn_time_s]))[0][0]
    profile = kind.profiles[0]
    expected = path_m(
        profile,
        places.latitude_rad[0],
        places.longitude_rad[0],
        0.0,
        profile.burnout_speed_m_s,
        profile.burnout_flight_path_angle_rad,
        profile.burn_time_s,
    )
    assert np.linalg.norm(result - expected) < 2.0
