"""Where rays from several places meet, and how surely."""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.columns import Columns


@frozen(eq=False)
class Fixes(Columns):
    """Positions (n, 3), m, the information (n, 3, 3) behind them, 1/m², and the least sum of squared residuals (n,).

    Positions of groups whose rays are parallel to working precision are nan.
    """

    position_m: FloatArray
    information: FloatArray
    misfit: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (n, 3, 3), m²: the Cramér-Rao bound at these positions."""
        return np.linalg.inv(self.information).astype(np.float64, copy=False)


def information(direction: FloatArray, range_m: FloatArray, sigma_rad: FloatArray) -> FloatArray:
    """Return what each ray tells of a position, (I - u uᵀ) / (σ R)², (n, 3, 3), 1/m².

    Two independent angular errors of σ each per ray: the Fisher information of a triangulation is their sum.
    """
    outer = direction[:, :, None] * direction[:, None, :]
    projector = np.eye(3) - outer
    return projector / ((sigma_rad * range_m) ** 2)[:, None, None]


def meeting_points(
    group: IntArray, count: int, origin_m: FloatArray, direction: FloatArray, sigma_rad: FloatArray, rounds: int = 3
) -> Fixes:
    """Return where the rays (n, 3) of each of `count` groups meet: weighted least squares of the angles across them.

    The weights hold the ranges, which hold the point: a few rounds settle them. Every group needs two rays that are not
    parallel.
    """
    range_m = np.full(len(group), 4e7)
    for _ in range(rounds):
        weight = information(direction, range_m, sigma_rad)
        total, pull = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(total, group, weight)
        np.add.at(pull, group, np.sum(weight * origin_m[:, None, :], axis=2))
        point = _solved(total, pull)
        range_m = np.sqrt(np.sum((point[group] - origin_m) ** 2, axis=1))
    apart = point[group] - origin_m
    misfit = np.zeros(count)
    np.add.at(misfit, group, np.sum(apart * np.sum(weight * apart[:, None, :], axis=2), axis=1))
    return Fixes(point, total, misfit)


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (n, 3) of symmetric systems; nan where a matrix is singular to working precision."""
    # What was singular in one round has no range for the next, and is not finite.
    sound: BoolArray = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
    sound[sound] = np.linalg.cond(matrix[sound]) < 1e13
    out = np.full_like(right, np.nan)
    out[sound] = np.linalg.solve(matrix[sound], right[sound][:, :, None])[:, :, 0]
    return out
