"""Iterated or unscented: how consistent is the first second of a track, by the way its looks are
taken in?

    python docs/design/iterated_update.py [--runs 2000]

A target known to 20 km, two or one sensors in geostationary or low places, one second of ten looks
a sensor at 20 µrad. ANEES of the position (1 is right) and the share inside the 95 % region after
one, two and four linearisations and after an unscented update of all looks at once. What it
settled: from a geostationary place all are alike; from a low one only relinearising is consistent,
twice is enough, and the unscented update fails as one linearisation does.
"""

import argparse
from collections.abc import Callable

import numpy as np
from opir_estimation import (
    COAST,
    AngleMeasurements,
    Motion,
    square_root,
    tangent_axes,
    taylor_positions,
    taylor_weights,
)
from opir_estimation.filter.measurement_updates import measurement_update

from opir_core.flight.forces import Forces

SIGMA_RAD = 2e-5
LOOKS = 10
KEPLER = Forces(zonal=())
SENSORS_M = 42164e3 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians([10.0, 70.0])])
#: Two places 1500 km and more from the target, as in low orbits.
LOW_M = np.array([[5.2e6, 4.9e6, 2.9e6], [4.9e6, 3.5e6, 4.2e6]])
START = np.array([4.2e6, 3.9e6, 2.9e6, -280.0, 310.0, 0.0])
PRIOR = np.repeat([20e3, 1000.0], 3)
#: The 95 % point of chi-squared with three degrees of freedom.
REGION = 7.814727903251179


Way = Callable[[np.ndarray, AngleMeasurements], tuple[np.ndarray, np.ndarray]]


def sights_of(
    target: np.ndarray, sensors: np.ndarray, rng: np.random.Generator
) -> AngleMeasurements:
    """Return a second of looks at one target, at times up to 0."""
    time_s = np.repeat(-np.arange(LOOKS) / LOOKS, len(sensors))
    origin = np.tile(sensors, (LOOKS, 1))
    motion = Motion(COAST, 0.0, KEPLER)
    place = taylor_positions(
        np.repeat(motion.taylor(target[None]), len(time_s), axis=0), taylor_weights(time_s)
    )
    apart = place - origin
    axes = tangent_axes(apart / np.linalg.norm(apart, axis=1)[:, None])
    seen = SIGMA_RAD * rng.normal(size=(len(time_s), 2))
    whitener = np.tile(np.eye(2) / SIGMA_RAD, (len(time_s), 1, 1))
    return AngleMeasurements(
        np.zeros(len(time_s), dtype=np.int64), time_s, origin, axes, seen, whitener
    )


def linearised(
    mean: np.ndarray, sights: AngleMeasurements, rounds: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate after a number of linearisations."""
    motion = Motion(COAST, 0.0, KEPLER)
    point = mean[None]
    root = np.diag(1.0 / PRIOR)[None]
    for _ in range(rounds):
        point, upper = once_more(motion, mean[None], point, root, sights)
    return point[0], square_root.covariance(upper)[0]


def once_more(
    motion: Motion, mean: np.ndarray, point: np.ndarray, root: np.ndarray, sights: AngleMeasurements
) -> tuple[np.ndarray, np.ndarray]:
    """Return the update linearised at a point."""
    weight = taylor_weights(sights.time_s)
    residual, slope = sights.residuals(
        taylor_positions(np.repeat(motion.taylor(point), len(sights), axis=0), weight)
    )
    rows = (slope[:, :, None, :] * weight[:, None, :2, None]).reshape(-1, COAST)
    whole = np.concatenate([rows, residual.reshape(-1, 1)], axis=1)[None]
    upper, step, _ = measurement_update(
        root, np.sum(root * (mean - point)[:, None, :], axis=2), whole
    )
    return point + step, upper


def unscented(mean: np.ndarray, sights: AngleMeasurements) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate after an unscented update (kappa = 3 - d) of all looks at once."""
    motion = Motion(COAST, 0.0, KEPLER)
    size = COAST
    kappa = 3.0 - size
    side = np.sqrt(size + kappa) * np.diag(PRIOR)
    points = mean + np.concatenate([np.zeros((1, size)), side, -side])
    share = np.full(2 * size + 1, 0.5 / (size + kappa))
    share[0] = kappa / (size + kappa)
    seen = []
    for point in points:
        path = np.repeat(motion.taylor(point[None]), len(sights), axis=0)
        seen.append(
            -sights.residuals(taylor_positions(path, taylor_weights(sights.time_s)))[0].ravel()
        )
    answers = np.array(seen)
    center = share @ answers
    spread = (answers - center).T @ ((answers - center) * share[:, None]) + np.eye(answers.shape[1])
    cross = (points - mean).T @ ((answers - center) * share[:, None])
    gain = np.linalg.solve(spread, cross.T).T
    covariance = np.diag(PRIOR**2) - gain @ spread @ gain.T
    return mean - gain @ center, 0.5 * (covariance + covariance.T)


def main() -> None:
    """Print consistency by way of update and number of sensors."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=2000)
    runs = parser.parse_args().runs
    ways = {
        "one linearisation": lambda mean, sights: linearised(mean, sights, 1),
        "two linearisations": lambda mean, sights: linearised(mean, sights, 2),
        "four linearisations": lambda mean, sights: linearised(mean, sights, 4),
        "unscented": unscented,
    }
    for where, sensors in (("high", SENSORS_M), ("low", LOW_M)):
        for count in (2, 1):
            for name, way in ways.items():
                print(f"{count} {where}, {name:20s} {consistency(way, sensors[:count], runs)}")


def consistency(way: Way, sensors: np.ndarray, runs: int) -> str:
    """Return ANEES of the position, the share inside the 95 % region and how many covariances were
    not definite.
    """
    rng = np.random.default_rng(5)
    found = []
    failed = 0
    for _ in range(runs):
        sights = sights_of(START, sensors, rng)
        state, covariance = way(START + PRIOR * rng.normal(size=COAST), sights)
        error = (state - START)[:3]
        failed += int(np.linalg.eigvalsh(covariance)[0] <= 0.0)
        found.append(error @ np.linalg.solve(covariance[:3, :3], error))
    nees = np.array(found)
    return (
        f"ANEES {nees.mean() / 3:9.3f}  in 95 %: {np.mean(nees < REGION):.3f}  indefinite: {failed}"
    )


if __name__ == "__main__":
    main()
