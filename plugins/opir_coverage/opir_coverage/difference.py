"""The difference of two coverages on one grid."""

from typing import Any

import numpy as np
from attrs import evolve
from numpy.typing import NDArray

from opir_coverage.layers import CoverageMap, Layer


def difference(coverage: CoverageMap, subtracted: CoverageMap) -> CoverageMap:
    """Return one coverage minus another with the same settings, of the layers that both have.

    Values are nan where either has none. Bands that only one has are left out, with the layers by
    band.
    """
    named = {layer.name: layer for layer in subtracted.layers}
    layers = [
        _minus(layer, named[layer.name])
        for layer in coverage.layers
        if layer.name in named
        and layer.values.shape == named[layer.name].values.shape
        and _alike(coverage, subtracted, layer)
    ]
    dims = {name for layer in layers for name in layer.dims}
    words = {
        **coverage.attributes,
        "title": f"{coverage.attributes['title']} minus that of {subtracted.attributes['scene']}",
        "minus": subtracted.attributes["scene"],
    }
    return CoverageMap(
        coverage.grid,
        {name: values for name, values in coverage.coordinates.items() if name in dims},
        layers,
        words,
    )


def _alike(coverage: CoverageMap, subtracted: CoverageMap, layer: Layer) -> bool:
    return all(
        list(coverage.coordinates[name]) == list(subtracted.coordinates[name])
        for name in layer.dims
    )


def _minus(layer: Layer, subtracted: Layer) -> Layer:
    values = np.subtract(_signed(layer.values), _signed(subtracted.values))
    definition = f"difference of: {layer.definition}; none where one scene has none"
    return evolve(layer, values=values, definition=definition)


def _signed(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.int16 if values.dtype.kind in "bu" else np.float32)
