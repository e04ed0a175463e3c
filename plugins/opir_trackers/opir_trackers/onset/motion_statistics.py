"""Sufficient statistics of the lines of sight of tracks, for the likelihood of any slow motion.

A line of sight with the angular error σ bounds the position p of its source, relative to a reference point near it at
the range R in the direction u, by the quadratic form (p - d)ᵀ W (p - d), with W = (I - u uᵀ) / (σ R)² and d where the
line crosses the plane through the reference point across u. (With u along the line itself, p would gain by moving
towards the sensor, where all its lines meet.) For p a polynomial of the time τ since the first detection, all lines of
a track enter through the sums of W τᵏ, W d τᵏ and dᵀ W d. The frame is fixed to the Earth, where sources stand still;
a constant pointing bias moves none.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import dot
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.interfaces import Columns
from opir_trackers.lines_of_sight import LinesOfSight, earth_rotated

#: Groups of hypotheses that motion distinguishes, columns of `MotionStatistics.probability`.
NOISE, GROUND, BOLIDE, LAUNCH, NONE = range(5)

#: Coefficients of a motion: position, velocity, acceleration, jerk. Sums of twice as many powers are needed but one.
ORDERS = 4
_POWERS = 2 * ORDERS - 1

#: i + j and i! of the coefficients i and j of a motion.
_SUM_OF_ORDERS = np.add.outer(np.arange(ORDERS), np.arange(ORDERS))
_FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0])

#: Snap that a cubic leaves out, m/s⁴: 30 m/s² that grow by 3 % a second; notional.
_SNAP_M_S4 = 0.03

#: A term s τ⁴ / 24 differs from its best cubic over [0, T] by at most s T⁴ / 24 / 128 (Chebyshev).
_LEFT_OUT = _SNAP_M_S4 / (24.0 * 128.0)


@frozen(eq=False, repr=False)
class MotionStatistics(Columns):
    """Statistics of tracks, one row each, and the latest probabilities of their groups.

    `reference_m` (n, 3) in ECEF, its `height_m` (n,) and local `axes` (n, 3, 3), rows east, north and up. Up to the
    horizon of a cubic: `information` (n, 7, 3, 3), `pull` (n, 4, 3) and `misfit` (n,) in local axes. Of all lines:
    `static_information` (n, 3, 3), `static_pull` (n, 3), number of `lines`. `noise_log` (n,) is the log likelihood of
    the lines as false alarms over that of lines without error. `probability` (n, 5) is over the groups; `is_decided`
    rows keep theirs.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = MappingProxyType(
        {
            "reference_m": (3,),
            "axes": (3, 3),
            "information": (_POWERS, 3, 3),
            "pull": (ORDERS, 3),
            "static_information": (3, 3),
            "static_pull": (3,),
            "probability": (5,),
        }
    )

    reference_m: FloatArray
    height_m: FloatArray
    axes: FloatArray
    information: FloatArray
    pull: FloatArray
    misfit: FloatArray
    static_information: FloatArray
    static_pull: FloatArray
    lines: FloatArray
    noise_log: FloatArray
    probability: FloatArray
    is_decided: BoolArray

    @classmethod
    def fresh(cls, position_m: FloatArray, time_s: float, prior: FloatArray) -> "MotionStatistics":
        """Return the statistics of tracks without lines, at inertial positions (n, 3), with probabilities (5,)."""
        count = len(position_m)
        reference_m = earth_rotated(position_m, np.full(count, -time_s))
        return cls(
            reference_m=reference_m,
            height_m=ecef_to_geodetic(reference_m).height_m,
            axes=local_axes(reference_m),
            information=np.zeros((count, _POWERS, 3, 3)),
            pull=np.zeros((count, ORDERS, 3)),
            misfit=np.zeros(count),
            static_information=np.zeros((count, 3, 3)),
            static_pull=np.zeros((count, 3)),
            lines=np.zeros(count),
            noise_log=np.zeros(count),
            probability=np.tile(prior, (count, 1)),
            is_decided=np.zeros(count, dtype=np.bool_),
        )

    @property
    def stands(self) -> BoolArray:
        """Return for which tracks (n,) a ground source is the likeliest."""
        return np.asarray(self.probability.argmax(axis=1) == GROUND)

    def horizon_s(self) -> FloatArray:
        """Return the time (n,), s, up to which a cubic describes a boost to within the error of the lines' mean."""
        sharp = 0.5 * np.trace(self.static_information, axis1=1, axis2=2)
        return np.asarray((_LEFT_OUT * np.sqrt(np.maximum(sharp, 1e-12))) ** -0.25)

    def with_lines(
        self, owner: IntArray, lines: LinesOfSight, first_s: FloatArray, noise_log: FloatArray
    ) -> "MotionStatistics":
        """Return the statistics with the lines (m,) of rows `owner`, -1 for none.

        `first_s` (n,) are the times of the first detections, `noise_log` (m,) the log likelihoods of `noise_log`.
        """
        mine = np.flatnonzero(owner >= 0)
        if not len(mine):
            return self
        mine = mine[np.argsort(owner[mine], kind="stable")]
        rows, starts = np.unique(owner[mine], return_index=True)
        of, used = owner[mine], lines.take(mine)
        since_s = used.time_s - first_s[of]
        near = since_s <= self.horizon_s()[of]
        near &= ~self.is_decided[of]
        weight, foot, square = _line_terms(used, self.reference_m[of], self.axes[of])
        powers = np.where(near[:, None], since_s[:, None] ** np.arange(_POWERS), 0.0)
        pulled = np.sum(weight * foot[:, None, :], axis=2)
        sums = [
            powers[:, :, None] * weight.reshape(-1, 1, 9),
            powers[:, :ORDERS, None] * pulled[:, None, :],
            powers[:, 0] * square,
            weight,
            pulled,
            np.ones(len(mine)),
            noise_log[mine],
        ]
        names = ("information", "pull", "misfit", "static_information", "static_pull", "lines", "noise_log")
        added = {}
        for name, terms in zip(names, sums, strict=True):
            column = getattr(self, name).copy()
            column[rows] += np.add.reduceat(terms, starts, axis=0).reshape(-1, *column.shape[1:])
            added[name] = column
        return evolve(self, **added)

    def of_motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return information (n, 12, 12), pull (n, 12) and misfit (n,) of the coefficients of a cubic.

        These are position, velocity, acceleration and jerk in local axes about the point at height 0 below the
        reference point.
        """
        count, size = len(self.misfit), 3 * ORDERS
        blocks = self.information[:, _SUM_OF_ORDERS] / _FACTORIALS[:, None, None, None] / _FACTORIALS[:, None, None]
        information = blocks.transpose(0, 1, 3, 2, 4).reshape(count, size, size)
        pull = (self.pull / _FACTORIALS[:, None]).reshape(count, size)
        raised = self.height_m[:, None] * information[:, 2]
        misfit = self.misfit + self.height_m * (2.0 * pull[:, 2] + raised[:, 2])
        return information, pull + raised, misfit

    def static_estimates(self, height_sigma_m: float, wide_m: float) -> tuple[FloatArray, FloatArray]:
        """Return positions (n, 3) in ECEF of sources that stand still near the ground, and covariances (n, 3, 3)."""
        prior = np.array([wide_m, wide_m, height_sigma_m]) ** -2.0
        covariance = np.linalg.inv(self.static_information + np.diag(prior))
        pull = self.static_pull.copy()
        pull[:, 2] -= prior[2] * self.height_m
        local = np.sum(covariance * pull[:, None, :], axis=2)
        turned = self.axes.transpose(0, 2, 1)
        return self.reference_m + np.sum(turned * local[:, None, :], axis=2), turned @ covariance @ self.axes


def _line_terms(
    lines: LinesOfSight, reference_m: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return W (m, 3, 3), 1/m², d (m, 3), m, and dᵀ W d (m,) of lines, in local axes about reference points (m, 3)."""
    apart = reference_m - lines.origin_ecef_m
    square = dot(apart, apart)
    towards = apart / np.sqrt(square)[:, None]
    # The point of the line in the plane through the reference point across the view.
    depth = square / dot(apart, lines.direction_ecef)
    off = depth[:, None] * lines.direction_ecef - apart
    along, foot = np.sum(axes * towards[:, None, :], axis=2), np.sum(axes * off[:, None, :], axis=2)
    scale = 1.0 / (np.square(lines.sigma_rad) * square)
    weight = scale[:, None, None] * (np.eye(3) - along[:, :, None] * along[:, None, :])
    return weight, foot, scale * dot(foot, foot)
