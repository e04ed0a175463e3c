"""What `opir coverage` does: compute, write page and data, print the figures of merit of the whole grid."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from opir_core import Host
from opir_core.cli import scene_of, table
from opir_core.errors import ModelError
from opir_core.output import OutputFiles
from opir_coverage.computing import computed_coverage, made_settings
from opir_coverage.difference import difference
from opir_coverage.layers import Coverage, Layer
from opir_coverage.page import page_of
from opir_coverage.settings import CoverageSettings, Requirement

#: Layers by time are on the page and in NetCDF; their statistics over time are in the table.
_OF_TIME = "time"


def coverage(arguments: argparse.Namespace) -> int:
    """Compute the coverage of the arguments' scene, write it and print its table."""
    settings, host = settings_of(arguments), Host.discover()
    found = computed_coverage(scene_of(arguments, host), settings)
    if arguments.against:
        other = argparse.Namespace(**{**vars(arguments), "scene": arguments.against})
        found = difference(found, computed_coverage(scene_of(other, host), settings))
    written = write_coverage(found, Path(arguments.out))
    rows = table_rows(found)
    if arguments.json:
        sys.stdout.write(json.dumps({"coverage": dict(found.attributes), "layers": rows}, indent=2) + "\n")
        return 0
    sys.stdout.write(as_text(rows) + "\n")
    for path in written:
        sys.stdout.write(f"{path}\n")
    return 0


def settings_of(arguments: argparse.Namespace) -> CoverageSettings:
    """Return the settings of the arguments; raises `ModelError` for impossible ones."""
    try:
        requirements = tuple(Requirement.of(words) for words in arguments.require)
    except ValueError as error:
        raise ModelError(f"--require: {error}") from error
    return made_settings(
        target_class=None if arguments.geometry else arguments.target_class,
        profile=arguments.profile,
        heights_km=arguments.height,
        grid_deg=arguments.grid,
        hours=arguments.hours,
        steps=arguments.steps,
        assets=arguments.assets,
        azimuths_deg=arguments.azimuth,
        launches=arguments.launches,
        chance=arguments.chance,
        track_reports=arguments.track_reports,
        requirements=requirements,
    )


def write_coverage(found: Coverage, folder: Path) -> list[Path]:
    """Write the page, Parquet and NetCDF into a folder, all or none; return the files."""
    names = ("coverage.html", "coverage.parquet", "coverage.nc")
    paths = [folder / name for name in names]
    with OutputFiles(folder=folder) as files:
        with files.writing(paths[1], "coverage", is_made_up=True) as part:
            found.write_parquet(Path(part))
        with files.writing(paths[2], "coverage", is_made_up=True) as part:
            found.write_netcdf(Path(part))
        files.write(paths[0], page_of(found, table_rows(found)).encode(), "coverage")
    return paths


def table_rows(found: Coverage) -> list[dict[str, Any]]:
    """Return a row for each layer and combination of its dimensions but times: area-weighted figures of the grid."""
    weights = found.grid.weights()
    return [row for layer in found.layers if _OF_TIME not in layer.dims for row in _rows_of(found, layer, weights)]


def _rows_of(found: Coverage, layer: Layer, weights: Any) -> list[dict[str, Any]]:
    rows = []
    places = [found.coordinates[name] for name in layer.dims]
    shape = tuple(len(each) for each in places)
    for number, values in enumerate(found.over_cells(layer)):
        index = np.unravel_index(number, shape) if shape else ()
        where = {name: own[int(at)] for name, own, at in zip(layer.dims, places, index, strict=True)}
        rows.append({"layer": layer.name, "unit": layer.unit, "of": where, **_figures(values, weights)})
    return rows


def _figures(values: Any, weights: Any) -> dict[str, Any]:
    """Return the least, the mean and the largest value, and the percentage of the area that has one."""
    known = np.isfinite(values)
    if not known.any():
        return {"min": None, "mean": None, "max": None, "percent_of_area": 0.0}
    share, own = weights[known], values[known]
    return {
        "min": float(own.min()),
        "mean": float((own * share).sum() / share.sum()),
        "max": float(own.max()),
        "percent_of_area": float(100.0 * share.sum() / weights.sum()),
    }


def as_text(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table as text."""
    head = ("layer", "of", "min", "mean", "max", "unit", "% of area")
    cells = [
        (
            row["layer"],
            words_of(row["of"]),
            *(("-" if row[name] is None else f"{row[name]:.4g}") for name in ("min", "mean", "max")),
            "" if row["unit"] == "1" else row["unit"],
            f"{row['percent_of_area']:.1f}",
        )
        for row in rows
    ]
    return table(head, cells, numbers=(2, 3, 4, 6))


def words_of(where: dict[str, Any]) -> str:
    """Return the place of a row in its dimensions as words."""
    units = {"height": " km", "azimuth": "°", "launch_time": " s", "assets": "+ in view"}
    return ", ".join(
        f"{value:g}{units.get(name, '')}" if isinstance(value, int | float) else str(value)
        for name, value in where.items()
    )
