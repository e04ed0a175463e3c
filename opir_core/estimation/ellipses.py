"""The ellipse that contains a point on the ground with a given probability."""

import math
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.interfaces.records import TRACK_CONTAINMENTS

#: The probability that a point lies in its ellipse, where none is named.
CONTAINMENT = 0.95
#: The relative rounding error that a covariance may have and still count as positive semi-definite.
_ROUNDING = 1e-9


class Ellipse(NamedTuple):
    """Semi-axes, m, and the bearing of the longer one, rad clockwise from north in [0, pi)."""

    semi_major_m: FloatArray
    semi_minor_m: FloatArray
    bearing_rad: FloatArray


def sigmas(containment: float) -> float:
    """Return the radius, in standard deviations, of the circle that holds a bivariate normal with
    this probability.

    It is the square root of the chi-square quantile of two degrees of freedom, -2 ln(1 - p).
    """
    return math.sqrt(-2.0 * math.log1p(-containment))


def _radii(containment: float, reported: FloatArray | None) -> FloatArray | float:
    """Return the radii of ellipses in standard deviations: the reported ones (n, 3), or those of a
    normal.
    """
    normal = sigmas(containment)
    if reported is None:
        return normal
    column = reported[:, TRACK_CONTAINMENTS.index(containment)]
    return np.where((column >= 0.0) & np.isfinite(column), column, normal)


@np.errstate(all="ignore")
def containment_ellipse(
    covariance_m2: FloatArray,
    containment: float = CONTAINMENT,
    reported_sigmas: FloatArray | None = None,
) -> Ellipse:
    """Return the ellipses of east-north covariances (n, 2, 2), m², that hold the point with this
    probability.

    Where the point is not normally distributed, `reported_sigmas` (n, 3) are the radii for
    `TRACK_CONTAINMENTS`, in standard deviations; nan means normal. The ellipse is nan where the
    covariance is unknown or not one.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation,
    section 3.7.4 (ellipsoids of probability); the axes are the eigenvectors, in closed form.
    """
    east = covariance_m2[:, 0, 0]
    north = covariance_m2[:, 1, 1]
    cross = 0.5 * (covariance_m2[:, 0, 1] + covariance_m2[:, 1, 0])
    major = 0.5 * (east + north) + np.hypot(0.5 * (east - north), cross)
    determinant = east * north - cross * cross
    # The smaller eigenvalue is the determinant over the larger: their difference would cancel.
    minor = np.where(major > 0.0, np.maximum(determinant, 0.0) / major, 0.0)
    valid = (
        (east >= 0.0)
        & (north >= 0.0)
        & (determinant >= -_ROUNDING * east * north)
        & np.isfinite(major * minor)
    )
    radius = _radii(containment, reported_sigmas)
    valid &= np.isfinite(radius * np.sqrt(major))
    bearing = np.mod(0.5 * np.pi - 0.5 * np.arctan2(2.0 * cross, east - north), np.pi)
    bearing = np.where(bearing < np.pi, bearing, 0.0)
    return Ellipse(
        *(
            np.where(valid, axis, np.nan)
            for axis in (radius * np.sqrt(major), radius * np.sqrt(minor), bearing)
        )
    )
