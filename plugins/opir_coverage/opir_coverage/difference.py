"""The difference of two coverages on one grid."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_coverage.layers import CoverageMap, Layer


def difference(one: CoverageMap, other: CoverageMap) -> CoverageMap:
    """Return one coverage minus another with the same settings: layers that both have, nan where
    either has no value.

    Bands that only one has are left out, with the layers by band.
    """
    named = {each.name: each for each in other.layers}
    layers = [
        _minus(each, named[each.name])
        for each in one.layers
        if each.name in named
        and each.values.shape == named[each.name].values.shape
        and _alike(one, other, each)
    ]
    used = {name for each in layers for name in each.dims}
    words = {
        **one.attributes,
        "title": f"{one.attributes['title']} minus that of {other.attributes['scene']}",
        "minus": other.attributes["scene"],
    }
    return CoverageMap(
        one.grid,
        {name: own for name, own in one.coordinates.items() if name in used},
        layers,
        words,
    )


def _alike(one: CoverageMap, other: CoverageMap, layer: Layer) -> bool:
    return all(list(one.coordinates[name]) == list(other.coordinates[name]) for name in layer.dims)


def _minus(one: Layer, other: Layer) -> Layer:
    values = np.subtract(_signed(one.values), _signed(other.values))
    return Layer(
        one.name,
        one.title,
        one.unit,
        one.dims,
        values,
        f"difference of: {one.definition}; none where one scene has none",
    )


def _signed(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.int16 if values.dtype.kind in "bu" else np.float32)
