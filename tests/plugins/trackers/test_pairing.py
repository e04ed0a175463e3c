"""Focal-plane tracks of sensors are paired by geometry."""

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.pairing import (
    Directions,
    SetModel,
    are_open,
    cheapest_pairing,
    fixes,
    normal_equations,
    set_sums,
)

EARTH_M = 6.4e6
ORBIT_M = 4.2164e7
SIGMA_RAD = 2e-5 / np.sqrt(7.0)


def sensors_m(count: int) -> np.ndarray:
    angle = np.radians([-30.0, 35.0, 5.0, -60.0])[:count]
    return ORBIT_M * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def targets_m(
    count: int, spread_m: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return places and velocities (n, 3) of targets that fan out from a field."""
    up = np.array([np.cos(0.6), 0.0, np.sin(0.6)])
    place = EARTH_M * up + rng.uniform(-spread_m, spread_m, (count, 3))
    return place, 300.0 * up + rng.normal(0.0, 20.0, (count, 3))


def looked_at(
    place_m: np.ndarray, velocity: np.ndarray, sensors: int, instants: int, rng: np.random.Generator
):
    """Return directions, the row of each, and each row's sensor and target; rows are in random
    order.
    """
    origin = sensors_m(sensors)
    parts = []
    rows = []
    order = rng.permutation(len(place_m) * sensors)
    sensor_of = order // len(place_m)
    target_of = order % len(place_m)
    for instant in range(instants):
        off = place_m[target_of] + instant * velocity[target_of] - origin[sensor_of]
        unit = off / np.linalg.norm(off, axis=1)[:, None]
        noise = SIGMA_RAD * rng.normal(size=unit.shape)
        unit += noise - unit * np.sum(noise * unit, axis=1)[:, None]
        unit /= np.linalg.norm(unit, axis=1)[:, None]
        when = np.full(len(order), float(instant))
        sigma = np.full(len(order), SIGMA_RAD)
        parts.append(
            Directions(np.arange(len(order)), sensor_of, when, origin[sensor_of], unit, sigma)
        )
        rows.append(np.arange(len(order)))
    return Directions.concatenate(parts), np.concatenate(rows), sensor_of, target_of


def equations(directions: Directions, row: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    return normal_equations(directions, row, count, np.full(len(row), 3.7e7))


@pytest.mark.parametrize("sensors", [2, 3])
def test_twenty_launches_are_paired_right(sensors: int) -> None:
    rng = np.random.default_rng(7)
    directions, row, sensor, target = looked_at(*targets_m(20, 5000.0, rng), sensors, 40, rng)
    table, centre = equations(directions, row, len(sensor))
    group = cheapest_pairing(table, sensor, SetModel(centre))
    right = [
        len(set(target[group == one])) == 1 and np.count_nonzero(group == one) == sensors
        for one in set(group)
    ]
    assert np.mean(right) >= 0.95


def test_a_set_has_a_track_per_sensor_at_most() -> None:
    rng = np.random.default_rng(3)
    place, velocity = targets_m(6, 8000.0, rng)
    directions, row, sensor, target = looked_at(place, velocity, 2, 20, rng)
    gone = np.flatnonzero(~((sensor[row] == 1) & (target[row] == 0)))
    table, centre = equations(directions.take(gone), row[gone], len(sensor))
    group = cheapest_pairing(table, sensor, SetModel(centre))
    assert np.bincount(group * 2 + sensor).max() == 1
    assert np.count_nonzero(group == group[(sensor == 0) & (target == 0)]) == 1


def test_lines_cross_at_the_target_with_the_misfit_of_their_noise() -> None:
    rng = np.random.default_rng(11)
    place, velocity = targets_m(1, 0.0, rng)
    directions, row, sensor, _ = looked_at(place, velocity, 3, 400, rng)
    table, centre = equations(directions, row, len(sensor))
    crossing = fixes(set_sums(table, np.zeros(3, dtype=np.int64))[0])
    point = np.stack(crossing.point, axis=-1)
    misfit = crossing.misfit
    truth = place[0] + np.arange(400)[:, None] * velocity[0]
    assert np.median(np.linalg.norm(point + centre - truth, axis=1)) < 500.0
    assert misfit.mean() == pytest.approx(3.0, abs=0.5)


def test_two_lines_of_metres_may_be_of_one_target_whichever_is_asked() -> None:
    """The least squares of one line alone are 0, and no rounding error of sums that cancel: those
    were some 60.
    """
    rng = np.random.default_rng(12)
    place, velocity = targets_m(40, 3e6, rng)
    for row in range(len(place)):
        directions, rows, *_ = looked_at(place[[row]], 0.0 * velocity[[row]], 2, 1, rng)
        exact = place[row] - directions.origin_ecef_m
        exact /= np.linalg.norm(exact, axis=1)[:, None]
        sharp = evolve(directions, direction_ecef=exact, sigma_rad=np.full(2, 3e-8))
        table, centre = normal_equations(sharp, rows, 2, np.full(2, 3.5e7))
        assert fixes(table).misfit.tolist() == [[0.0], [0.0]]
        one = table[:1]
        other = table[1:]
        assert SetModel(centre).may_share_target(one, other) == SetModel(centre).may_share_target(
            other, one
        )


def test_sets_of_three_sensors_that_fit_are_settled_and_others_are_open() -> None:
    rng = np.random.default_rng(4)
    directions, row, sensor, target = looked_at(*targets_m(3, 6000.0, rng), 3, 12, rng)
    table, _ = equations(directions, row, 9)
    assert not are_open(table, target).any()
    wrong = np.where((sensor == 0) & (target < 2), 1 - target, target)
    assert are_open(table, wrong).tolist() == (wrong < 2).tolist()
    two = np.flatnonzero(sensor < 2)
    assert are_open(table[two], target[two]).all()
