"""A layer as a map of matplotlib, in the Equal Earth projection."""

from typing import Any

import numpy as np
from opir_report import GRID, INK, MUTED, STYLE, coast_rings, equal_earth

from opir_core.arrays import FloatArray
from opir_coverage.grid import PlaceGrid
from opir_coverage.layers import CoverageMap

#: The quantiles of the values between which colours run.
_LIMITS = (0.02, 0.98)


def layer_axes(coverage: CoverageMap, name: str, *, ax: Any = None, **place: int) -> Any:
    """Draw a layer as a map and return its axes; `place` are indices of its dimensions (0)."""
    import matplotlib
    from matplotlib import pyplot
    from matplotlib.ticker import MaxNLocator

    layer = coverage[name]
    values = np.asarray(layer.values, dtype=np.float64)[
        tuple(place.get(dim, 0) for dim in layer.dims)
    ]
    finite = values[np.isfinite(values)]
    low, high, colours = _scale(finite, is_difference="minus" in coverage.attributes)
    with matplotlib.rc_context(STYLE):
        if ax is None:
            ax = pyplot.subplots(figsize=(8.6, 4.6), layout="constrained")[1]
        mesh = ax.pcolormesh(
            *_corners(coverage.grid),
            values,
            cmap=colours,
            vmin=low,
            vmax=max(high, low + 1e-9),
            rasterized=True,
        )
        _draw_ground(ax)
        unit = "" if layer.unit == "1" else f", {layer.unit}"
        extend = _beyond(finite, low, high)
        bar = ax.figure.colorbar(
            mesh, ax=ax, label=f"{layer.title}{unit}", extend=extend, shrink=0.85
        )
        if np.all(finite == np.rint(finite)):
            bar.locator = MaxNLocator(integer=True)
        ax.set(aspect="equal", xticks=[], yticks=[], title=coverage.attributes["title"])
        ax.grid(visible=False)
        ax.spines[:].set_visible(False)
    return ax


def _corners(grid: PlaceGrid) -> tuple[FloatArray, FloatArray]:
    """Return the corners (rows + 1, columns + 1) of cells in the projection."""
    half = 0.5 * grid.step_deg
    latitude = np.append(grid.latitude_deg - half, 90.0)
    longitude = np.append(grid.longitude_deg - half, 180.0)
    return equal_earth(*np.meshgrid(latitude, longitude, indexing="ij"))


def _scale(values: FloatArray, *, is_difference: bool) -> tuple[float, float, str]:
    """Return the ends of the colours and their name; those of differences are symmetric."""
    low, high = np.quantile(values, _LIMITS).tolist() if values.size else (0.0, 1.0)
    if is_difference:
        limit = max(abs(low), abs(high))
        return -limit, limit, "PuOr_r"
    return low, high, "viridis"


def _beyond(values: FloatArray, low: float, high: float) -> str:
    """Return which ends of a colour bar have values beyond them, as matplotlib names it."""
    below = int(np.any(values < low))
    above = int(np.any(values > high))
    return ("neither", "min", "max", "both")[below + 2 * above]


def _draw_ground(axes: Any) -> None:
    """Draw coasts, the graticule and the outline of the map."""
    for ring in coast_rings():
        latitude, longitude = np.degrees(ring).T
        leaps = np.flatnonzero(np.abs(np.diff(longitude)) > 180.0) + 1
        x, y = equal_earth(np.insert(latitude, leaps, np.nan), np.insert(longitude, leaps, np.nan))
        axes.plot(x, y, color="white", linewidth=1.6)
        axes.plot(x, y, color=INK, linewidth=0.7)
    parallel = np.linspace(-180.0, 180.0, 121)
    for latitude in range(-60, 61, 30):
        _draw_line(axes, latitude, parallel, color=GRID, linewidth=0.5)
    meridian = np.linspace(-90.0, 90.0, 91)
    for longitude in range(-120, 121, 60):
        _draw_line(axes, meridian, longitude, color=GRID, linewidth=0.5)
    for longitude in (-180, 180):
        _draw_line(axes, meridian, longitude, color=MUTED, linewidth=1.0)


def _draw_line(axes: Any, latitude: Any, longitude: Any, **style: Any) -> None:
    axes.plot(*equal_earth(*np.broadcast_arrays(latitude, longitude)), **style)
