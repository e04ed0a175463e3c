"""Elements and TEME against skyfield: its own elements of a state, its own sidereal time."""

import numpy as np
import pytest
from sgp4_cases import KINDS, TLE, epoch_of
from skyfield.api import load
from skyfield.elementslib import OsculatingElements
from skyfield.sgp4lib import theta_GMST1982
from skyfield.units import Distance, Velocity

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.orbits import (
    Elements,
    OrbitConfig,
    highly_elliptical_elements,
    orbit_of,
    slot_elements,
)
from opir_core.orbits.orbit_models import TwoBodyMotion
from opir_core.orbits.sgp4_motion import Sgp4Motion, satellite_of_tle

MU_KM3_S2 = EARTH_MU_M3_S2 * 1e-9
ORBITS = {
    "slot": slot_elements(1.0, inclination_rad=0.1, eccentricity=0.01, argument_of_perigee_rad=2.0),
    "molniya": highly_elliptical_elements(2.0, 0.74, 1.2, 500.0),
    "tundra": highly_elliptical_elements(1.0, 0.27, -1.7, -4000.0),
    "low": Elements(
        semi_major_axis_m=7.2e6,
        eccentricity=0.002,
        inclination_rad=1.7,
        node_longitude_rad=4.0,
        argument_of_perigee_rad=0.3,
        mean_anomaly_rad=5.0,
    ),
}


def turned(angle):
    """Return the angle's difference from whole turns."""
    return np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi


@pytest.mark.parametrize("elements", ORBITS.values(), ids=ORBITS.keys())
def test_elements_of_our_states_are_the_elements_given(elements):
    time_s = np.array([0.0, 1234.5, 40_000.0])
    position, velocity = TwoBodyMotion(elements).state_eci(time_s)
    time = load.timescale(builtin=True).tt_jd(2461132.0 + time_s / 86400.0)
    result = OsculatingElements(
        Distance(m=position.T), Velocity(km_per_s=velocity.T * 1e-3), time, MU_KM3_S2
    )
    assert result.semi_major_axis.m == pytest.approx(elements.semi_major_axis_m, rel=1e-12)
    assert result.eccentricity == pytest.approx(elements.eccentricity, rel=0.0, abs=1e-12)
    assert result.inclination.radians == pytest.approx(elements.inclination_rad, rel=0.0, abs=1e-12)
    node = result.longitude_of_ascending_node.radians
    assert turned(node - elements.node_longitude_rad) == pytest.approx(0.0, abs=1e-12)
    # Perigee and anomaly of a near-circular orbit are known to 1e-16 over its eccentricity.
    perigee = result.argument_of_periapsis.radians
    assert turned(perigee - elements.argument_of_perigee_rad) == pytest.approx(0.0, abs=1e-11)
    anomaly = elements.mean_anomaly_rad + elements.mean_motion_rad_s * time_s
    assert turned(result.mean_anomaly.radians - anomaly) == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("number", KINDS.values(), ids=KINDS.keys())
def test_its_sidereal_time_turns_teme_to_our_positions(number):
    satellite = satellite_of_tle(TLE[number])
    epoch_us, _ = epoch_of(satellite)
    time_s = np.linspace(0.0, 7200.0, 50)
    angle, _ = theta_GMST1982(2440587.5 + epoch_us // 86_400_000_000, time_s / 86400.0)
    x, y, z = Sgp4Motion(satellite, epoch_us).position_teme_m(time_s).T
    reference = np.stack(
        [np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z], axis=1
    )
    result = orbit_of(OrbitConfig(tle=TLE[number]), epoch_us).position_ecef_m(time_s)
    # Its angle is rounded at 3e-9 of a turn's seconds: 1e-9 rad.
    assert (
        np.linalg.norm(result - reference, axis=1).max()
        <= 1e-3 + 1e-9 * np.linalg.norm(reference, axis=1).max()
    )
