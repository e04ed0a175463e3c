"""Impacts of a track under each condition: regions, moments and the condition's probability."""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces
from opir_core.geometry import AzimuthalEquidistant, unit_vectors
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion
from opir_forecast.fates import Fates, GlideEnds, free_impacts
from opir_forecast.particles import LAW, BurnState
from opir_forecast.regions import regions


class Impacts(NamedTuple):
    """Regions and moments of the impacts under a condition, and its probability."""

    probability: float
    regions: tuple[ImpactRegion, ...]
    moments: tuple[FloatArray, FloatArray, FloatArray]


class Descents(NamedTuple):
    """Particles (m,) of a track with their fates, `falls` (m,) as weights of ballistic impacts, and
    glides.
    """

    lit: IntArray
    fates: Fates
    falls: FloatArray
    glides: GlideEnds | None


def impacts_by_condition(descents: Descents, burning: float, forces: Forces) -> list[Impacts]:
    """Return the impacts of a track under each condition, the most probable first.

    A probably burning target comes down or not. A dark one comes down as it is, or burns on: again,
    or still.
    """
    comes_down, over, relights = IMPACT_CONDITIONS
    is_dark = descents.lit == BurnState.DARK
    if burning > 0.5:
        conditions = {comes_down: np.ones(len(is_dark), dtype=np.bool_)}
    else:
        conditions = {over: is_dark, relights: ~is_dark}
    impacts = (
        _conditional(condition, rows, descents, forces) for condition, rows in conditions.items()
    )
    return sorted(filter(None, impacts), key=lambda impact: -impact.probability)


def _conditional(
    condition: str, rows: BoolArray, descents: Descents, forces: Forces
) -> Impacts | None:
    """Return the impacts of some rows of a track's particles, or None if they are improbable or too
    few count.
    """
    _, fates, falls, glided = descents
    weight = np.where(rows, falls, 0.0)
    glides = np.zeros(0) if glided is None else np.where(rows, glided.weight, 0.0)
    probability = float(weight.sum() + glides.sum())
    if not probability > LAW.least_probability:
        return None
    samples = probability**2 / float(np.sum(weight * weight) + np.sum(glides * glides))
    if samples < LAW.least_samples:
        return None
    points, time_s, share = _impact_points(fates, weight, forces)
    if glided is not None and glides.any():
        gliders = np.flatnonzero(glides > 0.0)
        points = np.concatenate([points, glided.place[gliders]])
        time_s = np.concatenate([time_s, glided.time_s[gliders]])
        share = np.concatenate([share, glides[gliders]])
    share = share / share.sum()
    areas = regions(points, share, condition, probability, samples, fates.origin[0])
    return Impacts(probability, areas, impact_moments(points, time_s, share))


def _impact_points(
    fates: Fates, weight: FloatArray, forces: Forces
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places (m, 2), times (m,) and weights (m,) of ballistic impacts that count."""
    heavy = np.flatnonzero(weight > LAW.least_weight * weight.max(initial=0.0))
    points = fates.place[heavy]
    share = weight[heavy]
    if not forces.is_kepler and len(heavy):
        flights = fates.state[heavy], fates.out_s[heavy]
        points = _shifted(points, share / share.sum(), flights, forces)
    return points, fates.when_s[heavy], share


def _shifted(
    place: FloatArray, weight: FloatArray, flights: tuple[FloatArray, FloatArray], forces: Forces
) -> FloatArray:
    """Return points (n, 2) moved as those of the middle particle are by the scene's forces.

    `flights` are states (n, 6) and times (n,) of the particles. Wide regions stay: the shift is
    some kilometres.
    """
    chart = AzimuthalEquidistant.about(weight @ unit_vectors(place))
    plane = chart.points(place)
    distance = np.sum((plane - weight @ plane) ** 2, axis=1)
    if weight @ distance > LAW.wide_m**2:
        return place
    row = int(np.argmin(distance))
    state, time_s = (column[row : row + 1] for column in flights)
    moved, _ = free_impacts(state, time_s, forces, 1.0)
    if not np.isfinite(moved).all():
        return place
    return chart.places(plane + chart.points(moved) - plane[row])


def impact_moments(
    place: FloatArray, time_s: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, covariance, and the radii of ellipses that contain the points in the shares
    `TRACK_CONTAINMENTS`.

    Points (n, 2) are latitude and longitude, rad, at times (n,), s. The mean is of these three; the
    covariance is of east and north, m, and time, s.
    """
    chart = AzimuthalEquidistant.about(weight @ unit_vectors(place))
    plane = chart.points(place)
    mean = weight @ plane
    mean_s = weight @ time_s
    columns = np.column_stack([plane - mean, time_s - mean_s])
    covariance = (weight[:, None] * columns).T @ columns + np.diag([1.0, 1.0, 1e-6])
    covariance = 0.5 * (covariance + covariance.T)
    radii = _radii(columns[:, :2], covariance[:2, :2], weight)
    return np.array([*chart.places(mean[None])[0], mean_s]), covariance, radii


def _radii(offset: FloatArray, covariance: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the radii of ellipses that contain offsets (n, 2) in the shares
    `TRACK_CONTAINMENTS`.
    """
    scaled = np.linalg.solve(covariance, offset.T).T
    distance = np.sqrt(np.sum(offset * scaled, axis=1))
    order = np.argsort(distance)
    return np.interp(TRACK_CONTAINMENTS, np.cumsum(weight[order]), distance[order])
