"""Columns of models of atmosphere, background and signatures, checked where the signal chain takes
them.

A check is two reductions of the columns, always on; `nan` fails it too.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, kind_of
from opir_core.host import InvalidOutput
from opir_core.plugin import Background, Paths, Transmittance, Views


def checked_transmittances(
    atmosphere: Transmittance, bands: Sequence[int], path: Paths
) -> FloatArray:
    """Return in-band transmittances (bands, n), in [0, 1]; raises `InvalidOutput`."""
    through = atmosphere.transmittances(bands, path)
    # With the rounding of a transmittance that models interpolate.
    fault = _fault(through, (len(bands), len(path)), -1e-9, 1.0 + 1e-9, "[0, 1]")
    if fault:
        raise InvalidOutput("atmosphere", "transmittance", fault)
    return through


def checked_radiances_and_clutter(
    background: Background, bands: Sequence[int], view: Views
) -> tuple[FloatArray, FloatArray]:
    """Return in-band radiances and clutter (bands, n), W m⁻² sr⁻¹, finite and not negative; raises
    `InvalidOutput`.
    """
    radiance, clutter = background.radiances_and_clutter_w_m2_sr(bands, view)
    require_radiance(radiance, len(bands), view, "radiance_w_m2_sr")
    require_radiance(clutter, len(bands), view, "clutter_w_m2_sr")
    return radiance, clutter


def require_radiance(column: Any, bands: int, view: Views, method: str) -> None:
    """Raise `InvalidOutput` unless a background's column (bands, n) is finite and not negative."""
    fault = _fault(
        column, (bands, len(view)), 0.0, math.nextafter(math.inf, 0.0), "[0, inf) W/(m2 sr)"
    )
    if fault:
        raise InvalidOutput("background", method, fault)


def checked_intensities(intensity: Any, bands: int, rows: int) -> FloatArray:
    """Return radiant intensities (bands, n), W/sr, if they are finite and not negative; raises
    `ModelError`.
    """
    fault = _fault(intensity, (bands, rows), 0.0, math.nextafter(math.inf, 0.0), "[0, inf) W/sr")
    if fault:
        raise ModelError(f"a signature of the scene's targets or sources: intensity_w_sr {fault}")
    return intensity


def _fault(column: Any, shape: tuple[int, int], low: float, high: float, allowed: str) -> str:
    """Return the first error of a column, or ""."""
    is_array = isinstance(column, np.ndarray)
    if not is_array or column.dtype.kind != "f" or column.shape != shape:
        value = f"{column.dtype} {column.shape}" if is_array else kind_of(column)
        return f"returned {value} for all bands; floats of shape {shape} are required"
    # Written so that nan is a fault.
    if column.size and not (column.min() >= low and column.max() <= high):
        band, row = np.unravel_index(int(np.argmin((column >= low) & (column <= high))), shape)
        return f"returned {column[band, row]:g} in row {row}; {allowed} is required"
    return ""
