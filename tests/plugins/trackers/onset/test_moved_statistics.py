"""Statistics that begin anew about another point keep the places of the lines before."""

import numpy as np
from attrs import evolve
from opir_estimation import LinesOfSight, earth_rotated
from opir_trackers.onset.motion_statistics import LAUNCH, MotionStatistics

RADIUS_M = 6378137.0
TIMES_S = np.linspace(0.0, 5.0, 20)
SENSORS_M = 4.2164e7 * np.array([[np.cos(slot), np.sin(slot), 0.0] for slot in (-0.5, 0.6)])
SEA = np.array([[1.0, 0.0, 100.0]])


def on_ground(east_m: float, north_m: float) -> np.ndarray:
    place = np.array([RADIUS_M, 6e5 + east_m, 1e5 + north_m])
    return RADIUS_M * place / np.linalg.norm(place)


def lines_to(place_m: np.ndarray) -> LinesOfSight:
    """Return the lines of sight of both sensors to a place."""
    number = np.repeat(np.arange(2), len(TIMES_S))
    view_m = place_m - SENSORS_M[number]
    return LinesOfSight(
        np.tile(TIMES_S, 2),
        number.astype(np.int32),
        np.arange(len(number)),
        SENSORS_M[number],
        view_m / np.linalg.norm(view_m, axis=1)[:, None],
        np.full(len(number), 20e-6),
    )


def test_places_of_earlier_lines_stay_where_the_lines_cross() -> None:
    place_m, far_m = on_ground(0.0, 0.0), on_ground(2e4, 2e4)
    lines = lines_to(place_m)
    begun = MotionStatistics.fresh(place_m[None] + 200.0, 0.0, np.zeros(1), np.full(5, 0.2))
    statistics = begun.with_lines(
        np.zeros(len(lines.time_s), dtype=np.int64), lines, np.full(2, -30.0)
    )
    launch = evolve(statistics, probability=np.eye(5)[[LAUNCH]], area=np.ones(1, dtype=np.int64))
    anew = launch.restarted(np.zeros(1, dtype=np.int64), 5.0)
    at_far_m = earth_rotated(far_m[None], np.array([5.0]))
    moved = anew.moved_on(launch, at_far_m, 5.0)
    for version in (anew, moved):
        assert version.area == 1
        point_m, covariance = version.of_all_lines().static_estimates(SEA, 100e3)
        error = point_m[0] - place_m
        assert error @ np.linalg.solve(covariance[0], error) < 16.3
        assert np.trace(covariance[0]) < 300.0**2
