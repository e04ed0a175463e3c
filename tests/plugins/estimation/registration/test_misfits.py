"""Misfits of rays: their information on shared errors does not depend on motion."""

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import GatedPairs, tangent_axes
from opir_estimation.registration.misfits import mean_residuals, misfits
from opir_testing import stub_sensor
from opir_trackers.sensors import vantages_of

SENSORS = (stub_sensor("A", -40.0), stub_sensor("B", 20.0), stub_sensor("C", 60.0))
VANTAGES = vantages_of(SENSORS, 0.0)._replace(weight=np.full(3, 1e9))
PLACE = np.array([5.9e6, 1.2e6, 2.4e6])
SIGMA_RAD = 2e-5
ERROR = np.array([3e-5, -5e-5, 0.0, 1e-5, 2e-5, 0.0, -4e-5, 1e-5, 0.0])


def pairs(
    predicted: np.ndarray, error: np.ndarray, noise: np.ndarray, sensors: int = 3
) -> tuple[GatedPairs, np.ndarray]:
    """Return pairs of a track predicted at a place with ten looks of each sensor at `PLACE`."""
    sensor = np.repeat(np.arange(sensors), 10)
    origin_m = VANTAGES.origin_m[sensor]
    line = predicted - origin_m
    axes = tangent_axes(line / np.linalg.norm(line, axis=1)[:, None])
    displacement = VANTAGES.displacements(PLACE[None], np.zeros((1, 3)))[0][sensor]
    moved = np.einsum("nij,nj->ni", displacement, error.reshape(-1, 3)[sensor])
    local = np.einsum("nij,nj->ni", axes, PLACE + moved - origin_m)
    measured = local[:, :2] / local[:, 2:] + noise
    count = len(sensor)
    return GatedPairs(
        np.zeros(count, dtype=np.int64),
        np.arange(count),
        np.tile(np.arange(10) * 0.1 - 1.0, sensors),
        origin_m,
        axes,
        measured,
        np.zeros(count),
        np.zeros(count),
        np.full(count, SIGMA_RAD),
    ), sensor


def information(
    looks: tuple[GatedPairs, np.ndarray], place: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    means = mean_residuals(*looks, 3)
    result = misfits(means, place[None], np.zeros((1, 3)), np.zeros(1), VANTAGES)
    return result.matrix[0], result.vector[0], float(result.square[0])


@pytest.mark.parametrize("off_m", [(0.0, 0.0, 0.0), (3e3, -2e3, 5e3)])
def test_errors_are_found_wherever_the_track_is(off_m: tuple[float, float, float]) -> None:
    place = PLACE + off_m
    matrix, vector, square = information(pairs(place, ERROR, np.zeros((30, 2))), place)
    # Three sensors have three misfits: of six angles three combinations are seen, and these to
    # within a nanoradian.
    angles = [0, 1, 3, 4, 6, 7]
    assert np.linalg.matrix_rank(matrix[np.ix_(angles, angles)], tol=1e6) == 3
    sharp = np.sqrt(np.diagonal(matrix)).max()
    assert np.abs(vector - matrix @ ERROR).max() < 2e-3 * sharp * np.sqrt(square)
    assert square == pytest.approx(ERROR @ matrix @ ERROR, rel=5e-3)


def test_two_sensors_see_the_misfit_of_their_epipolar_planes() -> None:
    looks = pairs(PLACE, ERROR, np.zeros((20, 2)), sensors=2)
    matrix, vector, square = information(looks, PLACE)
    base = VANTAGES.origin_m[1] - VANTAGES.origin_m[0]
    displacement = VANTAGES.displacements(PLACE[None], np.zeros((1, 3)))[0]
    moved = np.einsum("nij,nj->ni", displacement, ERROR.reshape(3, 3))
    lines = (PLACE + moved - VANTAGES.origin_m)[:2]
    west, east = lines / np.linalg.norm(lines, axis=1)[:, None]
    misfit = base @ np.cross(west, east)
    assert np.linalg.matrix_rank(matrix[:6, :6], tol=1e6) == 1
    # Each ray off its plane by the noise of a mean: the misfit is linear in both, by the triple
    # products.
    slopes = [
        base @ np.cross(axis, partner)
        for ray, partner in ((west, east), (east, west))
        for axis in tangent_axes(ray[None])[0][:2]
    ]
    spread = SIGMA_RAD / np.sqrt(10.0) * np.linalg.norm(slopes)
    assert np.sqrt(square) == pytest.approx(abs(misfit) / spread, rel=5e-3)
    assert vector.any()


def test_an_outlier_moves_no_mean_and_no_scatter() -> None:
    rng = np.random.default_rng(2)
    noise = SIGMA_RAD * rng.standard_normal((30, 2))
    clean = mean_residuals(*pairs(PLACE, ERROR, noise), 3)
    noise[3] += 4e-4
    wrong = mean_residuals(*pairs(PLACE, ERROR, noise), 3)
    assert np.abs(wrong.residual - clean.residual).max() < SIGMA_RAD
    assert wrong.degrees.tolist() == [clean.degrees[0] - 2.0, *clean.degrees[1:]]
    assert wrong.scatter_rad2[0] < clean.scatter_rad2[0]


def test_scatter_is_that_of_the_noise_whatever_the_velocity() -> None:
    rng = np.random.default_rng(3)
    ratio = []
    for _ in range(200):
        noise = SIGMA_RAD * rng.standard_normal((30, 2))
        looks, sensor = pairs(PLACE, ERROR, noise)
        drift = 5e-4 * looks.time_s[:, None] * [1.0, -2.0]
        looks = evolve(looks, measured=looks.measured + drift, sigma_rad=np.full(30, 1e-2))
        means = mean_residuals(looks, sensor, 3)
        ratio.append(means.scatter_rad2.sum() / means.degrees.sum() / SIGMA_RAD**2)
    assert np.mean(ratio) == pytest.approx(1.0, abs=4.0 / np.sqrt(100.0 * 200 * 0.5))
