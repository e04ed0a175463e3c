"""What holds for every orbit: conserved quantities, bounds, the Earth's symmetry, and independence
of the batch.
"""

import math

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, strategies as st

from examples import examples
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.geometry import ecef_to_eci_state
from opir_core.orbits import (
    CircularConfig,
    Elements,
    GeostationaryOrbit,
    MovingOrbit,
    OrbitConfig,
    SlotConfig,
    circular_elements,
    orbit_of,
)
from opir_core.orbits.orbit_models import FARTHEST_S, KEPT_SPANS, SPAN_S, TwoBodyMotion

angles = st.floats(-6.3, 6.3)
EPOCH_US = 1_775_044_800_000_000


@st.composite
def orbits(draw: st.DrawFn) -> Elements:
    eccentricity = draw(st.one_of(st.floats(0.0, 0.85), st.just(0.0)))
    return Elements(
        semi_major_axis_m=draw(st.floats(6.6e6, 4.3e7)) / (1.0 - eccentricity),
        eccentricity=eccentricity,
        inclination_rad=draw(
            st.one_of(st.floats(0.0, math.pi), st.sampled_from([0.0, math.pi, math.pi / 2]))
        ),
        node_longitude_rad=draw(angles),
        argument_of_perigee_rad=draw(angles),
        mean_anomaly_rad=draw(angles),
    )


def moving(elements: Elements) -> MovingOrbit:
    return MovingOrbit(TwoBodyMotion(elements))


def times(count: int, seed: int, span_s: float = 2e5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-span_s, span_s, count)


@examples(60)
@given(orbits())
def test_energy_and_momentum_stay(elements):
    time_s = times(50, 1)
    position, velocity = ecef_to_eci_state(*TwoBodyMotion(elements).state_ecef(time_s), time_s)
    radius = np.linalg.norm(position, axis=1)
    energy = 0.5 * np.einsum("ij,ij->i", velocity, velocity) - EARTH_MU_M3_S2 / radius
    momentum = np.cross(position, velocity)
    greatest = EARTH_MU_M3_S2 / elements.perigee_radius_m
    assert energy == pytest.approx(
        -0.5 * EARTH_MU_M3_S2 / elements.semi_major_axis_m, rel=0.0, abs=1e-11 * greatest
    )
    semilatus = elements.semi_major_axis_m * (1.0 - elements.eccentricity**2)
    length = math.sqrt(EARTH_MU_M3_S2 * semilatus)
    tilt = elements.inclination_rad
    node = elements.node_longitude_rad
    normal = [math.sin(tilt) * math.sin(node), -math.sin(tilt) * math.cos(node), math.cos(tilt)]
    assert momentum == pytest.approx(np.tile(normal, (50, 1)) * length, rel=0.0, abs=1e-10 * length)


@examples(40)
@given(orbits())
def test_distance_and_latitude_stay_within_their_bounds(elements):
    position = moving(elements).position_ecef_m(times(300, 2, 4e3))
    radius = np.linalg.norm(position, axis=1)
    assert radius.min() >= elements.perigee_radius_m - 1e-3
    assert radius.max() <= elements.apogee_radius_m + 1e-3
    highest = radius * math.sin(elements.inclination_rad)
    assert (np.abs(position[:, 2]) <= highest + 1e-3).all()


@examples(40)
@given(orbits(), st.integers(0, 1000))
def test_polynomials_keep_the_tolerance(elements, seed):
    motion = TwoBodyMotion(elements)
    time_s = times(2000, seed, 6e3)
    miss = np.linalg.norm(
        MovingOrbit(motion).position_ecef_m(time_s) - motion.position_ecef_m(time_s), axis=1
    )
    assert miss.max() <= 1e-3


@examples(30)
@given(orbits(), angles)
def test_turning_the_node_turns_the_orbit_about_the_earths_axis(elements, turn_rad):
    time_s = times(40, 3)
    node = elements.node_longitude_rad + turn_rad
    turned = evolve(elements, node_longitude_rad=node)
    x, y, z = TwoBodyMotion(elements).position_ecef_m(time_s).T
    cosine = math.cos(turn_rad)
    sine = math.sin(turn_rad)
    expected = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
    assert TwoBodyMotion(turned).position_ecef_m(time_s) == pytest.approx(
        expected, rel=0.0, abs=1e-11 * elements.apogee_radius_m
    )


def test_shifting_the_epoch_by_a_sidereal_day_moves_nothing():
    # A mean sidereal day is 86164.090531 s (Explanatory Supplement to the Astronomical Almanac,
    # 1992, section 2.24).
    node = {"inclination_deg": 53.0, "raan_deg": 40.0, "arg_latitude_deg": 10.0}
    config = OrbitConfig(circular=CircularConfig(altitude_km=1200.0, **node))
    position, shifted = (
        orbit_of(config, epoch_us).position_ecef_m(np.zeros(1))
        for epoch_us in (EPOCH_US, EPOCH_US + 86_164_090_531)
    )
    assert shifted == pytest.approx(position, rel=0.0, abs=2e-3)


@examples(25)
@given(orbits(), st.data())
def test_a_position_has_the_same_bits_in_any_batch(elements, data):
    time_s = np.array(data.draw(st.lists(st.floats(-1e5, 1e5), min_size=1, max_size=8)))
    together = moving(elements).position_ecef_m(time_s)
    orbit = moving(elements)
    for row in data.draw(st.permutations(range(len(time_s)))):
        assert orbit.position_ecef_m(time_s[[row]]).tobytes() == together[[row]].tobytes()
    batch = np.concatenate([np.repeat(time_s, 50), times(5000, 4, 2e3)])
    position = moving(elements).position_ecef_m(batch)[: 50 * len(time_s) : 50]
    assert position.tobytes() == together.tobytes()


def test_spans_that_were_forgotten_come_back_the_same():
    orbit = moving(circular_elements(1.2e6, 0.9, 0.1))
    position = orbit.position_ecef_m(np.array([5.0]))
    orbit.position_ecef_m((np.arange(KEPT_SPANS + 5) + 1.5) * SPAN_S)
    assert orbit.position_ecef_m(np.array([5.0])).tobytes() == position.tobytes()


@pytest.mark.parametrize(
    "time_s",
    [0.0, SPAN_S, -SPAN_S, np.nextafter(SPAN_S, 0.0), -1e-300, 1e7, np.nextafter(FARTHEST_S, 0.0)],
)
def test_the_ends_of_spans_have_positions(time_s):
    elements = circular_elements(1.2e6, 0.9, 0.1)
    expected = TwoBodyMotion(elements).position_ecef_m(np.array([time_s]))
    assert moving(elements).position_ecef_m(np.array([time_s])) == pytest.approx(
        expected, rel=0.0, abs=1e-3
    )


def test_times_without_a_position():
    none = np.array([np.nan, np.inf, -np.inf, FARTHEST_S, -FARTHEST_S, -1e300])
    orbit = moving(circular_elements(1.2e6, 0.9, 0.1))
    assert np.isnan(orbit.position_ecef_m(none)).all()
    mixed = orbit.position_ecef_m(np.concatenate([none, [7.0]]))
    assert np.isnan(mixed[:-1]).all()
    assert mixed[-1].tobytes() == orbit.position_ecef_m(np.array([7.0]))[0].tobytes()
    assert orbit.position_ecef_m(np.empty(0)).shape == (0, 3)


def test_continuous_where_spans_meet():
    edge = SPAN_S * 3.0
    times_s = np.array([np.nextafter(edge, 0.0), edge])
    start, end = moving(circular_elements(3e5, 0.9, 0.1)).position_ecef_m(times_s)
    assert start == pytest.approx(end, rel=0.0, abs=1e-6)


def test_a_motion_that_no_polynomial_follows_is_asked_itself():
    class Sawtooth:
        def position_ecef_m(self, time_s):
            return np.stack([np.remainder(time_s * 1e3, 10.0), time_s, time_s], axis=1)

        def state_ecef(self, time_s):
            return self.position_ecef_m(time_s), np.ones((len(time_s), 3))

    time_s = times(200, 5)
    assert np.array_equal(
        MovingOrbit(Sawtooth()).position_ecef_m(time_s), Sawtooth().position_ecef_m(time_s)
    )


def test_a_slot_is_stationary_only_where_it_is():
    assert isinstance(orbit_of(OrbitConfig(slot=SlotConfig(lon_deg=12.0)), 0), GeostationaryOrbit)
    assert orbit_of(OrbitConfig(slot=SlotConfig(lon_deg=12.0)), 0).is_stationary
    for changes in ({"inclination_deg": 1e-3}, {"eccentricity": 1e-6}):
        assert not orbit_of(OrbitConfig(slot=SlotConfig(lon_deg=12.0, **changes)), 0).is_stationary


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"semi_major_axis_m": 0.0}, "above zero"),
        ({"semi_major_axis_m": math.inf}, "finite"),
        ({"eccentricity": 1.0}, r"\[0, 1\)"),
        ({"eccentricity": -1e-9}, r"\[0, 1\)"),
        ({"eccentricity": math.nan}, r"\[0, 1\)"),
        ({"node_longitude_rad": math.nan}, "angles"),
    ],
)
def test_elements_of_no_closed_orbit_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        evolve(circular_elements(6e5, 0.0, 0.0), **changes)


def test_the_earth_turns_below_a_polar_orbit():
    elements = circular_elements(8e5, math.pi / 2, 0.0)
    crossings = moving(elements).position_ecef_m(np.arange(4) * elements.period_s)
    longitudes = np.arctan2(crossings[:, 1], crossings[:, 0])
    assert np.diff(longitudes) == pytest.approx(-EARTH_ROTATION_RAD_S * elements.period_s, rel=1e-9)
