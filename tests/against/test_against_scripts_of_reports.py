"""Times to reports and bounds at burnout against enumeration, simulation and a script of their
own.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from opir_coverage.bounds import BiasInformation, LaunchInformation, LaunchSlopes, burnout_bounds
from opir_coverage.grid import PlaceGrid
from opir_coverage.launches import LaunchPlaces
from opir_coverage.reports import ReportChain, Reports, ScanSteps
from scipy.special import ndtri

from opir_core.geometry import geodetic_to_ecef
from opir_core.scene import core_target_class

ECCENTRICITY_SQUARED = 0.00669437999014


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


def radii_of_curvature_m(latitude):
    """Return the radii of curvature of WGS 84 at a latitude: of the meridian, and across it."""
    root = 1.0 - ECCENTRICITY_SQUARED * math.sin(latitude) ** 2
    normal = 6378137.0 / math.sqrt(root)
    return normal * (1.0 - ECCENTRICITY_SQUARED) / root, normal


class Ascent(NamedTuple):
    """A launch: its place and azimuth, rad, and speed, m/s, and flight path angle, rad, at
    burnout.
    """

    latitude: float
    longitude: float
    azimuth: float
    speed_m_s: float
    angle_rad: float


def trapezoids(rate, time_s):
    return 0.5 * (rate[1:] + rate[:-1]) * np.diff(time_s)


def path_m(profile, ascent, since_s):
    """Return the position of a launch by stepping through speed and flight path angle, on a sphere
    that osculates.
    """
    latitude, longitude, azimuth = ascent[:3]
    meridian, normal = radii_of_curvature_m(latitude)
    radius = 1.0 / (math.cos(azimuth) ** 2 / meridian + math.sin(azimuth) ** 2 / normal)
    time_s = np.linspace(0.0, since_s, 4001)
    turn_s = profile.burn_time_s - profile.pitch_start_s
    share = np.clip((time_s - profile.pitch_start_s) / turn_s, 0.0, None)
    shape = profile.speed_shape
    growth = np.expm1(shape * time_s / profile.burn_time_s) / math.expm1(shape)
    speed_m_s = ascent.speed_m_s * growth
    over = np.sin(0.5 * math.pi * share**profile.pitch_exponent)
    gamma = 0.5 * math.pi + (ascent.angle_rad - 0.5 * math.pi) * over
    climb = np.append(0.0, np.cumsum(trapezoids(speed_m_s * np.sin(gamma), time_s)))
    swept = np.sum(trapezoids(speed_m_s * np.cos(gamma) / (radius + climb), time_s))
    level = np.array([math.cos(longitude), math.sin(longitude)]) * math.cos(latitude)
    up = np.append(level, math.sin(latitude))
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    heading = math.sin(azimuth) * east + math.cos(azimuth) * np.cross(up, east)
    launch = np.asarray(geodetic_to_ecef(latitude, longitude, 0.0))
    outward = math.cos(swept) * up + math.sin(swept) * heading
    return launch + (radius + climb[-1]) * outward - radius * up


class Watched(NamedTuple):
    """Looks of `sensors` (ECEF positions, m) at `times_s` at a launch of a profile, with noise and
    bias, rad.
    """

    profile: Any
    ascent: Ascent
    sensors: tuple[np.ndarray, ...]
    times_s: np.ndarray
    sigma: float
    bias: float

    def place(self, off, time_s):
        """Return the position with latitude, longitude, ignition, azimuth, speed and angle off."""
        ascent = Ascent(*np.add(self.ascent, np.delete(off, 2)))
        return path_m(self.profile, ascent, min(time_s - off[2], self.profile.burn_time_s))

    def velocity(self, off):
        """Return the velocity at burnout, by a difference."""
        ascent = Ascent(*np.add(self.ascent, np.delete(off, 2)))
        end_s = self.profile.burn_time_s
        return (
            path_m(self.profile, ascent, end_s) - path_m(self.profile, ascent, end_s - 0.01)
        ) / 0.01


def slopes_of(function):
    """Return the central differences (6, 3) of a function of what is off."""
    steps = np.diag([1e-5, 1e-5, 1e-2, 1e-4, 1.0, 1e-4])
    return np.array([(function(step) - function(-step)) / (2.0 * step.sum()) for step in steps])


def scripted_covariance(watched):
    """Return the covariance (6, 6) of what is off: angles along two axes, biases eliminated."""
    information = np.zeros((6 + 4, 6 + 4))
    for number, sensor in enumerate(watched.sensors):
        for time_s in watched.times_s:
            way = watched.place(np.zeros(6), time_s) - sensor
            range_m = np.linalg.norm(way)
            side = np.cross(way, [0.0, 0.0, 1.0])
            side /= np.linalg.norm(side)
            other = np.cross(way / range_m, side)
            slopes = slopes_of(lambda off, time_s=time_s: watched.place(off, time_s))
            rows = np.zeros((2, 10))
            rows[:, :6] = np.stack([slopes @ side, slopes @ other]) / range_m
            rows[0, 6 + 2 * number] = 1.0
            rows[1, 7 + 2 * number] = 1.0
            information += rows.T @ rows / watched.sigma**2
    information[range(6, 10), range(6, 10)] += 1.0 / watched.bias**2
    return np.linalg.inv(information)[:6, :6]


def bounds_of(watched):
    """Return the bounds at burnout of opir."""
    kind = core_target_class("ICBM")
    latitude, longitude, azimuth = watched.ascent[:3]
    places = LaunchPlaces(
        np.array([latitude]), np.array([longitude]), kind, watched.profile, azimuth
    )
    slopes = LaunchSlopes.of(places)
    slope_rows = [slopes.at(time_s) for time_s in watched.times_s]
    known = LaunchInformation(slope_rows)
    for sensor in watched.sensors:
        pointing = BiasInformation(1)
        for step, time_s in enumerate(watched.times_s):
            way = sensor - watched.place(np.zeros(6), time_s)
            range_m = np.linalg.norm(way)
            weight = np.array([1.0 / watched.sigma**2])
            measured = (way / range_m)[None], np.array([range_m]), weight
            known.add(step, np.arange(1), *measured)
            pointing.add(np.arange(1), slope_rows[step], *measured)
        known.lose(pointing, watched.bias)
    return burnout_bounds(slopes.at_burnout(), known.covariance(), comes_down=True)


def test_bounds_are_those_of_a_script_with_numeric_derivatives():
    """Positions are integrated in steps, their derivatives taken by differences, angles measured
    along two axes.
    """
    profile = core_target_class("ICBM").profiles[0]
    ascent = Ascent(
        math.radians(41.0),
        math.radians(-105.0),
        0.4,
        profile.burnout_speed_m_s,
        profile.burnout_flight_path_angle_rad,
    )
    slots = np.radians([-135.0, -70.0])
    sensors = tuple(4.2164e7 * np.array([math.cos(a), math.sin(a), 0.0]) for a in slots)
    times_s = np.linspace(15.0, profile.burn_time_s, 12) - 0.5
    watched = Watched(profile, ascent, sensors, times_s, 2e-5, 1e-5)
    covariance = scripted_covariance(watched)
    meridian, normal = radii_of_curvature_m(ascent.latitude)
    level = normal * math.cos(ascent.latitude)
    launch_m = math.sqrt(covariance[0, 0] * meridian**2 + covariance[1, 1] * level**2)
    bounds = bounds_of(watched)
    assert bounds.launch_m[0] == pytest.approx(launch_m, rel=0.01)
    turned = slopes_of(watched.velocity)
    turned[2] = 0.0
    spread = math.sqrt(np.trace(turned.T @ covariance @ turned))
    assert bounds.velocity_m_s[0] == pytest.approx(spread, rel=0.02)
    assert bounds.impact_m[0] > bounds.launch_m[0]


def test_the_profile_of_a_class_is_flown_from_every_cell():
    kind = core_target_class("SRBM")
    places = LaunchPlaces.of(PlaceGrid.of(30.0), kind, 0.0)
    path = places.path(0.0)
    result = path.state(np.zeros(1, dtype=np.int32), np.array([kind.profiles[0].burn_time_s]))[0][0]
    profile = kind.profiles[0]
    ascent = Ascent(
        places.latitude_rad[0],
        places.longitude_rad[0],
        0.0,
        profile.burnout_speed_m_s,
        profile.burnout_flight_path_angle_rad,
    )
    expected = path_m(profile, ascent, profile.burn_time_s)
    assert np.linalg.norm(result - expected) < 2.0
