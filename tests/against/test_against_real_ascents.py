"""The target model `ascent` against speeds and heights of real space launches, published by their
webcasts.

Medians of twelve launches of 2015 to 2019, each read once a second (shahar603/Telemetry-Data,
public domain): first burns and gaps are theirs, the program of opir's ascent was not fitted to
them.
"""

import numpy as np
import pytest
from opir_readers.ascent_legs import height_of
from opir_readers.ascents import legs_of
from opir_readers.configs import AscentConfig

#: Time since lift-off, s; height above the pad, km; speed over the Earth, m/s.
MEDIANS = {
    30.0: (1.6, 121.0),
    60.0: (7.6, 291.0),
    100.0: (24.9, 740.0),
    140.0: (58.0, 1624.0),
    200.0: (119.0, 1964.0),
}

#: Dark gaps of these launches, s.
GAPS_S = (10.6, 11.8)

#: The class SLV, one smooth burn, has these speeds at 30, 60 and 140 s.
CLASS_M_S = {30.0: 215.0, 60.0: 448.0, 140.0: 1175.0}


@pytest.fixture(scope="module")
def ascent():
    legs = legs_of(AscentConfig(lat_deg=28.6, lon_deg=-80.6))
    times, places, speeds = (np.concatenate([leg[column] for leg in legs]) for column in range(3))
    return (
        times,
        np.array([height_of(place) for place in places]) / 1e3,
        np.linalg.norm(speeds, axis=1),
    )


@pytest.mark.parametrize("time_s", list(MEDIANS))
def test_height_and_speed_are_those_of_real_launches_within_a_fifth(ascent, time_s):
    times, heights, speeds = ascent
    height_km, speed_m_s = MEDIANS[time_s]
    row = np.argmin(np.abs(times - time_s))
    assert heights[row] == pytest.approx(height_km, rel=0.2)
    assert speeds[row] == pytest.approx(speed_m_s, rel=0.2)


@pytest.mark.parametrize("time_s", list(CLASS_M_S))
def test_it_is_nearer_than_one_smooth_burn(ascent, time_s):
    times, _, speeds = ascent
    real = MEDIANS[time_s][1]
    speed = float(np.interp(time_s, times, speeds))
    assert abs(speed - real) < 0.5 * abs(CLASS_M_S[time_s] - real)


def test_its_gap_is_one_of_theirs():
    assert GAPS_S[0] <= AscentConfig(lat_deg=0.0, lon_deg=0.0).gap_s <= GAPS_S[1]
