"""Points that represent impact regions, for the energy score of a predicted impact."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import AzimuthalEquidistant, great_circle_m
from opir_core.plugin import ImpactRegion
from opir_scoring.proper_scores import weighted_energy


def region_energy_m(regions: Sequence[ImpactRegion], impact: FloatArray) -> float:
    """Return the energy score, m, of the impact that regions state, for a true one (latitude,
    longitude, ..., rad).

    The regions of each condition count with its probability, their sum as 1: the score is that of
    the place given that the target comes down. Between two nested regions the density is uniform;
    the probability outside the largest is put in the outermost ring. Distances are great circles.
    Points stand for areas, to about 1 % of the score.
    """
    conditions = dict.fromkeys(region.condition for region in regions)
    points = [
        _points_of_condition([region for region in regions if region.condition == name])
        for name in conditions
    ]
    place, weight = map(np.concatenate, zip(*points, strict=True))
    if not weight.sum() > 0.0:
        return np.nan
    error_m = great_circle_m(place, np.broadcast_to(impact[:2], place.shape))
    row, column = np.triu_indices(len(place), 1)
    distance_m = np.zeros((len(place), len(place)))
    distance_m[row, column] = great_circle_m(place[row], place[column])
    return weighted_energy(weight, error_m, distance_m + distance_m.T)


def _points_of_condition(regions: Sequence[ImpactRegion]) -> tuple[FloatArray, FloatArray]:
    """Return points (k, 2), rad, and weights (k,) of the nested regions of one condition."""
    nested = sorted(regions, key=lambda region: region.containment)
    shares = np.diff([0.0, *(region.containment for region in nested[:-1]), 1.0]).tolist()
    places = list[FloatArray]()
    weights = list[FloatArray]()
    holes = list[FloatArray]()
    for region, share in zip(nested, shares, strict=True):
        rings = [ring for polygon in region.polygons for ring in polygon]
        chart = region.chart()
        weight = nested[0].probability * share
        # Rings of the smaller region inside count as holes: a point is in one of both, not in both.
        place = _points_inside([*rings, *holes], chart) if rings else np.empty((0, 2))
        if rings and not len(place):
            if weights:
                # As large as the one inside: its further probability lies there.
                total = max(weights[-1].sum(), np.finfo(float).tiny)
                weights[-1] = weights[-1] * (1.0 + weight / total)
                holes = rings
                continue
            place = chart.places(np.zeros((1, 2)))
        holes = rings
        places.append(place)
        weights.append(np.full(len(place), weight / max(len(place), 1)))
    return np.concatenate(places), np.concatenate(weights)


def _points_inside(rings: Sequence[FloatArray], chart: AzimuthalEquidistant) -> FloatArray:
    """Return 64 points (k, 2), rad, spread evenly over the area inside an odd number of rings; k is
    0 without area.

    They lie at equal steps of the length that parallel lines have inside, on the map of a region.
    """
    left, right, height = _chords([chart.points(ring) for ring in rings])
    reached = np.cumsum(right - left)
    if not len(reached) or not reached[-1] > 0.0:
        return np.empty((0, 2))
    step = reached[-1] * (np.arange(64) + 0.5) / 64
    chord = np.searchsorted(reached, step)
    across = right[chord] - (reached[chord] - step)
    return chart.places(np.stack([across, height[chord]], axis=1))


def _chords(corners: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the ends and the heights (n,) of the chords of 128 parallel lines inside rings."""
    starts = np.concatenate([corner[:-1] for corner in corners])
    ends = np.concatenate([corner[1:] for corner in corners])
    low = starts[:, 1].min()
    high = starts[:, 1].max()
    height = low + (high - low) * (np.arange(128) + 0.5) / 128
    crosses = (starts[:, 1] > height[:, None]) != (ends[:, 1] > height[:, None])
    line, edge = np.nonzero(crosses)
    rise = (height[line] - starts[edge, 1]) / (ends[edge, 1] - starts[edge, 1])
    across = starts[edge, 0] + rise * (ends[edge, 0] - starts[edge, 0])
    order = np.lexsort((across, line))
    across = across[order]
    return across[::2], across[1::2], height[line[order][::2]]
