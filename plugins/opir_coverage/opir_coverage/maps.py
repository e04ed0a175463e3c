"""A layer as a map of matplotlib, in the Equal Earth projection."""

from typing import Any

import numpy as np
from opir_report import GRID, INK, MUTED, STYLE, coast_rings, equal_earth

from opir_core.arrays import FloatArray
from opir_coverage.layers import CoverageMap

#: The quantiles of the values between which colours run.
_LIMITS = (0.02, 0.98)


def layer_axes(found: CoverageMap, name: str, *, ax: Any = None, **place: int) -> Any:
    """Draw a layer as a map and return its axes; `place` are indices into its dimensions, by name,
    0 by default.
    """
    import matplotlib
    from matplotlib import pyplot
    from matplotlib.ticker import MaxNLocator

    layer = found[name]
    values = np.asarray(layer.values, dtype=np.float64)[
        tuple(place.get(each, 0) for each in layer.dims)
    ]
    with matplotlib.rc_context(STYLE):
        axes = (
            ax if ax is not None else pyplot.subplots(figsize=(8.6, 4.6), layout="constrained")[1]
        )
        half = 0.5 * found.grid.step_deg
        edges = (
            np.append(found.grid.latitude_deg - half, 90.0),
            np.append(found.grid.longitude_deg - half, 180.0),
        )
        corners = equal_earth(*np.meshgrid(*edges, indexing="ij"))
        known = values[np.isfinite(values)]
        low, high = np.quantile(known, _LIMITS) if known.size else (0.0, 1.0)
        colours = "viridis"
        if "minus" in found.attributes:
            high = max(abs(low), abs(high))
            low = -high
            colours = "PuOr_r"
        mesh = axes.pcolormesh(
            *corners, values, cmap=colours, vmin=low, vmax=max(high, low + 1e-9), rasterized=True
        )
        _draw_ground(axes)
        unit = "" if layer.unit == "1" else f", {layer.unit}"
        extend = _beyond(known, low, high)
        bar = axes.figure.colorbar(
            mesh, ax=axes, label=f"{layer.title}{unit}", extend=extend, shrink=0.85
        )
        if np.all(known == np.rint(known)):
            bar.locator = MaxNLocator(integer=True)
        axes.set(aspect="equal", xticks=[], yticks=[], title=found.attributes["title"])
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
    return axes


def _beyond(known: FloatArray, low: float, high: float) -> str:
    """Return which ends of a colour bar have values beyond them, as matplotlib names it."""
    below = bool(np.any(known < low))
    above = bool(np.any(known > high))
    return {
        (False, False): "neither",
        (True, False): "min",
        (False, True): "max",
        (True, True): "both",
    }[below, above]


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
        axes.plot(
            *equal_earth(meridian, np.full(meridian.shape, longitude)), color=GRID, linewidth=0.5
        )
    for edge in (-180.0, 180.0):
        axes.plot(*equal_earth(meridian, np.full(meridian.shape, edge)), color=MUTED, linewidth=1.0)
