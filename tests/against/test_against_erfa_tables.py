"""Tables of states in inertial frames, against the IAU 1980 nutation and 1994 sidereal time of
ERFA.
"""

import erfa
import numpy as np
import pytest
from opir_readers.celestial_frames import ecef_state, nutation_rad

from opir_core.constants import EARTH_ROTATION_RAD_S

YEARS = (1970, 1985, 1999, 2016, 2026, 2050, 2099)


def states(count, seed=3):
    rng = np.random.default_rng(seed)
    return rng.uniform(-8e6, 8e6, (count, 3)), rng.uniform(-7e3, 7e3, (count, 3))


def epoch_us(year):
    since = np.datetime64(f"{year}-04-01T12:34:56") - np.datetime64("1970-01-01T00:00:00")
    return int(since / np.timedelta64(1, "us"))


@pytest.mark.parametrize("year", YEARS)
@pytest.mark.parametrize("frame", ["EME2000", "TEME"])
def test_positions_are_those_of_erfa(year, frame):
    """To 0.06 arcseconds, 2 m at the Earth's surface: the terms of nutation that are left out."""
    position, velocity = states(50)
    time_s = np.linspace(-3e4, 5e6, 50)
    result, _ = ecef_state(frame, position, velocity, epoch_us(year), time_s)
    for row in range(50):
        days = (epoch_us(year) * 1e-6 + time_s[row]) / 86400.0 + 40587.0
        if frame == "EME2000":
            turned = erfa.rz(
                erfa.gst94(2400000.5, days), erfa.pnm80(2400000.5, days + 69.184 / 86400.0)
            )
        else:
            turned = erfa.rz(erfa.gmst82(2400000.5, days), np.eye(3))
        assert np.linalg.norm(result[row] - turned @ position[row]) <= 3e-7 * np.linalg.norm(
            position[row]
        )


@pytest.mark.parametrize("frame", ["EME2000", "TEME"])
def test_velocities_are_the_rates_of_positions(frame):
    position, velocity = states(40)
    ends = [
        ecef_state(frame, position + velocity * step, velocity, epoch_us(2026), np.full(40, step))[
            0
        ]
        for step in (-0.5, 0.5)
    ]
    _, result = ecef_state(frame, position, velocity, epoch_us(2026), np.zeros(40))
    np.testing.assert_allclose(result, ends[1] - ends[0], rtol=0.0, atol=2e-4)


def test_a_body_at_rest_in_space_turns_backwards_over_the_earth():
    result, rate = ecef_state(
        "TEME", np.array([[7e6, 0.0, 0.0]]), np.zeros((1, 3)), epoch_us(2026), np.zeros(1)
    )
    assert np.linalg.norm(rate) == pytest.approx(7e6 * EARTH_ROTATION_RAD_S, rel=1e-12)
    assert np.cross(result[0], rate[0])[2] < 0.0


def test_states_of_itrf_are_taken_as_they_are():
    position, velocity = states(3)
    taken = ecef_state("ITRF", position, velocity, 0, np.zeros(3))
    assert taken[0] is position
    assert taken[1] is velocity


def test_nutation_of_times_of_any_shape_is_that_of_each():
    times = np.random.default_rng(5).uniform(-0.3, 1.0, (2, 3, 4))
    total = np.stack(nutation_rad(times), axis=-1)
    assert total.shape == (2, 3, 4, 3)
    for place in np.ndindex(times.shape):
        assert np.array_equal(total[place], np.stack(nutation_rad(times[place])))
