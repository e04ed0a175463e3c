"""A layer as a map of matplotlib, in the Equal Earth projection.

Source: B. Šavrič, T. Patterson and B. Jenny, International Journal of Geographical Information Science 33 (2019) 454.
"""

from typing import Any

import numpy as np
from opir_report import GRID, INK, MUTED, STYLE, coast_rings

from opir_core.arrays import FloatArray
from opir_coverage.layers import CoverageMap

#: The polynomial of the projection, and half the root of 3.
_A, _M = (1.340264, -0.081106, 0.000893, 0.003796), 0.5 * np.sqrt(3.0)
#: The quantiles of the values between which colours run.
_LIMITS = (0.02, 0.98)


def equal_earth(latitude_deg: FloatArray, longitude_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return map coordinates (…) of places, in radii of the sphere; areas on the map are those on the sphere."""
    angle = np.arcsin(_M * np.sin(np.radians(latitude_deg)))
    square = angle * angle
    sixth = square**3
    slope = _A[0] + 3.0 * _A[1] * square + sixth * (7.0 * _A[2] + 9.0 * _A[3] * square)
    x = np.radians(longitude_deg) * np.cos(angle) / (_M * slope)
    return x, angle * (_A[0] + _A[1] * square + sixth * (_A[2] + _A[3] * square))


def layer_axes(found: CoverageMap, name: str, *, ax: Any = None, **place: int) -> Any:
    """Draw a layer as a map and return its axes; `place` are indices into its dimensions, by name, 0 by default."""
    import matplotlib
    from matplotlib import pyplot
    from matplotlib.ticker import MaxNLocator

    layer = found[name]
    values = np.asarray(layer.values, dtype=np.float64)[tuple(place.get(each, 0) for each in layer.dims)]
    with matplotlib.rc_context(STYLE):
        axes = ax if ax is not None else pyplot.subplots(figsize=(8.6, 4.6), layout="constrained")[1]
        half = 0.5 * found.grid.step_deg
        edges = np.append(found.grid.latitude_deg - half, 90.0), np.append(found.grid.longitude_deg - half, 180.0)
        corners = equal_earth(*np.meshgrid(*edges, indexing="ij"))
        known = values[np.isfinite(values)]
        low, high = np.quantile(known, _LIMITS) if known.size else (0.0, 1.0)
        mesh = axes.pcolormesh(*corners, values, cmap="viridis", vmin=low, vmax=max(high, low + 1e-9), rasterized=True)
        _draw_ground(axes)
        unit = "" if layer.unit == "1" else f", {layer.unit}"
        extend = _beyond(known, low, high)
        bar = axes.figure.colorbar(mesh, ax=axes, label=f"{layer.title}{unit}", extend=extend, shrink=0.85)
        if np.all(known == np.rint(known)):
            bar.locator = MaxNLocator(integer=True)
        axes.set(aspect="equal", xticks=[], yticks=[], title=found.attributes["title"])
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
    return axes


def _beyond(known: FloatArray, low: float, high: float) -> str:
    """Return which ends of a colour bar have values beyond them, as matplotlib names it."""
    below, above = bool(np.any(known < low)), bool(np.any(known > high))
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[below, above]


def _draw_ground(axes: Any) -> None:
    """Draw coasts, the graticule and the outline of the map."""
    for ring in coast_rings():
        latitude, longitude = np.degrees(ring).T
        leaps = np.flatnonzero(np.abs(np.diff(longitude)) > 180.0) + 1
        x, y = equal_earth(np.insert(latitude, leaps, np.nan), np.insert(longitude, leaps, np.nan))
        axes.plot(x, y, color="white", linewidth=1.6)
        axes.plot(x, y, color=INK, linewidth=0.7)
    line = np.linspace(-180.0, 180.0, 121)
    for latitude in (-60.0, -30.0, 0.0, 30.0, 60.0):
        axes.plot(*equal_earth(np.full(line.shape, latitude), line), color=GRID, linewidth=0.5)
    meridian = np.linspace(-90.0, 90.0, 91)
    for longitude in (-120.0, -60.0, 0.0, 60.0, 120.0):
        axes.plot(*equal_earth(meridian, np.full(meridian.shape, longitude)), color=GRID, linewidth=0.5)
    for edge in (-180.0, 180.0):
        axes.plot(*equal_earth(meridian, np.full(meridian.shape, edge)), color=MUTED, linewidth=1.0)
