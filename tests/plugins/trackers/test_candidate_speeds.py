"""Speeds of candidates of one sensor across its line of sight, against the motion that the lines
are drawn from.
"""

import numpy as np
import pytest
from opir_estimation import LinesOfSight
from opir_trackers.initiation import TrackCandidates, track_candidates

from opir_core.geometry import geodetic_to_ecef

SIGMA_RAD = 2e-5
TIMES_S = np.array([0.0, 10.0, 20.0])
SITE = geodetic_to_ecef(np.radians(40.0), np.radians(10.0), np.float64(0.0))
UP = SITE / np.linalg.norm(SITE)
GEO = np.array([4.2164e7, 0.0, 0.0])
#: Near its apogee, 4 000 km from the axis, where a Molniya orbit moves at 1.5 km/s.
HEO = np.array([2.0e7, 4.0e6, 4.1e7])
HEO_M_S = np.array([-1.0e3, 1.1e3, 0.0])


def candidate(
    sensor: np.ndarray, sensor_m_s: np.ndarray, height_m: float, climb_m_s: float
) -> TrackCandidates:
    """Return the only candidate of three lines of a sensor to a target that climbs."""
    origin = sensor + TIMES_S[:, None] * sensor_m_s
    place = SITE + (height_m + climb_m_s * TIMES_S)[:, None] * UP
    away = place - origin
    direction = away / np.linalg.norm(away, axis=1)[:, None]
    scan = np.arange(3)
    lines = LinesOfSight(
        TIMES_S, np.zeros(3, dtype=np.int32), scan, origin, direction, np.full(3, SIGMA_RAD)
    )
    found = track_candidates(lines, 2, np.zeros(1)).begun
    assert len(found) == 1
    return found


@pytest.mark.parametrize("sensor", [(GEO, np.zeros(3)), (HEO, HEO_M_S)])
def test_a_source_that_stands_has_no_speed_though_the_sensor_moves(
    sensor: tuple[np.ndarray, np.ndarray],
) -> None:
    assert candidate(*sensor, 0.0, 0.0).speed_m_s[0] == 0.0


@pytest.mark.parametrize("sensor", [(GEO, np.zeros(3)), (HEO, HEO_M_S)])
def test_a_fast_target_has_its_speed_across_the_line_less_three_standard_deviations(
    sensor: tuple[np.ndarray, np.ndarray],
) -> None:
    found = candidate(*sensor, 30e3, 1500.0)
    line = (SITE - sensor[0]) / np.linalg.norm(SITE - sensor[0])
    across = 1500.0 * np.linalg.norm(UP - (UP @ line) * line)
    sigma = SIGMA_RAD * np.linalg.norm(SITE - sensor[0]) / np.sqrt(200.0)
    assert found.speed_m_s[0] == pytest.approx(across - 3.0 * sigma, rel=0.03)
    # Half the square of the speed over 20 m/s² above the ground, along the line of sight.
    height = np.linalg.norm(found.position_ecef_m[0]) - np.linalg.norm(SITE)
    assert height == pytest.approx(found.speed_m_s[0] ** 2 / 40.0, abs=8e3)


def test_a_low_orbit_gives_no_speed() -> None:
    """Seen from below 1 000 km, a target 30 km high moves over the ground as the sensor does."""
    low = SITE * 1.12 + np.array([0.0, -7e4, 0.0])
    assert candidate(low, np.array([0.0, 7e3, 0.0]), 30e3, 0.0).speed_m_s[0] == 0.0
