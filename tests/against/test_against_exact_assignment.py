"""The assignment across sensors costs at most 1 % more than the best of all: enumeration, with
costs by `lstsq`.
"""

from itertools import permutations, product

import numpy as np
import pytest
from opir_trackers.pairing import Directions, SetModel, cheapest_pairing, normal_equations

RANGE_M = 3.7e7
SIGMA_RAD = 6e-6
INSTANTS = 6


def lines_of(sensors, targets, spread_m, rng):
    """Return origins (sensors, 3) and noisy unit vectors (sensors, targets, instants, 3) to targets
    that fan out.
    """
    angle = np.radians([-30.0, 35.0, 5.0, -60.0])[:sensors]
    origin = 4.2164e7 * np.stack([np.cos(angle), np.sin(angle), np.zeros(sensors)], axis=1)
    up = np.array([np.cos(0.6), 0.0, np.sin(0.6)])
    start = 6.4e6 * up + rng.uniform(-spread_m, spread_m, (targets, 3))
    velocity = 300.0 * up + rng.normal(0.0, 20.0, (targets, 3))
    place = start[:, None] + np.arange(INSTANTS)[:, None] * velocity[:, None]
    off = place[None] - origin[:, None, None]
    unit = off / np.linalg.norm(off, axis=-1, keepdims=True)
    unit += SIGMA_RAD * rng.normal(size=unit.shape)
    return origin, unit / np.linalg.norm(unit, axis=-1, keepdims=True)


def cost(origin, unit):
    """Return the sum over instants of the least squares of the crossing of lines (sensors,
    instants, 3).
    """
    total = 0.0
    for instant in range(INSTANTS):
        across = [np.eye(3) - np.outer(line[instant], line[instant]) for line in unit]
        matrix = np.concatenate(across) / (SIGMA_RAD * RANGE_M)
        side = np.concatenate([part @ place for part, place in zip(across, origin, strict=True)])
        side /= SIGMA_RAD * RANGE_M
        point = np.linalg.lstsq(matrix, side, rcond=None)[0]
        total += float(np.sum((matrix @ point - side) ** 2))
    return total


def least_cost(origin, unit):
    """Return the least cost over all ways to give each target of the first sensor one of each
    other.
    """
    sensors, targets = unit.shape[:2]
    costs = {
        rows: cost(origin, np.stack([unit[sensor, row] for sensor, row in enumerate(rows)]))
        for rows in product(range(targets), repeat=sensors)
    }
    return min(
        sum(costs[(row, *(order[row] for order in orders))] for row in range(targets))
        for orders in product(permutations(range(targets)), repeat=sensors - 1)
    )


@pytest.mark.parametrize(("sensors", "targets"), [(2, 5), (3, 4), (4, 3)])
@pytest.mark.parametrize("spread_m", [600.0, 3000.0])
def test_the_cost_is_within_a_hundredth_of_the_best(sensors, targets, spread_m):
    for seed in range(4):
        rng = np.random.default_rng([seed, sensors, targets])
        origin, unit = lines_of(sensors, targets, spread_m, rng)
        sensor, target = np.divmod(rng.permutation(sensors * targets), targets)
        row, instant = np.divmod(np.arange(len(sensor) * INSTANTS), INSTANTS)
        lines = Directions(
            row,
            sensor[row],
            instant.astype(np.float64),
            origin[sensor[row]],
            unit[sensor[row], target[row], instant],
            np.full(len(row), SIGMA_RAD),
        )
        table, centre = normal_equations(lines, row, len(sensor), np.full(len(row), RANGE_M))
        group = cheapest_pairing(table, sensor, SetModel(centre))
        assert np.bincount(group).tolist() == [sensors] * targets
        rows = [
            [
                np.flatnonzero((group == number) & (sensor == sensor_number))[0]
                for sensor_number in range(sensors)
            ]
            for number in set(group)
        ]
        result = sum(
            cost(
                origin, np.stack([unit[sensor[number], target[number]] for number in sensor_number])
            )
            for sensor_number in rows
        )
        assert result <= 1.01 * least_cost(origin, unit)
