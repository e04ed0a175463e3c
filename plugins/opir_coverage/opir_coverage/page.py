"""The page of a coverage: equal-area maps with controls, one HTML file with all its data."""

import json
import math
import zlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from opir_report import coast_rings, html_page

from opir_core.arrays import BoolArray, FloatArray
from opir_coverage.layers import DIMENSIONS, CoverageMap, Layer
from opir_coverage.summary import name_of, words_of

#: Values over more than this many times their least are drawn on a logarithmic scale.
_LOG_RATIO = 100.0
#: Colours run between these quantiles of area if they span less than this share of the range.
_LIMITS = (0.01, 0.99)
_BULK = 0.6
#: Dimensions, the last of a layer, over which its colours are the same, so that maps may be
#: compared.
_SHARED = ("azimuth", "launch_time", "time")


def page_of(coverage: CoverageMap, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the page of a coverage as HTML; `rows` are from `table_rows`."""
    folder = files("opir_coverage") / "page"
    text = json.dumps(_data(coverage), separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    body = f"""<main>
{(folder / "controls.html").read_text(encoding="utf-8")}
<section id="table"><h2>All layers</h2>
<p>Least, area-weighted mean and largest value over the grid, and the share of its area that has one.</p>
<div class="scroll" role="region" aria-label="All layers" tabindex="0"><table>
<thead><tr>{"".join(f'<th scope="col">{head}</th>' for head in _HEAD)}</tr></thead>
<tbody>{"".join(_row(row) for row in rows)}</tbody></table></div></section>
</main>"""
    scripts = f"""<script type="application/json" id="data">{text}</script>
<script>{(folder / "coverage.js").read_text(encoding="utf-8")}</script>
"""
    style = (folder / "coverage.css").read_text(encoding="utf-8")
    return html_page(
        coverage.attributes["title"],
        _subtitle(coverage),
        body,
        _FOOTER,
        style=style,
        scripts=scripts,
    )


def _data(coverage: CoverageMap) -> dict[str, Any]:
    """Return the data of the page's script."""
    is_difference = "minus" in coverage.attributes
    return {
        "layers": [
            _layer(layer, coverage, is_difference=is_difference) for layer in coverage.layers
        ],
        "coordinates": {name: list(values) for name, values in coverage.coordinates.items()},
        "dimensions": {name: list(words) for name, words in DIMENSIONS.items()},
        "rows": coverage.grid.shape[0],
        "columns": coverage.grid.shape[1],
        "step": coverage.grid.step_deg,
        "colours": [_palette("PuOr_r" if is_difference else "viridis")],
        "difference": is_difference,
        "epoch": coverage.attributes["epoch"],
        "land": _land(),
    }


def _land() -> list[list[float]]:
    """Return longitudes and latitudes, degrees, of coasts in turn."""
    return [np.round(np.degrees(ring), 1)[:, ::-1].ravel().tolist() for ring in coast_rings()]


_FOOTER = (
    "Written by opir-coverage. Unclassified textbook physics, notional numbers. Coastlines: Natural"
    " Earth."
)
_HEAD = ("Layer", "Of", "Least", "Mean", "Largest", "Unit", "% of area")


def _subtitle(coverage: CoverageMap) -> str:
    words = coverage.attributes
    count = len(coverage.attributes["sensors"].split(", "))
    launched = "" if words["launches"] == "none" else f"; launches of {words['launches']}"
    return (
        f"{count} sensors, {words['interval']} from {words['epoch']}{launched}; grid of"
        f" {coverage.grid.step_deg:g}°"
    )


def _row(row: Mapping[str, Any]) -> str:
    cells = ["–" if row[name] is None else f"{row[name]:.4g}" for name in ("min", "mean", "max")]
    numbers = "".join(f'<td class="n">{cell}</td>' for cell in cells)
    unit = "" if row["unit"] == "1" else escape(row["unit"])
    return (
        f'<tr><th scope="row">{escape(name_of(row))}</th><td>{escape(words_of(row["of"]))}</td>{numbers}<td>{unit}</td>'
        f'<td class="n">{row["percent_of_area"]:.1f}</td></tr>'
    )


def _palette(name: str) -> str:
    """Return the 256 colours of a colour-blind safe scale as hexadecimal digits."""
    return np.round(colormaps[name](np.arange(256))[:, :3] * 255).astype(np.uint8).tobytes().hex()


def _layer(layer: Layer, coverage: CoverageMap, *, is_difference: bool) -> dict[str, Any]:
    """Return a layer; its values are steps of a linear or logarithmic scale, compressed."""
    values = np.asarray(layer.values, dtype=np.float64)
    low, high, is_log = _scale(values[np.isfinite(values)], is_difference=is_difference)
    top = 254 if "time" in layer.dims else 65_534
    if layer.values.dtype.kind in "bui" and high - low <= top:
        top = round(high - low)
        is_log = False
    packed = _packed(_steps(values, low, high, top, is_log=is_log), np.isfinite(values), top)
    separate = [name for name in layer.dims if name not in _SHARED]
    maps = values.reshape(math.prod(len(coverage.coordinates[name]) for name in separate), -1)
    weights = coverage.grid.weights()
    return {
        "name": layer.name,
        "title": layer.title,
        "unit": "" if layer.unit == "1" else layer.unit,
        "dims": list(layer.dims),
        "definition": layer.definition,
        "bytes": packed.itemsize,
        "low": low,
        "high": high,
        "top": max(top, 1),
        "log": is_log,
        "shown": [
            _shown(row, weights, low, high, is_log=is_log, is_difference=is_difference)
            for row in maps
        ],
        "alone": separate,
        "data": b64encode(zlib.compress(packed.tobytes(), 6)).decode(),
    }


def _packed(steps: FloatArray, is_known: BoolArray, top: int) -> NDArray[np.unsignedinteger]:
    """Return steps in 8 or 16 bits; the largest number stands for an unknown value."""
    kind = np.uint8 if top <= 254 else np.uint16
    return np.where(is_known, np.clip(steps, 0, top), np.iinfo(kind).max).astype(kind)


def _scale(values: FloatArray, *, is_difference: bool) -> tuple[float, float, bool]:
    """Return the ends of a layer's scale and whether it is logarithmic."""
    if not values.size:
        return 0.0, 1.0, False
    low = float(values.min())
    high = float(values.max())
    if is_difference:
        limit = max(abs(low), abs(high)) or 1.0
        return -limit, limit, False
    if low > 0.0 and high > _LOG_RATIO * low:
        return low, high, True
    return low, high if high > low else low + 1.0, False


def _steps(values: FloatArray, low: float, high: float, top: int, *, is_log: bool) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (
            np.log(values / low) / np.log(high / low) if is_log else (values - low) / (high - low)
        )
        return np.nan_to_num(np.round(share * top))


def _shown(
    values: FloatArray,
    weights: FloatArray,
    low: float,
    high: float,
    *,
    is_log: bool,
    is_difference: bool,
) -> tuple[float, float]:
    """Return the values between which the colours of maps with one scale run."""
    is_known = np.isfinite(values)
    if not is_known.any():
        return low, high
    low, high, _ = _scale(values[is_known], is_difference=is_difference)
    order = np.argsort(values[is_known])
    share = np.cumsum(np.resize(weights, values.shape)[is_known][order])
    ends = np.minimum(np.searchsorted(share, np.multiply(_LIMITS, share[-1])), len(share) - 1)
    bottom, upper = values[is_known][order][ends].tolist()
    if is_difference:
        limit = max(abs(bottom), abs(upper)) or high
        return -limit, limit
    is_far = (
        np.log(upper / bottom) < _BULK * np.log(high / low)
        if is_log
        else upper - bottom < _BULK * (high - low)
    )
    return (bottom, upper) if is_far and upper > bottom else (low, high)
