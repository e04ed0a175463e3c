"""Probabilities of target types by range; the least ranges of the types are those of
`vehicles.json`.
"""

from math import erf

import numpy as np
from opir_forecast import vehicle_model

from opir_core.arrays import FloatArray
from opir_core.plugin import TARGET_TYPES
from opir_core.scene import UNKNOWN_TYPE


def type_probabilities(range_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """Return probabilities (n, 4) over `REPORTED_TYPES` for ranges with errors; UNKNOWN where the
    range is nan.
    """
    least_km = vehicle_model().data["least_ranges_km"]
    order = [TARGET_TYPES.index(name) for name in least_km]
    edges_m = [1e3 * edge_km for edge_km in list(least_km.values())[1:]]
    chance = np.zeros((len(range_m), len(TARGET_TYPES) + 1))
    chance[:, order] = np.diff(_shares_below(edges_m, range_m, sigma_m), axis=1)
    unknown = ~np.isfinite(range_m)
    chance[unknown] = 0.0
    chance[unknown, UNKNOWN_TYPE] = 1.0
    return chance


def _shares_below(edges_m: list[float], range_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """Return the probabilities (n, k + 2) of ranges below 0, each of k edges, and any."""
    shares = np.zeros((len(range_m), len(edges_m) + 2))
    shares[:, -1] = 1.0
    for row, (center, sigma) in enumerate(zip(range_m.tolist(), sigma_m.tolist(), strict=True)):
        scale = np.sqrt(2.0) * sigma
        shares[row, 1:-1] = [0.5 + 0.5 * erf((edge - center) / scale) for edge in edges_m]
    return shares
