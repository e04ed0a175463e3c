"""The tables of a run: detections, truth, tracks, regions, targets and sensors; and as data frames.

Names end in units. `time` columns are UTC, `_s` columns seconds of the scene. Angles are in
degrees. A column stands in one place: of detections and truth in `detection_tables`, of tracks and
regions in `track_tables`, of targets and sensors in `scene_tables`; every format writes them from
there.
"""

import json
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from opir_core.errors import PluginError, install_command
from opir_export.tabular.columns import table_of
from opir_export.tabular.detection_tables import detection_columns, truth_columns
from opir_export.tabular.scene_tables import sensor_columns, target_columns
from opir_export.tabular.track_tables import region_columns, track_columns

#: The key of the manifest, as JSON, in the metadata of each table.
MANIFEST_KEY = "opir_manifest"

_COLUMNS: Mapping[str, Callable[[Any], Any]] = {
    "detections": detection_columns,
    "truth": truth_columns,
    "tracks": track_columns,
    "regions": region_columns,
    "targets": target_columns,
    "sensors": sensor_columns,
}


def tables(run: Any) -> Mapping[str, Any]:
    """Return the tables of an `opir_core.Run` by name, as `pyarrow.Table`.

    `detections` and `truth` have a row per detection, in the same order; `tracks` one per track and
    tick, `regions` one per track, tick and containment; `targets` and `sensors` those of the scene.
    The metadata of a field are `unit` and `description`, those of a table the manifest.
    """
    return {name: table(run, name) for name in _COLUMNS}


def table(run: Any, name: str) -> Any:
    """Return one of the tables of a run."""
    metadata = {MANIFEST_KEY: json.dumps(run.manifest, separators=(",", ":"))}
    if name == "regions":
        metadata["geo"] = json.dumps(_GEO)
    return table_of(_COLUMNS[name](run), metadata)


#: The metadata of GeoParquet 1.1 (https://geoparquet.org/releases/v1.1.0/); the frame is that of
#: GeoJSON by default.
_GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["Polygon", "MultiPolygon"]}},
}


def to_pandas(run: Any) -> Mapping[str, Any]:
    """Return the tables of a run by name, as data frames; `PluginError` without pandas."""
    _require("pandas", "run.to_pandas()")
    return {name: rows.to_pandas() for name, rows in tables(run).items()}


def to_polars(run: Any) -> Mapping[str, Any]:
    """Return the tables of a run by name, as data frames; `PluginError` without polars."""
    from_arrow = _require("polars", "run.to_polars()").from_arrow
    return {name: from_arrow(rows) for name, rows in tables(run).items()}


def _require(library: str, call: str) -> Any:
    try:
        return import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:
            raise
        remedy = install_command("opir-export", library)
        raise PluginError(f"{call} needs {library}, which is not installed; {remedy}") from error
