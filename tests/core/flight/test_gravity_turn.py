"""Staged gravity turns: closed forms of thrust, vertical flight and energy; aims by class; lofts;
rows alone.
"""

import math

import numpy as np
import pytest
from attrs import evolve
from geographiclib.geodesic import Geodesic
from scipy.integrate import quad

from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight import launch_site
from opir_core.flight.dense_output import StepRecorder
from opir_core.flight.staged.flights import staged_flights
from opir_core.flight.staged.gravity_turn import Boosts, burnout
from opir_core.flight.staged.staging import (
    Stage,
    StageColumns,
    Staging,
    staging_for,
    stagings,
    stagings_of_classes,
)
from opir_core.geometry import Geodetic
from opir_core.plugin import TARGET_TYPES
from opir_core.scene import core_target_class

NO_AIR = 1e15


def flown(names, lat, lon, bearing, range_m, loft=0.0):
    """Return the flights of stagings by name, and their aim points as (latitude, longitude),
    degrees.
    """
    n = len(names)
    columns = (lat, lon, bearing, range_m, loft)
    lat, lon, *way, loft = (np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v in columns)
    ends = [Geodesic.WGS84.Direct(*row) for row in zip(lat, lon, *way, strict=True)]
    aims = [(end["lat2"], end["lon2"]) for end in ends]
    zero = np.zeros(n)
    launch = Geodetic(np.radians(lat), np.radians(lon), zero)
    aim = Geodetic(*np.radians(np.array(aims)).T, zero)
    return staged_flights(launch, aim, zero, [stagings()[name] for name in names], loft, zero), aims


def place(position):
    """Return latitude and longitude, degrees, of a point on the ellipsoid."""
    e2 = (1 / 298.257223563) * (2 - 1 / 298.257223563)
    x, y, z = position
    return math.degrees(math.atan2(z, (1 - e2) * math.hypot(x, y))), math.degrees(math.atan2(y, x))


@pytest.mark.parametrize("growth", [0.5, 1.0, 1.0 + 1e-12, 3.0])
def test_a_burn_gains_its_ideal_speed_and_grows_as_asked(growth):
    columns = StageColumns.of([Staging("s", (Stage(60.0, 3000.0, growth),), 5.0, 10.0, 2.0, 1e4)])

    def thrust(t):
        return columns.acceleration_m_s2(0, np.array([t]))[0]

    gained = quad(thrust, 0.0, 58.0, epsabs=1e-10)[0] + 0.5 * 2.0 * thrust(58.0)
    assert gained == pytest.approx(3000.0, abs=1e-6)
    assert thrust(60.0) / thrust(0.0) == pytest.approx(growth, rel=2e-9)


def test_stages_are_joined_and_taken_in_order():
    short, long = (StageColumns.of([stagings()[name]]) for name in ("SRBM", "SRBM_long"))
    columns = StageColumns.concatenate([short, long]).take(np.array([1, 0]))
    expected = StageColumns.of([stagings()["SRBM_long"], stagings()["SRBM"]])
    np.testing.assert_array_equal(columns.burn_time_s, expected.burn_time_s)
    np.testing.assert_array_equal(columns.q, expected.q)


def recorded(staging, lat_deg, kick_rad):
    """Return the arcs of one boost, and its time of burnout."""
    boosts = Boosts.of(launch_site(math.radians(lat_deg), 0.3, 0.0), [staging], "kepler")
    recorder = StepRecorder()
    cut_off_s = staging.latest_cut_off_s
    columns = (np.array([value]) for value in (0.7, kick_rad, cut_off_s, 1.0))
    burnout(boosts, *columns, recorder, np.array([0]))
    return recorder.arcs(1), cut_off_s + staging.tail_off_s


@pytest.mark.parametrize("name", ["SRBM", "IRBM", "ICBM_solid"])
def test_vertical_flight_without_air_obeys_the_rocket_equation(name):
    # At a pole the rotation of the Earth has no effect: a zero kick is flight along the axis.
    staging = evolve(stagings()[name], ballistic_coefficient_kg_m2=NO_AIR)
    arcs, burnout_s = recorded(staging, 90.0, 0.0)
    grid, weight = np.polynomial.legendre.leggauss(40)
    edges = np.linspace(0.0, burnout_s, 41)
    half = 0.5 * np.diff(edges)[:, None]
    times = edges[:-1, None] + half * (1.0 + grid)
    position, _ = arcs.state(0, times)
    loss = np.sum(EARTH_MU_M3_S2 / position[..., 2] ** 2 * weight * half)
    _, velocity = arcs.state(0, burnout_s)
    ideal = sum(stage.ideal_speed_m_s for stage in staging.stages)
    assert velocity[2] == pytest.approx(ideal - loss, abs=1e-4)
    assert np.abs(velocity[:2]).max() < 1e-6


def test_drag_of_a_vertical_flight_costs_speed_by_its_integral():
    staging = stagings()["SRBM"]
    arcs, burnout_s = recorded(staging, 90.0, 0.0)
    times = np.linspace(0.0, burnout_s, 40001)
    position, velocity = arcs.state(0, times)
    density = 1.225 * np.exp(-(position[:, 2] - position[0, 2]) / 7500.0)
    air = density * velocity[:, 2] ** 2 / (2 * staging.ballistic_coefficient_kg_m2)
    loss = np.trapezoid(EARTH_MU_M3_S2 / position[:, 2] ** 2 + air, times)
    assert np.trapezoid(air, times) > 10.0
    assert velocity[-1, 2] == pytest.approx(staging.stages[0].ideal_speed_m_s - loss, abs=1e-3)


def inertial_energy(position, velocity):
    carried = velocity + EARTH_ROTATION_RAD_S * np.stack(
        [-position[:, 1], position[:, 0], np.zeros(len(position))], 1
    )
    return 0.5 * np.sum(carried**2, axis=1) - EARTH_MU_M3_S2 / np.linalg.norm(position, axis=1)


def test_energy_is_conserved_in_dark_gaps_and_grows_in_burns():
    staging = evolve(stagings()["ICBM_solid"], ballistic_coefficient_kg_m2=NO_AIR)
    arcs, _ = recorded(staging, 35.0, 0.4)
    boost, second = staging.stages[:2]
    gap = boost.burn_time_s + np.linspace(0.0, boost.gap_s, 9)
    energy = inertial_energy(*arcs.state(0, gap))
    assert np.ptp(energy) < 1e-9 * abs(energy[0])
    burn = gap[-1] + np.linspace(0.0, second.burn_time_s, 9)
    assert (np.diff(inertial_energy(*arcs.state(0, burn))) > 0.0).all()


def test_every_class_has_stagings_for_all_of_its_ranges():
    assert set(TARGET_TYPES) <= set(stagings_of_classes())
    for kind, presets in stagings_of_classes().items():
        limits = [(p.minimum_range_m, p.maximum_range_m) for p in core_target_class(kind).profiles]
        for range_m in np.linspace(np.min(limits), np.max(limits), 40):
            staging = staging_for(presets, range_m)
            assert staging.minimum_range_m <= range_m <= staging.maximum_range_m, (kind, range_m)
    assert [staging.fault() for staging in stagings().values()] == [""] * len(stagings())


def drawn_aims(name, n, seed):
    """Return flights to aims anywhere in the ranges of a staging, at any place and bearing, and the
    aims.

    Every other flight has a loft, of up to a half.
    """
    random = np.random.default_rng(seed)
    low, high = stagings()[name].minimum_range_m, stagings()[name].maximum_range_m
    range_m = low + random.uniform(0.0, 1.0, n) * (high - low)
    lat = np.degrees(np.arcsin(random.uniform(-0.9, 0.9, n)))
    lon = random.uniform(-180.0, 180.0, n)
    bearing = random.uniform(0.0, 360.0, n)
    loft = random.uniform(-0.5, 0.5, n)
    return flown([name] * n, lat, lon, bearing, range_m, loft * (np.arange(n) % 2))


@pytest.mark.slow
@pytest.mark.parametrize("name", stagings())
def test_flights_of_every_preset_come_down_at_their_aims(name):
    """With 60 flights of each preset, half of them lofted, a fault in one of twenty is found at 95
    %.
    """
    flights, aims = drawn_aims(name, 60, 17)
    assert flights.is_solved.all()
    for row, aim in enumerate(aims):
        assert Geodesic.WGS84.Inverse(*aim, *place(flights.impact_ecef_m[row]))["s12"] < 10.0
    assert (flights.miss_m < 10.0).all()
    assert (flights.cut_off_s >= flights.earliest_s).all()
    assert (flights.cut_off_s <= flights.latest_s).all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "range_m"), [("SRBM_long", 600e3), ("ICBM_solid", 9500e3)])
def test_the_loft_is_around_the_kick_of_the_earliest_cut_off(name, range_m):
    lofts = np.array([-1.0, -0.6, -0.1, 0.0, 0.1, 0.6, 1.0])
    flights, _ = flown([name] * 7, 40.0, 60.0, 50.0, range_m, loft=lofts)
    assert flights.is_solved.all()
    assert (np.diff(flights.kick_rad) < 0.0).all()
    delay_s = flights.cut_off_s - flights.cut_off_s[3]
    assert (delay_s[[0, 1, 2, 4, 5, 6]] > 0.0).all()
    assert delay_s[1] > delay_s[2]
    assert delay_s[5] > delay_s[4]
    assert (np.diff(flights.impact_s - flights.burnout_s) > 0.0).all()
    up, along = (
        vectors / np.linalg.norm(vectors, axis=1)[:, None]
        for vectors in (flights.burnout_position_ecef_m, flights.burnout_velocity_ecef_m_s)
    )
    assert (np.diff(np.sum(up * along, axis=1)) > 0.0).all()


@pytest.mark.slow
def test_aims_out_of_reach_are_not_solved():
    flights, _ = flown(["SRBM", "IRBM"], 10.0, 0.0, 90.0, [900e3, 4000e3])
    assert flights.is_solved.tolist() == [False, True]
    range_m = flights.farthest_m[0] * np.array([0.99, 1.02])
    assert flown(["SRBM"] * 2, 10.0, 0.0, 90.0, range_m)[0].is_solved.tolist() == [True, False]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "range_m"), [("ICBM_solid", 1500e3), ("ICBM_liquid", 1063e3)])
def test_near_aims_are_reached_by_steep_flights(name, range_m):
    """They are nearer than the earliest cut-off flies."""
    flights, _ = flown([name] * 4, 10.0, 0.0, 90.0, range_m, loft=[0.0, 0.1, 0.5, 1.0])
    assert (flights.nearest_m > range_m).all()
    assert flights.is_solved.all()
    assert (flights.miss_m < 10.0).all()
    assert flights.cut_off_s[0] == flights.earliest_s[0]
    assert flights.cut_off_s[3] == pytest.approx(flights.latest_s[3], abs=1e-6)
    assert (np.diff(flights.impact_s) > 0.0).all()


@pytest.mark.slow
def test_a_flight_has_the_same_bits_in_any_company():
    names = ["SRBM", "ICBM_solid", "IRBM", "ICBM_solid"]
    lats = [10.0, 40.0, -20.0, 5.0]
    ranges_m = [200e3, 9e6, 4e6, 7e6]
    together, _ = flown(names, lats, 0.0, 90.0, ranges_m, loft=[0, 0.3, 0, 0])
    alone, _ = flown(["ICBM_solid"], 40.0, 0.0, 90.0, 9e6, loft=0.3)
    times = np.linspace(0.0, float(alone.burnout_s[0]), 50)
    assert alone.burnout_s[0] == together.burnout_s[1]
    target = np.zeros(50, dtype=int)
    np.testing.assert_array_equal(alone.state(target, times), together.state(target + 1, times))


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        ((Stage(60.0, 6000.0, 3.0),), "stage 1 reaches 185"),
        ((Stage(100.0, 900.0, 1.0),), "no lift-off"),
        ((Stage(60.0, 3000.0, 2.0), Stage(0.5, 10.0, 1.0)), "no longer than its tail-off"),
        ((Stage(20.0, 1000.0, 1.0),), "no longer than rise"),
    ],
)
def test_stages_that_cannot_be_flown_are_named(stages, words):
    fault = evolve(stagings()["ICBM_solid"], stages=stages).fault()
    assert words in fault


def test_a_first_burn_must_outlast_rise_pitch_over_and_tail_off() -> None:
    staging = evolve(
        stagings()["ICBM_solid"], vertical_rise_s=4.0, pitch_over_s=16.0, tail_off_s=0.5
    )
    at_once, longer = ((Stage(burn_s, 1000.0, 1.0),) for burn_s in (20.5, 20.5 + 2.0**-40))
    assert (
        "no longer than rise, pitch-over and tail-off together (20.5 s)"
        in evolve(staging, stages=at_once).fault()
    )
    assert "no longer than rise" not in evolve(staging, stages=longer).fault()
