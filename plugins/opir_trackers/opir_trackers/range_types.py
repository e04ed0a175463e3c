"""Target types by range: the generic classes and their ranges."""

from functools import cache
from math import erf

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.flight.boost import PROFILES_BY_TYPE, boost_profile
from opir_core.geometry import geodetic_to_ecef
from opir_core.scene.scene import TARGET_TYPES, UNKNOWN_TYPE

_RADIUS_M = 6.371e6


def ranges_m(launch: FloatArray, impact: FloatArray) -> FloatArray:
    """Return great-circle distances (n,) between points (n, 3), latitude and longitude first."""
    one, other = (geodetic_to_ecef(place[:, 0], place[:, 1], 0.0) for place in (launch, impact))
    chord = np.sqrt(np.sum((one - other) ** 2, axis=1))
    distance: FloatArray = 2.0 * _RADIUS_M * np.arcsin(np.minimum(0.5 * chord / _RADIUS_M, 1.0))
    return distance


def likeliest_types(range_m: FloatArray) -> IntArray:
    """Return codes (n,) into `TARGET_TYPES` of the types with these ranges."""
    order = np.argsort(_least_range_m())
    kind: IntArray = order[np.searchsorted(_least_range_m()[order][1:], range_m, side="right")]
    return kind


def type_probabilities(range_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """Return probabilities (n, 4) over `REPORTED_TYPES` for ranges with errors; UNKNOWN where the range is nan."""
    order = np.argsort(_least_range_m())
    below = np.array(
        [
            [0.5 + 0.5 * erf((edge - far) / (np.sqrt(2.0) * sigma)) for edge in _least_range_m()[order][1:]]
            for far, sigma in zip(range_m.tolist(), sigma_m.tolist(), strict=True)
        ]
    ).reshape(len(range_m), len(order) - 1)
    edges = np.concatenate([np.zeros((len(range_m), 1)), below, np.ones((len(range_m), 1))], axis=1)
    chance = np.zeros((len(range_m), len(TARGET_TYPES) + 1))
    chance[:, order] = np.diff(edges, axis=1)
    unknown = ~np.isfinite(range_m)
    chance[unknown] = 0.0
    chance[unknown, UNKNOWN_TYPE] = 1.0
    return chance


@cache
def _least_range_m() -> FloatArray:
    """Return the least range of each type, (types,) m: 0 for the type with the shortest ranges."""
    least = np.array([min(boost_profile(name).minimum_range_m for name in PROFILES_BY_TYPE[t]) for t in TARGET_TYPES])
    least[least.argmin()] = 0.0
    return least


@cache
def burn_s() -> FloatArray:
    """Return the mean burn time of each type's class profiles, (types,) s."""
    return np.array(
        [np.mean([boost_profile(name).burn_time_s for name in PROFILES_BY_TYPE[kind]]) for kind in TARGET_TYPES]
    )
