"""Impacts of a track under each condition: regions, moments and the condition's probability."""

from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces
from opir_core.geometry import AzimuthalEquidistant, unit_vectors
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion
from opir_trackers.forecast import gliders
from opir_trackers.forecast.fates import Fates, free_impacts
from opir_trackers.forecast.regions import regions

#: A region above this size, m, is not moved by forces other than a point mass's.
_WIDE_M = 200e3

#: A condition with less probability, or with fewer effective samples, has no region.
LEAST_PROBABILITY = 0.02
LEAST_SAMPLES = 8.0

#: A particle with a lesser share of the largest weight does not count.
_LEAST_WEIGHT = 1e-4


class Impacts(NamedTuple):
    """Regions and moments of the impacts under a condition, and its probability."""

    probability: float
    regions: tuple[ImpactRegion, ...]
    moments: tuple[FloatArray, FloatArray, FloatArray]


def impacts_by_condition(lit: IntArray, burning: float, *rest: Any) -> "list[Impacts]":
    """Return the impacts of a track under each condition, the most probable first.

    What probably burns comes down or not. What is dark comes down as it is, or burns on: again, or
    still.
    """
    if burning > 0.5:
        sets = [(IMPACT_CONDITIONS[0], np.ones(len(lit), dtype=np.bool_))]
    else:
        sets = [(IMPACT_CONDITIONS[1], lit == 0), (IMPACT_CONDITIONS[2], lit > 0)]
    impacts = (_conditional(condition, mine, *rest) for condition, mine in sets)
    return sorted((one for one in impacts if one is not None), key=lambda one: -one.probability)


def _conditional(
    condition: str,
    mine: BoolArray,
    rows: slice,
    fates: Fates,
    falls: FloatArray,
    glided: "gliders.GlideEnds | None",
    forces: Forces,
) -> Impacts | None:
    """Return the impacts of a track's particles `mine`, or None if they are improbable or too few
    count.
    """
    weight = np.where(mine, falls[rows], 0.0)
    glides = np.zeros(0) if glided is None else np.where(mine, glided.weight, 0.0)
    probability = float(weight.sum() + glides.sum())
    if not probability > LEAST_PROBABILITY:
        return None
    samples = probability**2 / float(np.sum(weight * weight) + np.sum(glides * glides))
    if samples < LEAST_SAMPLES:
        return None
    kept = np.flatnonzero(weight > _LEAST_WEIGHT * weight.max(initial=0.0))
    points = fates.place[rows][kept]
    when_s = fates.when_s[rows][kept]
    share = weight[kept]
    if not forces.is_kepler and len(kept):
        points = _shifted(
            points, share / share.sum(), fates.state[rows][kept], fates.out_s[rows][kept], forces
        )
    if glided is not None and glides.any():
        which = np.flatnonzero(glides > 0.0)
        points = np.concatenate([points, glided.place[which]])
        when_s = np.concatenate([when_s, glided.when_s[which]])
        share = np.concatenate([share, glides[which]])
    share = share / share.sum()
    found = regions(points, share, condition, probability, samples, fates.origin[rows.start])
    return Impacts(probability, found, _moments(points, when_s, share))


def _shifted(
    place: FloatArray, weight: FloatArray, state: FloatArray, time_s: FloatArray, forces: Forces
) -> FloatArray:
    """Return points (n, 2) moved as those of the middle particle are by the scene's forces.

    Wide regions stay: the shift is some kilometres.
    """
    chart = AzimuthalEquidistant.about(weight @ unit_vectors(place))
    plane = chart.points(place)
    middle = weight @ plane
    if weight @ np.sum((plane - middle) ** 2, axis=1) > _WIDE_M**2:
        return place
    row = int(np.argmin(np.sum((plane - middle) ** 2, axis=1)))
    there, _ = free_impacts(state[row : row + 1], time_s[row : row + 1], forces, 1.0)
    if not np.isfinite(there).all():
        return place
    return chart.places(plane + chart.points(there) - plane[row])


def _moments(
    place: FloatArray, when_s: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, covariance, and the radii of ellipses that contain the points in the shares
    `TRACK_CONTAINMENTS`.
    """
    chart = AzimuthalEquidistant.about(weight @ unit_vectors(place))
    plane = chart.points(place)
    mean = weight @ plane
    columns = np.column_stack([plane - mean, when_s - weight @ when_s])
    covariance = (weight[:, None] * columns).T @ columns + np.diag([1.0, 1.0, 1e-6])
    covariance = 0.5 * (covariance + covariance.T)
    distance = np.sqrt(
        np.sum(columns[:, :2] * np.linalg.solve(covariance[:2, :2], columns[:, :2].T).T, axis=1)
    )
    order = np.argsort(distance)
    radii = np.interp(TRACK_CONTAINMENTS, np.cumsum(weight[order]), distance[order])
    latitude, longitude = chart.places(mean[None])[0]
    return np.array([latitude, longitude, weight @ when_s]), covariance, radii
