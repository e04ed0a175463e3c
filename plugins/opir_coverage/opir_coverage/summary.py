"""The table of a coverage: each layer over the whole grid, weighed by area."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.cli import table
from opir_coverage.layers import CoverageMap, Layer

#: Layers by time are on the page and in NetCDF; their statistics over time are in the table.
_OF_TIME = "time"


def table_rows(coverage: CoverageMap) -> list[dict[str, Any]]:
    """Return area-weighted figures of each layer and combination of its dimensions, but times."""
    weights = coverage.grid.weights()
    return [
        row
        for layer in coverage.layers
        if _OF_TIME not in layer.dims
        for row in _rows_of(coverage, layer, weights)
    ]


def _rows_of(coverage: CoverageMap, layer: Layer, weights: Any) -> list[dict[str, Any]]:
    rows = []
    places = [coverage.coordinates[name] for name in layer.dims]
    shape = tuple(len(coordinates) for coordinates in places)
    for number, values in enumerate(coverage.over_cells(layer)):
        index = np.unravel_index(number, shape) if shape else ()
        where = {
            name: coordinates[int(at)]
            for name, coordinates, at in zip(layer.dims, places, index, strict=True)
        }
        rows.append(
            {
                "layer": layer.name,
                "title": layer.title,
                "unit": layer.unit,
                "of": where,
                **_figures(values, weights),
            }
        )
    return rows


def _figures(values: Any, weights: Any) -> dict[str, Any]:
    """Return least, mean and largest value, and the percentage of the area with a value."""
    is_known = np.isfinite(values)
    if not is_known.any():
        return {"min": None, "mean": None, "max": None, "percent_of_area": 0.0}
    share = weights[is_known]
    values_known = values[is_known]
    return {
        "min": float(values_known.min()),
        "mean": float((values_known * share).sum() / share.sum()),
        "max": float(values_known.max()),
        "percent_of_area": float(100.0 * share.sum() / weights.sum()),
    }


def step_note(coverage: CoverageMap) -> str:
    """Return a note if accesses or gaps last one step, so that shorter ones are missed; or ""."""
    time_s = coverage.coordinates.get("time", ())
    if len(time_s) < 2 or "minus" in coverage.attributes:
        return ""
    step_s = float(time_s[1]) - float(time_s[0])
    shortest_s = [
        np.asarray(coverage[name].values) for name in ("access_duration_min", "revisit_time_min")
    ]
    if not any(np.any((duration_s > 0.0) & (duration_s <= step_s)) for duration_s in shortest_s):
        return ""
    return (
        f"some accesses or gaps last one step of {step_s:g} s or less, so that shorter ones are"
        f" missed; --steps {round(len(time_s) * step_s / 60.0)} has a step each minute"
    )


def as_text(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table as text."""
    head = ("layer", "of", "min", "mean", "max", "unit", "% of area")
    cells = [
        (
            name_of(row),
            words_of(row["of"]),
            *(
                ("-" if row[name] is None else f"{row[name]:.4g}")
                for name in ("min", "mean", "max")
            ),
            "" if row["unit"] == "1" else row["unit"],
            f"{row['percent_of_area']:.1f}",
        )
        for row in rows
    ]
    return table(head, cells, numbers=(2, 3, 4, 6))


def name_of(row: Mapping[str, Any]) -> str:
    """Return the name of a row's layer, of a requirement with its words."""
    return (
        f"{row['layer']}: {row['title'].split()[-1]}"
        if row["layer"].startswith("share_")
        else row["layer"]
    )


def words_of(where: dict[str, Any]) -> str:
    """Return the place of a row in its dimensions as words."""
    units = {"height": " km", "azimuth": "°", "launch_time": " s", "assets": "+ in view"}
    return ", ".join(
        f"{value:g}{units.get(name, '')}" if isinstance(value, int | float) else str(value)
        for name, value in where.items()
    )
