"""The command `opir coverage`: compute, write page and data, print the figures of the grid."""

import argparse
import json
import sys
from pathlib import Path

from opir_core import Host
from opir_core.cli import scene_of
from opir_core.errors import ModelError
from opir_core.output import OutputFiles
from opir_coverage.computing import computed_coverage, made_settings
from opir_coverage.difference import difference
from opir_coverage.layers import CoverageMap
from opir_coverage.page import page_of
from opir_coverage.settings import CoverageSettings, Requirement
from opir_coverage.summary import as_text, step_note, table_rows


def coverage(arguments: argparse.Namespace) -> int:
    """Compute the coverage of the arguments' scene, write it and print its table."""
    settings = settings_of(arguments)
    host = Host.discover()
    coverage_map = computed_coverage(scene_of(arguments, host), settings)
    if arguments.against:
        other_arguments = argparse.Namespace(**{**vars(arguments), "scene": arguments.against})
        coverage_map = difference(
            coverage_map, computed_coverage(scene_of(other_arguments, host), settings)
        )
    written = write_coverage(coverage_map, Path(arguments.out))
    rows = table_rows(coverage_map)
    note = step_note(coverage_map)
    if note:
        sys.stderr.write(f"opir: {note}\n")
    if arguments.json:
        sys.stdout.write(
            json.dumps({"coverage": dict(coverage_map.attributes), "layers": rows}, indent=2) + "\n"
        )
        return 0
    sys.stdout.write("\n".join([as_text(rows), *map(str, written), ""]))
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


def write_coverage(coverage_map: CoverageMap, folder: Path) -> list[Path]:
    """Write the page, Parquet and NetCDF into a folder, all or none; return the files."""
    names = ("coverage.html", "coverage.parquet", "coverage.nc")
    paths = [folder / name for name in names]
    with OutputFiles(folder=folder) as files:
        writers = (coverage_map.write_parquet, coverage_map.write_netcdf)
        for path, write in zip(paths[1:], writers, strict=True):
            with files.writing(path, "coverage", is_made_up=True) as file_part:
                write(Path(file_part))
        files.write(paths[0], page_of(coverage_map, table_rows(coverage_map)).encode(), "coverage")
    return paths
