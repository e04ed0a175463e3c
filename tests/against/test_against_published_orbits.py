"""Orbits against published figures and closed forms: Vallado's example, periods, ground tracks,
Molniya's dwell.
"""

import math

import numpy as np
import pytest

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.orbits import (
    CRITICAL_INCLINATION_RAD,
    Elements,
    MolniyaConfig,
    OrbitConfig,
    SlotConfig,
    TundraConfig,
    circular_elements,
    elements_of,
    highly_elliptical_elements,
    orbit_of,
    slot_elements,
)
from opir_core.orbits.elements import mean_anomaly_rad
from opir_core.orbits.orbit_models import MovingOrbit, TwoBodyMotion

#: One rotation of the Earth, s.
DAY_S = 2.0 * math.pi / EARTH_ROTATION_RAD_S


def positions(elements, time_s):
    return MovingOrbit(TwoBodyMotion(elements)).position_ecef_m(time_s)


def longitudes_rad(position):
    return np.arctan2(position[:, 1], position[:, 0])


def test_vallado_example_2_6():
    # Vallado, Fundamentals of Astrodynamics and Applications, example 2-6: elements to position and
    # velocity.
    eccentricity = 0.83285
    elements = Elements(
        semi_major_axis_m=11_067_790.0 / (1.0 - eccentricity**2),
        eccentricity=eccentricity,
        inclination_rad=math.radians(87.87),
        node_longitude_rad=math.radians(227.89),
        argument_of_perigee_rad=math.radians(53.38),
        mean_anomaly_rad=mean_anomaly_rad(math.radians(92.335), eccentricity),
    )
    position, velocity = TwoBodyMotion(elements).state_eci(np.zeros(1))
    assert position[0] * 1e-3 == pytest.approx([6525.344, 6861.535, 6449.125], abs=0.03)
    assert velocity[0] * 1e-3 == pytest.approx([4.902276, 5.533124, -1.975709], abs=2e-5)


@pytest.mark.parametrize(
    ("altitude_km", "period_min"),
    # Wertz and Larson, Space Mission Analysis and Design, 3rd ed., inside rear cover: period of
    # circular orbits.
    [(200.0, 88.49), (500.0, 94.62), (1000.0, 105.12), (35_786.0, 1436.07)],
)
def test_periods_of_circular_orbits(altitude_km, period_min):
    elements = circular_elements(altitude_km * 1e3, 1.0, 0.0)
    assert elements.period_s / 60.0 == pytest.approx(period_min, rel=2e-4)
    eci, _ = TwoBodyMotion(elements).state_eci(
        np.array([0.0, elements.period_s, 100 * elements.period_s])
    )
    assert eci[1:] == pytest.approx(np.broadcast_to(eci[0], (2, 3)), rel=0.0, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("inclination_deg", [0.001, 1.0, 5.0, 15.0, 63.4, 90.0, 120.0])
def test_the_figure_eight_of_an_inclined_slot(inclination_deg):
    # Latitude reaches the inclination; longitude strays by asin(tan²(i/2)) where i < 90 deg.
    inclination = math.radians(inclination_deg)
    elements = slot_elements(0.3, inclination_rad=inclination)
    position = positions(elements, np.linspace(0.0, DAY_S, 20_001))
    latitude = np.arcsin(position[:, 2] / np.linalg.norm(position, axis=1))
    assert latitude.max() == pytest.approx(min(inclination, math.pi - inclination), rel=1e-7)
    assert latitude.min() == pytest.approx(-latitude.max(), rel=1e-9)
    if inclination_deg < 90.0:
        astray = np.remainder(longitudes_rad(position) - 0.3 + np.pi, 2.0 * np.pi) - np.pi
        half_width = math.asin(math.tan(0.5 * inclination) ** 2)
        assert astray.max() == pytest.approx(half_width, rel=1e-6, abs=2e-11)
        assert astray.min() == pytest.approx(-half_width, rel=1e-6, abs=2e-11)


@pytest.mark.parametrize("eccentricity", [0.001, 0.05, 0.3])
def test_the_libration_of_an_eccentric_slot(eccentricity):
    # On the equator the longitude strays from the slot by true less mean anomaly: by 2e at most, to
    # first order; its mean over a day is the slot's.
    elements = slot_elements(-1.2, eccentricity=eccentricity)
    time_s = (np.arange(4000) + 0.5) * DAY_S / 4000
    astray = (
        np.remainder(longitudes_rad(positions(elements, time_s)) + 1.2 + np.pi, 2.0 * np.pi) - np.pi
    )
    assert astray.mean() == pytest.approx(0.0, abs=1e-10)
    # Brouwer and Clemence, Methods of Celestial Mechanics, ch. II: greatest equation of the centre.
    greatest = 2.0 * eccentricity + 11.0 / 48.0 * eccentricity**3 + 599.0 / 5120.0 * eccentricity**5
    assert astray.max() == pytest.approx(greatest, rel=1e-4)


@pytest.mark.parametrize(
    "config", [SlotConfig(lon_deg=-75.0, inclination_deg=1e-9), SlotConfig(lon_deg=285.0)]
)
def test_a_slot_of_hardly_any_inclination_is_ideal(config):
    ideal = orbit_of(OrbitConfig(slot=SlotConfig(lon_deg=-75.0)), 0)
    time_s = np.linspace(-1e5, 1e5, 101)
    near = orbit_of(OrbitConfig(slot=config), 0)
    assert near.position_ecef_m(time_s) == pytest.approx(
        ideal.position_ecef_m(time_s), rel=0.0, abs=3e-3
    )


@pytest.mark.parametrize(
    ("elements", "day_count"),
    [
        (slot_elements(0.5, inclination_rad=0.4, eccentricity=0.1), 1),
        (highly_elliptical_elements(2.0, 0.74, 1.0), 1),
        (highly_elliptical_elements(1.0, 0.27, 1.0), 1),
        (highly_elliptical_elements(1.5, 0.6, 1.0), 2),
    ],
)
def test_ground_tracks_close_after_whole_days(elements, day_count):
    time_s = np.linspace(0.0, DAY_S, 50)
    later = positions(elements, time_s + day_count * DAY_S)
    assert later == pytest.approx(positions(elements, time_s), rel=0.0, abs=3e-3)


def test_molniya_is_where_it_is_known_to_be():
    elements = elements_of(
        OrbitConfig(molniya=MolniyaConfig(apogee_lon_deg=90.0, apogee_time_s=600.0)), 0
    )
    assert elements is not None
    assert elements.semi_major_axis_m == pytest.approx(26_562e3, abs=1e3)
    assert elements.period_s / 60.0 == pytest.approx(718.0, abs=0.1)
    assert math.degrees(CRITICAL_INCLINATION_RAD) == pytest.approx(63.4349, abs=1e-4)
    assert 4.0 - 5.0 * math.sin(elements.inclination_rad) ** 2 == pytest.approx(0.0, abs=1e-15)
    apogees = positions(elements, 600.0 + np.arange(3) * 0.5 * DAY_S)
    assert np.degrees(longitudes_rad(apogees)) % 360.0 == pytest.approx(
        [90.0, 270.0, 90.0], abs=1e-8
    )
    assert np.linalg.norm(apogees, axis=1) == pytest.approx(
        elements.semi_major_axis_m * 1.74, rel=1e-10
    )
    assert np.degrees(np.arcsin(apogees[:, 2] / np.linalg.norm(apogees, axis=1))) == pytest.approx(
        63.4349, abs=1e-4
    )


def test_tundra_dwells_over_one_longitude():
    elements = elements_of(
        OrbitConfig(tundra=TundraConfig(apogee_lon_deg=-95.0, apogee_time_s=-5e3)), 0
    )
    assert elements is not None
    apogees = positions(elements, -5e3 + np.arange(3) * DAY_S)
    assert np.degrees(longitudes_rad(apogees)) == pytest.approx([-95.0] * 3, abs=1e-8)


@pytest.mark.parametrize("argument_of_perigee_rad", [0.0, 0.7, 4.0, 4.9, 1.5 * math.pi])
@pytest.mark.parametrize("inclination_rad", [0.0, 0.4, 1.107, 2.5])
def test_the_apogee_stands_over_its_longitude_whatever_the_perigee(
    inclination_rad, argument_of_perigee_rad
):
    elements = highly_elliptical_elements(
        2.0,
        0.6,
        -2.0,
        3e3,
        inclination_rad=inclination_rad,
        argument_of_perigee_rad=argument_of_perigee_rad,
    )
    apogee = positions(elements, np.array([3e3]))
    assert longitudes_rad(apogee) == pytest.approx([-2.0], abs=1e-9)
    assert np.linalg.norm(apogee) == pytest.approx(elements.apogee_radius_m, rel=1e-10)


@pytest.mark.parametrize(("turns", "eccentricity"), [(2.0, 0.74), (2.0, 0.71), (1.0, 0.27)])
def test_the_share_of_time_spent_in_the_north(turns, eccentricity):
    # North of the equator the true anomaly runs from 90 to 270 deg, the eccentric from acos(e):
    # Kepler's equation.
    elements = highly_elliptical_elements(turns, eccentricity, 0.0)
    eccentric = math.acos(eccentricity)
    share = 1.0 - (eccentric - eccentricity * math.sin(eccentric)) / math.pi
    time_s = (np.arange(40_000) + 0.5) * elements.period_s / 40_000
    north = (positions(elements, time_s)[:, 2] > 0.0).mean()
    assert north == pytest.approx(share, abs=1e-4)
    if eccentricity == 0.74:
        assert share == pytest.approx(0.924, abs=1e-3)


def test_speed_at_perigee_is_that_of_vis_viva():
    elements = highly_elliptical_elements(2.0, 0.74, 0.0)
    position, velocity = TwoBodyMotion(elements).state_eci(np.array([elements.perigee_time_s]))
    radius = float(np.linalg.norm(position))
    speed = float(np.linalg.norm(velocity))
    assert radius == pytest.approx(elements.perigee_radius_m, rel=1e-13)
    assert speed**2 == pytest.approx(
        EARTH_MU_M3_S2 * (2.0 / radius - 1.0 / elements.semi_major_axis_m), rel=1e-13
    )
    assert radius - EARTH_EQUATORIAL_RADIUS_M == pytest.approx(528e3, abs=1e3)
