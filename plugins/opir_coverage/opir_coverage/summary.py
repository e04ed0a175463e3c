"""The table of a coverage: each layer over the whole grid, weighed by area."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.cli import table
from opir_coverage.layers import CoverageMap, Layer

#: Layers by time are on the page and in NetCDF; their statistics over time are in the table.
_OF_TIME = "time"


def table_rows(found: CoverageMap) -> list[dict[str, Any]]:
    """Return a row for each layer and combination of its dimensions but times: area-weighted
    figures of the grid.
    """
    weights = found.grid.weights()
    return [
        row
        for layer in found.layers
        if _OF_TIME not in layer.dims
        for row in _rows_of(found, layer, weights)
    ]


def _rows_of(found: CoverageMap, layer: Layer, weights: Any) -> list[dict[str, Any]]:
    rows = []
    places = [found.coordinates[name] for name in layer.dims]
    shape = tuple(len(each) for each in places)
    for number, values in enumerate(found.over_cells(layer)):
        index = np.unravel_index(number, shape) if shape else ()
        where = {
            name: own[int(at)] for name, own, at in zip(layer.dims, places, index, strict=True)
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
    """Return the least, the mean and the largest value, and the percentage of the area that has
    one.
    """
    known = np.isfinite(values)
    if not known.any():
        return {"min": None, "mean": None, "max": None, "percent_of_area": 0.0}
    share = weights[known]
    own = values[known]
    return {
        "min": float(own.min()),
        "mean": float((own * share).sum() / share.sum()),
        "max": float(own.max()),
        "percent_of_area": float(100.0 * share.sum() / weights.sum()),
    }


def step_note(found: CoverageMap) -> str:
    """Return a note if accesses or gaps last one step of time, so that shorter ones are missed; ""
    if not.
    """
    time_s = found.coordinates.get("time", ())
    if len(time_s) < 2 or "minus" in found.attributes:
        return ""
    step_s = float(time_s[1]) - float(time_s[0])
    shortest_s = [
        np.asarray(found[name].values) for name in ("access_duration_min", "revisit_time_min")
    ]
    if not any(np.any((each > 0.0) & (each <= step_s)) for each in shortest_s):
        return ""
    return (
        f"some accesses or gaps last one step of {step_s:g} s or less, so that shorter ones are"
        f" missed; "
        f"--steps {round(len(time_s) * step_s / 60.0)} has a step each minute"
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
