"""What shared errors do to directions and positions, beside the simulator's rotation and a
triangulation.
"""

import numpy as np
import pytest
from opir_estimation import LinesOfSight, triangulated
from opir_estimation.registration.shared_errors import corrected
from opir_testing import stub_sensor
from opir_trackers.sensors import vantages_of

from opir_core.planning.sensor_states import PointingBias

SENSORS = (stub_sensor("A", -40.0), stub_sensor("B", 20.0))
BOTH = np.arange(2)
ORIGIN = np.concatenate([sensor.orbit.position_ecef_m(np.zeros(1)) for sensor in SENSORS])
PLACE = np.array([5.9e6, -1.2e6, 2.4e6])
VELOCITY = np.array([-2000.0, -1000.0, 2500.0])
TURN_RAD_S = 7.292115e-5


def lines(direction: np.ndarray) -> LinesOfSight:
    return LinesOfSight(
        np.zeros(2), BOTH.astype(np.int32), BOTH, ORIGIN, direction, np.full(2, 2e-5)
    )


def directions(offset: np.ndarray) -> np.ndarray:
    return offset / np.linalg.norm(offset, axis=1)[:, None]


def test_what_the_simulator_turns_is_turned_back() -> None:
    true = directions(PLACE - ORIGIN)
    bias = PointingBias(np.array([6e-5, -3e-5]), np.array([2e-5, 8e-5]))
    turned = np.stack(bias.applied(*true.T, BOTH, ORIGIN), axis=1)
    error = np.column_stack([bias.east_rad, bias.north_rad, [0.1, -0.2]])
    right = corrected(lines(turned), error)
    assert np.abs(right.direction_ecef - true).max() < 1e-8
    assert np.abs(turned - true).max() > 1e-5
    assert right.time_s == pytest.approx([-0.1, 0.2])


@pytest.mark.parametrize("sensor", [0, 1])
@pytest.mark.parametrize("error", [0, 1, 2])
def test_against_triangulation_of_lines_with_an_error(sensor: int, error: int) -> None:
    """At scene time 0 Earth-fixed and inertial axes are the same."""
    size = (1e-5, 1e-5, 0.1)[error]
    true = directions(PLACE - ORIGIN)
    if error == 2:
        shifted = PLACE - size * (VELOCITY - np.cross([0.0, 0.0, TURN_RAD_S], PLACE))
        wrong = directions(np.where((sensor == BOTH)[:, None], shifted, PLACE) - ORIGIN)
    else:
        angles = np.where(sensor == BOTH, size, 0.0)
        bias = PointingBias(*((angles, 0.0 * angles) if error == 0 else (0.0 * angles, angles)))
        wrong = np.stack(bias.applied(*true.T, BOTH, ORIGIN), axis=1)
    position, moved = (
        triangulated(np.zeros(2, dtype=np.int64), 1, ORIGIN, rays, np.full(2, 2e-5)).position_m
        for rays in (true, wrong)
    )
    expected = (moved - position)[0]
    vantages = vantages_of(SENSORS, 0.0)._replace(weight=np.full(2, 1e9))
    shift = vantages.shifts(PLACE[None], VELOCITY[None], np.ones((1, 2), dtype=np.bool_))
    assert size * shift[0, :, 3 * sensor + error] == pytest.approx(expected, rel=0.01, abs=0.3)
