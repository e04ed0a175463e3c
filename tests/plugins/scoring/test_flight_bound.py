"""The bound of flights that parameters describe, against closed forms and what an efficient
estimator reaches.
"""

import sys

import numpy as np
import pytest
from opir_scoring.bound import DetectedLooks, state_bound
from repository import ROOT

sys.path.append(str(ROOT / "benchmarks"))
from flight_bound import KnownValues, bound_of, central_slopes, parameter_bound

#: Two sensors that look from across each other at a target that rises from (6.6e6, 0, 0), m.
SENSORS = np.array([[3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 4.0e6]])
SIGMA_RAD = 2e-5
START_M = np.array([6.6e6, 0.0, 0.0])


def looks(time_s, target):
    sensor = SENSORS[np.arange(len(time_s)) % 2]
    return DetectedLooks.unbiased(time_s, target, sensor, np.full(len(time_s), SIGMA_RAD))


def turned(rows, time_s):
    """Places (m, n, 3) of a climb that tips over: speed gained a second, its growth, and rate of
    the tilt, (m, 3).
    """
    fine = np.linspace(0.0, 1.0, 31)[:, None] * time_s
    size, growth, rate = (rows[:, number, None, None] for number in range(3))
    speed = size / growth * np.expm1(growth * fine)
    steps = np.stack(
        [speed * np.cos(rate * fine), speed * np.sin(rate * fine), 0.1 * speed], axis=-1
    )
    return START_M + 0.5 * (steps[:, 1:] + steps[:, :-1]).sum(axis=1) * (time_s / 30.0)[:, None]


def test_bound_of_a_target_at_rest():
    times = np.arange(0.0, 10.0)
    target = np.broadcast_to(START_M, (10, 3))
    result = parameter_bound(
        np.array([9.0]),
        looks(times, target),
        np.broadcast_to(np.eye(3), (10, 3, 3)),
        np.full(3, 1e9),
    )
    information = np.zeros((3, 3))
    for sensor in SENSORS:
        line = START_M - sensor
        far = np.linalg.norm(line)
        information += 5.0 * (np.eye(3) - np.outer(line, line) / far**2) / (far * SIGMA_RAD) ** 2
    assert result[0] == pytest.approx(np.linalg.inv(information), rel=1e-9, abs=1e-3)


def test_looks_after_a_tick_do_not_count_and_a_prior_does():
    times = np.arange(0.0, 10.0)
    target = np.broadcast_to(START_M, (10, 3))
    slope = np.broadcast_to(np.eye(3), (10, 3, 3))
    result = parameter_bound(
        np.array([-1.0, 3.0, 9.0]), looks(times, target), slope, np.array([1e3, 2e3, 3e3])
    )
    assert np.diagonal(result[0]) == pytest.approx([1e6, 4e6, 9e6], rel=1e-9)
    alone = parameter_bound(
        np.array([3.0]), looks(times[:4], target[:4]), slope[:4], np.array([1e3, 2e3, 3e3])
    )
    assert result[1] == pytest.approx(alone[0], rel=1e-9)
    assert np.all(np.diff([np.trace(each) for each in result]) < 0.0)


def test_free_flight_bound_is_that_of_the_recursion():
    """The parameters are position and velocity at the first look: a straight line, over seconds."""
    times = np.arange(0.0, 4.0, 0.2)
    speed = np.array([900.0, 300.0, 0.0])
    target = START_M + times[:, None] * speed
    slope = np.concatenate(
        [np.broadcast_to(np.eye(3), (20, 3, 3)), times[:, None, None] * np.eye(3)], axis=2
    )
    sigma = np.repeat([1e6, 1e4], 3)
    result = parameter_bound(np.array([times[-1]]), looks(times, target), slope, sigma)
    last = np.block([[np.eye(3), times[-1] * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    carried = bound_of(result, last[None])
    known = state_bound(times[-1:], looks(times, target))
    # Gravity's gradient and the rotation of the frame change it by a few parts in 1e4 within 4 s.
    assert np.trace(carried[0, :3, :3]) == pytest.approx(np.trace(known[0, :3, :3]), rel=1e-3)
    assert np.trace(carried[0, 3:, 3:]) == pytest.approx(np.trace(known[0, 3:, 3:]), rel=1e-3)


def test_values_that_become_known_count_from_then_on():
    known = KnownValues(np.array([5.0]), np.array([[0.0, 0.0, 1.0 / 10.0]]))
    times = np.arange(0.0, 10.0)
    target = np.broadcast_to(START_M, (10, 3))
    slope = np.broadcast_to(np.eye(3), (10, 3, 3))
    ticks = np.array([4.5, 5.0])
    sigma = np.full(3, 1e9)
    with_it, without = (
        parameter_bound(ticks, looks(times, target), slope, sigma, each) for each in (known, None)
    )
    assert with_it[0] == pytest.approx(without[0], rel=1e-9)
    information = np.linalg.inv(without[1]) + np.diag([0.0, 0.0, 1e-2])
    assert with_it[1] == pytest.approx(np.linalg.inv(information), rel=1e-6, abs=1e-3)


def test_biases_are_parameters_of_unit_variance():
    """A sensor's bias about one axis takes back what averaging many looks gains across it."""
    count = 40_000
    sensor = np.broadcast_to(SENSORS[0], (count, 3))
    turn = np.broadcast_to(np.array([[0.0, 0.0, 1e-4]]), (count, 1, 3))
    target = np.broadcast_to(START_M, (count, 3))
    biased = DetectedLooks(np.zeros(count), target, sensor, np.full(count, SIGMA_RAD), turn)
    aside = np.cross([0.0, 0.0, 1.0], START_M - SENSORS[0])
    slope = np.broadcast_to((aside / np.linalg.norm(aside))[:, None], (count, 3, 1))
    result = parameter_bound(np.zeros(1), biased, slope, np.array([1e9]))
    far = np.linalg.norm(START_M - SENSORS[0])
    wide = np.linalg.norm(aside)
    assert np.sqrt(result[0, 0, 0]) == pytest.approx(
        np.hypot(wide * 1e-4, far * SIGMA_RAD / 200.0), rel=1e-3
    )


def test_an_efficient_estimator_reaches_it_and_none_is_below():
    """Least squares by Gauss and Newton, 400 times: errors have the bound's covariance within 4
    standard errors.
    """
    truth = np.array([20.0, 0.01, 0.008])
    times = np.arange(1.0, 61.0)
    step = np.array([1e-3, 1e-6, 1e-6])
    target = turned(truth[None], times)[0]
    seen = looks(times, target)
    slope = central_slopes(lambda rows: turned(rows, times), truth, step)
    bound = parameter_bound(times[-1:], seen, slope, np.array([1e3, 1.0, 1.0]))[0]
    rng = np.random.default_rng(11)
    runs = 400

    def directions(rows):
        line = turned(rows, times) - seen.sensor_ecef_m
        return line / np.linalg.norm(line, axis=-1, keepdims=True)

    true = directions(truth[None])[0]
    side = np.cross(true, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    axes = np.stack([side, np.cross(true, side)], axis=1)
    noise = rng.normal(0.0, SIGMA_RAD, (runs, len(times), 2))
    result = np.tile(truth, (runs, 1))
    gain = np.einsum("nac,ncp->nap", axes, central_slopes(directions, truth, step)).reshape(-1, 3)
    # The slopes at the truth: this far from it, those elsewhere differ by less than 1e-3.
    for _ in range(3):
        remaining = noise - np.einsum("nac,rnc->rna", axes, directions(result) - true)
        result = result + remaining.reshape(runs, -1) @ np.linalg.pinv(gain).T
    error = result - truth
    squares = np.einsum("rp,pq,rq->r", error, np.linalg.inv(bound), error)
    assert np.mean(squares) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / runs))
    spread = np.std(error, axis=0) / np.sqrt(np.diag(bound))
    assert spread == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * runs))


def test_central_slopes_are_those_of_a_cubic():
    slopes = central_slopes(
        lambda rows: np.stack([rows[:, 0] ** 3, rows[:, 0] * rows[:, 1]], axis=1), *CUBIC
    )
    assert slopes == pytest.approx(np.array([[12.0, 0.0], [5.0, 2.0]]), abs=1e-6)


CUBIC = np.array([2.0, 5.0]), np.array([1e-4, 1e-4])
