"""The ellipse in which a point on the ground lies with a given probability."""

import math
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.records import TOLD_CONTAINMENTS

#: The probabilities that the point lies in the ellipses of an event, the first that of `containment_ellipse`.
CONTAINMENT = 0.95
OTHER_CONTAINMENTS = (0.5, 0.9)


# By how much, relative to its diagonal, a covariance may miss being one through rounding.
_ROUNDING = 1e-9


class Ellipse(NamedTuple):
    """Semi-axes, m, and the bearing of the longer one, rad clockwise from north in [0, pi)."""

    semi_major_m: FloatArray
    semi_minor_m: FloatArray
    bearing_rad: FloatArray


def sigmas(containment: float) -> float:
    """Return the radius, in standard deviations, of the circle that holds a bivariate normal with this probability.

    It is the square root of the chi-square quantile of two degrees of freedom, -2 ln(1 - p).
    """
    return math.sqrt(-2.0 * math.log1p(-containment))


def _reach(containment: float, told: FloatArray | None) -> FloatArray | float:
    """Return the radii of ellipses, in standard deviations: those told (n, 3) of `TOLD_CONTAINMENTS`, if they are."""
    usual = sigmas(containment)
    if told is None:
        return usual
    column = told[:, TOLD_CONTAINMENTS.index(containment)]
    return np.where((column >= 0.0) & np.isfinite(column), column, usual)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def containment_ellipse(
    covariance_m2: FloatArray, containment: float = CONTAINMENT, told_sigmas: FloatArray | None = None
) -> Ellipse:
    """Return the ellipses of east-north covariances (n, 2, 2), m², that hold the point with this probability.

    Where the point is not normally distributed, `told_sigmas` (n, 3) are the radii of `TOLD_CONTAINMENTS`, in
    standard deviations; nan where it is. The ellipse is nan where one is no covariance or not known.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 3.7.4
    (ellipsoids of probability); the axes are the eigenvectors, in closed form.
    """
    east, north = covariance_m2[:, 0, 0], covariance_m2[:, 1, 1]
    cross = 0.5 * (covariance_m2[:, 0, 1] + covariance_m2[:, 1, 0])
    major = 0.5 * (east + north) + np.hypot(0.5 * (east - north), cross)
    determinant = east * north - cross * cross
    # The smaller eigenvalue is the determinant over the larger: their difference would cancel.
    minor = np.where(major > 0.0, np.maximum(determinant, 0.0) / major, 0.0)
    lawful = (east >= 0.0) & (north >= 0.0) & (determinant >= -_ROUNDING * east * north) & np.isfinite(major * minor)
    reach = _reach(containment, told_sigmas)
    lawful &= np.isfinite(reach * np.sqrt(major))
    bearing = np.mod(0.5 * np.pi - 0.5 * np.arctan2(2.0 * cross, east - north), np.pi)
    bearing = np.where(bearing < np.pi, bearing, 0.0)
    return Ellipse(
        *(np.where(lawful, axis, np.nan) for axis in (reach * np.sqrt(major), reach * np.sqrt(minor), bearing))
    )
