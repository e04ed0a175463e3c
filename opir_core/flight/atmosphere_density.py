"""Density of the air against geodetic height, in layers within which it is smooth.

In every layer ln rho is a polynomial of degree 9 in x = g (Z - Z_b)/(1 + k (Z - Z_b)) - 1, from -1
at the layer's floor Z_b to 1 at its top. An integrator that uses one layer's polynomial during a
step, also slightly beyond the layer, meets no kink.
"""

from collections.abc import Callable
from functools import cache
from math import inf, log, log1p, nextafter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.forces import US_STANDARD_1976, ExponentialAtmosphere

#: The lowest height of the models, m: that of the 1976 standard.
LOWEST_HEIGHT_M = -5000.0

#: Radius of the Earth in the geopotential of the 1976 standard, m.
_GEOPOTENTIAL_RADIUS_M = 6356766.0

#: g0 M0/R* of the 1976 standard, K/m: 9.80665 m/s² · 28.9644 kg/kmol / 8314.32 J/(kmol K).
_HYDROSTATIC_K_M = 9.80665 * 28.9644 / 8314.32

#: Geopotential height of each base, m, and the gradient of temperature above it, K/m (the standard,
#: table 4).
_LAPSE_RATES = (
    (0.0, -6.5e-3),
    (11e3, 0.0),
    (20e3, 1e-3),
    (32e3, 2.8e-3),
    (47e3, 0.0),
    (51e3, -2.8e-3),
    (71e3, -2e-3),
)
_SEA_LEVEL_K = 288.15
_SEA_LEVEL_KG_M3 = 101325.0 * 28.9644 / (8314.32 * _SEA_LEVEL_K)

#: Where the standard's hydrostatic layers end, and the seams above, m.
_TURBOPAUSE_M = 86e3
_THERMOSPHERE_M = 120e3
_TOP_M = 1000e3

#: The stretch 1/k of height above 120 km, m, that makes the thermosphere's polynomial smooth.
_STRETCH_M = 500e3

#: Polynomials, lowest power first, fitted to the standard's table I
#: (docs/design/us_standard_atmosphere_fit.py).
_MESOPAUSE_FIT = (
    -14.9256794,
    -3.0143544,
    0.11682195,
    0.0159635033,
    -0.0414649747,
    0.125063609,
    0.101376613,
)
_THERMOSPHERE_FIT = (
    *(-25.7605789, -6.53001027, -1.0620151, -1.35404649, -0.543909378),
    *(-2.01480271, 2.19598824, 5.01802978, -0.274988842, -2.94240127),
)

_DEGREE = 9

#: A height change per step that is no bound, m.
_BOUNDLESS_M = 1e12

#: The largest height change per step, in scale heights of density at the floor of a layer; where
#: drag is too weak to limit the steps, also a share of the height above the floor, so that no step
#: skips the onset of drag.
_SCALE_HEIGHTS_PER_STEP = 2.0
_SHARE_OF_HEIGHT_PER_STEP = 0.6

#: Above this height, m, an exponential atmosphere counts as weak.
_EXPONENTIAL_INTERFACE_M = 150e3


class AirLayers(NamedTuple):
    """An atmosphere as m layers, from the lowest up; above the last seam there may be no air.

    `parameters`, (13, m), are each layer's Z_b, g, k and coefficients from the highest power to the
    lowest. In one step an integrator should change its height by `strides_m` plus `stride_shares`
    times its height above the floor at most.
    """

    floors_m: FloatArray
    strides_m: FloatArray
    stride_shares: FloatArray
    parameters: NDArray[np.float64]


def log_density(parameters: Any, height_m: Any) -> Any:
    """Return ln rho, rho in kg/m³, at heights (n,), m, each by the layer whose parameters, (13, n),
    are given; or at one height, from 13 numbers.
    """
    x = height_m - parameters[0]
    x *= parameters[1] / (1.0 + parameters[2] * x)
    x -= 1.0
    value = parameters[3] * x
    for coefficient in parameters[4:-1]:
        value += coefficient
        value *= x
    value += parameters[-1]
    return value


def density_kg_m3(
    height_m: ArrayLike, atmosphere: ExponentialAtmosphere | str = US_STANDARD_1976
) -> FloatArray:
    """Return densities, kg/m³, at geodetic heights, m; `nan` below -5 km.

    U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562, NASA-TM-X-74335): to 86 km its definition,
    within 1e-9; from there to 1000 km within 0.5 % of its table; zero above.
    """
    layers = air_layers(atmosphere)
    height = np.asarray(height_m, dtype=np.float64)
    flat = np.minimum(height.reshape(-1), _HIGHEST_M)
    layer = np.searchsorted(layers.floors_m, flat, side="right") - 1
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        density = np.exp(log_density(layers.parameters[:, np.maximum(layer, 0)], flat))
    inside = (layer >= 0) & ~np.isnan(flat)
    return np.where(inside, density, np.nan).reshape(height.shape)


#: Heights above are taken as this, m, where every model has no air left.
_HIGHEST_M = 1e9


def air_layers(atmosphere: ExponentialAtmosphere | str) -> AirLayers:
    """Return an atmosphere as layers, within each of which it is smooth."""
    if isinstance(atmosphere, ExponentialAtmosphere):
        return _stacked(_exponential(atmosphere))
    if atmosphere == US_STANDARD_1976:
        return _us_standard_1976()
    raise ValueError(f"unknown atmosphere {atmosphere!r}")


class _Layer(NamedTuple):
    floor_m: float
    shape: tuple[float, float]
    coefficients: tuple[float, ...]
    stride_m: float
    stride_share: float = 0.0


def _stacked(layers: list[_Layer]) -> AirLayers:
    parameters = np.zeros((_DEGREE + 4, len(layers)))
    for column, layer in zip(parameters.T, layers, strict=True):
        column[:3] = layer.floor_m, *layer.shape
        column[len(column) - len(layer.coefficients) :] = layer.coefficients[::-1]
    floors, strides, shares = (
        np.array([getattr(layer, name) for layer in layers])
        for name in ("floor_m", "stride_m", "stride_share")
    )
    return AirLayers(floors, strides, shares, parameters)


def _exponential(air: ExponentialAtmosphere) -> list[_Layer]:
    def layer(floor: float, share: float) -> _Layer:
        at_floor = log(air.density_kg_m3) - (floor - air.base_height_m) / air.scale_height_m
        coefficients = (at_floor - 1.0, -1.0)
        shape = (1.0 / air.scale_height_m, 0.0)
        return _Layer(
            floor, shape, coefficients, _SCALE_HEIGHTS_PER_STEP * air.scale_height_m, share
        )

    return [layer(LOWEST_HEIGHT_M, 0.0), layer(_EXPONENTIAL_INTERFACE_M, _SHARE_OF_HEIGHT_PER_STEP)]


@cache
def _us_standard_1976() -> AirLayers:
    layers = _hydrostatic()
    layers.append(_fitted(_TURBOPAUSE_M, _THERMOSPHERE_M, inf, _MESOPAUSE_FIT, 0.0))
    layers.append(
        _fitted(_THERMOSPHERE_M, _TOP_M, _STRETCH_M, _THERMOSPHERE_FIT, _SHARE_OF_HEIGHT_PER_STEP)
    )
    layers.append(_Layer(nextafter(_TOP_M, inf), (0.0, 0.0), (-inf,), _BOUNDLESS_M))
    return _stacked(layers)


def _hydrostatic() -> list[_Layer]:
    """Return the standard's seven layers of constant gradient of temperature with geopotential
    height.
    """
    from numpy.polynomial import chebyshev

    layers = []
    temperature = _SEA_LEVEL_K
    log_base = log(_SEA_LEVEL_KG_M3)
    floor = LOWEST_HEIGHT_M
    tops = [base for base, _ in _LAPSE_RATES[1:]] + [_geopotential(_TURBOPAUSE_M)]
    for (base, lapse), top in zip(_LAPSE_RATES, tops, strict=True):
        log_density_at = _constant_gradient(base, temperature, lapse, log_base)
        ceiling = top / (1.0 - top / _GEOPOTENTIAL_RADIUS_M)
        points = chebyshev.chebpts1(_DEGREE + 1)
        values = [
            log_density_at(floor + 0.5 * (ceiling - floor) * (1.0 + float(x))) for x in points
        ]
        coefficients = tuple(
            float(each) for each in chebyshev.cheb2poly(chebyshev.chebfit(points, values, _DEGREE))
        )
        stride = (
            _SCALE_HEIGHTS_PER_STEP
            * (ceiling - floor)
            / (log_density_at(floor) - log_density_at(ceiling))
        )
        layers.append(_Layer(floor, (2.0 / (ceiling - floor), 0.0), coefficients, stride))
        temperature = temperature + lapse * (top - base)
        log_base = log_density_at(ceiling)
        floor = ceiling
    return layers


def _constant_gradient(
    base: float, temperature: float, lapse: float, log_base: float
) -> Callable[[float], float]:
    """Return ln rho against geodetic height in a hydrostatic layer (the standard, equations 33a,
    33b and 42).
    """

    def log_density_at(height_m: float) -> float:
        above = _geopotential(height_m) - base
        if lapse == 0.0:
            return log_base - _HYDROSTATIC_K_M / temperature * above
        return log_base - (1.0 + _HYDROSTATIC_K_M / lapse) * log1p(lapse * above / temperature)

    return log_density_at


def _geopotential(height_m: float) -> float:
    return height_m / (1.0 + height_m / _GEOPOTENTIAL_RADIUS_M)


def _fitted(
    floor: float, top: float, stretch: float, coefficients: tuple[float, ...], share: float
) -> _Layer:
    curvature = 1.0 / stretch
    shape = (2.0 * (curvature + 1.0 / (top - floor)), curvature)
    slope = sum(power * value * (-1.0) ** (power - 1) for power, value in enumerate(coefficients))
    return _Layer(floor, shape, coefficients, -_SCALE_HEIGHTS_PER_STEP / (slope * shape[0]), share)
