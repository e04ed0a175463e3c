"""Points that represent impact regions, for the energy score of a predicted impact."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import AzimuthalEquidistant, great_circle_m
from opir_core.plugin import ImpactRegion
from opir_scoring.proper_scores import weighted_energy

#: Points of each region outside the next smaller one, and the lines across it on which they lie.
_POINTS = 64
_LINES = 128


def region_energy_m(regions: Sequence[ImpactRegion], impact: FloatArray) -> float:
    """Return the energy score, m, of the impact that regions state, for a true one (latitude,
    longitude, ..., rad).

    The regions of each condition count with its probability, their sum as 1: the score is that of
    the place given that the target comes down. Between two nested regions the density is uniform;
    the probability outside the largest is put in the outermost ring. Distances are great circles.
    Points stand for areas, to about 1 % of the score.
    """
    conditions = dict.fromkeys(region.condition for region in regions)
    parts = [
        _points_of_condition([each for each in regions if each.condition == name])
        for name in conditions
    ]
    place = np.concatenate([points for points, _ in parts])
    weight = np.concatenate([weights for _, weights in parts])
    if not weight.sum() > 0.0:
        return np.nan
    away = great_circle_m(place, np.broadcast_to(impact[:2], place.shape))
    first, second = np.triu_indices(len(place), 1)
    apart = np.zeros((len(place), len(place)))
    apart[first, second] = great_circle_m(place[first], place[second])
    return weighted_energy(weight, away, apart + apart.T)


def _points_of_condition(regions: Sequence[ImpactRegion]) -> tuple[FloatArray, FloatArray]:
    """Return points (k, 2), rad, and weights (k,) of the nested regions of one condition."""
    nested = sorted(regions, key=lambda region: region.containment)
    rings = [[ring for polygon in region.polygons for ring in polygon] for region in nested]
    edges = [0.0, *(region.containment for region in nested[:-1]), 1.0]
    places = list[FloatArray]()
    weights = list[FloatArray]()
    for number, (own, share) in enumerate(zip(rings, np.diff(edges).tolist(), strict=True)):
        # Rings of the smaller region inside count as holes: a point is in one of both, not in both.
        holes = rings[number - 1] if number else []
        chart = nested[number].chart()
        weight = nested[0].probability * share
        found = _points_inside([*own, *holes], chart) if own else np.empty((0, 2))
        if own and not len(found) and number:
            # As large as the one inside: what it adds lies there.
            weights[-1] = weights[-1] * (
                1.0 + weight / max(weights[-1].sum(), np.finfo(float).tiny)
            )
            continue
        if own and not len(found):
            found = chart.places(np.zeros((1, 2)))
        places.append(found)
        weights.append(np.full(len(found), weight / max(len(found), 1)))
    return np.concatenate(places), np.concatenate(weights)


def _points_inside(rings: Sequence[FloatArray], chart: AzimuthalEquidistant) -> FloatArray:
    """Return points (k, 2), rad, spread evenly over the area inside an odd number of rings; k is 0
    without area.

    They lie at equal steps of the length that parallel lines have inside, on the map of a region.
    """
    corners = [chart.points(ring) for ring in rings]
    starts, ends = (
        np.concatenate([corner[cut] for corner in corners]) for cut in (slice(-1), slice(1, None))
    )
    low = starts[:, 1].min()
    high = starts[:, 1].max()
    height = low + (high - low) * (np.arange(_LINES) + 0.5) / _LINES
    crosses = (starts[:, 1] > height[:, None]) != (ends[:, 1] > height[:, None])
    line, edge = np.nonzero(crosses)
    rise = (height[line] - starts[edge, 1]) / (ends[edge, 1] - starts[edge, 1])
    across = starts[edge, 0] + rise * (ends[edge, 0] - starts[edge, 0])
    order = np.lexsort((across, line))
    left = across[order][::2]
    right = across[order][1::2]
    line = line[order][::2]
    reached = np.cumsum(right - left)
    if not len(reached) or not reached[-1] > 0.0:
        return np.empty((0, 2))
    wanted = reached[-1] * (np.arange(_POINTS) + 0.5) / _POINTS
    chord = np.searchsorted(reached, wanted)
    return chart.places(
        np.stack([right[chord] - (reached[chord] - wanted), height[line[chord]]], axis=1)
    )
