"""Tracks that a sensor can hardly tell apart say so: their covariances allow for one another's lines of sight."""

import numpy as np
import pytest
from opir_testing.doubles import stub_sensor
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.imm.neighbours import with_neighbours
from opir_trackers.sensors import Biases

from opir_core.estimation import square_root
from opir_core.estimation.motion import BOOST, COAST

SENSORS = Biases.of([stub_sensor("A", 0.0), stub_sensor("B", 90.0)])
LOOK_RAD = SENSORS.sensors[0].line_of_sight_sigma_rad
GATE = 6.0
FIRST = np.array([0.0, 0.0, 6.6e6, 0.0, 0.0, 1000.0])


def estimates_at(states: np.ndarray) -> ModeEstimates:
    """Return estimates with standard deviations of 100 m and 100 m/s in every mode."""
    count = len(states)
    boost = np.concatenate([states, np.zeros((count, BOOST - COAST))], axis=1)
    roots = (np.tile(np.eye(size) / 100.0, (count, 1, 1)) for size in (BOOST, COAST))
    return ModeEstimates(np.tile([1.0, 0.0], (count, 1)), boost, next(roots), states, next(roots), np.zeros((count, 3)))


def added(states: np.ndarray, seen: np.ndarray | None = None) -> np.ndarray:
    """Return what is added to the covariances (n, 6, 6) of position and velocity, the same in both modes."""
    seen = np.ones((len(states), 2), dtype=bool) if seen is None else seen
    found = with_neighbours(estimates_at(states), states, 0.0, seen, SENSORS, GATE)
    boost, coast = (square_root.covariance(root)[:, :COAST, :COAST] for root in (found.boost_root, found.coast_root))
    assert boost == pytest.approx(coast, rel=1e-9, abs=1e-6)
    return boost - 1e4 * np.eye(COAST)


def along_sight_of_b() -> np.ndarray:
    """Return the unit vector from sensor B to the first target: of shifts along it only A sees anything."""
    away = FIRST[:3] - SENSORS.sensors[1].orbit.position_ecef_m(np.zeros(1))[0]
    return away / np.linalg.norm(away)


def test_half_of_two_targets_lines_may_be_the_others():
    shift = np.concatenate([700.0 * along_sight_of_b(), 30.0 * along_sight_of_b()])
    for covariance in added(np.stack([FIRST, FIRST + shift])):
        assert covariance == pytest.approx(0.5 * np.outer(shift, shift), rel=0.01, abs=0.01 * 700.0**2)
        assert np.sqrt(covariance[3:, 3:].trace()) == pytest.approx(np.sqrt(0.5) * 30.0, rel=0.01)


def test_more_neighbours_share_a_track_equally():
    shifts = np.outer([0.0, 700.0, -700.0], along_sight_of_b())
    middle = added(FIRST + np.concatenate([shifts, np.zeros((3, 3))], axis=1))[0]
    assert middle[:3, :3].trace() == pytest.approx(2.0 / 3.0 * 700.0**2, rel=0.01)


@pytest.mark.parametrize(("looks", "is_wider"), [(5.9, True), (6.1, False)])
def test_the_gate_is_six_looks_in_the_view_of_a_sensor(looks, is_wider):
    # Northwards and southwards of the first: far from the line of sight of either sensor.
    apart = np.array([0.0, 0.0, looks * LOOK_RAD * 42.7e6, 0.0, 0.0, 0.0])
    states = np.stack([FIRST, FIRST + apart / np.cos(np.arctan(6.6 / 42.164))])
    estimates = estimates_at(states)
    found = with_neighbours(estimates, states, 0.0, np.ones((2, 2), dtype=bool), SENSORS, GATE)
    assert (found is not estimates) == is_wider


def test_tracks_that_no_sensor_sees_both_of_are_no_neighbours():
    states = np.stack([FIRST, FIRST + np.concatenate([100.0 * along_sight_of_b(), np.zeros(3)])])
    assert not np.abs(added(states, np.eye(2, dtype=bool))).max() > 1e-6


def test_a_lone_track_is_as_it_was():
    estimates = estimates_at(FIRST[None])
    assert with_neighbours(estimates, FIRST[None], 0.0, np.ones((1, 2), dtype=bool), SENSORS, GATE) is estimates
