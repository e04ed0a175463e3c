"""TLE orbits against astropy's way from TEME to ITRS: equal but for UT1 and polar motion, which are
bounded.
"""

import erfa
import numpy as np
import pytest
from astropy import units
from astropy.coordinates import ITRS, TEME, CartesianRepresentation
from astropy.coordinates.builtin_frames.utils import get_polar_motion
from astropy.time import Time
from astropy.utils import iers
from sgp4_cases import KINDS, TLE, epoch_of

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.orbits import OrbitConfig, orbit_of
from opir_core.orbits.sgp4_motion import Sgp4Motion, satellite_of_tle

#: What `opir_core.orbits.sgp4_motion` promises: UT1 within 0.9 s of UTC and a pole within 0.6
#: arcseconds.
MOST_UT1_S = 0.9
MOST_POLE_RAD = np.radians(0.6 / 3600.0)


@pytest.fixture(autouse=True)
def _bundled_earth_orientation():
    with (
        iers.conf.set_temp("auto_download", False),
        iers.conf.set_temp("iers_degraded_accuracy", "warn"),
    ):
        yield


def ours_and_theirs(number):
    """Return positions by opir and by astropy, m, and their times."""
    satellite = satellite_of_tle(TLE[number])
    epoch_us, _ = epoch_of(satellite)
    time_s = np.linspace(0.0, 86400.0, 97)
    times = Time(str(np.datetime64(epoch_us, "us")), scale="utc") + time_s * units.s
    teme_m = Sgp4Motion(satellite, epoch_us).position_teme_m(time_s)
    frame = TEME(CartesianRepresentation(teme_m.T * units.m), obstime=times)
    reference = frame.transform_to(ITRS(obstime=times)).cartesian.xyz.to_value(units.m).T
    return (
        orbit_of(OrbitConfig(tle=TLE[number]), epoch_us).position_ecef_m(time_s),
        reference,
        times,
    )


@pytest.mark.slow
@pytest.mark.parametrize("number", KINDS.values(), ids=KINDS.keys())
def test_with_ut1_and_the_pole_put_in_nothing_is_left(number):
    result, reference, times = ours_and_theirs(number)
    late_rad = EARTH_ROTATION_RAD_S * 1.0000000001 * times.delta_ut1_utc
    cosine = np.cos(late_rad)
    sine = np.sin(late_rad)
    turned = np.stack(
        [
            cosine * result[:, 0] + sine * result[:, 1],
            cosine * result[:, 1] - sine * result[:, 0],
            result[:, 2],
        ],
        1,
    )
    corrected = np.einsum("nij,nj->ni", erfa.pom00(*get_polar_motion(times), 0.0), turned)
    # Fitted to 1 mm; a double of a Julian date, in two parts, costs no more.
    assert np.linalg.norm(corrected - reference, axis=1).max() <= 2e-3


@pytest.mark.parametrize("number", KINDS.values(), ids=KINDS.keys())
def test_without_them_the_difference_is_within_the_stated_bound(number):
    result, reference, _ = ours_and_theirs(number)
    miss = np.linalg.norm(result - reference, axis=1)
    bound = (EARTH_ROTATION_RAD_S * MOST_UT1_S + MOST_POLE_RAD) * np.linalg.norm(reference, axis=1)
    assert (miss <= bound).all()
    assert miss.max() > 1.0
