"""The bound that errors of states are judged by, against published figures and recursions of other
people.
"""

import json
import sys
from math import factorial

import numpy as np
import pytest
from opir_scoring.bound import (
    FREE_PRIOR_SIGMA,
    JERK_NOISE_M_S3,
    DetectedLooks,
    free_bound,
    position_and_velocity,
    state_bound,
)
from opir_scoring.errors import bias_turns
from opir_testing import stub_sensor
from repository import DATA

from opir_core.flight import propagate_kepler
from opir_core.geometry import eci_to_ecef, local_axes
from opir_core.planning.sensor_states import PointingBias


def test_bound_of_two_looks_is_that_of_triangulation():
    target = np.array([[6.6e6, 0.0, 0.0]] * 2)
    sensor = np.array([[3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 1.0e6]])
    sigma = np.array([2e-5, 3e-5])
    bounds = state_bound(np.zeros(1), DetectedLooks.unbiased(np.zeros(2), target, sensor, sigma))
    information = np.eye(3) * 1e-12
    for line, spread in zip(target - sensor, sigma, strict=True):
        unit = line / np.linalg.norm(line)
        information += (np.eye(3) - np.outer(unit, unit)) / (np.linalg.norm(line) * spread) ** 2
    assert bounds[0, :3, :3] == pytest.approx(np.linalg.inv(information), rel=1e-9)


@pytest.mark.parametrize("name", ["crlb_geo_60deg_apart", "crlb_three_geo"])
def test_the_bound_matches_published_values(name):
    cases = json.loads((DATA / "reference_cases.json").read_text())["cases"]
    case = next(each for each in cases if each["id"] == name)
    given = case["inputs"]
    expected = case["expected"]
    longitude = np.radians(given["sat_lon_deg"])
    sensor = given["sat_radius_m"] * np.stack(
        [np.cos(longitude), np.sin(longitude), 0.0 * longitude], axis=1
    )
    target = np.broadcast_to(np.array(expected["target_ecef_m"]), sensor.shape)
    sigma = np.array(given["sigma_rad_per_axis"])
    bounds = state_bound(
        np.zeros(1), DetectedLooks.unbiased(np.zeros(len(sensor)), target, sensor, sigma)
    )
    # A prior of 1000 km tells 1e-7 of what the looks do.
    assert bounds[0, :3, :3] == pytest.approx(np.array(expected["cov_ecef_m2"]), rel=1e-5, abs=1.0)
    assert position_and_velocity(bounds)[0][0] == pytest.approx(expected["rss_m"], rel=1e-6)


def test_the_bound_grows_as_differences_of_orbits():
    state = np.array([6.9e6, 1.0e6, 2.0e6, -1000.0, 5500.0, 3000.0])
    looks = np.array([0.0, 40.0, 80.0])
    tick = 100.0
    at, _ = propagate_kepler(state[:3], state[3:], looks)
    sensors = eci_to_ecef(
        np.array([[4.0e7, 1.0e7, 0.0], [3.0e7, -3.0e7, 0.0], [4.0e7, 0.0, 1.0e7]]), looks
    )
    sigma = np.full(3, 1e-5)
    result = state_bound(
        np.array([tick]), DetectedLooks.unbiased(looks, eci_to_ecef(at, looks), sensors, sigma)
    )[0]
    information = np.zeros((6, 6))
    prior = np.diag(1.0 / np.square([1e6] * 3 + [1e4] * 3))
    end = np.concatenate(propagate_kepler(state[:3], state[3:], tick))
    inertial = np.array([[4.0e7, 1.0e7, 0.0], [3.0e7, -3.0e7, 0.0], [4.0e7, 0.0, 1.0e7]])
    for time_s, sensor, place in zip(looks, inertial, at, strict=True):
        flow = differences(end, time_s - tick)
        line = place - sensor
        unit = line / np.linalg.norm(line)
        rows = ((np.eye(3) - np.outer(unit, unit)) / (np.linalg.norm(line) * 1e-5)) @ flow[:3]
        information += rows.T @ rows
    back = differences(end, -tick)
    # The inertial frame of the bound is the Earth-fixed one at the scene's epoch: that of the
    # sensors here.
    expected = np.linalg.inv(information + back.T @ prior @ back)
    for computed, reference in zip(
        position_and_velocity(result[None]), position_and_velocity(expected[None]), strict=True
    ):
        assert computed == pytest.approx(reference, rel=1e-3)


def test_free_bound_is_that_of_kalmans_recursion():
    looks = np.arange(0.0, 20.0, 0.4)
    path = np.array([6.9e6, 0.0, 0.0]) + np.array([0.0, 2000.0, 0.0]) * looks[:, None]
    target = eci_to_ecef(path, looks)
    inertial = np.where(
        np.arange(len(looks))[:, None] % 2, [3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 1.0e6]
    )
    sigma = np.full(len(looks), 2e-5)
    seen = DetectedLooks.unbiased(looks, target, eci_to_ecef(inertial, looks), sigma)
    result = free_bound(np.array([19.6]), seen)[0]
    covariance = np.diag(np.square(FREE_PRIOR_SIGMA))
    power = np.array(
        [[0.4 ** (b - a) / factorial(b - a) if b >= a else 0.0 for b in range(4)] for a in range(4)]
    )
    step = np.kron(power, np.eye(3))
    orders = [3 - a for a in range(4)]
    noise = [
        [0.4 ** (a + b + 1) / (factorial(a) * factorial(b) * (a + b + 1)) for b in orders]
        for a in orders
    ]
    noise = JERK_NOISE_M_S3**2 * np.kron(np.array(noise), np.eye(3))
    for number, (place, sensor) in enumerate(zip(path, inertial, strict=True)):
        covariance = step @ covariance @ step.T + noise if number else covariance
        line = place - sensor
        unit = line / np.linalg.norm(line)
        across = np.linalg.svd(unit[None])[2][1:] / (np.linalg.norm(line) * 2e-5)
        slope = np.concatenate([across, np.zeros((2, 9))], axis=1)
        gain = covariance @ slope.T @ np.linalg.inv(slope @ covariance @ slope.T + np.eye(2))
        remainder = np.eye(12) - gain @ slope
        covariance = remainder @ covariance @ remainder.T + gain @ gain.T
    for computed, reference in zip(
        position_and_velocity(result[None]),
        position_and_velocity(covariance[None, :6, :6]),
        strict=True,
    ):
        assert computed == pytest.approx(reference, rel=1e-5)
    known = state_bound(np.array([19.6]), seen)
    assert (position_and_velocity(known)[0] < position_and_velocity(result[None])[0]).all()


def test_a_bias_takes_back_what_averaging_gains():
    """Of a target that stands still before two sensors the bound is that of the mean ray and the
    bias together.
    """
    count = 4000
    bias = 3e-5
    target = np.broadcast_to([6.6e6, 0.0, 0.0], (count, 3))
    sensor = np.where(np.arange(count)[:, None] % 2, [3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 1.0e6])
    turn = np.zeros((count, 4, 3))
    for number in range(2):
        turn[number::2, 2 * number : 2 * number + 2] = bias * local_axes(sensor[:2])[number, :2]
    sigma = np.full(count, 2e-5)
    result = state_bound(np.zeros(1), DetectedLooks(np.zeros(count), target, sensor, sigma, turn))
    # A turn about east and north moves what is straight down by the same angle both ways, what is
    # beside it by less.
    mean = np.hypot(2e-5 / np.sqrt(count / 2), bias)
    information = np.eye(3) * 1e-12
    for place in sensor[:2]:
        line = target[0] - place
        unit = line / np.linalg.norm(line)
        distance = np.linalg.norm(line)
        shifts = distance * bias * np.cross(local_axes(place[None])[0, :2], unit)
        across = np.linalg.svd(unit[None])[2][1:]
        spread = across @ (shifts.T @ shifts) @ across.T + np.eye(2) * (distance * 2e-5) ** 2 / (
            count / 2
        )
        assert np.linalg.eigvalsh(spread) == pytest.approx((distance * mean) ** 2, rel=0.02)
        information += across.T @ np.linalg.inv(spread) @ across
    assert result[0, :3, :3] == pytest.approx(np.linalg.inv(information), rel=1e-6)
    seen = DetectedLooks(np.linspace(0.0, 20.0, count), target, sensor, sigma, turn)
    pair = (
        free_bound(np.array([20.0]), seen),
        free_bound(np.array([20.0]), DetectedLooks.unbiased(*seen[:4])),
    )
    assert position_and_velocity(pair[0])[0][0] > 5.0 * position_and_velocity(pair[1])[0][0]


def test_biases_of_no_size_leave_the_bounds_as_they_are():
    looks = np.arange(0.0, 20.0, 0.4)
    target = np.array([6.9e6, 0.0, 0.0]) + np.array([0.0, 2000.0, 0.0]) * looks[:, None]
    sensor = np.where(
        np.arange(len(looks))[:, None] % 2, [3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 1.0e6]
    )
    plain = DetectedLooks.unbiased(looks, target, sensor, np.full(len(looks), 2e-5))
    turned = plain._replace(turn_ecef_rad=np.zeros((len(looks), 4, 3)))
    for bound in (state_bound, free_bound):
        assert bound(np.array([5.0, 19.6]), turned) == pytest.approx(
            bound(np.array([5.0, 19.6]), plain), rel=1e-9
        )


def test_bound_turns_match_pointing_biases():
    sensors = (stub_sensor("A"), stub_sensor("B", line_of_sight_bias_sigma_rad=2e-6))
    random = np.random.default_rng(4)
    place = random.normal(size=(40, 3)) * 1e7 + [4e7, 0.0, 0.0]
    number = random.integers(0, 2, 40)
    line = -place + random.normal(size=(40, 3)) * 3e6
    line /= np.linalg.norm(line, axis=1)[:, None]
    shifts = np.cross(bias_turns(sensors, number, place), line[:, None])
    for biases in (
        PointingBias(np.array([0.0, 2e-6]), np.zeros(2)),
        PointingBias(np.zeros(2), np.array([0.0, 2e-6])),
    ):
        seen = np.stack(biases.applied(*line.T, number, place), axis=1) - line
        assert (np.linalg.norm(seen[number == 1], axis=1) > 1e-8).all()
        # The signs of biases mean nothing to a bound.
        off = np.minimum(
            *(np.linalg.norm(seen[:, None] - sign * shifts, axis=2) for sign in (1.0, -1.0))
        ).min(axis=1)
        assert (off < 1e-11).all()


def differences(state, span_s):
    """Return how the state a span later differs with the state, by central differences of two-body
    propagation.
    """
    steps = np.array([10.0] * 3 + [0.01] * 3)
    up = state + np.diag(steps)
    down = state - np.diag(steps)
    ends = [
        np.concatenate(propagate_kepler(each[:, :3], each[:, 3:], span_s), axis=1)
        for each in (up, down)
    ]
    return ((ends[0] - ends[1]) / (2.0 * steps[:, None])).T


def calls_of_bounds(looks):
    """Return how many functions are called for both bounds of a minute of looks, at a tick a
    second.
    """
    time_s = np.linspace(0.0, 60.0, looks)
    target = np.array([6.7e6, 0.0, 0.0]) + time_s[:, None] * np.array([500.0, 3000.0, 0.0])
    sensor = np.tile([[3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 1.0e6]], (looks // 2, 1))
    ticks = np.arange(1.0, 61.0)
    seen = DetectedLooks.unbiased(time_s, target, sensor, np.full(looks, 2e-5))
    calls = 0

    def counted(_frame, event, _argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(counted)
    try:
        state_bound(ticks, seen)
        free_bound(ticks, seen)
    finally:
        sys.setprofile(None)
    return calls


def test_work_grows_with_ticks_and_not_with_looks():
    calls_of_bounds(60)
    assert calls_of_bounds(6000) < 1.2 * calls_of_bounds(60)
