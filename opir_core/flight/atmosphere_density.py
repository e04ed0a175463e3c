"""Density of the air against geodetic height, in layers within which it is smooth.

In every layer ln rho is a polynomial of degree 9 in x = g (Z - Z_b)/(1 + k (Z - Z_b)) - 1, from -1
at the layer's floor Z_b to 1 at its top. An integrator that uses one layer's polynomial during a
step, also slightly beyond the layer, meets no kink.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from math import inf, log, log1p, nextafter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.flight.forces import US_STANDARD_1976, ExponentialAtmosphere
from opir_core.geometry.vectors import floats

#: The lowest height of the models, m: that of the 1976 standard.
LOWEST_HEIGHT_M = -5000.0

#: The degree of the polynomials of ln rho.
_DEGREE = 9

#: The largest height change per step, in scale heights of density at the floor of a layer; where
#: drag is too weak to limit the steps, also a share of the height above the floor, so that no step
#: skips the onset of drag.
_SCALE_HEIGHTS_PER_STEP = 2.0
_SHARE_OF_HEIGHT_PER_STEP = 0.6


class AirLayers(NamedTuple):
    """An atmosphere as m layers, from the lowest up; above the last seam there may be no air.

    `parameters`, (13, m), are each layer's Z_b, g, k and coefficients from the highest power to the
    lowest. In one step an integrator should change its height by `strides_m` plus `stride_shares`
    times its height above the floor at most.
    """

    floors_m: FloatArray
    strides_m: FloatArray
    stride_shares: FloatArray
    parameters: FloatArray


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
    height = floats(height_m)
    # Every model has no air left at 1e6 km.
    flat = np.minimum(height.reshape(-1), 1e9)
    layer = np.searchsorted(layers.floors_m, flat, side="right") - 1
    with np.errstate(all="ignore"):
        density = np.exp(log_density(layers.parameters[:, np.maximum(layer, 0)], flat))
    inside = (layer >= 0) & ~np.isnan(flat)
    return np.where(inside, density, np.nan).reshape(height.shape)


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
    coefficients: Sequence[float]
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
        stride = _SCALE_HEIGHTS_PER_STEP * air.scale_height_m
        return _Layer(floor, (1.0 / air.scale_height_m, 0.0), (at_floor - 1.0, -1.0), stride, share)

    # Above 150 km an exponential atmosphere counts as weak.
    return [layer(LOWEST_HEIGHT_M, 0.0), layer(150e3, _SHARE_OF_HEIGHT_PER_STEP)]


@cache
def _us_standard_1976() -> AirLayers:
    table = Path(__file__).parents[1] / "data" / "us_standard_1976.json"
    standard = json.loads(table.read_text(encoding="utf-8"))
    turbopause_m = standard["turbopause_m"]
    thermosphere_m = standard["thermosphere_m"]
    top_m = standard["top_m"]
    layers = list(_hydrostatic(standard))
    layers.append(_fitted(turbopause_m, thermosphere_m, inf, standard["mesopause_fit"], 0.0))
    layers.append(
        _fitted(
            thermosphere_m,
            top_m,
            standard["stretch_m"],
            standard["thermosphere_fit"],
            _SHARE_OF_HEIGHT_PER_STEP,
        )
    )
    # No change of height is a bound above all air.
    layers.append(_Layer(nextafter(top_m, inf), (0.0, 0.0), (-inf,), 1e12))
    return _stacked(layers)


def _hydrostatic(standard: Mapping[str, Any]) -> Iterator[_Layer]:
    """Yield the standard's seven layers of constant gradient of temperature with geopotential
    height (equations 33a, 33b and 42).
    """
    radius_m = standard["geopotential_radius_m"]
    pull_k_m = standard["hydrostatic_k_m"]
    temperature = standard["sea_level_k"]
    log_base = log(standard["sea_level_kg_m3"])
    bases, lapses = zip(*standard["lapse_rates"], strict=True)
    turbopause_m = standard["turbopause_m"]
    tops = [*bases[1:], turbopause_m / (1.0 + turbopause_m / radius_m)]
    floor = LOWEST_HEIGHT_M
    for base, lapse, top in zip(bases, lapses, tops, strict=True):

        def log_density_at(
            height_m: float,
            base: float = base,
            lapse: float = lapse,
            temperature: float = temperature,
            log_base: float = log_base,
        ) -> float:
            above = height_m / (1.0 + height_m / radius_m) - base
            if lapse == 0.0:
                return log_base - pull_k_m / temperature * above
            return log_base - (1.0 + pull_k_m / lapse) * log1p(lapse * above / temperature)

        ceiling = top / (1.0 - top / radius_m)
        yield _interpolated(log_density_at, floor, ceiling)
        temperature = temperature + lapse * (top - base)
        log_base = log_density_at(ceiling)
        floor = ceiling


def _interpolated(log_density_at: Callable[[float], float], floor: float, ceiling: float) -> _Layer:
    """Return a layer between two heights, m, in which ln rho is interpolated at Chebyshev nodes."""
    from numpy.polynomial import chebyshev

    depth = ceiling - floor
    points = chebyshev.chebpts1(_DEGREE + 1)
    values = [log_density_at(floor + 0.5 * depth * (1.0 + float(x))) for x in points]
    series = chebyshev.cheb2poly(chebyshev.chebfit(points, values, _DEGREE))
    drop = log_density_at(floor) - log_density_at(ceiling)
    stride = _SCALE_HEIGHTS_PER_STEP * depth / drop
    return _Layer(floor, (2.0 / depth, 0.0), tuple(series.tolist()), stride)


def _fitted(
    floor: float, top: float, stretch: float, coefficients: Sequence[float], share: float
) -> _Layer:
    curvature = 1.0 / stretch
    shape = (2.0 * (curvature + 1.0 / (top - floor)), curvature)
    slope = sum(power * value * (-1.0) ** (power - 1) for power, value in enumerate(coefficients))
    return _Layer(floor, shape, coefficients, -_SCALE_HEIGHTS_PER_STEP / (slope * shape[0]), share)
